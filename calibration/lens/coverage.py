"""Which views of a board a lens is calibrated from, and what they leave open, in sentences.

Used are those that are sharp, different, and all over the image.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.geometry.intrinsics import rays_by_intrinsics
from aerodft.geometry.lens import distorted_with_jacobian, pixels_from_rays, rays_from_pixels
from aerodft.geometry.rotation import skew
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from calibration.lens.adjustment import View, with_coefficients
from calibration.lens.solution import LensSolution, largest_turn_rad, normals

MOST_VIEWS: Final = 40
_CELLS: Final = (9, 6)  # of the image, across and down
_SHARP_PX, _BLURRED = 3.0, 1.8  # always sharp enough; times the sharper quarter's
_NEAR_DUPLICATE = 0.01  # of the image's diagonal, between the same corners
_TILT_STEP_RAD = math.radians(15.0)
_WEIGHTS: Final = {"cell": 1.0, "tilt": 6.0, "size": 3.0}
_REGION: Final = (3, 2)  # cells of each of nine regions
_REGIONS: Final = (
    ("upper left", "top", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "bottom", "lower right"),
)
_COVERED = 0.34  # of a region's cells
_GOOD_TURN_DEG = 30.0
_GOOD_SIZE = 0.33  # of the image's width or height
_GOOD_VIEWS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """Which views are used, and why the others are not.

    Attributes:
        used: In the order in which they were seen.
        blurred: Much less sharp than others.
        duplicates: Nearly the same as another one, which is sharper.
        surplus: They show nothing that others do not show already.
    """

    used: tuple[View, ...]
    blurred: tuple[View, ...]
    duplicates: tuple[View, ...]
    surplus: tuple[View, ...]


def choose(views: Sequence[View], size_px: tuple[int, int], most: int = MOST_VIEWS) -> Choice:
    """Choose at most so many views.

    Args:
        views: Those that show the board; at least one.
        size_px: Width and height of the images.
        most: How many may be used.
    """
    limit_px = max(_SHARP_PX, _BLURRED * float(np.quantile([view.edge_px for view in views], 0.25)))
    sharp = [view for view in views if view.edge_px <= limit_px]
    kept = _different(sorted(sharp, key=lambda view: view.edge_px), _NEAR_DUPLICATE * math.hypot(*size_px))
    used = _covering(kept, size_px, most)
    return Choice(
        used=_in_order(views, used),
        blurred=tuple(view for view in views if view.edge_px > limit_px),
        duplicates=_in_order(sharp, [view for view in sharp if view not in kept]),
        surplus=_in_order(kept, [view for view in kept if view not in used]),
    )


def _in_order(views: Sequence[View], wanted: Sequence[View]) -> tuple[View, ...]:
    return tuple(view for view in views if view in wanted)


def _different(views: Sequence[View], least_px: float) -> list[View]:
    """The first of those that are nearly the same."""
    kept: list[View] = []
    for view in views:
        if all(_moved_px(view, other) > least_px for other in kept):
            kept.append(view)
    return kept


def _moved_px(one: View, other: View) -> float:
    """How far the corners that both show are apart, root mean square; infinite where few are the same."""
    _, mine, theirs = np.intersect1d(one.ids, other.ids, assume_unique=True, return_indices=True)
    if 2 * len(mine) < max(len(one.ids), len(other.ids)):
        return math.inf
    apart = one.pixels_px[mine] - other.pixels_px[theirs]
    return math.sqrt(float(np.mean(np.sum(apart * apart, axis=-1))))


def _covering(views: Sequence[View], size_px: tuple[int, int], most: int) -> list[View]:
    """Greedy: what few others show counts most, and of equals the sharper one (they come first) is taken."""
    if len(views) <= most:
        return list(views)
    features = _features(views, size_px)
    seen: Counter[tuple[str, int, int]] = Counter()
    rest = list(range(len(views)))
    used: list[View] = []
    while len(used) < most:
        best = max(rest, key=lambda k: (sum(_WEIGHTS[f[0]] / (1 + seen[f]) for f in features[k]), -k))
        rest.remove(best)
        used.append(views[best])
        seen.update(features[best])
    return used


def _features(views: Sequence[View], size_px: tuple[int, int]) -> list[set[tuple[str, int, int]]]:
    """What each view shows: cells of the image, a tilt in steps of 15 degrees, a size in octaves."""
    found = []
    for view, facing in zip(views, normals(views, size_px), strict=True):
        shown = {("cell", int(x), int(y)) for x, y in cells(view, size_px)}
        turned = np.rint(facing[:2] * np.where(facing[2] < 0, -1.0, 1.0) / _TILT_STEP_RAD).astype(int)
        shown.add(("tilt", int(turned[0]), int(turned[1])))
        size = np.ptp(view.pixels_px, axis=0) / size_px
        shown.add(("size", round(2 * math.log2(max(float(np.max(size)), 1e-3))), 0))
        found.append(shown)
    return found


def cells(view: View, size_px: tuple[int, int]) -> np.ndarray:
    """``(m, 2)`` the cells of the image (across, down) that hold corners of a view."""
    share = (view.pixels_px + 0.5) / size_px
    return np.unique(np.clip((share * _CELLS).astype(int), 0, np.array(_CELLS) - 1), axis=0)


def covered_cells(views: Sequence[View], size_px: tuple[int, int]) -> np.ndarray:
    """``(down, across)`` how many views have corners in each cell of the image."""
    counts = np.zeros(_CELLS[::-1], dtype=int)
    for view in views:
        across, down = cells(view, size_px).T
        counts[down, across] += 1
    return counts


def missing(solution: LensSolution) -> tuple[str, ...]:
    """Sentences on what would make the calibration better; none where nothing is missing."""
    views, size_px = solution.views, (solution.camera.width_px, solution.camera.height_px)
    sentences = []
    open_regions = _open_regions(covered_cells(views, size_px) > 0)
    if open_regions:
        where = " or ".join([", ".join(open_regions[:-1]), open_regions[-1]] if len(open_regions) > 1 else open_regions)
        sentences.append(f"hardly any corners in the {where} of the image: hold the board there")
    turn_deg = math.degrees(largest_turn_rad(solution.bundle.rotations[:, :, 2]))
    if turn_deg < _GOOD_TURN_DEG:
        sentences.append(
            f"the boards are turned by at most {turn_deg:.0f} deg from each other:"
            " tilt them by 30 to 45 deg to the left, right, top and bottom"
        )
    largest = max(float(np.max(np.ptp(view.pixels_px, axis=0) / size_px)) for view in views)
    if largest < _GOOD_SIZE:
        sentences.append(f"the board never fills more than {100 * largest:.0f} % of the image: come closer")
    if len(views) < _GOOD_VIEWS:
        sentences.append(f"{len(views)} views are few: 15 to 40 make the lens better known")
    return tuple(sentences)


def _open_regions(covered: np.ndarray) -> list[str]:
    across, down = _REGION
    found = []
    for row, names in enumerate(_REGIONS):
        for column, name in enumerate(names):
            region = covered[row * down : (row + 1) * down, column * across : (column + 1) * across]
            if np.mean(region) < _COVERED:
                found.append(name)
    return found


def distortion_px(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    """How far the lens moves pixels ``(..., 2)`` from where it would have them with coefficients of 0.

    That is a pinhole for a Brown lens, and for a fisheye one whose pixels are apart as angles are. NaN where the lens
    has no inverse.
    """
    ideal = with_coefficients(camera, 0)
    return np.asarray(pixels_px - pixels_from_rays(ideal, rays_from_pixels(camera, pixels_px)))


def ray_std_px(camera: Camera, cov: FloatArray, pixels_px: FloatArray) -> FloatArray:
    """How well the rays of pixels ``(n, 2)`` are known, in pixels: the longer half axis of one sigma, ``(n,)``.

    A part of that is as if the whole camera were turned, which a pose that is found with this camera makes up for; it
    is left out.

    Args:
        camera: The camera, with its covariance.
        cov: Of its intrinsics.
        pixels_px: Pixels; those that the lens has no inverse for are NaN.
    """
    rays = rays_from_pixels(camera, pixels_px)
    sound = np.all(np.isfinite(rays), axis=-1)
    rays = rays[sound]
    by_ray = distorted_with_jacobian(camera, rays)[1] * np.array([[camera.fx_px], [camera.fy_px]])
    by_intrinsics = by_ray @ rays_by_intrinsics(camera, pixels_px[sound])
    flat, turned = by_intrinsics.reshape(-1, len(cov)), (by_ray @ skew(rays)).reshape(-1, 3)
    left = (flat - turned @ np.linalg.lstsq(turned, flat, rcond=None)[0]).reshape(-1, 2, len(cov))
    found = np.full(len(pixels_px), np.nan)
    found[sound] = np.sqrt(np.linalg.eigvalsh(left @ cov @ left.swapaxes(-1, -2))[:, -1].clip(0))
    return found
