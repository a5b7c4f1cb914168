"""Persons who walk about below a drone that hovers in the wind, or flies on slowly; and telemetry with its errors."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import from_rotation_vector, matrix, multiply, pixels_from_rays
from aerodft.model import FloatArray, ImageArray, Pose, PoseSample, PoseStd, Status
from aerodft.sim import Waypoint, default_camera, fly
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.trajectory import Trajectory
from aerodft.sim.world import DEFAULT_ORIGIN, Appearance, Post, River, Walker, Wall, World

FPS = 10
CAMERA = default_camera(960, 540)
HEIGHT_M = 12.0
STD = PoseStd(height_agl_m=0.15, horizontal_m=0.15, tilt_rad=7e-3, pan_rad=7e-3, roll_rad=7e-3, heading_rad=7e-3)
WALKERS = (
    Walker(start_en_m=(-6.0, 9.0), end_en_m=(7.0, 11.0)),
    Walker(start_en_m=(6.0, 14.0), end_en_m=(-7.0, 13.0), speed_mps=1.1),
    Walker(start_en_m=(-2.0, 17.0), end_en_m=(3.0, 7.0), speed_mps=0.9),
)
WALL = Wall(start_en_m=(-2.5, 12.0), end_en_m=(1.0, 12.2))


@dataclass(frozen=True)
class Seen:
    """One image, what it was taken from, and what telemetry says."""

    time_s: float
    pixels: ImageArray
    pose: Pose
    said: PoseSample

    def pixels_of(self, points_enu_m: FloatArray) -> FloatArray:
        """True pixels ``(..., 2)``."""
        return pixels_from_rays(CAMERA, (points_enu_m - self.pose.position_enu_m) @ matrix(self.pose.wxyz))


def hovering(seconds: float) -> Trajectory:
    """Half a metre to and fro, 6 degrees of yaw, some rise and fall."""
    return _flown([
        (t, 0.5 * math.sin(t / 1.7), 0.4 * math.sin(t / 2.3 + 1), HEIGHT_M + 0.3 * math.sin(t / 3), 6 * math.sin(t / 4))
        for t in np.arange(0.0, seconds + 1.01, 1.0).tolist()
    ])  # fmt: skip


def passing(seconds: float, speed_mps: float = 0.8) -> Trajectory:
    """To the right, looking ahead."""
    return _flown([(t, -3.0 + speed_mps * t, 0.0, HEIGHT_M, 0.0) for t in np.arange(0.0, seconds + 1.01, 1.0).tolist()])


def _flown(steps: list[tuple[float, float, float, float, float]]) -> Trajectory:
    points = tuple(
        Waypoint(
            time_s=time_s,
            east_m=east,
            north_m=north,
            height_m=height,
            heading_rad=math.radians(heading),
            gimbal_pitch_rad=math.radians(-42.0),
        )
        for time_s, east, north, height, heading in steps
    )
    return fly(points, origin=DEFAULT_ORIGIN)


def images(
    trajectory: Trajectory,
    seconds: float,
    *,
    walkers: tuple[Walker, ...] = WALKERS,
    walls: tuple[Wall, ...] = (),
    posts: tuple[Post, ...] = (),
    seed: int = 1,
) -> Iterator[Seen]:
    """All images; somebody is there from the first on."""
    look = Appearance(sun_azimuth_rad=math.radians(60.0 * seed), sun_elevation_rad=math.radians(35))
    world = World(
        origin=DEFAULT_ORIGIN,
        river=River(origin_en_m=(0.0, -300.0)),
        walkers=walkers,
        walls=walls,
        posts=posts,
        look=look,
        seed=seed,
    )
    renderer, draws = Renderer(CAMERA, world, SensorModel(noise_std=2.0, seed=seed)), np.random.default_rng(seed)
    bias = draws.normal(0, 1, 6) * [0.1, 0.1, 0.1, 4e-3, 4e-3, 4e-3]
    for k in range(round(seconds * FPS)):
        time_s = k / FPS
        pose = trajectory.pose(trajectory.start_ns + round(time_s * SECOND_NS))
        off = bias + draws.normal(0, 1, 6) * [0.02, 0.02, 0.02, 5e-4, 5e-4, 5e-4]
        said = replace(
            pose,
            position_enu_m=pose.position_enu_m + off[:3],
            wxyz=multiply(pose.wxyz, from_rotation_vector(off[3:])),
            cov=np.diag(np.square([0.15, 0.15, 0.15, 7e-3, 7e-3, 7e-3])),
        )
        sample = PoseSample(stamp_ns=round(time_s * SECOND_NS), status=Status.OK, pose=said, std=STD)
        yield Seen(time_s, renderer.render(pose, time_s), pose, sample)
