"""Rivers seen by a simulated camera that looks at them, how wide they truly are, and poses that are off as stated."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aerodft.dft import Setup
from aerodft.geometry import camera_pose, from_rotation_vector, multiply, pose_covariance
from aerodft.model import Pose, PoseStd
from aerodft.sim import default_camera
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.world import Appearance, Island, River, World, furnished_world
from aerodft.vision.river import RiverQuestion, WaterPlane
from aerodft.vision.river.centreline import centreline
from aerodft.vision.river.find import oriented, river_across

SHAPES: dict[str, dict[str, Any]] = {
    "straight": {"meander_m": 0.0, "width_swing_m": 0.0},
    "curved": {"meander_m": 8.0, "meander_wavelength_m": 140.0},
    "braided": {
        "islands": (
            Island(station_m=8.0, length_m=30.0, width_m=6.0),
            Island(station_m=60.0, length_m=30.0, width_m=7.0),
        )
    },
}
TILTS_DEG = (0, 20, 40, 55, 65)
POSE_STD = PoseStd(height_agl_m=0.4, tilt_rad=0.004, pan_rad=0.004, roll_rad=0.004)


@dataclass(frozen=True)
class Scene:
    """A river, the camera's true pose, and a pixel in the water."""

    world: World
    pose: Pose
    height_m: float
    tilt_deg: float
    roll_deg: float
    heading_deg: float


def river_scene(shape, tilt_deg, seed, *, height_m=40.0, look=None):
    """A camera about 40 m above the river, that looks along it within 20 degrees and at its middle."""
    random = np.random.default_rng([seed, tilt_deg])
    river = River(azimuth_rad=random.uniform(0, 2 * math.pi), **SHAPES[shape])
    world = furnished_world(river, seed=seed, look=look or Appearance())
    height = height_m * random.uniform(0.8, 1.2)
    tilt, roll = tilt_deg + random.uniform(-1, 1) * min(1.0, tilt_deg), random.uniform(-3, 3)
    aside = math.radians(random.uniform(-20, 20))
    # What lies 3/4 down the image shall be water, between the islands: there the camera looks without a seed.
    near_m = height * math.tan(math.radians(tilt) - math.atan(0.25 * 1080 / 1598))
    station = random.uniform(-38, -16)
    target = river.enu(station, river.centre_m(station) + random.uniform(-3, 3))
    heading = river.azimuth_rad + aside
    east, north = target[:2] - near_m * np.array([math.sin(heading), math.cos(heading)])
    pose = camera_pose(
        height_agl_m=height, tilt_rad=math.radians(tilt), roll_rad=math.radians(roll), heading_rad=heading,
        east_m=float(east), north_m=float(north),
    )  # fmt: skip
    return Scene(world, pose, height, tilt, roll, math.degrees(heading) % 360)


def picture(scene, *, width_px=1920, height_px=1080, noise_std=2.0, seed=1):
    """The camera, and the image that it takes."""
    camera = default_camera(width_px, height_px)
    return camera, Renderer(camera, scene.world, SensorModel(noise_std=noise_std, seed=seed)).render(scene.pose, 3.0)


def true_crossing(river, centres_en_m, to_left):
    """Offsets ``(n, 2)`` of left and right bank along lines through the water; NaN where their centre is on land."""
    offsets = np.linspace(-40.0, 40.0, 8001)
    found = np.full((len(centres_en_m), 2), np.nan)
    for row, (centre, unit) in enumerate(zip(centres_en_m, to_left, strict=True)):
        along, across = river.along_across(centre + offsets[:, None] * unit)
        left, right = river.banks_m(along)
        outside = np.flatnonzero((across > left) | (across < right))
        above, below = outside[offsets[outside] > 0], outside[offsets[outside] < 0]
        if len(above) and len(below) and not np.any(offsets[outside] == 0):
            gap = np.minimum(left - across, across - right)  # linear over a step: where it is 0, the bank is
            found[row] = [
                np.interp(0.0, gap[[dry, wet]], offsets[[dry, wet]])
                for dry, wet in ((above[0], above[0] - 1), (below[-1], below[-1] + 1))
            ]
    return found


def wrongly_posed(pose, seed):
    """The pose as telemetry with errors of ``POSE_STD`` might tell it."""
    cov = pose_covariance(pose.wxyz, POSE_STD.values)
    error = np.random.default_rng(seed).multivariate_normal(np.zeros(6), cov)
    turned = multiply(pose.wxyz, from_rotation_vector(error[3:]))
    return replace(pose, position_enu_m=pose.position_enu_m + error[:3], wxyz=turned, cov=cov)


def seen_again(image, camera, pose, found):
    """The river measured with another pose, from its centreline on: what is water in an image no pose decides."""
    plane = WaterPlane(camera, pose)
    line = centreline(plane, found.copy, found.water)
    assert line is not None
    told = RiverQuestion(spacing_m=6.0)
    return river_across(image, Setup(camera=camera), pose, told, found, oriented(plane, line, None))
