"""A minute of flight that circles over a river, climbs, and zooms in and out; and telemetry with its errors."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import from_rotation_vector, matrix, multiply, pixels_from_rays
from aerodft.model import Camera, FloatArray, ImageArray, Pose, PoseSample, Status, Zoom, ZoomSource
from aerodft.sim import Waypoint, default_camera, fly
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.trajectory import Trajectory, survey
from aerodft.sim.world import DEFAULT_ORIGIN, River, World, furnished_world

SECONDS = 60.0
FPS = 5.0
CAMERA = default_camera(640, 360)
_CENTRE_EN_M = (0.0, -15.0)
_RADIUS_M = 30.0
_WORLD = furnished_world(River(origin_en_m=(0.0, -25.0)))


@dataclass(frozen=True)
class Seen:
    """One image, what it truly was taken with, and what telemetry says."""

    time_s: float
    pixels: ImageArray
    camera: Camera
    pose: Pose
    said: PoseSample

    def pixels_of(self, points_enu_m: FloatArray) -> FloatArray:
        """True pixels ``(..., 2)``."""
        return pixels_from_rays(self.camera, (points_enu_m - self.pose.position_enu_m) @ matrix(self.pose.wxyz))


def flight(camera: Camera = CAMERA, between_s: tuple[float, float] = (0.0, SECONDS)) -> Iterator[Seen]:
    """All images of a camera, or those of some time."""
    trajectory = fly(_waypoints(), origin=DEFAULT_ORIGIN)
    yield from _seen(camera, _WORLD, trajectory, between_s, zooming=True)


def back_over_the_river(between_s: tuple[float, float], *, width_m: float = 22.0) -> Iterator[Seen]:
    """The simulator's survey, which at 40 to 54 s turns and comes back looking straight down at the water."""
    river = River(origin_en_m=(0.0, -26.0), width_m=width_m)
    trajectory = survey(river, origin=DEFAULT_ORIGIN, duration_s=SECONDS)
    yield from _seen(CAMERA, furnished_world(river), trajectory, between_s)


def over_nothing_but_water(seconds: float) -> Iterator[Seen]:
    """A drone over the middle of a river whose banks are out of view; its water flows by 0.8 m/s."""
    there = Waypoint(time_s=0.0, east_m=0.0, north_m=0.0, height_m=40.0, heading_rad=0.3, gimbal_pitch_rad=-math.pi / 2)
    trajectory = fly((there, replace(there, time_s=seconds, east_m=2.0 * seconds)), origin=DEFAULT_ORIGIN)
    world = World(origin=DEFAULT_ORIGIN, river=River(width_m=200.0))
    yield from _seen(CAMERA, world, trajectory, (0.0, seconds))


def _seen(
    lens: Camera, world: World, trajectory: Trajectory, between_s: tuple[float, float], *, zooming: bool = False
) -> Iterator[Seen]:
    last: tuple[float, Camera, Renderer] | None = None
    draws = np.random.default_rng(7)
    for k in range(round(between_s[0] * FPS), round(between_s[1] * FPS)):
        time_s = k / FPS
        zoom = round(_zoom(time_s), 2) if zooming else 1.0
        if last is None or last[0] != zoom:
            camera = replace(lens, fx_px=lens.fx_px * zoom, fy_px=lens.fy_px * zoom)
            last = zoom, camera, Renderer(camera, world, SensorModel(noise_std=2.0))
        pose = trajectory.pose(trajectory.start_ns + round(time_s * SECOND_NS))
        said = _said(pose, time_s, zoom, draws)
        yield Seen(time_s, last[2].render(pose, time_s), last[1], pose, said)


def _waypoints() -> tuple[Waypoint, ...]:
    angles = np.linspace(0.0, 2 * np.pi, 13)
    headings = np.unwrap(np.arctan2(-np.sin(angles), np.cos(angles)))
    return tuple(
        Waypoint(
            time_s=SECONDS * k / 12,
            east_m=_CENTRE_EN_M[0] + _RADIUS_M * math.sin(angle),
            north_m=_CENTRE_EN_M[1] - _RADIUS_M * math.cos(angle),
            height_m=35.0 + 25.0 * k / 12,
            heading_rad=float(heading),
            gimbal_pitch_rad=-math.atan2(35.0 + 25.0 * k / 12, _RADIUS_M),
        )
        for k, (angle, heading) in enumerate(zip(angles.tolist(), headings.tolist(), strict=True))
    )


def _zoom(time_s: float) -> float:
    return float(np.interp(time_s, [25.0, 35.0, 45.0, 55.0], [1.0, 1.5, 1.5, 1.0]))


def _said(pose: Pose, time_s: float, zoom: float, draws: np.random.Generator) -> PoseSample:
    """Half a degree and half a metre off, slowly changing, and a little noise."""
    turn = np.radians([0.5 * math.sin(time_s / 7), 0.5 * math.cos(time_s / 5), 0.3]) + draws.normal(0, 5e-4, 3)
    move = np.array([0.5 * math.sin(time_s / 9), 0.4 * math.cos(time_s / 11), 0.8])
    off = replace(pose, position_enu_m=pose.position_enu_m + move, wxyz=multiply(pose.wxyz, from_rotation_vector(turn)))
    return PoseSample(
        stamp_ns=round(time_s * SECOND_NS),
        status=Status.OK,
        pose=off,
        zoom=Zoom(magnification=zoom, std=0.0, source=ZoomSource.CAMERA_FOV_STATUS),
    )
