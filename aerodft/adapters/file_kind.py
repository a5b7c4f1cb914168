"""What a file looks like, for the sentence that refuses it."""

import errno
import os
from pathlib import Path

_MAGIC: tuple[tuple[int, bytes, str], ...] = (
    (0, b"\xff\xd8\xff", "a JPEG image"),
    (0, b"\x89PNG\r\n\x1a\n", "a PNG image"),
    (0, b"II*\x00", "a TIFF image"),
    (0, b"MM\x00*", "a TIFF image"),
    (4, b"ftyp", "an MP4 or MOV video"),
    (0, b"\x1aE\xdf\xa3", "a Matroska or WebM video"),
    (8, b"AVI ", "an AVI video"),
    (0, b"\x89MCAP0\r\n", "an MCAP recording"),
    (0, b"\xa3\x95\x80", "an ArduPilot .bin log"),
    (0, b"PK\x03\x04", "a ZIP archive"),
    (0, b"\x1f\x8b", "a gzip archive"),
    (0, b"%PDF", "a PDF document"),
    (8, b"\xfe", "a MAVLink .tlog"),
    (8, b"\xfd", "a MAVLink .tlog"),
)
_HEAD_BYTES = 512


def looks_like(path: Path) -> str:
    """What ``path`` holds, in a few words; never raises.

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
    """What a file that starts with ``head`` holds, in a few words."""
    if not head:
        return "an empty file"
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
    return "text"


def check_is_no_pipe(path: Path) -> None:
    """Refuse what would hold up whoever opens it, until somebody writes.

    Raises:
        OSError: It is a pipe, a socket or a device; or a folder.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "a pipe or a device", str(path))
