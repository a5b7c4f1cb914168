"""Reading a log file piece by piece, with one clear sentence where that cannot be."""

import os
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.mavlink.kernels import AT_QUIET, AT_SYNC, Bytes
from aerodft.errors import InputError
from aerodft.model.arrays import IntArray
from aerodft.model.telemetry import RawBlock, WireProtocol

Scan = Callable[[Bytes, int, int, IntArray], tuple[int, int]]

PIECE_BYTES: Final = 1 << 22
_EXPECTED: Final = "a MAVLink .tlog or an ArduPilot .bin log"
_BEFORE, _AFTER = 1 << 10, 1 << 12  # bytes; scanners look back and ahead by less: what one message and a stamp take


@dataclass(frozen=True, slots=True)
class Piece:
    """Part of a log.

    Attributes:
        data: Its bytes, with some around it.
        first: Where they begin in the log.
        limit: Where in ``data`` the part ends; what is behind it there is only looked at.
    """

    data: Bytes
    first: int
    limit: int

    @property
    def stop(self) -> int:
        """Where the part ends in the log."""
        return self.first + self.limit

    def block(self, rows: IntArray, protocol: WireProtocol, sender: str, *, checked: bool = False) -> RawBlock:
        """What a scanner found in it: ``rows (3, n)`` of where in ``data``, how long, and when in us."""
        start, stop = int(rows[0, 0]), int(rows[0, -1] + rows[1, -1])
        return RawBlock(
            protocol=protocol,
            sender=sender,
            arrival_ns=rows[2] * 1000,
            offset=rows[0] - start,
            length=rows[1].copy(),
            data=self.data[start:stop].tobytes(),
            checked=checked,
        )


class LogFile:
    """A log's bytes; memory does not grow with it.

    It is not mapped into memory: to touch what somebody has cut off would end the process without a word.

    Args:
        path: The file.

    Attributes:
        path: The file.
        size: Its bytes when it was opened; what is written later is not read.

    Raises:
        InputError: It is missing, a folder, unreadable or empty.
    """

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise InputError("no such file", where=path, expected=_EXPECTED, hint="check the path")
        if path.is_dir():
            raise InputError("is a folder", where=path, expected=_EXPECTED, hint="name one file in it")
        self.path = path
        try:
            if path.stat().st_size == 0:  # asked first: to open a pipe would wait for somebody who writes
                raise InputError("the file is empty", where=path, got="0 bytes", expected=_EXPECTED)
            self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
            weakref.finalize(self, os.close, self._descriptor)
            self.size = os.fstat(self._descriptor).st_size
        except OSError as error:
            raise InputError("cannot be read", where=path, got=error.strerror or error, expected=_EXPECTED) from error

    def read(self, start: int, stop: int) -> bytes:
        """Bytes of the log; fewer where it ends before ``stop``.

        Raises:
            InputError: It cannot be read, or somebody has cut it.
        """
        parts = []
        stop = min(stop, self.size)
        while start < stop:
            try:
                parts.append(os.pread(self._descriptor, stop - start, start))
            except OSError as error:
                raise InputError("cannot be read", where=self.path, got=error.strerror or error) from error
            if not parts[-1]:
                got, expected = f"{start} bytes", f"{self.size} bytes, as when it was opened"
                raise InputError(
                    "the file became shorter while it was read", where=self.path, got=got, expected=expected
                )
            start += len(parts[-1])
        return parts[0] if len(parts) == 1 else b"".join(parts)

    def piece(self, at: int) -> Piece:
        """What comes from ``at`` on.

        Raises:
            InputError: It cannot be read, or somebody has cut it.
        """
        first = max(at - _BEFORE, 0)
        stop = min(at + PIECE_BYTES, self.size)
        return Piece(np.frombuffer(self.read(first, stop + _AFTER), dtype=np.uint8), first, stop - first)

    def scanned(self, scan: Scan, state: IntArray, most: int, stop: int) -> Iterator[tuple[Piece, IntArray]]:
        """What a scanner finds before ``stop`` at least.

        Args:
            scan: Of some bytes, from where, to where; fills ``rows`` as for ``Piece.block``; gives how many, and
                where to go on.
            state: ``(STATE_SIZE,)`` of it, at its beginning; its places are kept to the bytes of the piece.
            most: So many at once.
            stop: Nothing is looked for in pieces that begin there or behind.

        Yields:
            A piece, and the rows in it, valid until the next.
        """
        rows = np.empty((3, most), dtype=np.int64)
        at, piece = 0, Piece(np.empty(0, dtype=np.uint8), 0, 0)
        while at < stop:
            if at >= piece.stop:
                last, piece = piece, self.piece(at)
                state[[AT_SYNC, AT_QUIET]] -= piece.first - last.first
            found, end = scan(piece.data, at - piece.first, piece.limit, rows)
            at = piece.first + end
            if found:
                yield piece, rows[:, :found]


def wrong_type(path: Path, got: str, hint: str = "") -> InputError:
    """The refusal of a file that holds something else."""
    return InputError("wrong type of file", where=path, got=got, expected=_EXPECTED, hint=hint)
