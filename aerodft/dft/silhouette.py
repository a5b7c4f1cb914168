"""What stands on the ground, from its outline in the image: where it stands, and its top and sides (paper, Section 4).

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
"""Of where an outline has its edge, unless whoever found it says better."""

_STEP_PX: Final = 0.5  # at which an outline's sides are sampled
_MOST_SAMPLES: Final = 200_000
_FOOT_PX: Final = 1.0  # so far above the lowest point the outline still belongs to the foot ...
_FOOT_SHARE: Final = 0.02  # ... or this share of its height: a pair of shoes side by side
_ASIDE: Final = 0.5  # of a box's or a foot's width, its middle half: somewhere there is what it stands on
_UNIFORM: Final = 1 / math.sqrt(12.0)
_UPRIGHT: Final = read_only([0.0, 1.0])
_TURN_RAD: Final = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """An upright object in the image, pixels.

    Attributes:
        foot_px: ``(2,)`` where it stands.
        foot_cov_px2: ``(2, 2)``.
        top_px: ``(2,)``.
        sides_px: ``(2, 2)`` its left and right limits, level with the foot.
        edge_std_px: Of where the outline has its edge.
        aside_std_px: Of the foot, across the vertical.
    """

    foot_px: FloatArray
    foot_cov_px2: FloatArray
    top_px: FloatArray
    sides_px: FloatArray
    edge_std_px: float
    aside_std_px: float


def down_in_image(camera: Camera, pose: Pose | None, outline_px: FloatArray) -> FloatArray | None:
    """Where down is at an object, as a direction ``(2,)`` of length 1 in the image.

    Args:
        camera: The camera.
        pose: Its pose; None for a camera that is upright as far as one knows.
        outline_px: ``(n, 2)``.

    Returns:
        None where there is no such direction: the object is right below the camera, or outside the lens model.
    """
    if pose is None:
        return _UPRIGHT
    low, high = np.min(outline_px, axis=0), np.max(outline_px, axis=0)
    ray = rays_from_pixels(camera, (low + high) / 2)
    if not np.all(np.isfinite(ray)):
        return None
    ray = ray / np.linalg.norm(ray)
    nadir = -matrix(pose.wxyz)[2]  # straight down, in camera axes
    nadir_px = pixels_from_rays(camera, nadir) if nadir[2] > 0 else np.full(2, np.nan)
    if np.all((nadir_px >= low) & (nadir_px <= high)):
        return None
    towards = nadir - (nadir @ ray) * ray
    length = float(np.linalg.norm(towards))
    if length < _TURN_RAD:
        return None
    ends = pixels_from_rays(camera, ray + np.array([[-0.5], [0.5]]) * _TURN_RAD * towards / length)
    step = ends[1] - ends[0]
    size = float(np.linalg.norm(step))
    return np.asarray(step / size) if math.isfinite(size) and size > 0 else None


def standing_outline(
    camera: Camera, pose: Pose | None, outline_px: FloatArray, edge_std_px: float = EDGE_STD_PX
) -> Standing:
    """An object from its outline.

    What is lowest is what is seen closest to straight down, not what is farthest along some direction of the image.

    Args:
        camera: The camera.
        pose: Its pose; None for a camera that is upright as far as one knows.
        outline_px: ``(n, 2)`` corners of the closed outline, where the object ends: not centres of its last pixels.
        edge_std_px: Of the outline.
    """
    down = down_in_image(camera, pose, outline_px)
    if down is None:
        return _seen_from_above(outline_px, edge_std_px)
    points = _sampled(outline_px)
    low, side, sides = points[:, 1], points[:, 0], None
    if pose is not None:
        points, low, side, sides = _by_nadir(camera, pose, points, down)
    lowest, highest = float(np.max(low)), float(np.min(low))
    near = max(_FOOT_PX, _FOOT_SHARE * (lowest - highest))
    foot_px, spread = _middle(points, side, low >= lowest - near, low)
    top_px, _ = _middle(points, side, low <= highest + near, -low)
    if sides is None or not np.all(np.isfinite(sides)):
        sides = np.array([[side.min(), lowest], [side.max(), lowest]])
    return Standing(
        foot_px=foot_px,
        foot_cov_px2=_covariance(down, edge_std_px, math.hypot(edge_std_px, spread)),
        top_px=top_px,
        sides_px=sides,
        edge_std_px=edge_std_px,
        aside_std_px=math.hypot(edge_std_px, spread),
    )


def _by_nadir(
    camera: Camera, pose: Pose, points_px: FloatArray, down: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Pixels inside the lens model ``(m, 2)``, how low each is and how far to the right ``(m,)``, in about pixels.

    Verticals have one azimuth each: those at both sides go down to where the lowest point is, ``(2, 2)`` pixels.
    """
    rays = rays_from_pixels(camera, points_px)
    points, rays = points_px[np.isfinite(rays[:, 0])], rays[np.isfinite(rays[:, 0])]
    rotation = matrix(pose.wxyz)
    enu = rays @ rotation.T
    off_nadir = np.arctan2(np.hypot(enu[:, 0], enu[:, 1]), -enu[:, 2])
    level = enu[:, :2] / np.linalg.norm(enu[:, :2], axis=-1, keepdims=True)
    middle = np.mean(level, axis=0)
    aside = np.arctan2(level[:, 0] * middle[1] - level[:, 1] * middle[0], level @ middle)
    lowest = float(np.min(off_nadir))
    scale = float(np.ptp(points @ down)) / max(float(np.ptp(off_nadir)), 1e-12)
    ends = np.arctan2(middle[0], middle[1]) + np.array([np.min(aside), np.max(aside)])
    flat = np.sin(lowest) * np.stack([np.sin(ends), np.cos(ends)], axis=-1)
    sides = pixels_from_rays(camera, np.column_stack([flat, np.full(2, -np.cos(lowest))]) @ rotation)
    return points, -off_nadir * scale, aside * scale * np.sin(lowest), sides


def standing_box(
    box_px: tuple[float, float, float, float], down: FloatArray | None, edge_std_px: float = EDGE_STD_PX
) -> Standing:
    """An object from the box around it, of which only the middle can be told: it is as upright as the vertical is.

    Args:
        box_px: Left, top, right and bottom limit.
        down: See :func:`down_in_image`.
        edge_std_px: Of each limit.
    """
    left, top, right, bottom = box_px
    if down is None:
        return _seen_from_above(np.array([[left, top], [right, bottom]]), edge_std_px)
    centre, half = np.array([left + right, top + bottom]) / 2, np.array([right - left, bottom - top]) / 2
    across = _across(down)
    reach_down, reach_aside = _exit(half, down), _exit(half, across)
    foot = centre + reach_down * down
    aside = math.hypot(edge_std_px, _ASIDE * 2 * reach_aside * _UNIFORM)
    return Standing(
        foot_px=foot,
        foot_cov_px2=_covariance(down, edge_std_px, aside),
        top_px=centre - reach_down * down,
        sides_px=np.array([foot - reach_aside * across, foot + reach_aside * across]),
        edge_std_px=edge_std_px,
        aside_std_px=aside,
    )


def _across(down: FloatArray) -> FloatArray:
    """To the right where ``down (2,)`` is down."""
    return np.array([down[1], -down[0]])


def _covariance(down: FloatArray, along_px: float, aside_px: float) -> FloatArray:
    across = _across(down)
    return np.asarray(along_px**2 * np.outer(down, down) + aside_px**2 * np.outer(across, across))


def _exit(half: FloatArray, direction: FloatArray) -> float:
    """How far it is from the middle of a box to its border."""
    return float(np.min(half / np.maximum(np.abs(direction), 1e-12)))


def _seen_from_above(outline_px: FloatArray, edge_std_px: float) -> Standing:
    """What is right below the camera stands somewhere within its outline; it shows neither height nor sides."""
    low, high = np.min(outline_px, axis=0), np.max(outline_px, axis=0)
    centre = (low + high) / 2
    spread = np.hypot(edge_std_px, (high - low) * _UNIFORM)
    sides = np.array([[low[0], centre[1]], [high[0], centre[1]]])
    return Standing(centre, np.diag(spread**2), centre, sides, float(np.max(spread)), float(np.max(spread)))


def _sampled(outline_px: FloatArray) -> FloatArray:
    """Points ``(m, 2)`` all along a closed outline, so that long sides count as much as short ones in a row."""
    ends = np.roll(outline_px, -1, axis=0)
    lengths = np.linalg.norm(ends - outline_px, axis=-1)
    step = max(_STEP_PX, float(np.sum(lengths)) / _MOST_SAMPLES)
    counts = np.maximum(np.ceil(lengths / step).astype(np.int64), 1)
    starts = np.repeat(np.cumsum(counts) - counts, counts)
    share = ((np.arange(len(starts)) - starts) / np.repeat(counts, counts))[:, None]
    return np.asarray(np.repeat(outline_px, counts, axis=0) * (1 - share) + np.repeat(ends, counts, axis=0) * share)


def _middle(points_px: FloatArray, side: FloatArray, chosen: BoolArray, low: FloatArray) -> tuple[FloatArray, float]:
    """The middle of what is lowest of an outline, and how far aside of it anything of that is, as a std."""
    rows = np.flatnonzero(chosen)
    rows = rows[np.argsort(side[rows], kind="stable")]
    ends = points_px[rows[[0, -1]]]
    lowest = points_px[int(np.argmax(low))]
    along = np.array([ends[1][1] - ends[0][1], ends[0][0] - ends[1][0]])
    length = float(np.linalg.norm(along))
    middle = np.mean(ends, axis=0)
    if length > 0:  # as low as the lowest point, between the ends
        middle = middle + (lowest - middle) @ along / length**2 * along
    return middle, _ASIDE * length * _UNIFORM


def corners_of(outline_px: FloatArray, most: int = 64) -> FloatArray:
    """A closed outline ``(n, 2)`` with at most so many corners, its area nearly unchanged.

    Left out is, one by one, the corner that spans the smallest triangle with its neighbours (Visvalingam and Whyatt
    1993).
    """
    corners = outline_px
    while len(corners) > most:
        to_last, to_next = np.roll(corners, 1, axis=0) - corners, np.roll(corners, -1, axis=0) - corners
        spans = np.abs(to_last[:, 0] * to_next[:, 1] - to_last[:, 1] * to_next[:, 0])
        corners = np.delete(corners, int(np.argmin(spans)), axis=0)
    return corners
