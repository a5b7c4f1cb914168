"""Log files read piece by piece: what all formats of telemetry logs share, and what a format has to say."""

import os
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol, TypeAlias, runtime_checkable

import numpy as np

from aerodft.adapters.files import check_is_no_pipe, hint_for_kind
from aerodft.adapters.telemetry.mavlink import AT_QUIET, AT_SYNC, STATE_SIZE, Bytes, FollowedIds, FrameCounts, counts_of
from aerodft.errors import InputError, os_errors_as
from aerodft.model import IntArray, RawBlock
from aerodft.service import Source, TelemetryDecoder

Scan = Callable[[Bytes, int, int, IntArray, IntArray], tuple[int, int]]

HEAD_BYTES: Final = 512
"""So much of a log's beginning is shown to the formats."""
PIECE_BYTES: Final = 1 << 20
_BEFORE: Final = 1 << 10  # bytes; scanners look back by less


class LogSource(Source, Protocol):
    """A recorded flight's telemetry."""

    @property
    def counts(self) -> FrameCounts:
        """Counts of the frames read so far."""
        ...

    def warnings(self) -> tuple[str, ...]:
        """Sentences on damage in the log; complete once ``events`` has ended."""
        ...


class LogFormat(Protocol):
    """A format of telemetry logs: a module, or an object, that has these.

    To add one, write such a module and name it in ``log_formats.LOG_FORMATS``.
    """

    @property
    def PROTOCOL(self) -> str:  # noqa: N802 - a module's constant
        """Mark of the format's blocks of raw frames, here and in recordings; formats of one protocol share it."""
        ...

    @property
    def TITLE(self) -> str:  # noqa: N802 - a module's constant
        """Words for such a file, for the sentence that refuses others: ``a MAVLink .tlog``."""
        ...

    def recognises(self, head: bytes) -> bool:
        """Whether a file that begins with these bytes, at most ``HEAD_BYTES``, is of this format."""
        ...

    def open_source(self, path: Path) -> LogSource:
        """Open a file of this format.

        Raises:
            InputError: It is missing, empty, unreadable, or of another format after all.
        """
        ...

    def new_decoder(self, followed: FollowedIds) -> TelemetryDecoder:
        """A decoder of its blocks, which follows one vehicle where the format has several."""
        ...


FrameNames: TypeAlias = tuple[IntArray, Mapping[int, str]]
"""Key of each frame ``(n,)``, negative for what is not listed; and the names of messages by key."""


@runtime_checkable
class NamesFrames(Protocol):
    """A decoder that knows the messages of its frames by name, for the lists of ``doctor``."""

    def frame_names(self, block: RawBlock) -> FrameNames:
        """The messages of a block that has been decoded."""
        ...


@runtime_checkable
class FolderFormat(LogFormat, Protocol):
    """A format whose logs may also be folders; a ``LogFormat`` that has this as well."""

    def recognises_folder(self, folder: Path) -> bool:
        """Whether a folder is a log of this format; ``open_source`` then takes it."""
        ...


@runtime_checkable
class VideoFormat(LogFormat, Protocol):
    """A format whose frames may also stand in a video's data track; a ``LogFormat`` that has this as well."""

    def recognises_video(self, path: Path) -> bool:
        """Whether a video carries this format; ``open_source`` then takes it."""
        ...


def rows_that_go_on(times_ns: Sequence[int | None]) -> list[int]:
    """Rows of a text log whose times ascend: a time that is off alone, ahead or back, is left out with its row."""
    following_ns: list[int | None] = [None] * len(times_ns)
    for k in range(len(times_ns) - 1, 0, -1):
        following_ns[k - 1] = times_ns[k] if times_ns[k] is not None else following_ns[k]
    kept: list[int] = []
    last_ns: int | None = None
    for k, (time_ns, next_ns) in enumerate(zip(times_ns, following_ns, strict=True)):
        if time_ns is None or (last_ns is not None and time_ns <= last_ns):
            continue
        if next_ns is not None and next_ns < time_ns and (last_ns is None or last_ns < next_ns):
            continue
        kept.append(k)
        last_ns = time_ns
    return kept


@dataclass(frozen=True, slots=True)
class Piece:
    """Part of a log.

    Attributes:
        raw: Its bytes, with some around it.
        first: Where they begin in the log.
        limit: Where in ``raw`` the part ends; what is behind it there is only looked at.
    """

    raw: bytes
    first: int
    limit: int

    @property
    def stop(self) -> int:
        """End of the part in the log."""
        return self.first + self.limit

    def block(self, rows: IntArray, protocol: str, sender: str, *, checked: bool = False) -> RawBlock:
        """Block of the frames that a scanner found: ``rows (3, n)`` of place in ``raw``, length, and us."""
        return RawBlock(
            protocol=protocol,
            sender=sender,
            arrival_ns=rows[2] * 1000,
            offset=rows[0],
            length=rows[1],
            data=self.raw,
            checked=checked,
        )


class LogFile:
    """A log's bytes, and what was scanned of them so far; memory does not grow with it.

    It is not mapped into memory: to touch what somebody has cut off would end the process without a word.

    Args:
        path: The file.
        expected: What would have been right, for the sentence that refuses a file.
        state_size: How many numbers its scanner keeps.

    Attributes:
        path: The file.
        size: Its bytes when it was opened; what is written later is not read.
        lookahead: Bytes behind a piece that a scanner is shown: as many as one message and a stamp take.

    Raises:
        InputError: It is missing, a folder, unreadable or empty.
    """

    lookahead: int = 1 << 12

    def __init__(self, path: Path, expected: str, state_size: int = STATE_SIZE) -> None:
        if not path.exists():
            raise InputError("no such file", where=path, expected=expected, hint="check the path")
        if path.is_dir():
            raise InputError("is a folder", where=path, expected=expected, hint="name one file in it")
        self.path = path
        self._expected = expected
        self._state = np.zeros(state_size, dtype=np.int64)
        with os_errors_as("cannot be read", where=path, expected=expected):
            check_is_no_pipe(path)
            if path.stat().st_size == 0:
                raise InputError("the file is empty", where=path, got="0 bytes", expected=expected)
            self._descriptor = self._open(path)
            weakref.finalize(self, os.close, self._descriptor)
            self.size = os.fstat(self._descriptor).st_size

    def _open(self, path: Path) -> int:
        """Descriptor of the bytes that are read."""
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)

    @property
    def counts(self) -> FrameCounts:
        """Counts of the frames read so far."""
        return counts_of(self._state)

    def read(self, start: int, stop: int) -> bytes:
        """Bytes of the log; fewer where it ends before ``stop``.

        Raises:
            InputError: It cannot be read, or somebody has cut it.
        """
        parts = []
        stop = min(stop, self.size)
        while start < stop:
            with os_errors_as("cannot be read", where=self.path):
                parts.append(os.pread(self._descriptor, stop - start, start))
            if not parts[-1]:
                got, expected = f"{start} bytes", f"{self.size} bytes, as when it was opened"
                raise InputError(
                    "the file became shorter while it was read", where=self.path, got=got, expected=expected
                )
            start += len(parts[-1])
        return parts[0] if len(parts) == 1 else b"".join(parts)

    def piece(self, at: int) -> Piece:
        """The file's bytes from an offset on, with some before and after.

        Raises:
            InputError: It cannot be read, or somebody has cut it.
        """
        first = max(at - _BEFORE, 0)
        stop = min(at + PIECE_BYTES, self.size)
        return Piece(self.read(first, stop + self.lookahead), first, stop - first)

    def scan_pieces(self, scan: Scan, most: int, stop: int) -> Iterator[tuple[Piece, IntArray]]:
        """Frames that a scanner finds, at least up to an offset; begins at the file's start.

        Args:
            scan: Of some bytes, from where, to where; fills ``rows`` as for ``Piece.block``, and updates its state,
                the places in which are kept to the bytes of the piece; gives how many, and where to go on.
            most: So many at once.
            stop: Nothing is looked for in pieces that begin there or behind.

        Yields:
            A piece, and the rows in it.
        """
        self._state = state = np.zeros_like(self._state)
        at, piece = 0, Piece(b"", 0, 0)
        while at < stop:
            if at >= piece.stop:
                last, piece = piece, self.piece(at)
                state[[AT_SYNC, AT_QUIET]] -= piece.first - last.first
            rows = np.empty((3, most), dtype=np.int64)
            found, end = scan(np.frombuffer(piece.raw, dtype=np.uint8), at - piece.first, piece.limit, rows, state)
            at = piece.first + end
            if found:
                yield piece, rows[:, :found]

    def wrong_type(self, got: str, hint: str = "") -> InputError:
        """The refusal of a file that holds something else."""
        hint = hint or hint_for_kind(got)
        return InputError("wrong type of file", where=self.path, got=got, expected=self._expected, hint=hint)
