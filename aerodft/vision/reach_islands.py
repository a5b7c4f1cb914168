"""Islands of a reach, from what its images show of them across the same transects."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from aerodft.vision.river import River
from aerodft.vision.river_banks import Islands


class _Sight(NamedTuple):
    """What one image shows of one transect."""

    islands: int
    dry_m: float
    std_m: float


def common_islands(looks: Sequence[River], count: int) -> Islands:
    """The islands across each of ``count`` transects, as most images that measure its width show them.

    Where images disagree on how many islands there are, that is one error of all of them, and does not average out.
    """
    sights: list[list[_Sight]] = [[] for _ in range(count)]
    for look in looks:
        islands = look.islands
        for row in look.rows[look.used].tolist():
            sight = _Sight(int(islands.count[row]), float(islands.dry_m[row]), float(islands.std_m[row]))
            sights[row].append(sight)
    common = [_common(each) for each in sights]
    counts, dry, std = (np.array(column) for column in zip(*common, strict=True))
    return Islands(counts.astype(np.int64), dry, std)


def _common(sights: Sequence[_Sight]) -> _Sight:
    """What most images show; the more islands where as many show more."""
    if not sights:
        return _Sight(0, 0.0, 0.0)
    counts = np.array([each.islands for each in sights])
    most = max(counts.tolist(), key=lambda one: (int(np.sum(counts == one)), one))
    agree = [each for each in sights if each.islands == most]
    dry = np.array([each.dry_m for each in agree])
    stated = np.sqrt(np.mean(np.square([each.std_m for each in agree])))
    scatter = np.std(dry, ddof=1) if len(agree) > 1 else 0.0
    others = [each.dry_m - dry.mean() for each in sights if each.islands != most]
    doubt = np.sqrt(np.sum(np.square(others)) / len(sights))
    return _Sight(most, float(dry.mean()), float(np.hypot(max(stated, scatter) / np.sqrt(len(agree)), doubt)))
