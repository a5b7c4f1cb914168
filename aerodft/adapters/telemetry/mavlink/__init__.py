"""MAVLink: bytes framed strictly, messages decoded, links opened."""

from aerodft.adapters.telemetry.mavlink.decoding import (
    ALTITUDE,
    ATTITUDE,
    CAMERA_FOV_STATUS,
    CAMERA_SETTINGS,
    DISTANCE_SENSOR,
    EKF_STATUS_REPORT,
    ESTIMATOR_STATUS,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    OF_ANOTHER_ADDRESS,
    OF_AUTOPILOT,
    OF_POSES,
    ORIENTATION_DOWN,
    RANGEFINDER,
    SYSTEM_TIME,
    TERRAIN_REPORT,
    VIDEO_STREAM_INFORMATION,
    FollowedIds,
    MavlinkDecoder,
    is_peripheral,
)
from aerodft.adapters.telemetry.mavlink.dialect import MESSAGES, MessageClass, frame_table, message_name, payload_dtype
from aerodft.adapters.telemetry.mavlink.framing import (
    FrameCounts,
    FrameSpans,
    StreamFramer,
    counts_of,
    headers,
    payload_rows,
)
from aerodft.adapters.telemetry.mavlink.gimbal_messages import (
    GIMBAL_DEVICE_ATTITUDE_STATUS,
    GIMBAL_MESSAGES,
    MOUNT_ORIENTATION,
    MOUNT_STATUS,
)
from aerodft.adapters.telemetry.mavlink.kernels import (
    AT_QUIET,
    AT_SYNC,
    BACKWARDS,
    FRAME,
    JUMP_US,
    LAST_US,
    MAX_STAMP_US,
    MIN_FRAME,
    N_OK,
    N_SKIPPED,
    N_TRUNCATED,
    SIGNATURE,
    SIGNED,
    STAMP_SIZE,
    STATE_SIZE,
    TLOG_STATE,
    UNKNOWN,
    V1,
    V2,
    Bytes,
    checksum,
    measure,
    plausible_stamps,
    probe,
    scan_tlog,
)
from aerodft.adapters.telemetry.mavlink.link import OWN_COMPONENT, OWN_SYSTEM, MavlinkLink
from aerodft.adapters.telemetry.mavlink.signing import (
    SignatureCheck,
    SigningCounts,
    SigningState,
    load_key,
    opened_signing,
    signing_document,
    signing_sentences,
    unchecked_sentence,
)
from aerodft.adapters.telemetry.mavlink.transport import LinkKind, Transport, is_link, open_transport, parse_address
