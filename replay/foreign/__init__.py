"""Other tools' recordings as input: MAVLink, images and cameras in any MCAP file."""

from replay.foreign.messages import (
    CDR,
    JSON,
    NANOSECONDS,
    PROTOBUF,
    ROS1,
    SECONDS,
    ChannelKind,
    FrameReader,
    kind_of,
    read_encoded_image,
)
from replay.foreign.recordings import (
    AnyRecording,
    ForeignImages,
    ForeignRecording,
    ForeignTelemetry,
    is_foreign,
    open_recording,
)
