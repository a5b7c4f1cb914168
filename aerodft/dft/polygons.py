"""Whether the corners of a polygon, in their order, go round one piece of ground."""

from typing import Final

import numpy as np
import numpy.typing as npt

from aerodft.model.arrays import FloatArray

_ROUNDING: Final = 1e-10
"""Of the square of the polygon's size: a corner that is nearer to a side than this share of the size lies on it."""


def crosses_itself(points_enu_m: FloatArray) -> bool:
    """Whether the closed polygon ``(k, 3)`` crosses or touches itself, on the map: its area would be something else.

    Corners that are named twice in a row count once. Sides that go back on each other, and fewer than three corners,
    touch as well.
    """
    corners = points_enu_m[:, :2]
    corners = corners[np.any(corners != np.roll(corners, 1, axis=0), axis=1)]
    count = len(corners)
    if count < 3:  # noqa: PLR2004 - corners of a triangle
        return True
    ends, tiny = np.roll(corners, -1, axis=0), _ROUNDING * float(np.max(np.ptp(corners, axis=0))) ** 2
    onward = np.roll(ends, -1, axis=0)
    back = (np.abs(_turns(corners, ends, onward)) <= tiny) & (np.sum((ends - corners) * (onward - ends), axis=1) < 0)
    first, second = np.triu_indices(count, 2)
    apart = (first != 0) | (second != count - 1)  # the last side and the first are neighbours
    first, second = first[apart], second[apart]
    return bool(np.any(back) or np.any(_meet(corners[first], ends[first], corners[second], ends[second], tiny)))


def _meet(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, tiny: float) -> npt.NDArray[np.bool_]:
    """Whether segments from ``a`` to ``b`` and from ``c`` to ``d``, ``(n, 2)`` each, have a point in common."""
    sides = [_signs(_turns(*three), tiny) for three in ((a, b, c), (a, b, d), (c, d, a), (c, d, b))]
    crossing = (sides[0] * sides[1] < 0) & (sides[2] * sides[3] < 0)
    touching = np.zeros(len(a), dtype=bool)
    for side, start, end, point in zip(sides, (a, a, c, c), (b, b, d, d), (c, d, a, b), strict=True):
        touching |= (side == 0) & np.all((np.minimum(start, end) <= point) & (point <= np.maximum(start, end)), axis=1)
    return np.asarray(crossing | touching)


def _turns(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Twice the signed areas ``(n,)`` of triangles."""
    u, v = b - a, c - a
    return np.asarray(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def _signs(turns: FloatArray, tiny: float) -> FloatArray:
    return np.where(np.abs(turns) <= tiny, 0.0, np.sign(turns))
