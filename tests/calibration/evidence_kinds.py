"""Every kind of evidence in random scenes, seen through every kind of lens, and steps of everything it depends on."""

import math
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np

from aerodft.geometry import from_rotation_vector, multiply
from aerodft.model import KnownLength, Landmark, LensModel, SlantRange
from calibration.pose.residuals import ConditionResidual, Distances
from calibration.pose.residuals import condition_of as condition_alone
from tests.truth.calibration_scenes import ImpossibleError, World

KINDS: dict[str, tuple[Any, tuple[float, float]]] = {
    "landmark": (World.landmark, (0.0, 70.0)),
    "landmark of unknown east": (partial(World.landmark, unknown=0), (0.0, 70.0)),
    "landmark of unknown north": (partial(World.landmark, unknown=1), (0.0, 70.0)),
    "landmark of unknown height": (partial(World.landmark, unknown=2), (20.0, 70.0)),
    "range": (World.range_, (0.0, 70.0)),
    "ground": (World.ground, (5.0, 70.0)),
    "length": (World.length, (0.0, 70.0)),
    "height": (World.height, (35.0, 70.0)),
    "vertical": (World.vertical, (35.0, 70.0)),
    "parallel": (partial(World.lines, at_right_angle=False), (10.0, 70.0)),
    "right angle": (partial(World.lines, at_right_angle=True), (10.0, 70.0)),
    "horizon": (World.horizon, (72.0, 82.0)),
    "sea horizon": (partial(World.horizon, is_sea=True), (72.0, 82.0)),
}
"""Makers, and the tilts, in degrees, at which there is something to see."""

LENSES = {
    "straight": (LensModel.BROWN, ()),
    "brown": (LensModel.BROWN, (-0.12, 0.03, 1e-3, -8e-4)),
    "brown with k3": (LensModel.BROWN, (-0.2, 0.05, -1e-3, 5e-4, -0.01)),
    "rational": (LensModel.BROWN, (0.3, 0.05, 4e-4, -6e-4, 0.01, 0.45, 0.1, 0.02)),
    "fisheye": (LensModel.FISHEYE, (-0.02, 0.01, -3e-3, 5e-4)),
}

_PIXELS = ("pixel", "pixels", "base", "top", "first", "second")
_SIZES = ("position_m", "range_m", "xy_m", "length_m", "height_m")


def scene(kind, lens, rng, **stds):
    """A random world behind that lens, and one piece of evidence of that kind in it."""
    make, tilt_deg = KINDS[kind]
    model, distortion = LENSES[lens]
    while True:
        world = World.random(rng, tilt_deg=tilt_deg, **stds)
        world = replace(world, camera=replace(world.camera, lens=model, distortion=distortion))
        try:
            return world, make(world, kind)
        except ImpossibleError:
            continue


def condition_of(evidence):
    """The condition of any piece of evidence."""
    if not isinstance(evidence, SlantRange | KnownLength):
        return condition_alone(evidence)

    def condition(state):
        alone: dict[int, Any] = {0: evidence}
        off, shared, variance = Distances(alone).residuals(state)
        return ConditionResidual(off, shared, np.diag(variance), evidence.std_px)

    return condition


def nearby(state, rng):
    """Another state, a few pixels and decimetres off."""
    steps = rng.normal(size=7 + 4 + len(state.camera.distortion))
    steps *= [0.02, 0.02, 0.02, 2e-3, 2e-3, 2e-3, 0.02, *[2.0] * 4, *[1e-4] * len(state.camera.distortion)]
    return moved_by_shared(state, steps)


def moved_by_shared(state, steps):
    """The state, off by the shared errors of ``dft.projection``."""
    lens, (fx, fy, cx, cy, *bent) = state.camera, steps[7:].tolist()
    camera = replace(
        lens, fx_px=lens.fx_px + fx, fy_px=lens.fy_px + fy, cx_px=lens.cx_px + cx, cy_px=lens.cy_px + cy,
        distortion=tuple(k + step for k, step in zip(lens.distortion, bent, strict=True)),
    )  # fmt: skip
    return replace(
        state, camera=camera, position_m=state.position_m + steps[:3], elevation_m=state.elevation_m + steps[6],
        wxyz=multiply(state.wxyz, from_rotation_vector(steps[3:6])),
    )  # fmt: skip


def central(function, count, sizes):
    """Central differences ``(..., count)`` of a function of ``count`` small steps of these sizes."""
    columns = []
    for index in range(count):
        step = np.zeros(count)
        step[index] = sizes[index]
        columns.append((np.asarray(function(step)) - np.asarray(function(-step))) / (2 * sizes[index]))
    return np.stack(columns, axis=-1)


def shared_sizes(state):
    """Steps at which central differences of what a camera sees are good to 1e-7 of the largest."""
    scale = float(state.position_m[2]) - state.elevation_m
    return np.array(
        [*[1e-5 * scale] * 3, *[1e-5] * 3, 1e-5 * scale, *[1e-2] * 4, *[1e-5] * len(state.camera.distortion)]
    )


def off_by(evidence, steps_px, steps_std):
    """The evidence with its pixels off by ``steps_px`` pixels, and what is known by so many of its stds.

    Args:
        evidence: Any.
        steps_px: One of each coordinate, see ``freedoms``.
        steps_std: One of each known number.
    """
    changed, pixels, stds = {}, iter(steps_px), iter(steps_std)
    for field in fields(evidence):
        value = getattr(evidence, field.name)
        if field.name in _PIXELS:
            at = np.array(value)
            at = at + np.array([next(pixels) for _ in range(at.size)]).reshape(at.shape)
            changed[field.name] = tuple(map(tuple, at.tolist())) if at.ndim > 1 else tuple(at.tolist())
        elif field.name == "position_m":
            off = [next(stds) * std for std in evidence.std_m]
            changed[field.name] = tuple(None if v is None else v + d for v, d in zip(value, off, strict=True))
        elif field.name == "xy_m":
            changed[field.name] = tuple(v + next(stds) * evidence.std_m for v in value)
        elif field.name in _SIZES:
            changed[field.name] = value + next(stds) * evidence.std_m
    return replace(evidence, **changed)


def with_stds(evidence, above_m):
    """The evidence with stds stated: half a pixel, and a thousandth of the camera's height."""
    stds: dict[str, Any] = {"std_px": 0.5}
    if hasattr(evidence, "std_m"):
        stds["std_m"] = (1e-3 * above_m,) * 3 if isinstance(evidence, Landmark) else 1e-3 * above_m
    return replace(evidence, **stds)


def freedoms(evidence):
    """How many pixel coordinates and known numbers there are."""
    names = {field.name for field in fields(evidence)}
    pixels = sum(np.size(getattr(evidence, name)) for name in names & set(_PIXELS))
    return pixels, sum(len(np.atleast_1d(np.array(getattr(evidence, name), object))) for name in names & set(_SIZES))


def turned(angle_rad):
    """The angle on the turn next to 0."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi
