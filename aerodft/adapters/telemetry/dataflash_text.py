"""ArduPilot's text logs (.log): each line is the text of a .bin log's message, and is read as that message.

Lines are encoded by the FMT lines before them into a temporary .bin log. What is decoded, recorded and said of it is
what the .bin log would be; numbers have the digits that the text has.
"""

import os
import struct
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import IO, Final

from aerodft.adapters.telemetry.dataflash import FMT_TYPE, HEAD, PROTOCOL, DataflashSource, new_decoder, parse_format
from aerodft.errors import os_errors_as

__all__ = ["PROTOCOL", "TITLE", "TextLogSource", "new_decoder", "open_source", "recognises"]

TITLE: Final = "ArduPilot's text .log"
_NAME: Final = "FMT"
_HEAD: Final = struct.Struct("<BBB")
_FMT: Final = struct.Struct("<BB4s16s64s")
_FORMAT_CELLS: Final = 4  # name, type, length and format, before the columns
_MOST_LINE_BYTES: Final = 1 << 16  # the longest message has 255 bytes, its text some 1,500
_STRUCTS: Final = {
    **dict(zip("bBMhHcCiIeELqQfdg", "bBBhHhHiIiIiqQfde", strict=True)),
    "n": "4s",
    "N": "16s",
    "Z": "64s",
    "a": "64s",
}
_TEXTS: Final = "nNZ"
_FLOATS: Final = "fdg"
_Encoder = Callable[[str], float | bytes]


def recognises(head: bytes) -> bool:
    """Whether a line that declares a message stands at the beginning."""
    return b"\0" not in head and any(_is_format(line) for line in head.lstrip(b"\xef\xbb\xbf").split(b"\n")[:-1])


def _is_format(line: bytes) -> bool:
    cells = [cell.strip() for cell in line.split(b",")]
    return len(cells) > _FORMAT_CELLS and cells[0] == b"FMT" and cells[1].isdigit() and cells[2].isdigit()


def open_source(path: Path) -> "TextLogSource":
    """A text log as blocks of the messages of its .bin log."""
    return TextLogSource(path)


class TextLogSource(DataflashSource):
    """A text log as blocks of raw messages of DataFlash, see the module.

    Args:
        path: The file.

    Raises:
        InputError: The file is missing, unreadable, empty, or no such log.
    """

    def __init__(self, path: Path) -> None:
        self._left_out: Counter[str] = Counter()
        super().__init__(path, TITLE)

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each kind of damage met so far; complete once ``events`` has ended."""
        lines = (f"{self.path}: {count} lines left out: {why}" for why, count in self._left_out.items())
        return (*super().warnings(), *lines)

    def _open(self, path: Path) -> int:
        """Descriptor of the encoded log; its file has no name, and ends with the descriptor."""
        with path.open("rb") as text, tempfile.TemporaryFile() as encoded:
            _Encoding(self._left_out).encode(text, encoded)
            encoded.flush()
            return os.dup(encoded.fileno())


class _Encoding:
    """Encodes lines to messages by the formats that earlier lines declare; counts what it leaves out."""

    def __init__(self, left_out: Counter[str]) -> None:
        self._left_out = left_out
        self._formats: dict[str, tuple[int, struct.Struct, list[_Encoder]]] = {}

    def encode(self, text: IO[bytes], encoded: IO[bytes]) -> None:
        """Write the messages of all lines."""
        with os_errors_as("no room for a temporary copy", where=tempfile.gettempdir()):
            while line := text.readline(_MOST_LINE_BYTES):
                name, _, cells = line.decode("utf-8-sig", "replace").strip().partition(",")
                if cells:
                    encoded.write(self._format(cells) if name == _NAME else self._message(name.strip(), cells))

    def _message(self, name: str, text: str) -> bytes:
        """The message of a line; nothing of one that is left out."""
        if name not in self._formats:
            self._left_out["no FMT line declares them"] += 1
            return b""
        kind, layout, encoders = self._formats[name]
        cells = text.split(",", len(encoders) - 1) if encoders and encoders[-1] is _text else text.split(",")
        if len(cells) != len(encoders):
            self._left_out["they have another number of columns than their FMT line"] += 1
            return b""
        try:
            values = [encode(cell.strip()) for encode, cell in zip(encoders, cells, strict=True)]
            return _HEAD.pack(*HEAD, kind) + layout.pack(*values)
        except (ValueError, OverflowError, struct.error):
            self._left_out["a value is none of its type"] += 1
            return b""

    def _format(self, text: str) -> bytes:
        """The message of a FMT line, which holds for the lines behind it; nothing of one that contradicts itself."""
        cells = [cell.strip() for cell in text.split(",")]
        try:
            kind, length, name, codes = int(cells[0]), int(cells[1]), cells[2], cells[3]
            fields = (name.encode(), codes.encode(), ",".join(cells[4:]).encode())
            message = _HEAD.pack(*HEAD, FMT_TYPE) + _FMT.pack(kind, length, *fields)
            found = parse_format(message)
        except (ValueError, IndexError, struct.error):
            found = None
        if found is None or not set(codes) <= _STRUCTS.keys():
            self._left_out["a FMT line contradicts itself"] += 1
            return b""
        layout = struct.Struct("<" + "".join(_STRUCTS[code] for code in codes))
        scales = found[1].scale.values()
        if kind != FMT_TYPE:
            self._formats[name] = kind, layout, [_encoder(*each) for each in zip(codes, scales, strict=True)]
        return message


def _encoder(code: str, scale: float) -> _Encoder:
    """What makes a value of a cell's text."""
    if code in _TEXTS:
        return _text
    if code in _FLOATS:
        return float
    if code == "a":
        return _no_array
    if code == "M":
        return _mode
    return int if scale == 1 else lambda cell: round(float(cell) / scale)


def _text(cell: str) -> bytes:
    return cell.encode()


def _no_array(_cell: str) -> bytes:
    """Nothing of an array of 16-bit numbers: no track is made of one."""
    return b""


def _mode(cell: str) -> int:
    """A flight mode's number; 0 where the text has its name."""
    return int(cell) if cell.isdigit() else 0
