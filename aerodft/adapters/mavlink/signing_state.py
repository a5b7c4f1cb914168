"""The time stamps of a signed link that outlive the process: what was believed once is not believed again."""

import contextlib
import fcntl
import hashlib
import logging
import os
import time
from pathlib import Path
from typing import Any, Final, Self

import orjson

from aerodft.errors import InputError

_LOG: Final = logging.getLogger(__name__)
_SCHEMA: Final = "aerodft.signing/1"
_MOST: Final = 1 << 48
_BYTE: Final = 0xFF
_STREAM_PARTS: Final = 3
_SETTLE_S: Final = 0.05
_OURS: Final = 0o600

StreamKey = tuple[int, int, int]
"""System, component, link id."""


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
                state._take_up(path.read_bytes(), path)
            state._write(path)
        except OSError as error:
            state._release()
            hint = "name a file that can be written with state_file"
            raise InputError("cannot keep signing time stamps", where=path, got=error.strerror, hint=hint) from error
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

    def settle(self) -> None:
        """Write down what is new, if the last time was not just now."""
        if self._dirty and time.monotonic() >= self._due_s:
            self._save()

    def _save(self) -> None:
        self._due_s = time.monotonic() + _SETTLE_S
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
    if not isinstance(value, int) or not 0 <= value < _MOST:
        raise ValueError(value)
    return value
