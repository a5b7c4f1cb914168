"""Array types of all packages, and the read-only copy that a frozen value keeps of an array."""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
FloatLike: TypeAlias = float | FloatArray
ImageArray: TypeAlias = npt.NDArray[np.uint8]


def read_only(values: npt.ArrayLike, *, trailing: tuple[int, ...] = ()) -> FloatArray:
    """Read-only float64 copy of an array, its trailing shape checked.

    Args:
        values: Array-like, shape ``(..., *trailing)``.
        trailing: The shape that the last axes must have.

    Returns:
        A contiguous read-only copy.

    Raises:
        ValueError: The trailing shape differs.
    """
    array = np.array(values, dtype=np.float64, order="C")
    if trailing and array.shape[-len(trailing) :] != trailing:
        raise ValueError(f"got shape {array.shape}, expected (..., {', '.join(map(str, trailing))})")
    array.setflags(write=False)
    return array
