"""The beginning and the end of an MCAP file: what it says of itself, and the index of its chunks."""

import zlib
from collections import Counter
from collections.abc import Iterable
from typing import Final

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.records import Channel as ChannelRecord

from aerodft.adapters.mcap.layout import INDEX_ENTRY_BYTES, INDEX_HEAD_BYTES, MAGIC, BuiltChunk, encoded

# What a chunk takes in the summary without its channels, and what each of them takes there and in the statistics.
_CHUNK_SUMMARY_BYTES, _CHANNEL_SUMMARY_BYTES, _FIXED_SUMMARY_BYTES = 90, 10, 4096
_CRC_BYTES = 4
MOST_INDEX_BYTES: Final = 8 << 20
"""Of chunks in a summary: three hours of ours. Readers hold it in memory, and believe no more of it than twice that."""


class Summary:
    """What stands at the end of a file: where its chunks are, and how much is in them.

    Args:
        profile: Of the header.
        library: Of the header.
        metadata: Keys and values, by name.
        schemas: By id; what is added later is seen.
        channels: Likewise.
    """

    def __init__(
        self,
        profile: str,
        library: str,
        metadata: Iterable[tuple[str, dict[str, str]]],
        schemas: dict[int, Schema],
        channels: dict[int, ChannelRecord],
    ) -> None:
        self._schemas = schemas
        self._channels = channels
        self._indexes: list[ChunkIndex] = []
        self._counts: list[dict[int, int]] = []
        self._metadata_indexes: list[MetadataIndex] = []
        self._attachment_indexes: list[AttachmentIndex] = []
        self.messages = 0
        self.beginning = MAGIC + encoded(Header(profile=profile, library=library))
        for name, values in metadata:
            record = encoded(Metadata(name=name, metadata=values))
            self._metadata_indexes.append(MetadataIndex(offset=len(self.beginning), length=len(record), name=name))
            self.beginning += record
        self._bytes = _FIXED_SUMMARY_BYTES + sum(40 + len(index.name) for index in self._metadata_indexes)

    @property
    def is_full(self) -> bool:
        """Whether no more chunks should be added."""
        return self._bytes > MOST_INDEX_BYTES

    def most_bytes(self, definitions: int) -> int:
        """What ``ending`` is long at most, with that many bytes of definitions."""
        return self._bytes + definitions + _CHANNEL_SUMMARY_BYTES * len(self._channels)

    def add(self, offset: int, chunk: BuiltChunk) -> None:
        """Take note of a chunk that is in the file."""
        self._indexes.append(_chunk_index(offset, chunk))
        self._counts.append(chunk.counts)
        self._bytes += index_bytes(chunk)
        self.messages += chunk.messages

    def attach(self, offset: int, length: int, attachment: Attachment, data_bytes: int) -> None:
        """Take note of an attachment that is in the file, in a record of ``length`` bytes, ``data_bytes`` its own."""
        self._attachment_indexes.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                log_time=attachment.log_time,
                create_time=attachment.create_time,
                data_size=data_bytes,
                name=attachment.name,
                media_type=attachment.media_type,
            )
        )

    def forget(self, from_offset: int) -> None:
        """Forget the chunks from an offset on: they are cut off."""
        while self._indexes and self._indexes[-1].chunk_start_offset >= from_offset:
            del self._indexes[-1]
            self.messages -= sum(self._counts.pop().values())

    def ending(self, position: int) -> bytes:
        """All that comes behind the last chunk, which ends at ``position``."""
        data_end = encoded(DataEnd(data_section_crc=0))
        start = position + len(data_end)
        groups: list[tuple[Opcode, bytes]] = [
            (Opcode.SCHEMA, encoded(*self._schemas.values())),
            (Opcode.CHANNEL, encoded(*self._channels.values())),
            (Opcode.STATISTICS, encoded(self._statistics())),
            (Opcode.CHUNK_INDEX, encoded(*self._indexes)),
            (Opcode.ATTACHMENT_INDEX, encoded(*self._attachment_indexes)),
            (Opcode.METADATA_INDEX, encoded(*self._metadata_indexes)),
        ]
        content, offsets = b"", b""
        for opcode, group in groups:
            if group:
                place = SummaryOffset(group_opcode=opcode, group_start=start + len(content), group_length=len(group))
                offsets += encoded(place)
                content += group
        footer = Footer(summary_start=start, summary_offset_start=start + len(content), summary_crc=0)
        checked = content + offsets + encoded(footer)[:-_CRC_BYTES]
        footer.summary_crc = zlib.crc32(checked)
        return b"".join((data_end, content, offsets, encoded(footer), MAGIC))

    def _statistics(self) -> Statistics:
        totals: Counter[int] = Counter()
        for counts in self._counts:
            totals.update(counts)
        return Statistics(
            attachment_count=len(self._attachment_indexes),
            channel_count=len(self._channels),
            channel_message_counts=totals,
            chunk_count=len(self._indexes),
            message_count=self.messages,
            message_start_time=min((each.message_start_time for each in self._indexes), default=0),
            message_end_time=max((each.message_end_time for each in self._indexes), default=0),
            metadata_count=len(self._metadata_indexes),
            schema_count=len(self._schemas),
        )


def index_bytes(chunk: BuiltChunk) -> int:
    """What a chunk takes in a summary, at most."""
    return _CHUNK_SUMMARY_BYTES + _CHANNEL_SUMMARY_BYTES * len(chunk.counts)


def _chunk_index(offset: int, chunk: BuiltChunk) -> ChunkIndex:
    places: dict[int, int] = {}
    length = len(chunk.head) + len(chunk.content)
    position = offset + length
    first = position
    for channel_id, count in chunk.counts.items():
        places[channel_id] = position
        position += INDEX_HEAD_BYTES + INDEX_ENTRY_BYTES * count
    return ChunkIndex(
        message_start_time=chunk.start_ns,
        message_end_time=chunk.end_ns,
        chunk_start_offset=offset,
        chunk_length=length,
        message_index_offsets=places,
        message_index_length=position - first,
        compression=chunk.compression,
        compressed_size=len(chunk.content),
        uncompressed_size=chunk.content_bytes,
    )
