"""Opening a log file for reading, with one clear sentence where that cannot be."""

from pathlib import Path

import numpy as np

from aerodft.adapters.filetype import looks_like
from aerodft.adapters.mavlink.layout import Bytes
from aerodft.errors import InputError


def map_log(path: Path, expected: str) -> Bytes:
    """Map a log into memory, read-only; the pages come from disk as they are touched.

    Args:
        path: The file.
        expected: What it should be, for the refusal.

    Returns:
        ``(n,)`` uint8, n > 0.

    Raises:
        InputError: It is missing, a folder, unreadable or empty.
    """
    if not path.exists():
        raise InputError("no such file", where=path, expected=expected, hint="check the path")
    if path.is_dir():
        raise InputError("is a folder", where=path, expected=expected, hint="name one file in it")
    try:
        if path.stat().st_size == 0:
            raise InputError("the file is empty", where=path, got="0 bytes", expected=expected)
        return np.memmap(path, dtype=np.uint8, mode="r").view(np.ndarray)
    except OSError as error:
        raise InputError("cannot be read", where=path, got=error.strerror or error, expected=expected) from error


def check_length(path: Path, data: Bytes) -> None:
    """Make sure that a mapped log is as long as it was: to touch what is gone would end the process without a word.

    Args:
        path: The file.
        data: What ``map_log`` gave.

    Raises:
        InputError: Somebody has cut it.
    """
    try:
        size = path.stat().st_size
    except OSError:  # it was deleted or moved: the mapping keeps what it had
        return
    if size < len(data):
        got, expected = f"{size} bytes", f"{len(data)} bytes, as when it was opened"
        raise InputError("the file became shorter while it was read", where=path, got=got, expected=expected)


def wrong_type(path: Path, expected: str, *, got: str | None = None, hint: str = "") -> InputError:
    """The refusal of a file that holds something else."""
    return InputError("wrong type of file", where=path, got=got or looks_like(path), expected=expected, hint=hint)
