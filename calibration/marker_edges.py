"""Corners and centres of markers to a few hundredths of a pixel: lines fitted to the edges of the black square.

Straight edges are straight lines only without distortion, so with a known lens lines are fitted to rays. A corner is
where two lines meet, and the centre where the diagonals do: it is the image of the square's centre from any side, which
the mean of the corners is not.
"""

from dataclasses import dataclass, fields
from typing import Final

import cv2
import numpy as np

from aerodft.geometry.lens import pixels_from_rays, rays_from_pixels
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.model.camera import Camera

_SAMPLES: Final = 24  # along an edge
_ENDS: Final = 0.1  # of an edge, next to its corners: not used
_TAPS: Final = 17  # across it
_PLATEAU: Final = 3  # taps at either end that tell black and white
_REACH: Final = 0.75  # of a module, across the edge to either side
_LEAST_REACH_PX, _MOST_REACH_PX = 1.2, 6.0
_CONTRAST: Final = 10.0  # grey values: less is no edge
_ROUNDS: Final = 3
_TOLERATED: Final = 3.0  # times the scatter
_LEAST_SCATTER_PX: Final = 0.05
_SHARE: Final = 0.4  # of an edge that must be seen
_CORRELATED_PX: Final = 1.5  # samples that are closer say the same: blur and the camera's own sharpening
_AT_END: Final = (1 + 12 * (0.5 / (1 - 2 * _ENDS)) ** 2) ** 0.5  # a fitted line's std at its corner over that of a mean
_ROUGH_STD_PX: Final = 1.0
_STRAYED_PX, _STRAYED = 2.0, 0.1  # or share of the longest side: corners that move farther have left their marker
_PARALLEL: Final = 1e-3  # sine of the angle between lines that never meet
_AHEAD: Final = 0.1  # cosine: rays farther from the axis are on no plane before the camera


@dataclass(frozen=True, slots=True, eq=False)
class Squares:
    """Refined markers.

    Attributes:
        corners_px: ``(m, 4, 2)``.
        corner_std_px: ``(m,)`` of each coordinate.
        centres_px: ``(m, 2)``.
        centre_std_px: ``(m,)`` of each coordinate.
    """

    corners_px: FloatArray
    corner_std_px: FloatArray
    centres_px: FloatArray
    centre_std_px: FloatArray

    def of(self, which: BoolArray) -> "Squares":
        """Some of them."""
        return Squares(*(getattr(self, each.name)[which] for each in fields(self)))

    def beside(self, more: "Squares") -> "Squares":
        """These and others."""
        return Squares(*(np.concatenate([getattr(self, each.name), getattr(more, each.name)]) for each in fields(self)))


def no_squares() -> Squares:
    """None of them."""
    return Squares(np.zeros((0, 4, 2)), np.zeros(0), np.zeros((0, 2)), np.zeros(0))


def refined(grey: ImageArray, rough_px: FloatArray, modules: int, camera: Camera | None = None) -> Squares:
    """Find the edges of markers anew, next to where a detector saw them.

    Where edges are not clear, the detector's corners stay, with a std of one pixel.

    Args:
        grey: ``(h, w)``.
        rough_px: ``(m, 4, 2)`` corners in order around each square, at least one.
        modules: Along a side, with the border's two.
        camera: Whose lens bends the edges; None to take them as straight.
    """
    nearer = _once(grey, rough_px, modules, camera)
    return _once(grey, nearer.corners_px, modules, camera)


def _once(grey: ImageArray, rough_px: FloatArray, modules: int, camera: Camera | None) -> Squares:
    edges_px, seen = _edges(grey, rough_px, modules)
    plane = _Plane(camera, np.concatenate([edges_px, rough_px[:, :, None]], axis=2))
    points, rough = plane.points[:, :, :-1], plane.points[:, :, -1]
    middles, along, scatter_px, clear = _lines(points, seen)
    corners, sines = _crossings(np.roll(middles, 1, 1), np.roll(along, 1, 1), middles, along)
    sides_px = np.linalg.norm(np.roll(rough_px, -1, 1) - rough_px, axis=-1)
    limit_px = np.maximum(_STRAYED_PX, _STRAYED * sides_px.max(axis=1, keepdims=True))
    good = np.all(clear & (np.linalg.norm(corners - rough, axis=-1) < limit_px), axis=1)
    corners = np.where(good[:, None, None], corners, rough)
    independent = np.clip(sides_px * (1 - 2 * _ENDS) / _CORRELATED_PX, 2.0, _SAMPLES)
    line_std_px = _AT_END * scatter_px / np.sqrt(independent)
    each_px = np.sqrt((line_std_px**2 + np.roll(line_std_px, 1, 1) ** 2) / 2) / np.maximum(np.abs(sines), _PARALLEL)
    corner_std_px = np.where(good, np.sqrt(np.mean(each_px**2, axis=1)), _ROUGH_STD_PX)
    diagonals = corners[:, 2:] - corners[:, :2]
    diagonals /= np.linalg.norm(diagonals, axis=-1, keepdims=True)
    centres, sines = _crossings(corners[:, 0], diagonals[:, 0], corners[:, 1], diagonals[:, 1])
    found_px = plane.pixels(np.concatenate([corners, centres[:, None]], axis=1))
    return Squares(
        corners_px=found_px[:, :4],
        corner_std_px=corner_std_px,
        centres_px=found_px[:, 4],
        centre_std_px=corner_std_px / np.sqrt(2) / np.maximum(np.abs(sines), _PARALLEL),
    )


class _Plane:
    """Points of markers where straight edges are straight, in pixels of the lens without its distortion."""

    def __init__(self, camera: Camera | None, pixels: FloatArray) -> None:
        self._camera = camera
        self.points = pixels
        self._flat = np.zeros(len(pixels), dtype=bool)
        if camera is None or not any(camera.distortion):
            return
        rays = rays_from_pixels(camera, pixels)
        ahead = rays[..., 2] > _AHEAD * np.linalg.norm(rays, axis=-1)
        self._flat = np.all(ahead | np.isnan(pixels[..., 0]), axis=(1, 2))
        with np.errstate(invalid="ignore", divide="ignore"):
            flat = rays[..., :2] / rays[..., 2:] * [camera.fx_px, camera.fy_px]
        self.points = np.where(self._flat[:, None, None, None], flat, pixels)

    def pixels(self, points: FloatArray) -> FloatArray:
        """``(m, k, 2)`` where the camera sees such points."""
        if self._camera is None or not self._flat.any():
            return points
        flat = points / [self._camera.fx_px, self._camera.fy_px]
        bent = pixels_from_rays(self._camera, np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1))
        return np.asarray(np.where(self._flat[:, None, None], bent, points))


def _edges(grey: ImageArray, corners_px: FloatArray, modules: int) -> tuple[FloatArray, BoolArray]:
    """``(m, 4, n, 2)`` pixels where black turns white, sample by sample along each edge, and where it does."""
    ends_px = np.roll(corners_px, -1, axis=1)
    along = ends_px - corners_px
    length_px = np.maximum(np.linalg.norm(along, axis=-1), 1e-9)
    turn = np.sign(_area(corners_px))[:, None, None]
    outward = np.stack([along[..., 1], -along[..., 0]], axis=-1) / length_px[..., None] * turn
    module_px = np.abs(_area(corners_px))[:, None] / length_px / modules
    reach_px = np.clip(_REACH * module_px, _LEAST_REACH_PX, _MOST_REACH_PX)
    shares = np.linspace(_ENDS, 1 - _ENDS, _SAMPLES)
    starts = corners_px[:, :, None] + shares[:, None] * along[:, :, None]
    steps = np.linspace(-1.0, 1.0, _TAPS)
    at = starts[..., None, :] + (reach_px[..., None, None, None] * steps[:, None]) * outward[:, :, None, None]
    flat = at.reshape(len(at) * 4, -1, 2).astype(np.float32)
    profiles = cv2.remap(grey, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR).astype(np.float64)
    offset, seen = _crossing(profiles.reshape(at.shape[:-1]), steps)
    edges = starts + (reach_px[..., None] * offset)[..., None] * outward[:, :, None]
    height, width = grey.shape
    inside = np.all((at >= 0) & (at <= [width - 1, height - 1]), axis=(-1, -2))
    seen &= inside
    return np.where(seen[..., None], edges, starts), seen


def _area(corners_px: FloatArray) -> FloatArray:
    """``(m,)``, above 0 where corners go clockwise on the image."""
    x, y = corners_px[..., 0], corners_px[..., 1]
    return np.asarray(0.5 * np.sum(x * np.roll(y, -1, -1) - y * np.roll(x, -1, -1), axis=-1))


def _crossing(profiles: FloatArray, steps: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Where profiles ``(..., taps)`` cross the middle between their ends, nearest to 0; and whether they do at all."""
    black, white = profiles[..., :_PLATEAU].mean(axis=-1), profiles[..., -_PLATEAU:].mean(axis=-1)
    above = profiles - ((black + white) / 2)[..., None]
    crosses = (above[..., :-1] < 0) & (above[..., 1:] >= 0)
    rise = np.where(crosses, above[..., 1:] - above[..., :-1], 1.0)
    offsets = steps[:-1] - above[..., :-1] / rise * (steps[1] - steps[0])
    nearest = np.argmin(np.where(crosses, np.abs(offsets), np.inf), axis=-1)[..., None]
    offset = np.take_along_axis(offsets, nearest, axis=-1)[..., 0]
    seen = crosses.any(axis=-1) & (white - black > _CONTRAST)
    return np.where(seen, offset, 0.0), seen


def _lines(points: FloatArray, seen: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Lines through points ``(m, 4, n, 2)``: a point on each, its direction, the scatter about it, whether it is clear.

    Points that stand off by more than chance are left out.
    """
    weights = seen.astype(np.float64)
    for _ in range(_ROUNDS):
        count = np.maximum(weights.sum(axis=-1), 1.0)
        middles = np.sum(weights[..., None] * points, axis=-2) / count[..., None]
        off = points - middles[..., None, :]
        xx, yy, xy = (np.sum(weights * off[..., a] * off[..., b], axis=-1) for a, b in ((0, 0), (1, 1), (0, 1)))
        angle = 0.5 * np.arctan2(2 * xy, xx - yy)
        along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        away = np.abs(off[..., 0] * along[..., None, 1] - off[..., 1] * along[..., None, 0])
        scatter_px = np.sqrt(np.sum(weights * away**2, axis=-1) / np.maximum(count - 2, 1.0))
        typical = 1.4826 * np.median(np.where(seen, away, np.inf), axis=-1)
        limit = _TOLERATED * np.maximum(np.minimum(typical, scatter_px), _LEAST_SCATTER_PX)
        kept, weights = weights, (seen & (away <= limit[..., None])).astype(np.float64)
    clear = kept.sum(axis=-1) >= _SHARE * _SAMPLES
    return middles, along, np.maximum(scatter_px, _LEAST_SCATTER_PX), clear


def _crossings(a: FloatArray, along_a: FloatArray, b: FloatArray, along_b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where lines meet ``(..., 2)``, and the sine of the angle between them; not finite where they are parallel."""
    sine = along_a[..., 0] * along_b[..., 1] - along_a[..., 1] * along_b[..., 0]
    gap = b - a
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (gap[..., 0] * along_b[..., 1] - gap[..., 1] * along_b[..., 0]) / sine
        return a + share[..., None] * along_a, sine
