"""A recording as input again: its configuration, messages and pixels."""

from replay.recordings.recording import (
    ENCODED_IMAGE_SCHEMAS,
    JPEG_SCHEMA,
    VIDEO_SCHEMA,
    LeftOut,
    Recording,
    measurements_of,
    pose_at,
    pose_of,
)
from replay.recordings.redetection import Redetection, RedetectionStatistics
from replay.recordings.segments import channels_of, is_mcap, is_within, messages_by_time, messages_of, segment_order
from replay.recordings.source import PixelStore, RecordingSource, jpeg_of
