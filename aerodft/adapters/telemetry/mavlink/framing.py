"""A strict MAVLink 1 and 2 framer, and what their headers say.

A frame counts only with a known id, a possible length and the right checksum. After damage the framer resynchronises
byte by byte and never skips a claimed length, so an intact frame is never lost to a broken neighbour. Files and live
streams go through the same check (``kernels.probe``).
"""

from dataclasses import astuple, dataclass

import numpy as np
import numpy.typing as npt

from aerodft.adapters.telemetry.mavlink.dialect import frame_table
from aerodft.adapters.telemetry.mavlink.kernels import (
    AT_SYNC,
    MIN_FRAME,
    N_BAD_CRC,
    N_OK,
    N_SKIPPED,
    N_TRUNCATED,
    N_UNKNOWN,
    STATE_SIZE,
    copy_payloads,
    read_headers,
    scan_stream,
)
from aerodft.model import IntArray, RawBlock


@dataclass(frozen=True, slots=True)
class FrameCounts:
    """Counts of a framer: good and bad frames, and bytes between them.

    Attributes:
        frames: Good frames.
        bad_crc: Frames with a wrong checksum where a frame was due.
        unknown: Frames of messages that the dialect does not know, or not with this length, where a frame was due.
        skipped_bytes: Bytes that belong to no frame.
        truncated: Frames cut off by the end of the input.
    """

    frames: int = 0
    bad_crc: int = 0
    unknown: int = 0
    skipped_bytes: int = 0
    truncated: int = 0

    def __add__(self, other: "FrameCounts") -> "FrameCounts":
        """Sums of the counts of two framers."""
        return FrameCounts(*(own + more for own, more in zip(astuple(self), astuple(other), strict=True)))


def counts_of(state: IntArray) -> FrameCounts:
    """A scanner's counters."""
    return FrameCounts(*state[[N_OK, N_BAD_CRC, N_UNKNOWN, N_SKIPPED, N_TRUNCATED]].tolist())


@dataclass(frozen=True, slots=True, eq=False)
class FrameSpans:
    """The frames that are in some bytes.

    Attributes:
        data: The bytes.
        offset: ``(n,)`` where each begins.
        length: ``(n,)`` bytes of each.
        known: So many of the bytes are older than the others: what was left of those before.
    """

    data: bytes
    offset: IntArray
    length: IntArray
    known: int

    def each(self) -> list[bytes]:
        """The frames."""
        places = zip(self.offset.tolist(), self.length.tolist(), strict=True)
        return [self.data[start : start + size] for start, size in places]


class StreamFramer:
    """Cuts one sender's bytes into frames, however they were cut into reads."""

    def __init__(self) -> None:
        self._rest = b""
        self._seen_before = 0
        self._state = np.zeros(STATE_SIZE, dtype=np.int64)
        self._offsets = np.empty(64, dtype=np.int64)
        self._lengths = np.empty(64, dtype=np.int64)

    @property
    def counts(self) -> FrameCounts:
        """Counts of the stream so far."""
        return counts_of(self._state)

    def push(self, data: bytes) -> list[bytes]:
        """Whole frames that are complete with these bytes."""
        return self.spans(data).each()

    def spans(self, data: bytes) -> "FrameSpans":
        """Places of the frames that are complete with these bytes."""
        return self._scan(self._rest + data, known=len(self._rest))

    def flush(self) -> list[bytes]:
        """Frames in the remaining bytes, after which nothing follows."""
        return self._scan(self._rest, known=len(self._rest), given_up=len(self._rest)).each()

    def overdue(self) -> list[bytes]:
        """Frames behind one that was begun before the last call and is not whole yet: that one is cut.

        Without any it is waited for: the link may just have stopped.
        """
        state, rest, given_up = self._state.copy(), self._rest, self._seen_before
        frames = self._scan(rest, known=len(rest), given_up=given_up).each() if given_up else []
        if not frames:
            self._state, self._rest = state, rest
        self._seen_before = len(self._rest)
        return frames

    def _scan(self, data: bytes, *, known: int, given_up: int = 0) -> "FrameSpans":
        capacity = len(data) // MIN_FRAME + 1
        if capacity > len(self._offsets):
            self._offsets = np.empty(capacity, dtype=np.int64)
            self._lengths = np.empty(capacity, dtype=np.int64)
        found, done = scan_stream(
            np.frombuffer(data, dtype=np.uint8),
            given_up=given_up,
            table=frame_table(),
            offsets=self._offsets,
            lengths=self._lengths,
            state=self._state,
        )
        self._rest = data[done:]
        self._seen_before = max(self._seen_before - done, 0)
        self._state[AT_SYNC:] -= done
        return FrameSpans(data, self._offsets[:found].copy(), self._lengths[:found].copy(), known)


def headers(block: RawBlock) -> IntArray:
    """``(5, n)`` message id (-1: no good frame), system, component, payload's start and length (``read_headers``)."""
    heads = np.empty((5, len(block.offset)), dtype=np.int64)
    data = np.frombuffer(block.data, dtype=np.uint8)
    frames = np.stack([block.offset, block.length])
    read_headers(data, frames, frame_table(), heads, checked=block.checked)
    return heads


def payload_rows(block: RawBlock, places: IntArray, dtype: np.dtype[np.void]) -> npt.NDArray[np.void]:
    """Payloads of one message ``(k,)``, with zeros where they were cut off.

    Args:
        block: The frames.
        places: ``(2, k)`` start and length (bytes) of each payload in the block's bytes.
        dtype: What a whole payload is made of.
    """
    raw = np.zeros((places.shape[1], dtype.itemsize), dtype=np.uint8)
    copy_payloads(np.frombuffer(block.data, dtype=np.uint8), np.ascontiguousarray(places), raw)
    return raw.view(dtype)[:, 0]
