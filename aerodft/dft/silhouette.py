"""Foot, top and sides of an upright object from its outline in the image (paper, Section 4).

An object is where its bottom-most point is, not where its centroid is. "Down" is the image of the vertical at the
object: straight down the image only for a camera without roll, and for a steep view another direction in every corner.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.geometry import matrix, pixels_from_rays, rays_from_pixels
from aerodft.model import BoolArray, Camera, FloatArray, Pose, read_only

EDGE_STD_PX: Final = 1.0
"""Standard deviation of an outline's edge for detections that state none."""

_SAMPLE_STEP_PX: Final = 0.5  # spacing of the points along an outline
_MAX_SAMPLES: Final = 200_000
_FOOT_PX: Final = 1.0  # height of the foot band above the lowest point ...
_FOOT_HEIGHT_SHARE: Final = 0.02  # ... or this share of the object's height: a pair of shoes side by side
_FOOT_WIDTH_SHARE: Final = 0.5  # middle share of a box's or foot's width that holds the point where the object stands
_UNIFORM_STD: Final = 1 / math.sqrt(12.0)  # of a uniform distribution of width 1
_DOWN_WITHOUT_ROLL: Final = read_only([0.0, 1.0])
_MOST_CORNERS: Final = 64  # of an outline whose area is measured
_DIRECTION_STEP_RAD: Final = 1e-4  # of the numerical derivative of the image towards the nadir


@dataclass(frozen=True, slots=True, eq=False)
class Silhouette:
    """Foot, top and sides of an upright object in the image.

    Attributes:
        foot_px: ``(2,)`` point where it stands.
        foot_cov_px2: ``(2, 2)``.
        top_px: ``(2,)``.
        sides_px: ``(2, 2)`` its left and right limits, level with the foot.
        edge_std_px: Of where the outline has its edge.
        lateral_std_px: Of the foot, across the vertical.
    """

    foot_px: FloatArray
    foot_cov_px2: FloatArray
    top_px: FloatArray
    sides_px: FloatArray
    edge_std_px: float
    lateral_std_px: float


@dataclass(frozen=True, slots=True)
class ObjectPoints:
    """Points of an outlined object that a kind of probe is measured at, and the pixel errors that matter to it.

    Attributes:
        foot: Where it stands.
        top: Its top.
        sides: Its left and right limits, level with the foot.
        contour: The corners of its contour, and no other points.
        errs_in_depth: Whether errors along the vertical change the value.
        errs_sideways: Whether errors across the vertical change the value.
    """

    foot: bool = False
    top: bool = False
    sides: bool = False
    contour: bool = False
    errs_in_depth: bool = False
    errs_sideways: bool = False

    def takes_elevations(self, count: int) -> bool:
        """Whether the points may have so many elevations; 0 is one for all of them."""
        return count == 0 or (self.sides and count == 2)  # noqa: PLR2004 - left and right

    def pixels_and_std(self, seen: Silhouette) -> tuple[FloatArray, float]:
        """Pixels ``(q, 2)`` of an upright object, and the standard deviation of each coordinate."""
        points = [seen.foot_px] * self.foot + [seen.top_px] * self.top + list(seen.sides_px) * self.sides
        stds = [seen.edge_std_px] * self.errs_in_depth + [seen.lateral_std_px] * self.errs_sideways
        return np.array(points), max(stds)


def down_in_image(camera: Camera, pose: Pose | None, outline_px: FloatArray) -> FloatArray | None:
    """Direction of the vertical, downwards, at an object: a unit vector ``(2,)`` in the image.

    Args:
        camera: The camera.
        pose: Its pose; None for a camera taken to be without roll.
        outline_px: ``(n, 2)``.

    Returns:
        None where there is no such direction: the object is right below the camera, or outside the lens model.
    """
    if pose is None:
        return _DOWN_WITHOUT_ROLL
    low, high = np.min(outline_px, axis=0), np.max(outline_px, axis=0)
    ray = rays_from_pixels(camera, (low + high) / 2)
    if not np.all(np.isfinite(ray)):
        return None
    ray = ray / np.linalg.norm(ray)
    nadir = -matrix(pose.wxyz)[2]  # straight down, in camera axes
    nadir_px = pixels_from_rays(camera, nadir) if nadir[2] > 0 else np.full(2, np.nan)
    if np.all((nadir_px >= low) & (nadir_px <= high)):
        return None
    nadir_direction = nadir - (nadir @ ray) * ray
    length = float(np.linalg.norm(nadir_direction))
    if length < _DIRECTION_STEP_RAD:
        return None
    ends = pixels_from_rays(camera, ray + np.array([[-0.5], [0.5]]) * _DIRECTION_STEP_RAD * nadir_direction / length)
    step = ends[1] - ends[0]
    size = float(np.linalg.norm(step))
    return np.asarray(step / size) if math.isfinite(size) and size > 0 else None


def locate_outline(
    camera: Camera, pose: Pose | None, outline_px: FloatArray, edge_std_px: float = EDGE_STD_PX
) -> Silhouette:
    """Locate an upright object from its outline.

    The lowest point is the one seen closest to the nadir, not the farthest along some direction of the image.

    Args:
        camera: The camera.
        pose: Its pose; None for a camera taken to be without roll.
        outline_px: ``(n, 2)`` corners of the closed outline, at the object's border: not centres of its last pixels.
        edge_std_px: Standard deviation of the outline's edge.
    """
    down = down_in_image(camera, pose, outline_px)
    if down is None:
        return _locate_below(outline_px, edge_std_px)
    points = _sample_outline(outline_px)
    low, side, sides = points[:, 1], points[:, 0], None
    if pose is not None:
        points, low, side, sides = _nadir_coordinates(camera, pose, points, down)
    lowest, highest = float(np.max(low)), float(np.min(low))
    near = max(_FOOT_PX, _FOOT_HEIGHT_SHARE * (lowest - highest))
    foot_px, spread = _centre(points, side, low >= lowest - near, low)
    top_px, _ = _centre(points, side, low <= highest + near, -low)
    if sides is None or not np.all(np.isfinite(sides)):
        sides = np.array([[side.min(), lowest], [side.max(), lowest]])
    return Silhouette(
        foot_px=foot_px,
        foot_cov_px2=_foot_covariance(down, edge_std_px, math.hypot(edge_std_px, spread)),
        top_px=top_px,
        sides_px=sides,
        edge_std_px=edge_std_px,
        lateral_std_px=math.hypot(edge_std_px, spread),
    )


def _nadir_coordinates(
    camera: Camera, pose: Pose, points_px: FloatArray, down: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Pixels inside the lens model ``(m, 2)``, closeness to the nadir and offset to the right ``(m,)`` px.

    Verticals have one azimuth each: fourth are the ends ``(2, 2)`` px of both sides' at the lowest point's nadir angle.
    """
    rays = rays_from_pixels(camera, points_px)
    points, rays = points_px[np.isfinite(rays[:, 0])], rays[np.isfinite(rays[:, 0])]
    rotation = matrix(pose.wxyz)
    enu = rays @ rotation.T
    off_nadir = np.arctan2(np.hypot(enu[:, 0], enu[:, 1]), -enu[:, 2])
    level = enu[:, :2] / np.linalg.norm(enu[:, :2], axis=-1, keepdims=True)
    middle = np.mean(level, axis=0)
    azimuth_offset = np.arctan2(level[:, 0] * middle[1] - level[:, 1] * middle[0], level @ middle)
    lowest = float(np.min(off_nadir))
    scale = float(np.ptp(points @ down)) / max(float(np.ptp(off_nadir)), 1e-12)
    ends = np.arctan2(middle[0], middle[1]) + np.array([np.min(azimuth_offset), np.max(azimuth_offset)])
    flat = np.sin(lowest) * np.stack([np.sin(ends), np.cos(ends)], axis=-1)
    sides = pixels_from_rays(camera, np.column_stack([flat, np.full(2, -np.cos(lowest))]) @ rotation)
    return points, -off_nadir * scale, azimuth_offset * scale * np.sin(lowest), sides


def locate_box(
    box_px: tuple[float, float, float, float], down: FloatArray | None, edge_std_px: float = EDGE_STD_PX
) -> Silhouette:
    """Locate an upright object from its bounding box, of which only the middle can be told.

    Args:
        box_px: Left, top, right and bottom limit.
        down: See :func:`down_in_image`.
        edge_std_px: Of each limit.
    """
    left, top, right, bottom = box_px
    if down is None:
        return _locate_below(np.array([[left, top], [right, bottom]]), edge_std_px)
    centre, half = np.array([left + right, top + bottom]) / 2, np.array([right - left, bottom - top]) / 2
    lateral = _right_of(down)
    down_px, lateral_px = _border_distance(half, down), _border_distance(half, lateral)
    foot = centre + down_px * down
    lateral_std = math.hypot(edge_std_px, _FOOT_WIDTH_SHARE * 2 * lateral_px * _UNIFORM_STD)
    return Silhouette(
        foot_px=foot,
        foot_cov_px2=_foot_covariance(down, edge_std_px, lateral_std),
        top_px=centre - down_px * down,
        sides_px=np.array([foot - lateral_px * lateral, foot + lateral_px * lateral]),
        edge_std_px=edge_std_px,
        lateral_std_px=lateral_std,
    )


def _right_of(down: FloatArray) -> FloatArray:
    """Direction to the right of ``down (2,)``."""
    return np.array([down[1], -down[0]])


def _foot_covariance(down: FloatArray, vertical_px: float, lateral_px: float) -> FloatArray:
    """Covariance ``(2, 2)`` of a foot from standard deviations along and across the vertical."""
    right = _right_of(down)
    return np.asarray(vertical_px**2 * np.outer(down, down) + lateral_px**2 * np.outer(right, right))


def _border_distance(half: FloatArray, direction: FloatArray) -> float:
    """Distance from the centre of a box to its border along a direction."""
    return float(np.min(half / np.maximum(np.abs(direction), 1e-12)))


def _locate_below(outline_px: FloatArray, edge_std_px: float) -> Silhouette:
    """Locate an object right below the camera: within its outline, without height or sides."""
    low, high = np.min(outline_px, axis=0), np.max(outline_px, axis=0)
    centre = (low + high) / 2
    spread = np.hypot(edge_std_px, (high - low) * _UNIFORM_STD)
    sides = np.array([[low[0], centre[1]], [high[0], centre[1]]])
    return Silhouette(centre, np.diag(spread**2), centre, sides, float(np.max(spread)), float(np.max(spread)))


def _sample_outline(outline_px: FloatArray) -> FloatArray:
    """Sample a closed outline at equal steps ``(m, 2)``, so that long sides weigh as much as many short ones."""
    ends = np.roll(outline_px, -1, axis=0)
    lengths = np.linalg.norm(ends - outline_px, axis=-1)
    step = max(_SAMPLE_STEP_PX, float(np.sum(lengths)) / _MAX_SAMPLES)
    counts = np.maximum(np.ceil(lengths / step).astype(np.int64), 1)
    starts = np.repeat(np.cumsum(counts) - counts, counts)
    share = ((np.arange(len(starts)) - starts) / np.repeat(counts, counts))[:, None]
    return np.asarray(np.repeat(outline_px, counts, axis=0) * (1 - share) + np.repeat(ends, counts, axis=0) * share)


def _centre(points_px: FloatArray, side: FloatArray, band: BoolArray, low: FloatArray) -> tuple[FloatArray, float]:
    """Centre of a band of an outline, as low as its lowest point, and the lateral standard deviation."""
    rows = np.flatnonzero(band)
    rows = rows[np.argsort(side[rows], kind="stable")]
    ends = points_px[rows[[0, -1]]]
    lowest = points_px[int(np.argmax(low))]
    along = np.array([ends[1][1] - ends[0][1], ends[0][0] - ends[1][0]])
    length = float(np.linalg.norm(along))
    middle = np.mean(ends, axis=0)
    if length > 0:  # as low as the lowest point, between the ends
        middle = middle + (lowest - middle) @ along / length**2 * along
    return middle, _FOOT_WIDTH_SHARE * length * _UNIFORM_STD


def simplify_outline(outline_px: FloatArray) -> FloatArray:
    """Reduce a closed outline ``(n, 2)`` to at most 64 corners, its area nearly unchanged.

    Removes one by one the corner of the smallest triangle with its neighbours (Visvalingam and Whyatt 1993).
    """
    corners = outline_px
    while len(corners) > _MOST_CORNERS:
        to_last, to_next = np.roll(corners, 1, axis=0) - corners, np.roll(corners, -1, axis=0) - corners
        spans = np.abs(to_last[:, 0] * to_next[:, 1] - to_last[:, 1] * to_next[:, 0])
        corners = np.delete(corners, int(np.argmin(spans)), axis=0)
    return corners
