"""Files: what one looks like, for the sentence that refuses it; written whole or not at all; texts as CSV cells."""

import errno
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from aerodft.errors import InputError, UsageError, os_errors_as, printable

_MAGIC: tuple[tuple[int, bytes, str], ...] = (
    (0, b"\xff\xd8\xff", "a JPEG image"),
    (0, b"\x89PNG\r\n\x1a\n", "a PNG image"),
    (0, b"II*\x00", "a TIFF image"),
    (0, b"MM\x00*", "a TIFF image"),
    (4, b"ftyphei", "a HEIC photo, which is to be saved as JPEG"),
    (4, b"ftyp", "an MP4 or MOV video"),
    (0, b"\x1aE\xdf\xa3", "a Matroska or WebM video"),
    (8, b"AVI ", "an AVI video"),
    (0, b"\x89MCAP0\r\n", "an MCAP recording"),
    (0, b"\xa3\x95\x80", "an ArduPilot .bin log"),
    (0, b"ULog\x01\x12\x35", "a PX4 .ulg log"),
    (0, b"PK\x03\x04", "a ZIP archive"),
    (0, b"\x1f\x8b", "a gzip archive"),
    (0, b"%PDF", "a PDF document"),
    (8, b"\xfe", "a MAVLink .tlog"),
    (8, b"\xfd", "a MAVLink .tlog"),
)


class _TextKind(NamedTuple):
    """A kind of text that no reader here takes, and what to give instead."""

    name: str
    pattern: re.Pattern[bytes]
    hint: str


_NO_ATTITUDE: Final = "it has places but no camera attitude: give the .tlog, .bin or .ulg of the flight"
_TEXT_KINDS: Final = (
    _TextKind("a GPX track", re.compile(rb"(?:\xef\xbb\xbf)?\s*<(?:[^\0]*<)?gpx[\s>]"), _NO_ATTITUDE),
    _TextKind("a KML file", re.compile(rb"(?:\xef\xbb\xbf)?\s*<(?:[^\0]*<)?kml[\s>]"), _NO_ATTITUDE),
    _TextKind(
        "ArduPilot's text log",
        re.compile(rb"(?:[^\0]*\n)?FMT, ?\d+, ?\d+,"),
        "give it as the log of a flight",
    ),
    _TextKind(
        "pyorc's camera configuration",
        re.compile(rb'\s*\{(?=[^\0]*"width"\s*:)(?=[^\0]*"height"\s*:)[^\0]*"(?:gcps|window_size|crs)"\s*:'),
        "write its gcps as a CSV table name,u,v,X,Y,Z: src has u, v, dst has X, Y and perhaps Z",
    ),
)
_HEAD_BYTES = 512
_TS_PACKET_BYTES, _TS_SYNC = 188, 0x47  # of ISO 13818-1
_MOST_BYTES = 1 << 30  # a file without end, or one that claims to be, takes all memory

_SCHEME = re.compile(r"[a-z][a-z0-9+.-]+:")  # s3:, gs:, https:; a drive of Windows has one letter
_FORMULAS = ("=", "+", "-", "@")
_MARK = "'"


def looks_like(path: Path) -> str:
    """Kind of file that a path is, in a few words; never raises.

    Args:
        path: A file, a folder, or nothing.

    Returns:
        For instance ``a JPEG image``, ``an empty file``, ``text``, ``a folder``.
    """
    try:
        if path.is_dir():
            return "a folder"
        check_is_no_pipe(path)
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        return f"unreadable ({error.strerror})"
    return content_looks_like(head)


def content_looks_like(head: bytes) -> str:
    """Kind of file that starts with some bytes, in a few words."""
    if not head:
        return "an empty file"
    if len(head) > 2 * _TS_PACKET_BYTES and set(head[::_TS_PACKET_BYTES][:3]) == {_TS_SYNC}:
        return "an MPEG-TS video"
    for offset, magic, name in _MAGIC:
        if head[offset : offset + len(magic)] == magic:
            return name
    if b"\x00" in head:
        return "unknown binary data"
    try:
        # The cut may go through a character; up to three bytes of it are forgiven.
        head[:-3].decode()
    except UnicodeDecodeError:
        return "unknown binary data"
    return next((each.name for each in _TEXT_KINDS if each.pattern.match(head)), "text")


def hint_for_kind(kind: str) -> str:
    """What to give instead of a file of a kind that ``content_looks_like`` names; empty for most kinds."""
    return next((each.hint for each in _TEXT_KINDS if each.name == kind), "")


def check_is_no_pipe(path: Path) -> None:
    """Refuse what would hold up whoever opens it, until somebody writes.

    Raises:
        OSError: It is a pipe, a socket or a device; or a folder.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is a pipe or a device, not a file", str(path))


def read_whole(path: Path) -> bytes:
    """All bytes of a file.

    Raises:
        OSError: It cannot be read, holds up whoever opens it, or is larger than any that is read as a whole.
    """
    check_is_no_pipe(path)
    if path.stat().st_size > _MOST_BYTES:
        raise OSError(errno.EFBIG, f"more than {_MOST_BYTES >> 20} MB", str(path))
    return path.read_bytes()


def check_is_local(path: Path) -> None:
    """Refuse the address of a store, ``s3://bucket/flight``, which a folder ``s3:`` would be made for.

    Raises:
        InputError: It is one.
    """
    if path.parts and _SCHEME.fullmatch(path.parts[0]):
        expected = "a folder or file on this machine, to be copied there afterwards"
        raise InputError("nothing can be written to an address", where=path, got=path.parts[0], expected=expected)


def check_ending(path: Path, *endings: str) -> None:
    """Refuse a name that promises another format than is written; without an ending it promises none.

    Raises:
        UsageError: It ends with none of ``endings``.
    """
    if path.suffix and path.suffix.lower() not in endings:
        raise UsageError("the name says another format", where=path, got=path.suffix, expected=" or ".join(endings))


@contextmanager
def whole_file(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """Write a file as a whole or not at all; where that fails, say so in a sentence.

    Args:
        path: The file.
        overwrite: Whether one that exists is replaced.

    Yields:
        Where to write.

    Raises:
        InputError: It exists and must not be replaced, or it cannot be written.
    """
    check_is_local(path)
    if path.is_file() and not overwrite:
        raise InputError("the file exists", where=path, hint="choose another name, or add `overwrite`")
    try:
        with atomic_file(path, keep=not overwrite) as partial:
            yield partial
    except FileExistsError:
        raise InputError(
            "the file exists", where=path, hint="somebody made it meanwhile: choose another name"
        ) from None
    except OSError as error:
        raise InputError("the file cannot be written", where=path, got=error) from error


@contextmanager
def atomic_file(path: Path, *, keep: bool = False) -> Iterator[Path]:
    """A file that takes its name when the block is through, and leaves nothing behind when it raises.

    A link stays one; what is no file (a pipe, a device) is written to as it is.

    Args:
        path: The file.
        keep: Whether a file that appeared meanwhile stays.

    Yields:
        Where to write.

    Raises:
        OSError: It cannot be written.
    """
    target = path.resolve()
    if target.is_dir():
        raise IsADirectoryError(None, "Is a directory")
    if target.exists() and not target.is_file():
        yield target
        return
    partial = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        yield partial
        if keep:
            _take_name(partial, target)
        else:
            partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def write_whole(path: Path, data: bytes) -> None:
    """Write all of a file or none of it, as ``atomic_file``."""
    with atomic_file(path) as partial:
        partial.write_bytes(data)


def _take_name(partial: Path, target: Path) -> None:
    """Give a file its name, unless another one has it.

    Raises:
        FileExistsError: One has.
    """
    try:
        target.hardlink_to(partial)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        partial.replace(target)


@contextmanager
def output_folder(folder: Path, what: str, expected: str = "a folder to write to") -> Iterator[None]:
    """A folder, made where it is not there, that something is written to.

    Args:
        folder: The folder.
        what: What is written, for the sentence where that fails.
        expected: What would have been right, for that sentence.

    Raises:
        InputError: The folder cannot be written to.
    """
    check_is_local(folder)
    with writable(folder, what, expected):
        folder.mkdir(parents=True, exist_ok=True)
        yield


@contextmanager
def writable(path: Path, what: str, expected: str = "a folder to write to") -> Iterator[None]:
    """Errors of the system in this block are an ``InputError`` that says what cannot be written, and where."""
    with os_errors_as(f"{what} cannot be written", where=path, expected=expected):
        yield


def csv_cell(value: object) -> object:
    """A value that a spreadsheet takes for no formula, without control characters; numbers stay as they are."""
    if not isinstance(value, str):
        return value
    text = printable(value)
    return f"{_MARK}{text}" if text.startswith(_FORMULAS) else text


def cell_text(cell: str) -> str:
    """The text of a cell that ``csv_cell`` wrote."""
    return cell[1:] if cell.startswith(tuple(_MARK + each for each in _FORMULAS)) else cell
