"""The image's footprint on the ground, and the horizon line in the image.

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

_POINTS_PER_SIDE = 64  # lens distortion bends a side smoothly
_AZIMUTH_COUNT = 4096  # of the horizon and of the circle of maximum range: one in 0.09 degrees
_MAX_HORIZON_POINTS = 129  # keeps a horizon that goes all round a fisheye's image within a tenth of a pixel
_ARC_STEP_RAD = math.radians(1.0)  # between corners of the outline along the circle of maximum range
_BISECTIONS = 30  # halve a step of the perimeter or of the azimuth to a billionth
_BORDER_TOLERANCE_PX = 1e-6  # the ray of a border pixel projects back this close to it
_TERRAIN_GRID_STEPS = 384  # along the image's longer side, of the grid of pixels that starts the outline on terrain
_UP = read_only([0.0, 0.0, 1.0])

_Predicate: TypeAlias = Callable[[FloatArray], BoolArray]
_PixelsToGround: TypeAlias = Callable[[FloatArray], FloatArray]


def horizon_line(camera: Camera, pose: Pose) -> tuple[FloatArray, ...]:
    """The image's horizon line.

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

    def is_shown(azimuth_rad: FloatArray) -> BoolArray:
        return in_image(camera, pixels_at(azimuth_rad), -_BORDER_TOLERANCE_PX)

    azimuths_rad = np.linspace(0.0, 2 * math.pi, _AZIMUTH_COUNT + 1)
    intervals = _intervals(azimuths_rad, is_shown(azimuths_rad[:-1]), is_shown)
    return tuple(pixels_at(np.linspace(part[0], part[-1], min(len(part), _MAX_HORIZON_POINTS))) for part in intervals)


def footprint(
    camera: Camera, pose: Pose, max_range_m: float, elevation_m: float = 0.0, ground: Ground | None = None
) -> FloatArray | None:
    """Outline of the ground in the image, cut off at the slant range ``max_range_m``.

    On terrain the outline is traced in the image, between pixels with ground and pixels without: along the image's
    border, and where that is above the ground or beyond the elevation model, along the farthest visible ground below
    it. At a ridge the outline jumps along the line of sight to the next visible ground; occluded ground inside the
    outline is not cut out.

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
    """Footprint on a plane, in axes in which it is level: there the maximum range is a circle."""
    height = float(plane.normal_enu @ pose.position_enu_m) - plane.offset_m
    if not 0 < height < max_range_m:
        return None
    reach = math.sqrt((max_range_m - height) * (max_range_m + height))
    plane_from_enu = _level_axes(plane.normal_enu)
    plane_from_cam = plane_from_enu @ matrix(pose.wxyz)

    def offsets_at(perimeter: FloatArray) -> FloatArray:
        return _level_ground(_border_rays(camera, perimeter) @ plane_from_cam.T, height)

    def in_range(perimeter: FloatArray) -> BoolArray:
        offsets = offsets_at(perimeter)
        return np.asarray(np.hypot(offsets[..., 0], offsets[..., 1]) <= reach)  # NaN at and above the horizon: false

    perimeter = np.linspace(0.0, 4.0, 4 * _POINTS_PER_SIDE + 1)
    segments = [offsets_at(part) for part in _intervals(perimeter, in_range(perimeter[:-1]), in_range)]
    outline = _close_with_arcs(segments, reach) if segments else _range_circle(camera, plane_from_cam, reach, height)
    if outline is None:
        return None
    offsets = np.concatenate([outline[::-1], np.full((len(outline), 1), -height)], axis=-1) @ plane_from_enu
    return np.asarray(offsets[:, :2] + pose.position_enu_m[:2])


def _level_axes(normal_enu: FloatArray) -> FloatArray:
    """Rotation ``(3, 3)`` from ENU to axes with the plane's normal as the third and the first above east."""
    right = np.array([1.0, 0.0, 0.0]) - normal_enu[0] * normal_enu
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(normal_enu, right), normal_enu])


def _close_with_arcs(segments: list[FloatArray], reach_m: float) -> FloatArray:
    """Closed outline of border segments, each ``(k, 2)``, and arcs of maximum range between them."""
    if len(segments) == 1 and np.array_equal(segments[0][0], segments[0][-1]):
        return segments[0][:-1]
    following = segments[1:] + segments[:1]
    arcs = [_arc(segment[-1], successor[0], reach_m) for segment, successor in zip(segments, following, strict=True)]
    return np.concatenate([part for pair in zip(segments, arcs, strict=True) for part in pair])


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
        np.linspace(0.0, side, max(2, math.ceil(_TERRAIN_GRID_STEPS * side / max(size))) + 1) - PIXEL_CENTRE_OFFSET_PX
        for side in size.tolist()
    )
    pixels = np.stack(np.meshgrid(across, down), axis=-1)
    is_ground = ~np.isnan(points_at(pixels)[..., 0])
    contours, _ = cv2.findContours(is_ground.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    rings = [points_at(_extend(pixels, is_ground, contour[:, 0].astype(np.intp), points_at)) for contour in contours]
    areas = [ring_area(ring) for ring in rings]
    if not any(areas):
        return None
    largest = int(np.argmax(np.abs(areas)))
    return rings[largest] if areas[largest] > 0 else rings[largest][::-1]


def _extend(
    pixels_px: FloatArray, ground: BoolArray, nodes: npt.NDArray[np.intp], points_at: _PixelsToGround
) -> FloatArray:
    """Contour pixels ``(k, 2)`` moved outwards to where ground ends, at most to the next grid node.

    Args:
        pixels_px: ``(rows, columns, 2)`` of the grid's nodes; the outermost ones are the image's border.
        ground: ``(rows, columns)`` whether a node shows ground.
        nodes: ``(k, 2)`` column and row of nodes that show ground, next to nodes that do not.
        points_at: Ground points of pixels; NaN where there is no ground.
    """
    columns, rows = nodes[:, 0], nodes[:, 1]
    last_row, last_column = ground.shape[0] - 1, ground.shape[1] - 1
    missing = np.pad(~ground, 1).astype(np.int8)  # nodes without ground; none beyond the border
    gaps = {(dx, dy): missing[rows + 1 + dy, columns + 1 + dx] for dx in (-1, 0, 1) for dy in (-1, 0, 1)}
    right = np.sign(sum(dx * count for (dx, _), count in gaps.items())) * ((columns > 0) & (columns < last_column))
    below = np.sign(sum(dy * count for (_, dy), count in gaps.items())) * ((rows > 0) & (rows < last_row))
    start, beyond = pixels_px[rows, columns], (rows + below, columns + right)
    step = np.where(ground[beyond][:, None], 0.0, pixels_px[beyond] - start)
    zero, one = np.zeros((len(nodes), 1)), np.ones((len(nodes), 1))
    fraction = _bisect_boundary(zero, one, lambda middle: ~np.isnan(points_at(start + middle * step)[:, :1]))
    return np.asarray(start + fraction * step)


def ring_area(corners_m: FloatArray) -> float:
    """Signed area (m2) of a polygon of corners ``(k, 2)``, not closed; positive if counterclockwise."""
    relative_m = corners_m - corners_m[0]
    x, y = relative_m[:, 0], relative_m[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def border_pixels(camera: Camera, perimeter: FloatArray) -> FloatArray:
    """Pixels ``(..., 2)`` at positions along the image's border: clockwise from the top-left corner, 1 per side."""
    side, along = np.divmod(np.asarray(perimeter, dtype=np.float64) % 4.0, 1.0)
    zero, one = np.zeros_like(along), np.ones_like(along)
    x = np.select([side == 0, side == 1, side == 2], [along, one, 1 - along], zero)  # noqa: PLR2004 - side numbers
    y = np.select([side == 0, side == 1, side == 2], [zero, along, one], 1 - along)  # noqa: PLR2004
    return np.stack([x * camera.width_px, y * camera.height_px], axis=-1) - PIXEL_CENTRE_OFFSET_PX


def in_image(camera: Camera, pixels_px: FloatArray, margin_px: float = 0.0) -> BoolArray:
    """Whether pixels ``(..., 2)`` are in the image, so far from its border; false for NaN."""
    nearest = margin_px - PIXEL_CENTRE_OFFSET_PX
    farthest = np.array([camera.width_px, camera.height_px]) - 1 - nearest
    return np.asarray(np.all((pixels_px >= nearest) & (pixels_px <= farthest), axis=-1))


def _border_rays(camera: Camera, perimeter: FloatArray) -> FloatArray:
    """Rays in camera axes along the image's border, or short of it where the lens model ends."""
    pixels = border_pixels(camera, perimeter)
    rays = rays_from_pixels(camera, pixels)
    beyond = np.isnan(rays[..., 0])
    if not np.any(beyond):
        return rays
    centre = np.array([camera.cx_px, camera.cy_px])

    def rays_at(fraction: FloatArray) -> FloatArray:
        return rays_from_pixels(camera, centre + fraction[..., None] * (pixels - centre))

    valid = _bisect_boundary(np.zeros(beyond.shape), np.ones(beyond.shape), lambda f: ~np.isnan(rays_at(f)[..., 0]))
    return rays_at(np.where(beyond, valid, 1.0))


def _level_ground(rays_enu: FloatArray, height_m: float) -> FloatArray:
    """East and north ``(..., 2)`` of the camera's foot to the rays' points; NaN at and above the horizon."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return np.where(rays_enu[..., 2:] < 0, rays_enu[..., :2] * (-height_m / rays_enu[..., 2:]), np.nan)


def _range_circle(camera: Camera, plane_from_cam: FloatArray, reach_m: float, height_m: float) -> FloatArray | None:
    """Circle of maximum range, clockwise, if all of it is in the image; None otherwise: no ground is in view."""
    azimuth = np.arange(0.0, 2 * math.pi, _ARC_STEP_RAD)
    circle_m = reach_m * np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    rays = np.concatenate([circle_m, np.full((len(circle_m), 1), -height_m)], axis=-1) @ plane_from_cam
    is_whole = np.all(in_image(camera, pixels_from_rays(camera, rays), -_BORDER_TOLERANCE_PX))
    return circle_m if is_whole else None


def _arc(start_m: FloatArray, end_m: FloatArray, reach_m: float) -> FloatArray:
    """Points of the circle of maximum range between two of its points, clockwise seen from above."""
    first, last = (math.atan2(*point.tolist()) for point in (start_m, end_m))
    sweep = (last - first) % (2 * math.pi)
    azimuth = first + np.linspace(0.0, sweep, max(2, math.ceil(sweep / _ARC_STEP_RAD)) + 1)[1:-1]
    return reach_m * np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)


def _intervals(parameters: FloatArray, inside: BoolArray, is_inside: _Predicate) -> list[FloatArray]:
    """Intervals of a closed curve on which a predicate holds, with ends bisected to rounding.

    Args:
        parameters: ``(n + 1,)`` of the curve's samples; the last sample is the first one again.
        inside: The predicate ``(n,)`` at the samples.
        is_inside: The predicate; it also takes parameters beyond the last.

    Returns:
        Parameters of each interval in order; the whole curve, closed, where the predicate holds everywhere.
    """
    count, period = len(inside), parameters[-1] - parameters[0]
    if np.all(inside):
        return [parameters]
    starts = np.flatnonzero(inside & ~np.roll(inside, 1))
    ends = np.flatnonzero(inside & ~np.roll(inside, -1))
    if len(starts) and ends[0] < starts[0]:
        ends = np.roll(ends, -1)
    intervals = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        last = end if end >= start else end + count
        index = np.arange(start, last + 1)
        within = parameters[index % count] + period * (index // count)
        step = period / count
        enter, leave = _bisect_boundary(within[[0, -1]], within[[0, -1]] + [-step, step], is_inside)
        intervals.append(np.concatenate([[enter], within, [leave]]))
    return intervals


def _bisect_boundary(inside: FloatArray, outside: FloatArray, is_inside: _Predicate) -> FloatArray:
    """Boundaries ``(...)`` between parameters inside and outside, by bisection, on the inside."""
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        within = is_inside(middle)
        inside, outside = np.where(within, middle, inside), np.where(within, outside, middle)
    return inside
