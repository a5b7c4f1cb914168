"""MAVLink 2 message signing: who holds the key is believed, once and in order; nobody else is.

The rules are those of the protocol's guide (48-bit time stamps in steps of 10 us since 2015, kept for every system,
component and link id), with two differences that keep forged frames out: the hash is checked before anything is
remembered, and a frame from more than a minute ahead is refused, so that no stray clock locks everybody else out. Time
stamps outlive the process: what was believed once is not believed again.
"""

import contextlib
import fcntl
import hashlib
import hmac
import logging
import os
import re
import stat
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
import orjson

from aerodft.adapters.files import check_is_no_pipe, read_whole
from aerodft.adapters.telemetry.mavlink.dialect import MESSAGES, frame_table
from aerodft.adapters.telemetry.mavlink.kernels import SIGNATURE, SIGNED, V2, checksum
from aerodft.errors import ConfigError, InputError, counted
from aerodft.service import RADIO_STATUS, SigningSettings
from aerodft.service.clocks import WallClock

_LOG: Final = logging.getLogger(__name__)
_SCHEMA: Final = "aerodft.signing/1"
_MOST_STAMP: Final = 1 << 48
_BYTE: Final = 0xFF
_STREAM_PARTS: Final = 3
_COMMIT_S: Final = 0.05
_OURS: Final = 0o600
_MOST_BYTES: Final = 4096
_OTHERS: Final = stat.S_IRWXG | stat.S_IRWXO
_SHORT: Final = 12  # characters: one hash a try, ten thousand million of them a second
_EXPECTED: Final = "64 hexadecimal digits, or a passphrase"

StreamKey = tuple[int, int, int]
"""System, component, link id."""
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
_MEANING: Final = {
    UNSIGNED: "they carry no signature: somebody without the key sends, or the vehicle has signing off",
    WRONG: "their signature does not fit: somebody with another key sends, or this key file is not the vehicle's",
    REPLAYED: "their time stamp is not later than one seen before: somebody repeats them, or the network doubles them",
    OLD: "their time stamp is more than a minute behind: somebody plays a recording, or the vehicle's clock is slow",
    FUTURE: "their time stamp is more than a minute ahead: this machine's clock is slow, or the vehicle's is fast",
}


class SigningState:
    """Time stamps by stream, in memory and in a file of which no half can be seen.

    A killed process forgets at most the last tenth of a second. One process at a time holds the file.

    Attributes:
        streams: The last time stamp of every stream.
        latest: The largest of all.
    """

    def __init__(self, path: Path | None = None, mark: str = "") -> None:
        self.streams: dict[StreamKey, int] = {}
        self.latest = 0
        self._path = path
        self._mark = mark
        self._lock: int | None = None
        self._dirty = False
        self._due_s = 0.0
        self._complained = False

    @classmethod
    def open(cls, path: Path, key: bytes) -> Self:
        """Take up what the file knows of this key; with another key, or without the file, that is nothing.

        Raises:
            InputError: The file is damaged, cannot be written, or another process holds it.
        """
        state = cls(path, hashlib.sha256(_SCHEMA.encode() + key).hexdigest()[:16])
        try:
            state._hold(path)
            if path.exists():
                state._take_up(read_whole(path), path)
            state._write(path)
        except OSError as error:
            state._release()
            hint = "name a file that can be written with state_file"
            raise InputError("cannot keep signing time stamps", where=path, got=error, hint=hint) from error
        except InputError:
            state._release()
            raise
        return state

    def _hold(self, path: Path) -> None:
        self._lock = os.open(path.with_name(f"{path.name}.lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, _OURS)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            hint = "stop it, or give every link a state_file of its own"
            raise InputError("another aerodft keeps its time stamps there", where=path, hint=hint) from None

    def _take_up(self, data: bytes, path: Path) -> None:
        try:
            document = orjson.loads(data)
            is_ours = {_SCHEMA: document["key"] == self._mark}[document["schema"]]
            if is_ours:
                self.streams = {_stream_of(name): _stamp_of(stamp) for name, stamp in document["streams"].items()}
                self.latest = max(_stamp_of(document["latest"]), *self.streams.values(), 0)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            hint = "delete it to start anew, which lets old frames pass that are signed within the last minute"
            raise InputError("no signing time stamps", where=path, expected=_SCHEMA, hint=hint) from error

    def note(self, stream: StreamKey, stamp: int) -> None:
        """A frame of this stream is believed, or sent."""
        self.streams[stream] = stamp
        self.latest = max(self.latest, stamp)
        self._dirty = True

    def commit(self) -> None:
        """Write down what is new, if the last time was not just now."""
        if self._dirty and time.monotonic() >= self._due_s:
            self._save()

    def _save(self) -> None:
        self._due_s = time.monotonic() + _COMMIT_S
        self._dirty = False
        if self._path is None:
            return
        try:
            self._write(self._path)
            self._complained = False
        except OSError as error:
            if not self._complained:
                _LOG.warning("%s cannot be written (%s): a restart would let old frames pass", self._path, error)
            self._complained = True
            self._dirty = True

    def _write(self, path: Path, *, sync: bool = False) -> None:
        streams = {"/".join(map(str, stream)): stamp for stream, stamp in self.streams.items()}
        document: dict[str, Any] = {"schema": _SCHEMA, "key": self._mark, "latest": self.latest, "streams": streams}
        fresh = path.with_name(f"{path.name}.new")
        fresh.touch(_OURS)
        with fresh.open("wb") as file:
            file.write(orjson.dumps(document))
            if sync:
                file.flush()
                os.fsync(file.fileno())
        fresh.replace(path)

    def close(self) -> None:
        """Write down all that is known, down to the disk, and let others have the file."""
        if self._path is not None and self._lock is not None:
            with contextlib.suppress(OSError):
                self._write(self._path, sync=True)
        self._release()

    def _release(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def _stream_of(name: str) -> StreamKey:
    parts = [int(part) for part in name.split("/")]
    if len(parts) != _STREAM_PARTS or not all(0 <= part <= _BYTE for part in parts):
        raise ValueError(name)
    return parts[0], parts[1], parts[2]


def _stamp_of(value: object) -> int:
    if not isinstance(value, int) or not 0 <= value < _MOST_STAMP:
        raise ValueError(value)
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class SigningCounts:
    """Counts of a signed link's frames by what became of them.

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
        """Counts so far."""
        return SigningCounts(verified=self._verified, unsigned=self._unsigned, refused=dict(self._refused))

    def passed(self, frames: Sequence[bytes]) -> list[bytes]:
        """The whole, intact frames that may be believed, in their order."""
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

    def commit(self) -> None:
        """Write down what is new, if the last time was not just now; to be called at least ten times a second."""
        self._state.commit()

    def close(self) -> None:
        """Keep what is known for the next time."""
        self._state.close()


def load_key(path: Path) -> bytes:
    """The 32 bytes of a key file; a passphrase is hashed as the ground stations do (SHA-256 of its UTF-8 text).

    Raises:
        ConfigError: It is missing, unreadable, empty or no text.
    """
    try:
        check_is_no_pipe(path)
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
        if path.stat().st_mode & _OTHERS:
            _LOG.warning("%s: others than its owner may read or write this key; chmod 600 it", path)
    except OSError as error:
        got = error.strerror or str(error)
        raise ConfigError("cannot read the signing key", where=path, got=got, expected=_EXPECTED) from error
    try:
        text = data.decode().strip("\r\n")
    except UnicodeDecodeError:
        raise ConfigError("no signing key", where=path, got="binary data", expected=_EXPECTED) from None
    if not text.strip() or len(data) > _MOST_BYTES:
        got = "nothing" if not text.strip() else f"more than {_MOST_BYTES} bytes"
        raise ConfigError("no signing key", where=path, got=got, expected=_EXPECTED)
    return _key_of(text, path)


def _key_of(text: str, path: Path) -> bytes:
    """The key that a text stands for; one that is almost 64 hexadecimal digits is a mistake, no passphrase."""
    digits = text.strip()
    if re.fullmatch(rf"[0-9a-fA-F]{{{KEY_SIZE},}}", digits) is None:
        if len(text) < _SHORT:
            _LOG.warning("%s: a passphrase of %d characters is soon guessed; take %d or more", path, len(text), _SHORT)
        return hashlib.sha256(text.encode()).digest()
    if len(digits) != 2 * KEY_SIZE:
        raise ConfigError(
            "no signing key", where=path, got=counted(len(digits), "hexadecimal digit"), expected=_EXPECTED
        )
    return bytes.fromhex(digits)


def open_signing(settings: SigningSettings, now_ns: Callable[[], int]) -> SignatureCheck:
    """The check of a link that is about to be opened.

    Args:
        settings: What is configured.
        now_ns: Host UTC, as good as it is known at the moment.

    Raises:
        ConfigError: The key cannot be read, or there is no such message.
        InputError: The state is damaged, cannot be written, or another process holds it.
    """
    ids = {str(message.msgname): message_id for message_id, message in MESSAGES.items()}
    for name in settings.accept_unsigned:
        if name not in ids:
            raise ConfigError("accept_unsigned", got=f'"{name}"', expected=f'a message like "{RADIO_STATUS}"')
    key = load_key(settings.key_file)
    beside = settings.key_file.with_name(f"{settings.key_file.name}.state")
    return SignatureCheck(
        key,
        SigningState.open(settings.state_file or beside, key),
        now_ns,
        link_id=settings.link_id,
        unsigned_ids=frozenset(ids[name] for name in settings.accept_unsigned),
    )


@contextlib.contextmanager
def opened_signing(settings: SigningSettings | None) -> Iterator[SignatureCheck | None]:
    """The check of a link while that is open, by this machine's clock; None without settings.

    Raises:
        ConfigError: The key cannot be used.
        InputError: The time stamps cannot be kept.
    """
    if settings is None:
        yield None
        return
    # Read anew each time: the first time synchronisation after boot must reach the signatures.
    with contextlib.closing(open_signing(settings, lambda: WallClock().now_ns())) as check:
        yield check


def signing_sentences(counts: SigningCounts) -> list[str]:
    """One sentence for each reason why frames were refused, with what it may mean."""
    sentences = [f"{count} frames refused, {_MEANING[reason]}" for reason, count in sorted(counts.refused.items())]
    if counts.refused and not counts.verified:
        sentences.append("not one frame with a good signature came: check the key on both sides, and both clocks")
    return sentences


def unchecked_sentence(signed: int, frames: int) -> str:
    """Sentence that a link without a key is signed, with the number of such frames."""
    return (
        f"this link is signed ({signed} of {frames} frames): without `signing_key`, or telemetry.signing of a"
        " `station`, nothing is checked, and the vehicle would ignore requests"
    )


def signing_document(counts: SigningCounts) -> dict[str, Any]:
    """The counters as plain JSON values."""
    return {"verified": counts.verified, "unsigned": counts.unsigned, "refused": dict(sorted(counts.refused.items()))}
