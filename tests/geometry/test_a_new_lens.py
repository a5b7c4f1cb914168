"""A lens that nobody here has heard of, a fisheye of equal areas, which states how it distorts and nothing else."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import aerodft
from aerodft.adapters.recording.write.records import camera_calibration
from aerodft.dft.maps import GroundMap
from aerodft.geometry import LENS_MODELS, Distorted, Lens, camera_pose
from aerodft.model import CameraStd, LensModel
from replay.foreign.messages import read_camera
from tests.replay.test_foreign_messages import channel

EQUAL_AREAS = LensModel("equal-areas", "k1", (0, 1))
"""Radius 2 sin(angle / 2) (1 + k1 angle^2)."""


class EqualAreas(Lens):
    def distort(self, coefficients, rays_cam):
        (k1,), flat = coefficients, np.linalg.norm(rays_cam[..., :2], axis=-1)
        angle = np.arctan2(flat, rays_cam[..., 2])
        radius = 2 * np.sin(angle / 2) * (1 + k1 * angle**2)
        slope = np.cos(angle / 2) * (1 + k1 * angle**2) + 4 * k1 * angle * np.sin(angle / 2)
        outward = rays_cam[..., :2] / np.where(flat > 0, flat, 1.0)[..., None]
        square = np.sum(np.square(rays_cam), axis=-1)
        by_angle = np.concatenate([outward * rays_cam[..., 2:], -flat[..., None]], axis=-1) / square[..., None]
        across = np.eye(2) - outward[..., :, None] * outward[..., None, :]
        jac = outward[..., :, None] * (slope[..., None] * by_angle)[..., None, :]
        jac[..., :2] += across * np.where(flat > 0, radius / np.where(flat > 0, flat, 1.0), 1.0)[..., None, None]
        return Distorted(radius[..., None] * outward, jac, slope > 0)

    def undistort(self, coefficients, points):
        radius = np.linalg.norm(points, axis=-1)
        angle = radius.copy()
        for _ in range(30):
            value = 2 * np.sin(angle / 2) * (1 + coefficients[0] * angle**2)
            slope = np.cos(angle / 2) * (1 + coefficients[0] * angle**2)
            angle = angle - (value - radius) / (slope + 4 * coefficients[0] * angle * np.sin(angle / 2))
        outward = points / np.where(radius > 0, radius, 1.0)[..., None]
        rays = np.concatenate([outward * np.sin(angle)[..., None], np.cos(angle)[..., None]], axis=-1)
        return rays, np.linalg.pinv(self.distort(coefficients, rays).jac_ray)

    def by_coefficients(self, coefficients, rays_cam):  # noqa: ARG002
        flat = np.linalg.norm(rays_cam[..., :2], axis=-1)
        angle = np.arctan2(flat, rays_cam[..., 2])
        return ((2 * np.sin(angle / 2) * angle**2 / flat)[..., None] * rays_cam[..., :2])[..., None]


@pytest.fixture(autouse=True)
def equal_areas(monkeypatch):
    entry = EqualAreas(model=EQUAL_AREAS, ideal="a fisheye of equal areas", wire_names=(("equal-areas", 1),))
    monkeypatch.setitem(LENS_MODELS, EQUAL_AREAS, entry)


@pytest.fixture
def camera(tmp_path):
    text = 'name = "wide"\nwidth_px = 2000\nheight_px = 1500\nfx_px = 800\nfy_px = 800\ncx_px = 999.5\ncy_px = 749.5\n'
    (tmp_path / "wide.toml").write_text(f'{text}lens = "equal-areas"\ndistortion = [0.02]\ndistortion_std = [0.001]\n')
    return aerodft.load_camera(tmp_path / "wide.toml")


def pixel_at(angle_rad):
    radius = 2 * math.sin(abs(angle_rad) / 2) * (1 + 0.02 * angle_rad**2)
    return 999.5 + 800 * math.copysign(radius, angle_rad), 749.5


def test_its_camera_file_measures_a_width_straight_below(camera):
    pose = aerodft.CameraPose(height_m=20.0, tilt_deg=0.0)
    found = aerodft.measure(camera, pose, aerodft.Width([pixel_at(-0.9), pixel_at(0.3)], std_px=0.0))
    assert_allclose(found.value, 20.0 * (math.tan(0.9) + math.tan(0.3)), rtol=1e-9)
    widths = [
        aerodft.measure(replace(camera, distortion=(k1,)), pose, aerodft.Width([pixel_at(-0.9), pixel_at(0.3)])).value
        for k1 in (0.0201, 0.0199)
    ]
    by_k1_m = 0.001 * (widths[1] - widths[0]) / 2e-4
    exact = aerodft.measure(replace(camera, std=CameraStd()), pose, aerodft.Width([pixel_at(-0.9), pixel_at(0.3)]))
    noisy = aerodft.measure(camera, pose, aerodft.Width([pixel_at(-0.9), pixel_at(0.3)]))
    assert_allclose(noisy.std, math.hypot(exact.std, by_k1_m), rtol=0.01)


def test_maps_and_messages_know_it(camera):
    below = GroundMap.at(camera, camera_pose(height_agl_m=20.0, tilt_rad=0.0)).points_enu_m(np.array([pixel_at(0.7)]))
    assert_allclose(np.hypot(*below[0, :2]), 20.0 * math.tan(0.7), rtol=1e-9)
    again = read_camera(channel("protobuf", "foxglove.CameraCalibration"), camera_calibration(camera, 0))
    assert (again.lens, again.distortion) == (camera.lens, camera.distortion)
