"""A camera above a field of landmarks, with its own projection (no code of the product), as files."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .conftest import run_aerodft

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 1920, 1080, 1500.0
CENTRE_PX = np.array([959.5, 539.5])
TILT_DEG, ROLL_DEG, HEADING_DEG = 60.0, 1.0, 40.0
EYE_M = np.array([3.0, -5.0, 12.0])
STD_PX = 0.5
POSE = "position,height,tilt,roll,heading"
CAMERA = f"""
name = "field"
width_px = {WIDTH_PX}
height_px = {HEIGHT_PX}
fx_px = {FOCAL_PX}
fy_px = {FOCAL_PX}
cx_px = {CENTRE_PX[0]}
cy_px = {CENTRE_PX[1]}
"""
RD_M = np.array([155_000.0, 463_000.0, 10.0])
"""Where the scene is on the Dutch national grid, where that is asked for."""


def axes_of(tilt_deg, roll_deg, heading_deg):
    """Camera axes right, down, ahead as rows in east, north, up."""
    tilt, roll, heading = map(math.radians, (tilt_deg, roll_deg, heading_deg))
    ahead = np.array([math.sin(tilt) * math.sin(heading), math.sin(tilt) * math.cos(heading), -math.cos(tilt)])
    right = np.array([math.cos(heading), -math.sin(heading), 0.0])
    down = np.cross(ahead, right)
    cos, sin = math.cos(roll), math.sin(roll)
    return np.stack([cos * right + sin * down, cos * down - sin * right, ahead])


AXES = axes_of(TILT_DEG, ROLL_DEG, HEADING_DEG)


def pixels_of(places_m):
    in_camera = (np.asarray(places_m) - EYE_M) @ AXES.T
    return CENTRE_PX + FOCAL_PX * in_camera[:, :2] / in_camera[:, 2:]


@dataclass(frozen=True)
class Field:
    """Landmarks: pixels with noise, and places in metres."""

    pixels: np.ndarray
    places: np.ndarray

    @classmethod
    def of(cls, count=9, seed=1):
        rng = np.random.default_rng(seed)
        seen = rng.uniform([100, 150], [1820, 1000], (count, 2))
        rays = np.column_stack([(seen - CENTRE_PX) / FOCAL_PX, np.ones(count)]) @ AXES
        up_m = rng.uniform(0.0, 0.5, count)
        places = EYE_M + rays * ((up_m - EYE_M[2]) / rays[:, 2])[:, None]
        return cls(pixels_of(places) + rng.normal(0.0, STD_PX, (count, 2)), places)


def landmarks(pixels, places, *, names=None, in_degrees=False):
    """``[[landmark]]`` tables."""
    tables = []
    for index, (pixel, place) in enumerate(zip(np.asarray(pixels), np.asarray(places), strict=True)):
        first, second, third = (f"{value:.11g}" for value in place)
        where = (
            f"lat_deg = {first}\nlon_deg = {second}\nalt_m = {third}"
            if in_degrees
            else f"position_m = [{first}, {second}, {third}]"
        )
        name = names[index] if names else f"p{index + 1}"
        tables.append(
            f'[[landmark]]\nname = "{name}"\npixel = [{pixel[0]:.2f}, {pixel[1]:.2f}]\n{where}\nstd_px = {STD_PX}\n'
        )
    return "".join(tables)


def calibrate(folder: Path, text, *more, unknowns=POSE, suffix=".toml"):
    """Run ``aerodft calibrate`` on evidence, with an output; both returned."""
    (folder / "camera.toml").write_text(CAMERA)
    evidence = folder / f"evidence{suffix}"
    evidence.write_bytes(text if isinstance(text, bytes) else text.encode())
    output = folder / "calibration.toml"
    given = ("--camera", folder / "camera.toml", "--unknowns", unknowns, "-o", output)
    return run_aerodft("calibrate", evidence, *given, *more), output
