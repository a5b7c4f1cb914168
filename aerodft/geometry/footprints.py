"""What an image shows of the ground as an outline: its footprint, and the horizon in the image.

The horizon is that of a flat earth, where rays are level, whatever the ground is.
"""

import math
from collections.abc import Callable
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.geometry.ground import Ground, Plane
from aerodft.geometry.lens import pixels_from_rays, rays_from_pixels
from aerodft.geometry.rotation import matrix
from aerodft.model import BoolArray, Camera, FloatArray, Pose, read_only

_EDGE_POINTS = 64  # on each side of the image: a lens bends it smoothly
_AZIMUTHS = 4096  # of the horizon and of the farthest ground that is looked for: one in 0.09 degrees
_LINE_POINTS = 129  # of a horizon, at most: all round a fisheye's image within a tenth of a pixel
_ARC_RAD = math.radians(1.0)  # from corner to corner where the farthest ground is the outline
_BISECTIONS = 30  # halve an edge's step or an azimuth's to a billionth
_EDGE_SLACK_PX = 1e-6  # a ray through the border's own pixel comes back this close to it
_STEPS = 384  # along the image's longer side, of the pixels from which the outline of terrain starts
_UP = read_only([0.0, 0.0, 1.0])

_Test: TypeAlias = Callable[[FloatArray], BoolArray]
_Points: TypeAlias = Callable[[FloatArray], FloatArray]


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


def footprint(
    camera: Camera, pose: Pose, max_range_m: float, elevation_m: float = 0.0, ground: Ground | None = None
) -> FloatArray | None:
    """The outline of the ground that the image shows, no farther than ``max_range_m`` along any ray.

    On terrain it is followed in the image, between pixels that show ground and such that do not: along the image's
    border, and where that looks over the ground or beyond its end, along the farthest ground below it. Where a ridge
    hides what is behind it the outline goes straight on to what is seen next, along the line of sight; hidden ground
    within it is not cut out.

    Args:
        camera: The camera.
        pose: One pose; its position's third component is the height above the elevation 0.
        max_range_m: Slant range at which the ground is cut off, before the horizon.
        elevation_m: Height of the measured surface: of level ground, or above ``ground``.
        ground: Ground that is not level; None for the horizontal plane at ``elevation_m``.

    Returns:
        East and north ``(k, 2)`` of the corners, counterclockwise seen from above, not closed; None where the image
        shows no such ground. Where terrain is seen in several separate parts of the image, the one with the largest
        area on the map; parts that are smaller than a 384th of the image's longer side are not found.
    """
    if ground is None:
        return _plane_footprint(camera, pose, max_range_m, Plane(_UP, elevation_m))
    if isinstance(ground, Plane):
        return _plane_footprint(camera, pose, max_range_m, ground.raised(elevation_m))
    return _terrain_footprint(camera, pose, max_range_m, elevation_m, ground)


def _plane_footprint(camera: Camera, pose: Pose, max_range_m: float, plane: Plane) -> FloatArray | None:
    """The footprint on a plane, in axes in which it is level: there the farthest ground is a circle."""
    height = float(plane.normal_enu @ pose.position_enu_m) - plane.offset_m
    if not 0 < height < max_range_m:
        return None
    reach = math.sqrt((max_range_m - height) * (max_range_m + height))
    plane_from_enu = _level_axes(plane.normal_enu)
    turn_rays = (plane_from_enu @ matrix(pose.wxyz)).T

    def away_at(turn: FloatArray) -> FloatArray:
        return _level_ground(_border_rays(camera, turn) @ turn_rays, height)

    def near(turn: FloatArray) -> BoolArray:
        away = away_at(turn)
        return np.asarray(np.hypot(away[..., 0], away[..., 1]) <= reach)  # false for NaN: at and above the horizon

    turn = np.linspace(0.0, 4.0, 4 * _EDGE_POINTS + 1)
    pieces = [away_at(piece) for piece in _pieces(turn, near(turn[:-1]), near)]
    outline = _joined(pieces, reach) if pieces else _whole_circle(camera, turn_rays.T, reach, height)
    if outline is None:
        return None
    away = np.concatenate([outline[::-1], np.full((len(outline), 1), -height)], axis=-1) @ plane_from_enu
    return np.asarray(away[:, :2] + pose.position_enu_m[:2])


def _level_axes(normal_enu: FloatArray) -> FloatArray:
    """``(3, 3)``: ENU to axes whose third is the normal and whose first lies over the east; level: the same axes."""
    right = np.array([1.0, 0.0, 0.0]) - normal_enu[0] * normal_enu
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(normal_enu, right), normal_enu])


def _joined(pieces: list[FloatArray], reach_m: float) -> FloatArray:
    """Parts of the border, each ``(k, 2)``, with the farthest ground between them, not closed."""
    if len(pieces) == 1 and np.array_equal(pieces[0][0], pieces[0][-1]):
        return pieces[0][:-1]
    following = pieces[1:] + pieces[:1]
    arcs = [_arc(piece[-1], after[0], reach_m) for piece, after in zip(pieces, following, strict=True)]
    return np.concatenate([part for pair in zip(pieces, arcs, strict=True) for part in pair])


def _terrain_footprint(
    camera: Camera, pose: Pose, max_range_m: float, elevation_m: float, ground: Ground
) -> FloatArray | None:
    def points_at(pixels_px: FloatArray) -> FloatArray:
        rays = rays_from_pixels(camera, pixels_px) @ matrix(pose.wxyz).T
        hits = ground.meet(pose.position_enu_m, rays, elevation_m)
        with np.errstate(invalid="ignore"):
            return np.where((hits.range_m <= max_range_m)[..., None], hits.points_enu_m[..., :2], np.nan)

    size = np.array([camera.width_px, camera.height_px])
    across, down = (
        np.linspace(0.0, side, max(2, math.ceil(_STEPS * side / max(size))) + 1) - PIXEL_CENTRE_OFFSET_PX
        for side in size.tolist()
    )
    pixels = np.stack(np.meshgrid(across, down), axis=-1)
    shown = ~np.isnan(points_at(pixels)[..., 0])
    contours, _ = cv2.findContours(shown.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    rings = [points_at(_to_the_edge(pixels, shown, contour[:, 0].astype(np.intp), points_at)) for contour in contours]
    areas = [ring_area(ring) for ring in rings]
    if not any(areas):
        return None
    largest = int(np.argmax(np.abs(areas)))
    return rings[largest] if areas[largest] > 0 else rings[largest][::-1]


def _to_the_edge(
    pixels_px: FloatArray, shown: BoolArray, nodes: npt.NDArray[np.intp], points_at: _Points
) -> FloatArray:
    """Pixels ``(k, 2)`` of a contour's nodes, moved outwards as far as ground is shown, at most to the next node.

    Args:
        pixels_px: ``(rows, columns, 2)`` of all nodes; the outermost ones are the image's border.
        shown: ``(rows, columns)``.
        nodes: ``(k, 2)`` column and row of nodes that show ground, beside such that do not.
        points_at: NaN where a pixel shows no ground.
    """
    columns, rows = nodes[:, 0], nodes[:, 1]
    last_row, last_column = shown.shape[0] - 1, shown.shape[1] - 1
    missing = np.pad(~shown, 1).astype(np.int8)  # beyond the border nothing is missing
    at = {(dx, dy): missing[rows + 1 + dy, columns + 1 + dx] for dx in (-1, 0, 1) for dy in (-1, 0, 1)}
    right = np.sign(sum(dx * count for (dx, _), count in at.items())) * ((columns > 0) & (columns < last_column))
    below = np.sign(sum(dy * count for (_, dy), count in at.items())) * ((rows > 0) & (rows < last_row))
    start, beyond = pixels_px[rows, columns], (rows + below, columns + right)
    step = np.where(shown[beyond][:, None], 0.0, pixels_px[beyond] - start)
    zero, one = np.zeros((len(nodes), 1)), np.ones((len(nodes), 1))
    share = _last_inside(zero, one, lambda middle: ~np.isnan(points_at(start + middle * step)[:, :1]))
    return np.asarray(start + share * step)


def ring_area(corners_m: FloatArray) -> float:
    """Area (m2) of a polygon of corners ``(k, 2)``, not closed; above 0 counterclockwise."""
    away = corners_m - corners_m[0]
    x, y = away[:, 0], away[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


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

    def rays_at(share: FloatArray) -> FloatArray:
        return rays_from_pixels(camera, centre + share[..., None] * (pixels - centre))

    valid = _last_inside(np.zeros(beyond.shape), np.ones(beyond.shape), lambda share: ~np.isnan(rays_at(share)[..., 0]))
    return rays_at(np.where(beyond, valid, 1.0))


def _level_ground(rays_enu: FloatArray, height_m: float) -> FloatArray:
    """East and north ``(..., 2)`` from the camera's foot; NaN at and above the horizon."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return np.where(rays_enu[..., 2:] < 0, rays_enu[..., :2] * (-height_m / rays_enu[..., 2:]), np.nan)


def _whole_circle(camera: Camera, axes_from_cam: FloatArray, reach_m: float, height_m: float) -> FloatArray | None:
    """The farthest ground all round, clockwise, where the image shows it and more; else the image shows no ground."""
    azimuth = np.arange(0.0, 2 * math.pi, _ARC_RAD)
    away = reach_m * np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    rays = np.concatenate([away, np.full((len(away), 1), -height_m)], axis=-1) @ axes_from_cam
    return away if np.all(_in_image(camera, pixels_from_rays(camera, rays))) else None


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
        enter, leave = _last_inside(within[[0, -1]], within[[0, -1]] + [-step, step], is_inside)
        pieces.append(np.concatenate([[enter], within, [leave]]))
    return pieces


def _last_inside(inside: FloatArray, outside: FloatArray, is_inside: _Test) -> FloatArray:
    """The last parameters ``(...)`` that are inside, on the way out."""
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        within = is_inside(middle)
        inside, outside = np.where(within, middle, inside), np.where(within, outside, middle)
    return inside
