"""Segments: numbered MCAP files of one series, each readable up to its last flush whatever happens."""

import os
from pathlib import Path

from mcap.writer import CompressionType, Writer

from aerodft.adapters.codec.wire import SOFTWARE
from aerodft.adapters.mcap.channels import STATION_KEY, Channel

METADATA_NAME = "aerodft"
_CHUNK_BYTES = 1 << 20


class _File:
    """The file under the MCAP writer: unbuffered, so that a failed write is known at once and can be cut off."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        self._size = 0

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest:
            written = os.write(self._descriptor, rest)
            self._size += written
            rest = rest[written:]
        return len(data)

    def tell(self) -> int:
        return self._size

    def flush(self) -> None:
        """Nothing is held back."""

    def sync(self) -> None:
        os.fdatasync(self._descriptor)

    def close(self) -> None:
        os.close(self._descriptor)

    def cut(self, size: int) -> None:
        os.ftruncate(self._descriptor, size)


class Segment:
    """One MCAP file, open for writing.

    Attributes:
        path: The file.
        number: Its place in its series, from 0.
        messages: Messages that are readable whatever happens now.

    Raises:
        OSError: From any method; the segment must then be given up with ``abandon``.
    """

    def __init__(self, path: Path, station: str, *, number: int, compress: bool) -> None:
        self.path = path
        self.number = number
        self.messages = 0
        self._unflushed = 0
        self._file = _File(path)
        self._whole = 0
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._channels: dict[Channel, int] = {}
        # The writer asks for write, tell and flush only.
        self._writer = Writer(
            self._file,  # type: ignore[arg-type]
            chunk_size=_CHUNK_BYTES,
            compression=CompressionType.ZSTD if compress else CompressionType.NONE,
        )
        self._writer.start(profile="x-aerodft", library=SOFTWARE)
        self._writer.add_metadata(METADATA_NAME, {STATION_KEY: station, "software": SOFTWARE})

    @property
    def size_bytes(self) -> int:
        """Bytes in the file so far."""
        return self._file.tell()

    @property
    def unflushed(self) -> int:
        """Messages that a crash would cost now."""
        return self._unflushed

    def write(self, channel: Channel, log_ns: int, data: bytes, sequence: int = 0) -> None:
        """Add a message to the chunk in progress."""
        identity = self._channels.get(channel) or self._register(channel)
        self._unflushed += 1
        self._writer.add_message(identity, log_ns, data, log_ns, sequence)

    def register(self, channel: Channel) -> None:
        """Make a channel known before its first message."""
        if channel not in self._channels:
            self._register(channel)

    def flush(self) -> None:
        """Close the chunk in progress: what was written so far is readable."""
        self._writer.flush()  # type: ignore[no-untyped-call]  # the writer is annotated in part
        self.messages += self._unflushed
        self._unflushed = 0
        self._whole = self._file.tell()

    def sync(self) -> None:
        """Wait until the disk has it."""
        self._file.sync()

    def finish(self) -> None:
        """Write index and footer, and close the file."""
        self.flush()
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.sync()
        self._file.close()

    def abandon(self) -> int:
        """Cut the file after its last whole chunk and close it; returns the number of messages that this costs."""
        try:
            self._file.cut(self._whole)
        finally:
            self._file.close()
        lost, self._unflushed = self._unflushed, 0
        return lost

    def _register(self, channel: Channel) -> int:
        schema = 0
        if channel.schema_name:
            key = (channel.schema_name, channel.schema)
            schema = self._schemas.get(key) or self._writer.register_schema(
                channel.schema_name, channel.schema_encoding, channel.schema
            )
            self._schemas[key] = schema
        identity = self._writer.register_channel(channel.topic, channel.encoding, schema, dict(channel.metadata))
        self._channels[channel] = identity
        return identity


def sync_folder(folder: Path) -> None:
    """Make new names in a folder survive a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
