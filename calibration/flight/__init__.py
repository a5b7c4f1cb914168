"""Calibration of a flight's telemetry biases from landmarks in many images."""

from calibration.flight.biases import (
    BiasCalibrator,
    BiasedPoses,
    BiasModel,
    propagate_covariance,
    stds_of,
    with_lat_lon,
)
from calibration.flight.result import ImagesResult, calibrate_images
from calibration.flight.state import ImageView, PoseTrack, split_stds, typical_noise
