"""A Parquet dataset with a partition for each recording; what is in it is whole, and known by what it follows from."""

import hashlib
import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import orjson

from aerodft.errors import InputError
from aerodft.version import SOFTWARE

_KEY = "aerodft.key"
_STATUSES = "aerodft.statuses"
_LEFT_OUT = "aerodft.left_out"
_NAME_DIGITS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class InputKey:
    """What a part follows from, as hashes.

    Attributes:
        recording: Of the recording's data.
        all: Of that, of the configurations and of the software.
    """

    recording: str
    all: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part of the dataset while it is written: where, and what its footer must say."""

    path: Path
    metadata: dict[str, str]


def recording_hash(segments: Sequence[Path]) -> str:
    """``sha256:...`` of a recording's data: of its segments' SHA-256 digests, one behind the other.

    Raises:
        InputError: A segment cannot be read.
    """
    data = hashlib.sha256()
    for path in segments:
        try:
            with path.open("rb") as file:
                data.update(hashlib.file_digest(file, "sha256").digest())
        except OSError as error:
            raise InputError("the recording cannot be read", where=path, got=error.strerror) from error
    return f"sha256:{data.hexdigest()}"


def input_key(segments: Sequence[Path], texts: Sequence[str]) -> InputKey:
    """The key of a recording's data segments and of the texts that they are computed with, by this software.

    Raises:
        InputError: A segment cannot be read.
    """
    recording = recording_hash(segments)
    whole = hashlib.sha256(SOFTWARE.encode())
    whole.update(bytes.fromhex(recording.removeprefix("sha256:")))
    for text in texts:
        whole.update(hashlib.sha256(text.encode()).digest())
    return InputKey(recording=recording, all=f"sha256:{whole.hexdigest()}")


@dataclass(frozen=True, slots=True)
class Dataset:
    """A folder ``recording=<name>/part-<key>.parquet``, partitioned as Hive does it.

    Attributes:
        folder: Where.
    """

    folder: Path

    @classmethod
    def at(cls, folder: Path) -> "Dataset":
        """The dataset in a folder, which is made.

        Raises:
            InputError: It holds something else, or cannot be written.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            strange = next((each for each in folder.iterdir() if not each.name.startswith("recording=")), None)
        except OSError as error:
            raise InputError("the dataset cannot be written", where=folder, got=error.strerror) from error
        if strange is not None:
            expected = "a new folder, or a dataset of recording=... folders"
            raise InputError("the folder holds something else", where=folder, got=strange.name, expected=expected)
        return cls(folder.resolve())

    def done(self, recording: str, key: InputKey) -> dict[str, int] | None:
        """Measurements by status of a part that is there for this key; None where it is not."""
        path = self._path(recording, key)
        if not path.is_file():
            return None
        metadata = _metadata(path)
        if metadata is None or metadata.get(_KEY) != key.all:
            return None  # damaged since, or another key of the same beginning: made again
        statuses: dict[str, int] = orjson.loads(metadata.get(_STATUSES, "{}"))
        return statuses

    @contextmanager
    def part(self, recording: str, key: InputKey, *, overwrite: bool) -> Iterator[Part]:
        """A part to be written; it counts when the block is through, and then replaces what was of other input.

        Raises:
            InputError: There are rows of other input, which must not be replaced; or it cannot be written.
        """
        path = self._path(recording, key)
        others = [each for each in path.parent.glob("part-*.parquet") if each != path]
        if others and not overwrite:
            raise InputError(
                "the dataset has rows of it that follow from other input (recording, configuration or software)",
                where=path.parent,
                got=others[0].name,
                expected=path.name,
                hint="choose another `output`, or add `overwrite`",
            )
        partial = path.with_name(f".{path.stem}.{socket.gethostname()}.{os.getpid()}")
        try:
            path.parent.mkdir(exist_ok=True)
            _clear(path.parent, path.stem)
            try:
                yield Part(path=partial, metadata={_KEY: key.all})
                partial.replace(path)
            finally:
                partial.unlink(missing_ok=True)
            for each in others:
                each.unlink()
        except OSError as error:
            raise InputError("the dataset cannot be written", where=path, got=error.strerror or error) from error
        finally:
            _remove_if_empty(path.parent)

    @staticmethod
    def statuses_text(statuses: Mapping[str, int], left_out: str = "") -> dict[str, str]:
        """What a part's footer says of its rows, and of the recording's parts that are not in them."""
        return {_STATUSES: orjson.dumps(dict(statuses)).decode(), _LEFT_OUT: left_out}

    def left_out(self, recording: str, key: InputKey) -> str:
        """What a part that is done says of what is not in it; empty where that is nothing."""
        return (_metadata(self._path(recording, key)) or {}).get(_LEFT_OUT, "")

    def _path(self, recording: str, key: InputKey) -> Path:
        digits = key.all.removeprefix("sha256:")[:_NAME_DIGITS]
        return self.folder / f"recording={quote(recording, safe=' ')}" / f"part-{digits}.parquet"


def _metadata(path: Path) -> dict[str, str] | None:
    from replay.export import parquet_metadata  # noqa: PLC0415 - slow to load, and hashes are asked for without it

    return parquet_metadata(path)


def _clear(folder: Path, stem: str) -> None:
    """Remove what workers of this machine that were killed left of this part."""
    host = socket.gethostname()
    for each in folder.glob(f".{stem}.{host}.*"):
        if not Path(f"/proc/{each.name.rsplit('.', 1)[-1]}").exists():
            each.unlink(missing_ok=True)


def _remove_if_empty(folder: Path) -> None:
    try:
        folder.rmdir()
    except OSError:
        return  # something is in it, which is the rule
