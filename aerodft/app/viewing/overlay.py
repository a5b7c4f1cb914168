"""What helps to read an image: the horizon, a metre grid on the ground, and what of the ground is seen."""

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from aerodft.dft import Setup
from aerodft.geometry import Plane, camera_angles, footprint, horizon_line, lat_lon, matrix, pixels_from_rays
from aerodft.model import Camera, FloatArray, Pose, PoseSample

_REACH_HEIGHTS: Final = 10.0
"""Farther away than so many camera heights a grid is a blur, and a pixel many metres."""
_MOST_LINES: Final = 12
_LINE_POINTS: Final = 512
_DIGITS: Final = 1


def scene_overlay(setup: Setup, sample: PoseSample) -> dict[str, Any]:
    """What an image shows of the ground.

    Args:
        setup: Camera and ground.
        sample: The image's pose.

    Returns:
        ``horizon``: lines of pixels. ``grid``: lines on the ground every ``spacing_m``, each with its ``pixels`` and
        how far to the ``right`` or ``ahead`` of the camera it is (``axis`` and ``at_m``), of level or sloping ground.
        ``footprint_enu_m``: corners, up to ten camera heights away. ``camera_enu_m`` and ``heading_deg``. ``geo``:
        where on the map the camera is, None where nobody knows. Without a pose there is nothing.
    """
    pose = sample.pose
    if pose is None:
        return {"horizon": [], "grid": [], "spacing_m": None, "footprint_enu_m": [], "geo": None}
    height_m = float(pose.position_enu_m[2]) - sample.datum_enu_m
    reach_m = min(_REACH_HEIGHTS * height_m, setup.max_range_m or math.inf)
    outline = footprint(setup.camera, pose, reach_m, ground=setup.ground)
    _, _, heading_rad = map(float, camera_angles(pose.wxyz))
    found = {
        "horizon": [line.round(_DIGITS).tolist() for line in horizon_line(setup.camera, pose)],
        "grid": [],
        "spacing_m": None,
        "footprint_enu_m": [] if outline is None else outline.tolist(),
        "camera_enu_m": pose.position_enu_m.tolist(),
        "heading_deg": math.degrees(heading_rad),
        "geo": _geo(sample, pose),
    }
    if outline is not None and (setup.ground is None or isinstance(setup.ground, Plane)):
        ahead = np.array([math.sin(heading_rad), math.cos(heading_rad)])
        axes = np.stack([[ahead[1], -ahead[0]], ahead])  # right and ahead of the camera, in east and north
        seen_m = (outline - pose.position_enu_m[:2]) @ axes.T
        spacing_m = _spacing(float(np.ptp(seen_m, axis=0).max()))
        grid = _grid(setup.camera, pose, setup.ground, (axes, seen_m), spacing_m)
        found |= {"spacing_m": spacing_m, "grid": list(grid)}
    return found


def _geo(sample: PoseSample, pose: Pose) -> dict[str, Any] | None:
    """Latitude and longitude of the camera, its east and north, and how many metres a degree is there."""
    if sample.origin is None:
        return None
    east_m, north_m = pose.position_enu_m[:2].tolist()
    steps_m = np.array([[east_m, north_m], [east_m + 1.0, north_m], [east_m, north_m + 1.0]])
    (lat, lon), (_, lon_east), (lat_north, _) = np.degrees(lat_lon(sample.origin, steps_m)).tolist()
    per_deg = [1.0 / (lon_east - lon), 1.0 / (lat_north - lat)]
    return {"lat_deg": lat, "lon_deg": lon, "east_m": east_m, "north_m": north_m, "metres_per_deg": per_deg}


def _spacing(extent_m: float) -> float:
    """1, 2 or 5 times a power of ten: of a handful of lines across an extent."""
    least = extent_m / _MOST_LINES
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= least)


def _grid(
    camera: Camera, pose: Pose, plane: Plane | None, seen: tuple[FloatArray, FloatArray], spacing_m: float
) -> Iterator[dict[str, Any]]:
    """The lines of a grid, in the parts that are in the image."""
    axes, seen_m = seen
    low, high = seen_m.min(axis=0), seen_m.max(axis=0)
    for across, axis in ((0, "right"), (1, "ahead")):
        along_m = np.linspace(low[1 - across], high[1 - across], _LINE_POINTS)
        first, last = math.ceil(low[across] / spacing_m), math.floor(high[across] / spacing_m)
        for number in range(first, last + 1):
            line_m = np.empty((_LINE_POINTS, 2))
            line_m[:, across], line_m[:, 1 - across] = number * spacing_m, along_m
            for part in _in_image(camera, _pixels(camera, pose, plane, line_m @ axes)):
                yield {"pixels": part.round(_DIGITS).tolist(), "axis": axis, "at_m": number * spacing_m}


def _pixels(camera: Camera, pose: Pose, plane: Plane | None, away_m: FloatArray) -> FloatArray:
    """Pixels ``(n, 2)`` of points of the ground, east and north ``(n, 2)`` of the camera."""
    up_m = np.zeros(len(away_m))
    if plane is not None:
        east_north = away_m + pose.position_enu_m[:2]
        up_m = (plane.offset_m - east_north @ plane.normal_enu[:2]) / plane.normal_enu[2]
    rays = np.column_stack([away_m, up_m - pose.position_enu_m[2]]) @ matrix(pose.wxyz)
    return np.where(rays[:, 2:] > 0, pixels_from_rays(camera, rays), np.nan)


def _in_image(camera: Camera, pixels_px: FloatArray) -> Iterator[FloatArray]:
    """The parts of a line that are in the image, or touch its border."""
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels_px >= 0) & (pixels_px <= [camera.width_px - 1, camera.height_px - 1]), axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if stop - start > 1:
            yield pixels_px[start:stop]
