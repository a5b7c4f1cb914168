"""Messages out of MCAP segments, as far as these are whole."""

from aerodft.adapters.recording.read.chunks import (
    ATTACHMENT_HEAD_BYTES,
    CRC_BYTES,
    HEAD_BYTES,
    MAX_SUMMARY_BYTES,
    MOST_ATTACHMENTS,
    AttachmentHead,
    ChunkHead,
    FileSummary,
    attachment_head,
    chunk_content,
    chunk_head,
    goes_on,
    indexed_channel,
    is_chunk,
    next_chunk,
    read_summary,
    salvaged_length,
    stated_count,
)
from aerodft.adapters.recording.read.messages import (
    ChannelFilter,
    ChunkReader,
    ChunkTable,
    content_bytes,
    is_one_of,
    records_in,
)
from aerodft.adapters.recording.read.segment_scan import (
    ChunkLocation,
    Gap,
    SegmentScan,
    has_owned_chunks,
    log_times,
    scan_segment,
)
from aerodft.adapters.recording.read.series import PROVENANCE_NAME, Ownership, unique_segments
