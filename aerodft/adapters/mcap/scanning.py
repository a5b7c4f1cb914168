"""Where the chunks of an MCAP segment are, found by hopping from record to record.

Works on files without an index too: a recorder that was killed leaves whole chunks and a torn end.
"""

import struct
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import MessageIndex, Metadata

from aerodft.adapters.mcap.channels import STATION_KEY
from aerodft.adapters.mcap.segment import METADATA_NAME
from aerodft.errors import InputError

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_CHUNK_TIMES = struct.Struct("<QQ")
_MAX_SMALL_RECORD = 64 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkPlace:
    """A whole chunk in a file.

    Attributes:
        path: The file.
        offset: Where the chunk's content begins.
        length: Bytes of it.
        start_ns: Earliest log time in it.
        end_ns: Latest.
        log_ns: Log times by channel id, from the message indexes behind the chunk; None where they are missing.
    """

    path: Path
    offset: int
    length: int
    start_ns: int
    end_ns: int
    log_ns: dict[int, tuple[int, ...]] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentScan:
    """What a segment holds.

    Attributes:
        path: The file.
        chunks: Its whole chunks, in order.
        station: From its metadata; None where it has none.
        is_whole: Whether it ends as it should.
    """

    path: Path
    chunks: tuple[ChunkPlace, ...]
    station: str | None
    is_whole: bool


def scan_segment(path: Path) -> SegmentScan:
    """Find the chunks of an MCAP file, as far as it is whole.

    Raises:
        InputError: The file cannot be read, or is no MCAP file.
    """
    try:
        with path.open("rb") as file:
            magic = file.read(len(MAGIC))
            if len(magic) < len(MAGIC) and MAGIC.startswith(magic):  # the machine died as the file was made
                return SegmentScan(path=path, chunks=(), station=None, is_whole=False)
            if magic != MAGIC:
                raise InputError("the file is no MCAP recording", where=path, got=repr(magic), expected=repr(MAGIC))
            return _Scan(path, file).run()
    except OSError as error:
        raise InputError("the recording cannot be read", where=path, got=error.strerror) from error


class _Scan:
    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path = path
        self._file = file
        self._size = path.stat().st_size
        self._places: list[ChunkPlace] = []
        self._indexes: list[dict[int, tuple[int, ...]]] = []
        self._station: str | None = None

    def run(self) -> SegmentScan:
        is_whole = False
        position = self._file.tell()
        while len(head := self._file.read(_HEAD.size)) == _HEAD.size:
            opcode, length = _HEAD.unpack(head)
            position += _HEAD.size
            if position + length > self._size:
                break
            if not self._take(opcode, position, length):
                break
            position += length
            if opcode == Opcode.FOOTER:
                is_whole = self._size - position == len(MAGIC)
                break
            self._file.seek(position)
        chunks = tuple(
            ChunkPlace(
                path=place.path,
                offset=place.offset,
                length=place.length,
                start_ns=place.start_ns,
                end_ns=place.end_ns,
                log_ns=index or None,
            )
            for place, index in zip(self._places, self._indexes, strict=True)
        )
        return SegmentScan(path=self._path, chunks=chunks, station=self._station, is_whole=is_whole)

    def _take(self, opcode: int, position: int, length: int) -> bool:
        """Look at one record; False where it is damaged."""
        if opcode == Opcode.CHUNK:
            if length < _CHUNK_TIMES.size:
                return False
            start_ns, end_ns = _CHUNK_TIMES.unpack(self._file.read(_CHUNK_TIMES.size))
            place = ChunkPlace(
                path=self._path, offset=position, length=length, start_ns=start_ns, end_ns=end_ns, log_ns=None
            )
            self._places.append(place)
            self._indexes.append({})
            return True
        if opcode not in {Opcode.MESSAGE_INDEX, Opcode.METADATA}:
            return True
        if length > _MAX_SMALL_RECORD:
            return False
        try:
            self._take_small(opcode, ReadDataStream(BytesIO(self._file.read(length))))
        except (McapError, struct.error, UnicodeDecodeError, OverflowError):
            return False
        return True

    def _take_small(self, opcode: int, content: ReadDataStream) -> None:
        if opcode == Opcode.METADATA:
            metadata = Metadata.read(content)
            if metadata.name == METADATA_NAME:
                self._station = metadata.metadata.get(STATION_KEY)
        elif self._indexes:
            index = MessageIndex.read(content)
            self._indexes[-1][index.channel_id] = tuple(at for at, _ in index.records)
