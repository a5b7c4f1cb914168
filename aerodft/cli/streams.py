"""Standard streams that may be closed, full, or a pipe that nobody reads: said once, never a traceback."""

import io
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Final, cast

from aerodft.errors import InputError

_FIRST_THREE: Final = range(3)


class ReaderGone(Exception):  # noqa: N818 - no error: whoever read stdout has seen enough
    """The pipe behind stdout was closed at its other end."""


class _Guarded(io.FileIO):
    """A file that fails once, as it is told to, and takes everything from then on.

    Else the buffer above it would fail again when the interpreter ends.
    """

    def __init__(self, descriptor: int, fail: Callable[[OSError], None]) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self._fail = fail
        self._is_lost = False

    def write(self, data: bytes | memoryview, /) -> int:  # type: ignore[override]  # of the buffer, never None
        """Write, or fail as told."""
        if not self._is_lost:
            try:
                return super().write(data) or 0
            except OSError as error:
                self._is_lost = True
                self._fail(error)
        return len(data)


def guard_streams() -> None:
    """Make the three standard streams ones that fail in a sentence, where they are the process's own.

    A closed one is opened on nothing: else the next file opened would take its place, and what C libraries print.
    stdout raises ``ReaderGone``, or ``InputError`` where it cannot be written; stderr is silent then, because nobody
    is left to tell.
    """
    for descriptor in _FIRST_THREE:
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    if sys.stdout is None or sys.stdout is sys.__stdout__:
        sys.stdout = _wrapped(1, _fail_stdout)
    if sys.stderr is None or sys.stderr is sys.__stderr__:
        sys.stderr = _wrapped(2, lambda _: None)


def flush_stdout() -> None:
    """Write out what is buffered, while there is still somebody to say that it failed."""
    with suppress(ValueError):  # closed already
        sys.stdout.flush()


def _wrapped(descriptor: int, fail: Callable[[OSError], None]) -> io.TextIOWrapper:
    raw = _Guarded(descriptor, fail)
    return io.TextIOWrapper(
        io.BufferedWriter(cast("io.RawIOBase", raw)),
        encoding="utf-8",
        errors="backslashreplace",
        line_buffering=raw.isatty() or descriptor != 1,
        write_through=descriptor != 1,
    )


def _fail_stdout(error: OSError) -> None:
    if isinstance(error, BrokenPipeError):
        raise ReaderGone from error
    raise InputError("the output cannot be written", where="stdout", got=error.strerror) from error
