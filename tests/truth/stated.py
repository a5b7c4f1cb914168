"""Scenes over everything that a user may state, and what the full nonlinear model makes of the stated errors.

Each answer's interval is held against draws of the inputs through OpenCV's lens, explicit rotations and closed forms
(GUM Supplement 1): none of the engine's own functions, and no first order anywhere.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from aerodft.dft import Request, Setup
from aerodft.geometry import camera_pose
from aerodft.model import Camera, CameraStd, LensModel, PoseSample, PoseStd, Probe, ProbeKind, Status
from tests.one_image import measure

from .scenes import as_pixels, camera_axes

SIZE = np.array([1920.0, 1080.0])
DRAWS = 2000
_EXACT = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 1e-12)


def some(rng, low, high, never=0.25):
    """A standard deviation from 0 to large."""
    return 0.0 if rng.random() < never else math.exp(rng.uniform(math.log(low), math.log(high)))


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What a user states of one image: camera, angles (rad), height (m), and how well each is known."""

    camera: Camera
    tilt_rad: float
    roll_rad: float
    heading_rad: float
    height_m: float
    std: PoseStd
    std_px: float
    elevation_m: float
    elevation_std_m: float

    @staticmethod
    def drawn(rng):
        """Anything."""
        focal = rng.uniform(700, 2600)
        lens = rng.choice(["straight", "brown", "fisheye"], p=[0.4, 0.4, 0.2])
        bent = {"straight": (), "brown": (-0.08, 0.02, 5e-4, -3e-4, 0.0), "fisheye": (0.02, -0.004, 0.001, 0.0)}[lens]
        camera = Camera(
            name=str(lens), width_px=1920, height_px=1080, fx_px=focal, fy_px=focal * rng.uniform(0.98, 1.02),
            cx_px=960 + rng.uniform(-30, 30), cy_px=540 + rng.uniform(-30, 30), distortion=bent,
            lens=LensModel.FISHEYE if lens == "fisheye" else LensModel.BROWN,
            std=CameraStd(focal_px=some(rng, 0.3, 0.02 * focal, 0.5), principal_point_px=some(rng, 0.3, 8, 0.5)),
        )  # fmt: skip
        height, rad = math.exp(rng.uniform(math.log(0.5), math.log(500))), math.radians
        std = PoseStd(
            height_agl_m=height * some(rng, 0.001, 0.1),
            horizontal_m=some(rng, 0.1, 10.0),
            tilt_rad=rad(some(rng, 0.03, 5.0)),
            pan_rad=rad(some(rng, 0.03, 2.0)),
            roll_rad=rad(some(rng, 0.03, 5.0)),
            heading_rad=rad(some(rng, 0.3, 180.0)),
        )
        return Stated(
            camera=camera, std=std, height_m=height,
            tilt_rad=rad(rng.choice([0.0, rng.uniform(0, 10), rng.uniform(0, 89)], p=[0.1, 0.2, 0.7])),
            roll_rad=rad(rng.choice([0.0, rng.uniform(-30, 30)])), heading_rad=rng.uniform(0, 2 * math.pi),
            std_px=math.exp(rng.uniform(math.log(0.1), math.log(4.0))),
            elevation_m=rng.choice([0.0, rng.uniform(-0.2, 0.4) * height]),
            elevation_std_m=height * some(rng, 0.001, 0.05, 0.6),
        )  # fmt: skip

    @property
    def sample(self):
        pose = camera_pose(
            height_agl_m=self.height_m, tilt_rad=self.tilt_rad, roll_rad=self.roll_rad, heading_rad=self.heading_rad,
            std=self.std,
        )  # fmt: skip
        return PoseSample(stamp_ns=0, status=Status.OK, pose=pose, std=self.std)

    def request(self, kind, pixels_px):
        pixels = as_pixels(pixels_px)
        probe = Probe(
            name=kind, kind=kind, pixels=pixels, elevation_m=self.elevation_m, elevation_std_m=self.elevation_std_m
        )
        return Request(probe=probe, pixels=pixels, std_px=self.std_px)

    def answers_at(self, probes, heights):
        """What the engine answers to probes with elevations and standard deviations ``(e,)`` of their own, each."""
        requests = [self.request(*probe) for probe in probes]
        own = [{"elevation_m": tuple(each), "elevation_std_m": tuple(std)} for each, std in heights]
        requests = [replace(each, probe=replace(each.probe, **keys)) for each, keys in zip(requests, own, strict=True)]
        return measure(Setup(camera=self.camera), self.sample, tuple(requests))

    def answers(self, probes):
        """What the engine answers to probes, ``(kind, pixels)`` each."""
        requests = tuple(self.request(*probe) for probe in probes)
        return measure(Setup(camera=self.camera), self.sample, requests)

    def exact(self):
        """All of it without errors."""
        camera = replace(self.camera, std=CameraStd())
        return replace(self, camera=camera, std=PoseStd(), std_px=1e-9, elevation_std_m=0.0)

    def world(self, rng, count):
        """Cameras, rotations, planes and intrinsics that are off as stated."""
        std, normal = self.std, rng.standard_normal((11, count))
        lean = np.stack([std.tilt_rad * normal[0], std.pan_rad * normal[1], std.roll_rad * normal[2]], axis=-1)
        turn = Rotation.from_rotvec(std.heading_rad * normal[3][:, None] * [0.0, 0.0, 1.0])
        axes = Rotation.from_matrix(camera_axes(self.tilt_rad, self.roll_rad, self.heading_rad))
        off_m = np.array([std.horizontal_m, std.horizontal_m, std.height_agl_m]) * normal[4:7].T
        position, camera = off_m + np.array([0.0, 0.0, self.height_m]), self.camera
        focal = 1 + camera.std.focal_px / camera.fx_px * normal[8]
        centre = np.array([camera.cx_px, camera.cy_px]) + camera.std.principal_point_px * normal[9:11].T
        return World(
            camera=camera, position_m=position, axes=(turn * axes * Rotation.from_rotvec(lean)).as_matrix(),
            plane_m=self.elevation_m + self.elevation_std_m * normal[7], focal=focal, centre_px=centre,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class World:
    """``n`` draws of what was stated; planes ``(n,)``, or ``(n, q)`` one for each pixel."""

    camera: Camera
    position_m: np.ndarray
    axes: np.ndarray
    plane_m: np.ndarray
    focal: np.ndarray
    centre_px: np.ndarray

    def see(self, pixels_px):
        """Directions and points ``(n, q, 3)`` of pixels ``(n, q, 2)``; NaN where a ray misses."""
        f = np.array([self.camera.fx_px, self.camera.fy_px]) * self.focal[:, None]
        bent = np.ascontiguousarray((pixels_px - self.centre_px[:, None]) / f[:, None]).reshape(-1, 1, 2)
        coefficients, one = np.array(self.camera.distortion or (0.0,) * 4), np.eye(3)
        if self.camera.lens is LensModel.FISHEYE:
            radius = np.linalg.norm(bent, axis=-1)
            angle = radius.copy()
            for _ in range(20):
                powers = angle[..., None] ** np.array([2, 4, 6, 8])
                angle -= (angle * (1 + powers @ coefficients) - radius) / (1 + powers @ (coefficients * [3, 5, 7, 9]))
            scale = np.where(radius > 0, np.sin(angle) / np.where(radius > 0, radius, 1), 1.0)
            rays = np.concatenate([bent[:, 0] * scale, np.cos(angle)], axis=-1)
        else:
            straight = cv2.undistortPoints(bent, one, coefficients, criteria=_EXACT) if np.any(coefficients) else bent
            rays = np.concatenate([straight[:, 0], np.ones((len(straight), 1))], axis=-1)
        away = np.einsum("nij,nqj->nqi", self.axes, rays.reshape(*pixels_px.shape[:2], 3))
        drop = self.plane_m.reshape(len(self.plane_m), -1) - self.position_m[:, 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where((away[..., 2] < 0) & (drop < 0), drop / away[..., 2], np.nan)
        return away, self.position_m[:, None] + reach[..., None] * away

    def values(self, kind, pixels_px):  # noqa: PLR0911 - a line each
        """What a probe comes to in every draw ``(n,)``, east and north of a position ``(n, 2)``."""
        away, points = self.see(pixels_px)
        x, y = points[..., 0], points[..., 1]
        if kind == ProbeKind.POSITION:
            return points[:, 0, :2]
        if kind == ProbeKind.RANGE:
            return np.linalg.norm(points[:, 0] - self.position_m, axis=-1)
        if kind in (ProbeKind.DISTANCE, ProbeKind.WIDTH, ProbeKind.LENGTH):
            return np.sum(np.hypot(np.diff(x), np.diff(y)), axis=-1)
        if kind == ProbeKind.RIVER:
            return np.median(np.hypot(x[:, 1::2] - x[:, ::2], y[:, 1::2] - y[:, ::2]), axis=-1)
        if kind == ProbeKind.AREA:
            return np.abs(np.sum(x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1), axis=-1)) / 2
        if kind == ProbeKind.BEARING:
            east_north = away[:, 0, :2] if x.shape[1] == 1 else points[:, 1, :2] - points[:, 0, :2]
            return np.degrees(np.arctan2(east_north[:, 0], east_north[:, 1]))
        base, top = points[:, 0], away[:, 1]
        foot = base[:, :2] - self.position_m[:, :2]
        reach = np.sum(foot * top[:, :2], axis=-1) / np.sum(np.square(top[:, :2]), axis=-1)
        return np.where(reach > 0, self.position_m[:, 2] + reach * top[:, 2] - base[:, 2], np.nan)


def content(answer, values):
    """The share of draws that an answer's interval, or ellipse, holds."""
    if answer.kind == ProbeKind.POSITION:
        ellipse = answer.ellipse95
        sin, cos = math.sin(ellipse.azimuth_rad), math.cos(ellipse.azimuth_rad)
        along, across = np.array([[sin, cos], [cos, -sin]]) @ (values - answer.enu_m[0][:2]).T
        major_m, minor_m = np.array([ellipse.semi_major_m, ellipse.semi_minor_m]) + 1e-9 + 1e-6 * ellipse.semi_major_m
        return np.mean((along / major_m) ** 2 + (across / minor_m) ** 2 <= 1)
    low, high = answer.ci95
    tiny = 1e-9 * max(abs(answer.value), 1.0)
    if answer.kind == ProbeKind.BEARING:
        return np.mean((values - low + tiny) % 360 <= high - low + 2 * tiny)
    return np.mean((values >= low - tiny) & (values <= high + tiny))


def random_probes(rng):
    """One of each kind somewhere in the image, with 2 to 200 pixels where a kind takes many."""

    def anywhere():
        return rng.uniform([20, 20], SIZE - 20)

    def beside(pixel):
        turn, apart = rng.uniform(0, 2 * math.pi), math.exp(rng.uniform(math.log(2), math.log(600)))
        return np.clip(pixel + apart * np.array([math.cos(turn), math.sin(turn)]), 10, SIZE - 10)

    first = anywhere()
    two = np.stack([first, beside(first)])
    corners = rng.choice([3, 4, 8, 40, 200], p=[0.3, 0.3, 0.2, 0.15, 0.05])
    around = 2 * math.pi * np.arange(corners) / corners + rng.uniform(0, 6)
    radius_px = math.exp(rng.uniform(math.log(15), math.log(300)))
    polygon = rng.uniform([320, 320], SIZE - 320) + radius_px * np.stack([np.cos(around), np.sin(around)], axis=-1)
    banks = np.sort(rng.uniform([100, 100], SIZE - 100, (2 * rng.integers(1, 12), 2)), axis=0)
    return [
        (ProbeKind.RANGE, anywhere()[None]),
        (ProbeKind.POSITION, anywhere()[None]),
        (ProbeKind.DISTANCE, two),
        (ProbeKind.WIDTH, np.stack([anywhere(), anywhere()])),
        (ProbeKind.LENGTH, two[::-1]),
        (ProbeKind.AREA, polygon),
        (ProbeKind.HEIGHT, np.stack([first, np.clip(first - [rng.uniform(-5, 5), rng.uniform(5, 300)], 5, None)])),
        (ProbeKind.BEARING, anywhere()[None]),
        (ProbeKind.BEARING, two),
        (ProbeKind.RIVER, banks),
    ]
