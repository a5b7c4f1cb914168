"""The camera at one stamp: zoomed as its pose says, the file's where it says nothing."""

from dataclasses import replace

import numpy as np

from aerodft.dft.request import Setup
from aerodft.model.pose import PoseSample


def zoomed(setup: Setup, sample: PoseSample) -> tuple[Setup, PoseSample]:
    """A setup with the camera as it was at a sample's stamp, and the sample.

    Where pose and lens were calibrated together, the covariance of their errors is in pixels of the file's focal
    lengths: it is turned into pixels of the zoomed ones.
    """
    zoom, pose = sample.zoom, sample.pose
    if zoom is None:
        return setup, sample
    setup = replace(setup, camera=setup.camera.zoomed(zoom.magnification, zoom.std))
    if pose is None or not pose.lens_cov.size:
        return setup, sample
    scales = np.ones(pose.lens_cov.shape[1])
    scales[:2] = zoom.magnification
    return setup, replace(sample, pose=replace(pose, lens_cov=pose.lens_cov * scales))
