"""Other tools' recordings as input: MAVLink, images and cameras in any MCAP file."""

from replay.foreign.formats import CDR, JSON, PROTOBUF, ROS1, Kind, kind_of
from replay.foreign.frames import FrameReader
from replay.foreign.images import NANOSECONDS, SECONDS, read_encoded_image
from replay.foreign.recordings import (
    AnyRecording,
    ForeignImages,
    ForeignRecording,
    ForeignTelemetry,
    is_foreign,
    open_recording,
)
