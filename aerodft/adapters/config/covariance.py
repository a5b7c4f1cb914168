"""Covariances that people or calibrations state in full, checked before anything is computed with them."""

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
import orjson

from aerodft.adapters.config.tables import impossible
from aerodft.adapters.file_kind import check_is_no_pipe, content_looks_like, looks_like
from aerodft.conventions import LARGEST
from aerodft.errors import ConfigError, InputError
from aerodft.model import FloatArray

Rows: TypeAlias = tuple[tuple[float, ...], ...]

_ROUNDING = 1e-6
"""Of the correlations: rows that were printed with seven digits still pass."""

_ROWS = "a JSON list of rows, each a list of numbers"


def checked_covariance(
    rows: Sequence[Sequence[float]] | FloatArray, size: int, *, where: object, key: str = "covariance", of: str = ""
) -> FloatArray:
    """A stated covariance as a matrix that is finite, symmetric and positive semidefinite.

    Singular ones are fine: something is known exactly.

    Args:
        rows: The covariance as it was stated.
        size: How many rows of how many numbers it must have.
        where: File that it was stated in, for messages.
        key: What the covariance is called there.
        of: What its rows are about, for messages.

    Returns:
        ``(size, size)``, exactly symmetric; unchanged where it was that already.

    Raises:
        ConfigError: The rows are no covariance; names the entry.
    """
    shape = f"{size} rows of {size} numbers" + (f" ({of})" if of else "")
    lengths = [len(row) for row in rows]
    if lengths != [size] * size:
        wrong = next((i for i, length in enumerate(lengths) if length != size), None)
        got = f"{len(lengths)} rows" if len(lengths) != size or wrong is None else f"{lengths[wrong]} in [{wrong}]"
        raise ConfigError(key, where=where, got=got, expected=shape)
    cov = np.array(rows, dtype=np.float64)
    sound = np.abs(cov) <= LARGEST  # no number is not
    if not np.all(sound):
        raise ConfigError(key, where=where, got=_entry(cov, ~sound), expected=f"numbers up to {LARGEST:g}")
    if np.any(np.diag(cov) < 0):
        got = _entry(cov, np.diag(np.diag(cov) < 0))
        raise ConfigError(key, where=where, got=got, expected="variances of 0 or more on its diagonal")
    stds = np.sqrt(np.diag(cov))
    uneven = np.abs(cov - cov.T) > _ROUNDING * np.outer(stds, stds)
    if np.any(uneven):
        got = f"{_entry(cov, uneven)} and {_entry(cov.T, uneven, mirrored=True)}"
        raise ConfigError(key, where=where, got=got, expected="the same number twice: it is symmetric")
    _check_definite(cov, stds, where, key)
    return np.asarray((cov + cov.T) / 2)


def check_lens_covariance(covariance: Rows | None, lens: Rows | None, count: int = 6) -> None:
    """Refuse a covariance with the lens without that of the pose, or of another size (for validators)."""
    if lens is None:
        return
    if covariance is None:
        raise impossible("lens_covariance", got="it without covariance", expected="both")
    if len(lens) != count or len({len(row) for row in lens}) != 1:
        expected = f"{count} rows of as many as the lens has"
        raise impossible("lens_covariance", got=f"{len(lens)} rows", expected=expected)


def as_rows(cov: FloatArray) -> Rows:
    """A covariance ``(n, n)`` as rows of plain numbers."""
    return tuple(tuple(row) for row in cov.tolist())


def _check_definite(cov: FloatArray, stds: FloatArray, where: object, key: str) -> None:
    exact = stds == 0
    tied = (exact[:, None] | exact) & (cov != 0)
    if np.any(tied):
        expected = "0 in the rows and columns of what has no variance"
        raise ConfigError(key, where=where, got=_entry(cov, tied), expected=expected)
    scale = np.where(exact, 1.0, stds)
    lowest = float(np.linalg.eigvalsh(cov / np.outer(scale, scale))[0])
    if lowest < -_ROUNDING:
        raise ConfigError(
            key,
            where=where,
            got=f"correlations with an eigenvalue of {lowest:.4g}",
            expected="none below 0: no combination of errors has a negative variance",
        )


def _entry(cov: FloatArray, bad: np.ndarray, *, mirrored: bool = False) -> str:
    """The first number that is bad, with its place; counted from 0, as keys are in all messages."""
    row, column = np.argwhere(bad)[0].tolist()
    place = f"[{column}][{row}]" if mirrored else f"[{row}][{column}]"
    return f"{place} = {float(cov[row, column])!r}"


def load_covariance(path: Path) -> FloatArray:
    """Read a pose's covariance ``(6, 6)`` from a JSON file: a list of rows.

    Raises:
        InputError: Missing, unreadable, or none; see ``checked_covariance``.
    """
    try:
        check_is_no_pipe(path)
        data = path.read_bytes()
    except OSError:
        raise InputError("the covariance cannot be read", where=path, got=looks_like(path), expected=_ROWS) from None
    try:
        rows = orjson.loads(data)
    except orjson.JSONDecodeError:
        raise InputError("not JSON", where=path, got=content_looks_like(data[:512]), expected=_ROWS) from None
    if not (isinstance(rows, list) and rows and all(isinstance(row, list) and row for row in rows)):
        raise InputError("holds no covariance", where=path, got=content_looks_like(data[:512]), expected=_ROWS)
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise InputError(f"[{i}][{j}]", where=path, got=orjson.dumps(value).decode(), expected="a number")
    return checked_covariance(rows, 6, where=path)
