"""What an image shows of level ground as an outline: its footprint, and the horizon in the image.

Ground and horizon are those of a flat earth: the horizon is where rays are level.
"""

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.geometry.lens import pixels_from_rays, rays_from_pixels
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.model.camera import Camera
from aerodft.model.pose import Pose

_EDGE_POINTS = 64  # on each side of the image: a lens bends it smoothly
_AZIMUTHS = 4096  # of the horizon and of the farthest ground that is looked for: one in 0.09 degrees
_LINE_POINTS = 129  # of a horizon, at most: all round a fisheye's image within a tenth of a pixel
_ARC_RAD = math.radians(1.0)  # from corner to corner where the farthest ground is the outline
_BISECTIONS = 30  # halve an edge's step or an azimuth's to a billionth
_EDGE_SLACK_PX = 1e-6  # a ray through the border's own pixel comes back this close to it

_Test: TypeAlias = Callable[[FloatArray], BoolArray]


def horizon_line(camera: Camera, pose: Pose) -> tuple[FloatArray, ...]:
    """The horizon in the image.

    Args:
        camera: The camera; with a distorted lens the line is bent.
        pose: One pose.

    Returns:
        Polylines ``(k, 2)`` of pixels, ends on the image's border (or where the lens model ends), clockwise round the
        camera: from the left to the right in an upright image. Empty where the horizon is not in view; several where it
        leaves the image and comes back; a closed one (the last pixel is the first) where all of it is in view.
    """

    def pixels_at(azimuth_rad: FloatArray) -> FloatArray:
        level = np.stack([np.sin(azimuth_rad), np.cos(azimuth_rad), np.zeros_like(azimuth_rad)], axis=-1)
        return pixels_from_rays(camera, level @ matrix(pose.wxyz))

    def in_image(azimuth_rad: FloatArray) -> BoolArray:
        return _in_image(camera, pixels_at(azimuth_rad))

    turn = np.linspace(0.0, 2 * math.pi, _AZIMUTHS + 1)
    pieces = _pieces(turn, in_image(turn[:-1]), in_image)
    return tuple(pixels_at(np.linspace(piece[0], piece[-1], min(len(piece), _LINE_POINTS))) for piece in pieces)


def footprint(camera: Camera, pose: Pose, max_range_m: float, elevation_m: float = 0.0) -> FloatArray | None:
    """The outline of the ground that the image shows, no farther than ``max_range_m`` along any ray.

    Args:
        camera: The camera.
        pose: One pose; its position's third component is the height above the elevation 0.
        max_range_m: Slant range at which the ground is cut off, before the horizon.
        elevation_m: Height of the level ground.

    Returns:
        East and north ``(k, 2)`` of the corners, counterclockwise seen from above, not closed; None where the image
        shows no such ground.
    """
    height = float(pose.position_enu_m[2]) - elevation_m
    if not 0 < height < max_range_m:
        return None
    reach = math.sqrt((max_range_m - height) * (max_range_m + height))

    def away_at(turn: FloatArray) -> FloatArray:
        return _level_ground(_border_rays(camera, turn) @ matrix(pose.wxyz).T, height)

    def near(turn: FloatArray) -> BoolArray:
        away = away_at(turn)
        return np.asarray(np.hypot(away[..., 0], away[..., 1]) <= reach)  # false for NaN: at and above the horizon

    turn = np.linspace(0.0, 4.0, 4 * _EDGE_POINTS + 1)
    pieces = [away_at(piece) for piece in _pieces(turn, near(turn[:-1]), near)]
    if not pieces:
        return _whole_circle(camera, pose, reach, height)
    if len(pieces) == 1 and np.array_equal(pieces[0][0], pieces[0][-1]):
        outline = pieces[0][:-1]
    else:
        following = pieces[1:] + pieces[:1]
        arcs = [_arc(piece[-1], after[0], reach) for piece, after in zip(pieces, following, strict=True)]
        outline = np.concatenate([part for pair in zip(pieces, arcs, strict=True) for part in pair])
    return np.asarray(outline[::-1] + pose.position_enu_m[:2])


def border_pixels(camera: Camera, turn: FloatArray) -> FloatArray:
    """Pixels ``(..., 2)`` of the image's border, clockwise in the image from its top-left corner: 4 turns the whole."""
    side, along = np.divmod(np.asarray(turn, dtype=np.float64) % 4.0, 1.0)
    zero, one = np.zeros_like(along), np.ones_like(along)
    x = np.select([side == 0, side == 1, side == 2], [along, one, 1 - along], zero)  # noqa: PLR2004 - the sides' numbers
    y = np.select([side == 0, side == 1, side == 2], [zero, along, one], 1 - along)  # noqa: PLR2004
    return np.stack([x * camera.width_px, y * camera.height_px], axis=-1) - PIXEL_CENTRE_OFFSET_PX


def _in_image(camera: Camera, pixels_px: FloatArray) -> BoolArray:
    size = np.array([camera.width_px, camera.height_px])
    slack = PIXEL_CENTRE_OFFSET_PX + _EDGE_SLACK_PX
    low, high = -slack, size - 1 + slack
    return np.asarray(np.all((pixels_px >= low) & (pixels_px <= high), axis=-1))


def _border_rays(camera: Camera, turn: FloatArray) -> FloatArray:
    """Rays in camera axes of what bounds the image: its border, or within it where the lens model ends."""
    pixels = border_pixels(camera, turn)
    rays = rays_from_pixels(camera, pixels)
    beyond = np.isnan(rays[..., 0])
    if not np.any(beyond):
        return rays
    centre = np.array([camera.cx_px, camera.cy_px])
    inside, outside = np.zeros(beyond.shape), np.ones(beyond.shape)
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        valid = ~np.isnan(rays_from_pixels(camera, centre + middle[..., None] * (pixels - centre))[..., 0])
        inside, outside = np.where(valid, middle, inside), np.where(valid, outside, middle)
    share = np.where(beyond, inside, 1.0)
    return rays_from_pixels(camera, centre + share[..., None] * (pixels - centre))


def _level_ground(rays_enu: FloatArray, height_m: float) -> FloatArray:
    """East and north ``(..., 2)`` from the camera's foot; NaN at and above the horizon."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return np.where(rays_enu[..., 2:] < 0, rays_enu[..., :2] * (-height_m / rays_enu[..., 2:]), np.nan)


def _whole_circle(camera: Camera, pose: Pose, reach_m: float, height_m: float) -> FloatArray | None:
    """The farthest ground all round, where the image shows it and more; else the image shows no ground."""
    azimuth = np.arange(0.0, 2 * math.pi, _ARC_RAD)[::-1]
    away = reach_m * np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    rays = np.concatenate([away, np.full((len(away), 1), -height_m)], axis=-1) @ matrix(pose.wxyz)
    if not np.all(_in_image(camera, pixels_from_rays(camera, rays))):
        return None
    return np.asarray(away + pose.position_enu_m[:2])


def _arc(start_m: FloatArray, end_m: FloatArray, reach_m: float) -> FloatArray:
    """Points between two on the circle of the farthest ground, clockwise from above as the image's border is."""
    first, last = (math.atan2(*point.tolist()) for point in (start_m, end_m))
    sweep = (last - first) % (2 * math.pi)
    azimuth = first + np.linspace(0.0, sweep, max(2, math.ceil(sweep / _ARC_RAD)) + 1)[1:-1]
    return reach_m * np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)


def _pieces(turn: FloatArray, inside: BoolArray, is_inside: _Test) -> list[FloatArray]:
    """The parts of a closed curve on which something holds, ends found to rounding.

    Args:
        turn: Parameters ``(n + 1,)`` once round; the last is the first again.
        inside: Whether it holds, ``(n,)``.
        is_inside: Whether it holds, for any parameters, also beyond the last.

    Returns:
        Parameters of each part in order; the whole curve, closed, where it holds everywhere.
    """
    count, period = len(inside), turn[-1] - turn[0]
    if np.all(inside):
        return [turn]
    starts = np.flatnonzero(inside & ~np.roll(inside, 1))
    ends = np.flatnonzero(inside & ~np.roll(inside, -1))
    if len(starts) and ends[0] < starts[0]:
        ends = np.roll(ends, -1)
    pieces = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        last = end if end >= start else end + count
        index = np.arange(start, last + 1)
        within = turn[index % count] + period * (index // count)
        step = period / count
        enter = _edge(within[0], within[0] - step, is_inside)
        leave = _edge(within[-1], within[-1] + step, is_inside)
        pieces.append(np.concatenate([[enter], within, [leave]]))
    return pieces


def _edge(inside: float, outside: float, is_inside: _Test) -> float:
    """The last parameter that is inside, on the way out."""
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        if is_inside(np.asarray(middle)):
            inside = middle
        else:
            outside = middle
    return inside
