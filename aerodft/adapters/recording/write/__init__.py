"""The recorder: a sink that writes a folder of MCAP segments from threads of its own."""

from aerodft.adapters.recording.write.annotations import Annotator
from aerodft.adapters.recording.write.recorder import McapRecorder, RecorderSettings, RecordingTotals
from aerodft.adapters.recording.write.records import RecordEncoder, camera_calibration, compressed_image, image_sequence
from aerodft.adapters.recording.write.segment import (
    CONFIG_NAME,
    COUNT_BYTES,
    COUNT_NAME,
    METADATA_NAME,
    MOST_INDEX_BYTES,
    PROFILE,
    RECOVERED_NAME,
    CopiedSegment,
    SegmentFile,
    Summary,
    copied_segments,
    count_record,
    index_bytes,
    pieces,
    sync_folder,
)
