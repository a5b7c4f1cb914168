"""Covariances that people or calibrations state in full, checked before anything is computed with them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Self, TypeAlias

import numpy as np
import orjson
from pydantic import model_validator

from aerodft.adapters.config.keys import Matrix, impossible
from aerodft.adapters.config.reading import validated
from aerodft.adapters.config.tables import SiAttribute, Table
from aerodft.adapters.files import content_looks_like, looks_like, read_whole
from aerodft.errors import InputError, Reason, counted, located
from aerodft.model import FloatArray

Rows: TypeAlias = tuple[tuple[float, ...], ...]

POSE_ROWS: Final = "east, north, up, then rotation about the camera's x, y, z"
"""What the rows of a pose's covariance are about."""

_ROUNDING = 1e-6
"""Of the correlations: rows that were printed with seven digits still pass."""

_ROWS = "a JSON list of rows, each a list of numbers"


def check_covariance(rows: Rows | None, size: int, of: str) -> None:
    """Refuse a covariance that is not symmetric and positive semidefinite (for validators).

    Singular ones are fine: something is known exactly.

    Args:
        rows: The key ``covariance`` as it was stated, of finite numbers; None passes.
        size: How many rows of how many numbers it must have.
        of: What its rows are about, for messages.
    """
    if rows is None:
        return
    lengths = [len(row) for row in rows]
    if lengths != [size] * size:
        wrong = next((i for i, length in enumerate(lengths) if length != size), None)
        got = (
            counted(len(lengths), "row") if len(lengths) != size or wrong is None else f"{lengths[wrong]} in [{wrong}]"
        )
        raise impossible("covariance", got=got, expected=f"{size} rows of {size} numbers ({of})")
    cov = np.array(rows, dtype=np.float64)
    if np.any(np.diag(cov) < 0):
        got = _entry(cov, np.diag(np.diag(cov) < 0))
        raise impossible("covariance", got=got, expected="variances of 0 or more on its diagonal")
    stds = np.sqrt(np.diag(cov))
    uneven = np.abs(cov - cov.T) > _ROUNDING * np.outer(stds, stds)
    if np.any(uneven):
        got = f"{_entry(cov, uneven)} and {_entry(cov.T, uneven, mirrored=True)}"
        raise impossible("covariance", got=got, expected="the same number twice: it is symmetric")
    exact = stds == 0
    tied = (exact[:, None] | exact) & (cov != 0)
    if np.any(tied):
        expected = "0 in the rows and columns of what has no variance"
        raise impossible("covariance", got=_entry(cov, tied), expected=expected)
    scale = np.where(exact, 1.0, stds)
    lowest = float(np.linalg.eigvalsh(cov / np.outer(scale, scale))[0])
    if lowest < -_ROUNDING:
        expected = "none below 0: no combination of errors has a negative variance"
        raise impossible("covariance", got=f"correlations with an eigenvalue of {lowest:.4g}", expected=expected)


def check_lens_covariance(covariance: Rows | None, lens: Rows | None, count: int = 6) -> None:
    """Refuse a covariance with the lens without that of the pose, or of another size (for validators)."""
    if lens is None:
        return
    if covariance is None:
        raise impossible("lens_covariance", got=Reason("it stands without covariance"), expected="both")
    if len(lens) != count or len({len(row) for row in lens}) != 1:
        expected = f"{count} rows of as many as the lens has"
        raise impossible("lens_covariance", got=counted(len(lens), "row"), expected=expected)


def symmetric(rows: Sequence[Sequence[float]]) -> FloatArray:
    """A checked covariance ``(n, n)``, exactly symmetric; unchanged where it was that already."""
    cov = np.array(rows, dtype=np.float64)
    return np.asarray((cov + cov.T) / 2)


def as_rows(cov: FloatArray) -> Rows:
    """A covariance ``(n, n)`` as rows of plain numbers."""
    return tuple(tuple(row) for row in cov.tolist())


COVARIANCE: Final = SiAttribute(into=lambda rows: as_rows(symmetric(rows or ())), out=lambda rows: rows or None)
"""Of a key: its rows exactly symmetric, none where it is left out."""


def _entry(cov: FloatArray, bad: np.ndarray, *, mirrored: bool = False) -> str:
    """The first number that is bad, with its place; counted from 0, as keys are in all messages."""
    row, column = np.argwhere(bad)[0].tolist()
    place = f"[{column}][{row}]" if mirrored else f"[{row}][{column}]"
    return f"{place} = {float(cov[row, column])!r}"


class _PoseCovariance(Table):
    covariance: Matrix

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        check_covariance(self.covariance, 6, POSE_ROWS)
        return self


def load_covariance(path: Path) -> FloatArray:
    """Read a pose's covariance ``(6, 6)`` from a JSON file: a list of rows.

    Raises:
        InputError: Missing, unreadable, or none; see ``check_covariance``.
    """
    try:
        data = read_whole(path)
    except OSError:
        raise InputError("the covariance cannot be read", where=path, got=looks_like(path), expected=_ROWS) from None
    try:
        rows: Any = orjson.loads(data)
    except orjson.JSONDecodeError:
        raise InputError("not JSON", where=path, got=content_looks_like(data[:512]), expected=_ROWS) from None
    with located(path):
        return symmetric(validated(_PoseCovariance, {"covariance": rows}).covariance)
