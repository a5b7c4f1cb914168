"""A yard with persons who walk, their shadows and a wall, before a camera that stands still."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from aerodft.geometry import camera_pose, inverse, matrix, pixels_from_rays
from aerodft.model import FloatArray, ImageArray, PoseStd
from aerodft.sim import default_camera
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.world import DEFAULT_ORIGIN, Appearance, River, Walker, Wall, World

FPS = 10
EMPTY = 15
"""Images before anybody is there."""

CAMERA = default_camera(960, 540)
STD = PoseStd(height_agl_m=0.02, tilt_rad=2e-3, pan_rad=2e-3, roll_rad=2e-3)
POSE = camera_pose(height_agl_m=5.0, tilt_rad=math.radians(67), roll_rad=math.radians(4), std=STD)
APART = (  # nobody passes before another
    Walker(start_en_m=(-5.0, 10.0), end_en_m=(-1.5, 9.0)),
    Walker(start_en_m=(5.0, 14.0), end_en_m=(1.5, 16.0), speed_mps=1.1),
)
BEHIND = (  # two pass behind the wall, in opposite directions, the third in front of it
    Walker(start_en_m=(-9.0, 14.0), end_en_m=(9.0, 15.0)),
    Walker(start_en_m=(8.0, 17.0), end_en_m=(-8.0, 16.5), speed_mps=1.1),
    Walker(start_en_m=(-2.0, 8.5), end_en_m=(2.0, 9.0), speed_mps=0.9),
)
WALL = Wall(start_en_m=(-2.0, 13.0), end_en_m=(1.0, 13.0))


def pixels_of(points_enu_m: FloatArray) -> FloatArray:
    """Pixels ``(..., 2)`` of points ``(..., 3)``."""
    return pixels_from_rays(CAMERA, (points_enu_m - POSE.position_enu_m) @ matrix(inverse(POSE.wxyz)).T)


def images(
    walkers: tuple[Walker, ...],
    count: int,
    *,
    sun_azimuth_deg: float,
    seed: int,
    walls: tuple[Wall, ...] = (),
    empty_images: int = EMPTY,
) -> Iterator[tuple[float, ImageArray]]:
    """Times (s) and images, the first of them of the empty yard."""
    look = Appearance(sun_azimuth_rad=math.radians(sun_azimuth_deg), sun_elevation_rad=math.radians(30))
    river = River(origin_en_m=(0.0, -300.0))
    empty = World(origin=DEFAULT_ORIGIN, river=river, walls=walls, look=look, seed=seed)
    noise = SensorModel(noise_std=2.0, seed=seed)
    bare, full = Renderer(CAMERA, empty, noise), Renderer(CAMERA, replace(empty, walkers=walkers), noise)
    for k in range(count):
        yield k / FPS, (bare if k < empty_images else full).render(POSE, k / FPS)


def feet_px(walkers: tuple[Walker, ...], time_s: float) -> FloatArray:
    """Where they stand in the image ``(n, 2)``."""
    return pixels_of(np.array([walker.foot_enu_m(time_s) for walker in walkers]))
