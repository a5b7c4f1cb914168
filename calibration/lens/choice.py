"""Which views of a board a lens is calibrated from: sharp, different, and all over the image."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from calibration.lens.adjustment import View
from calibration.lens.solution import normals

MOST_VIEWS: Final = 40
_CELLS: Final = (9, 6)  # of the image, across and down
_SHARP_PX, _BLURRED = 3.0, 1.8  # always sharp enough; times the sharper quarter's
_NEAR_DUPLICATE = 0.01  # of the image's diagonal, between the same corners
_TILT_STEP_RAD = math.radians(15.0)
_WEIGHTS: Final = {"cell": 1.0, "tilt": 6.0, "size": 3.0}


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


def cells(view: View, size_px: tuple[int, int], grid: tuple[int, int] = _CELLS) -> np.ndarray:
    """``(m, 2)`` the cells of the image (across, down) that hold corners of a view."""
    share = (view.pixels_px + 0.5) / size_px
    return np.unique(np.clip((share * grid).astype(int), 0, np.array(grid) - 1), axis=0)
