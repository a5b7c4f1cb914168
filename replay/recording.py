"""A recording: a folder of MCAP segments with the configuration that it was made with."""

import logging
from collections.abc import Iterator
from pathlib import Path

from aerodft.adapters.codec import measurement
from aerodft.adapters.mcap.reading import ChunkReader, ReadMessage
from aerodft.adapters.mcap.scanning import SegmentScan, scan_segment
from aerodft.errors import InputError, NoAnswerError

_log = logging.getLogger(__name__)


class Recording:
    """A recording, open for reading; holds no file open.

    Attributes:
        folder: Where it is.
        station: The station that made it.
        data: Its data segments, in order.
        images: Its image segments, in order; empty where there are none.
        start_ns: Earliest log time.
        end_ns: Latest log time.
        is_whole: Whether every segment was finished; else a recorder was killed and the end may be missing.

    Args:
        folder: The recording's folder.

    Raises:
        InputError: There is no recording there, or it cannot be read.
        NoAnswerError: It holds nothing.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.data = _segments(folder, "data")
        self.images = _segments(folder, "images")
        chunks = [chunk for segment in self.data for chunk in segment.chunks]
        if not chunks:
            raise NoAnswerError("the recording holds nothing", where=folder)
        self.station = next((segment.station for segment in self.data if segment.station), "")
        self.start_ns = min(chunk.start_ns for chunk in chunks)
        self.end_ns = max(chunk.end_ns for chunk in chunks)
        self.is_whole = all(segment.is_whole for segment in (*self.data, *self.images))
        if not self.is_whole:
            _log.warning("%s: was not finished; read as far as it is whole", folder)

    def text(self, name: str) -> str | None:
        """A file beside the segments (``config.toml`` and the like); None where there is none.

        Raises:
            InputError: It cannot be read.
        """
        path = self.folder / name
        try:
            return path.read_text(encoding="utf-8") if path.is_file() else None
        except (OSError, UnicodeDecodeError) as error:
            raise InputError("the file cannot be read", where=path, got=error) from error

    def messages(self, *, from_ns: int | None = None, to_ns: int | None = None) -> Iterator[ReadMessage]:
        """All messages of the data segments as they were written, log times in ``[from_ns, to_ns)``."""
        return _messages(self.data, from_ns, to_ns)

    def image_messages(self, *, from_ns: int | None = None, to_ns: int | None = None) -> Iterator[ReadMessage]:
        """All messages of the image segments, likewise."""
        return _messages(self.images, from_ns, to_ns)

    def measurements(self) -> Iterator[bytes]:
        """The payloads of all measurements, in the order in which they were made."""
        for message in self.messages():
            if message.channel.schema == measurement.SCHEMA:
                yield message.data


def _messages(segments: tuple[SegmentScan, ...], from_ns: int | None, to_ns: int | None) -> Iterator[ReadMessage]:
    for segment in segments:
        # Chunks before the start are read all the same: they may define channels.
        wanted = (chunk for chunk in segment.chunks if to_ns is None or chunk.start_ns < to_ns)
        for message in ChunkReader().messages(wanted):
            if (from_ns is None or message.log_ns >= from_ns) and (to_ns is None or message.log_ns < to_ns):
                yield message


def _segments(folder: Path, stem: str) -> tuple[SegmentScan, ...]:
    if not folder.is_dir():
        got = "a file" if folder.exists() else "nothing"
        raise InputError("there is no recording", where=folder, got=got, expected="a folder with data_000.mcap")
    paths = sorted(folder.glob(f"{stem}_*.mcap"))
    if not paths and stem == "data":
        found = next((path.name for path in folder.iterdir()), None)
        raise InputError(
            "there is no recording",
            where=folder,
            got=f"{found} and no data_*.mcap" if found else "an empty folder",
            expected="a folder with data_000.mcap",
        )
    return tuple(map(scan_segment, paths))
