"""A recording as input again: its configuration, messages and pixels."""

from replay.recordings.pixels import PixelStore, jpeg_of
from replay.recordings.recording import JPEG_SCHEMA, PICTURE_SCHEMAS, VIDEO_SCHEMA, Recording
from replay.recordings.redetection import Moved, Redetection
from replay.recordings.segments import channels_of, in_time, is_mcap, messages_of, nearly_sorted, numbered
from replay.recordings.source import RecordingSource
