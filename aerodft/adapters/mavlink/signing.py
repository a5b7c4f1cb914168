"""MAVLink 2 message signing: who holds the key is believed, once and in order; nobody else is.

The rules are those of the protocol's guide (48-bit time stamps in steps of 10 us since 2015, kept for every system,
component and link id), with two differences that keep forged frames out: the hash is checked before anything is
remembered, and a frame from more than a minute ahead is refused, so that no stray clock locks everybody else out.
"""

import hashlib
import hmac
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from aerodft.adapters.mavlink.dialect import frame_table
from aerodft.adapters.mavlink.kernels import checksum
from aerodft.adapters.mavlink.layout import SIGNATURE, SIGNED, V2
from aerodft.adapters.mavlink.signing_state import SigningState, StreamKey

KEY_SIZE: Final = 32
# Why a frame is refused.
UNSIGNED: Final = "unsigned"
WRONG: Final = "wrong signature"
REPLAYED: Final = "replayed or late"
OLD: Final = "too old for a new sender"
FUTURE: Final = "far in the future"

_FLAGS_AT: Final = 2
_HASH: Final = 6
_STEP_NS: Final = 10_000
_EPOCH_NS: Final = 1_420_070_400 * 10**9  # 2015-01-01
_MINUTE: Final = 60 * 10**9 // _STEP_NS


@dataclass(frozen=True, slots=True, kw_only=True)
class SigningCounts:
    """What became of a signed link's frames.

    Attributes:
        verified: Frames with a good signature and a fresh time stamp.
        unsigned: Frames without a signature that were let in, because their message is listed.
        refused: Frames that were not let in, by reason.
    """

    verified: int = 0
    unsigned: int = 0
    refused: dict[str, int] = field(default_factory=dict)


def signing_time(unix_ns: int) -> int:
    """UTC as a signature's time stamp; 0 before 2015."""
    return max((unix_ns - _EPOCH_NS) // _STEP_NS, 0)


def sign(frame: bytes, key: bytes, *, link_id: int, stamp: int) -> bytes:
    """An unsigned MAVLink 2 frame with its signature.

    Args:
        frame: The whole frame.
        key: 32 bytes.
        link_id: Of the link it is sent on, 0 to 255.
        stamp: From ``signing_time``, more than the one before.

    Raises:
        ValueError: MAVLink 1, or signed already.
    """
    if frame[0] != V2 or frame[_FLAGS_AT] & SIGNED:
        raise ValueError("only an unsigned MAVLink 2 frame can be signed")
    extra = int(frame_table()[int.from_bytes(frame[7:10], "little")]) & 0xFF
    body = bytearray(frame[:-2])
    body[_FLAGS_AT] |= SIGNED
    crc = checksum(np.frombuffer(body, dtype=np.uint8), 1, len(body), extra)
    signed = bytes(body) + crc.to_bytes(2, "little") + bytes([link_id]) + stamp.to_bytes(6, "little")
    return signed + _digest(key, signed)


def _digest(key: bytes, signed: bytes) -> bytes:
    return hashlib.sha256(key + signed).digest()[:_HASH]


def _stream(frame: bytes, link_id: int) -> StreamKey:
    return frame[5], frame[6], link_id


class SignatureCheck:
    """Lets the frames of one link pass that its key has signed; signs what is sent on it. For one thread.

    Args:
        key: 32 bytes.
        state: What was known when the link was last open; written to while frames pass.
        now_ns: Host UTC, as good as it is known at the moment.
        link_id: Of what is sent.
        unsigned_ids: Messages that pass without a signature.
    """

    def __init__(
        self,
        key: bytes,
        state: SigningState,
        now_ns: Callable[[], int],
        *,
        link_id: int = 0,
        unsigned_ids: frozenset[int] = frozenset(),
    ) -> None:
        self._key = key
        self._state = state
        self._now_ns = now_ns
        self._link_id = link_id
        self._unsigned_ids = unsigned_ids
        self._verified = 0
        self._unsigned = 0
        self._refused: Counter[str] = Counter()

    @property
    def counts(self) -> SigningCounts:
        """What was seen so far."""
        return SigningCounts(verified=self._verified, unsigned=self._unsigned, refused=dict(self._refused))

    def passed(self, frames: Sequence[bytes]) -> list[bytes]:
        """Those of whole, intact frames that may be believed, in their order."""
        known = max(signing_time(self._now_ns()), self._state.latest)
        return [frame for frame in frames if self._believes(frame, known)]

    def _believes(self, frame: bytes, known: int) -> bool:
        if frame[0] != V2 or not frame[_FLAGS_AT] & SIGNED:
            return self._takes_unsigned(frame)
        reason = self._fault(frame, known)
        if reason:
            self._refused[reason] += 1
            return False
        self._verified += 1
        return True

    def _takes_unsigned(self, frame: bytes) -> bool:
        message_id = int.from_bytes(frame[7:10], "little") if frame[0] == V2 else frame[5]
        if message_id not in self._unsigned_ids:
            self._refused[UNSIGNED] += 1
            return False
        self._unsigned += 1
        return True

    def _fault(self, frame: bytes, known: int) -> str:
        """Why a signed frame is not believed, empty where it is; only then its time stamp is remembered."""
        if not hmac.compare_digest(_digest(self._key, frame[:-_HASH]), frame[-_HASH:]):
            return WRONG
        stream, stamp = _stream(frame, frame[-SIGNATURE]), int.from_bytes(frame[-12:-_HASH], "little")
        last = self._state.streams.get(stream)
        if last is not None and stamp <= last:
            return REPLAYED
        if last is None and stamp + _MINUTE < known:
            return OLD
        if stamp > known + _MINUTE:
            return FUTURE
        self._state.note(stream, stamp)
        return ""

    def sign(self, frame: bytes) -> bytes:
        """An own MAVLink 2 frame, signed for this link; its echo is no news."""
        stamp = max(signing_time(self._now_ns()), self._state.latest + 1)
        self._state.note(_stream(frame, self._link_id), stamp)
        return sign(frame, self._key, link_id=self._link_id, stamp=stamp)

    def settle(self) -> None:
        """Write down what is new, if the last time was not just now; to be called at least ten times a second."""
        self._state.settle()

    def close(self) -> None:
        """Keep what is known for the next time."""
        self._state.close()
