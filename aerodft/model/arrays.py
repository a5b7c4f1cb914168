"""Array types of all packages, the read-only copy that a frozen value keeps of an array, and values in columns."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self, TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
FloatLike: TypeAlias = float | FloatArray
ImageArray: TypeAlias = npt.NDArray[np.uint8]
Selection: TypeAlias = BoolArray | IntArray | slice


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """``n`` things of a kind in columns: fields that are arrays ``(n, ...)`` or batches; other fields are common."""

    def rows(self, rows: Selection) -> Self:
        """The things of a mask ``(n,)``, of indices ``(m,)`` or of a slice."""
        columns = {each.name: getattr(self, each.name) for each in fields(self)}
        for name, column in columns.items():
            if isinstance(column, np.ndarray):
                columns[name] = column[rows]
            elif isinstance(column, Batch):
                columns[name] = column.rows(rows)
        return type(self)(**columns)

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """The things of several batches, at least one, in order; what is common is the first one's."""
        if len(parts) == 1:
            return parts[0]
        columns = {each.name: [getattr(part, each.name) for part in parts] for each in fields(cls)}
        arrays = {name: np.concatenate(each) for name, each in columns.items() if isinstance(each[0], np.ndarray)}
        batches = {name: each[0].concatenate(each) for name, each in columns.items() if isinstance(each[0], Batch)}
        return replace(parts[0], **arrays, **batches)


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
