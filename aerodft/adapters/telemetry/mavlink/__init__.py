"""MAVLink: bytes framed strictly, messages decoded, links opened."""

from aerodft.adapters.telemetry.mavlink.address import LinkKind, is_link, parse_address
from aerodft.adapters.telemetry.mavlink.decoding import (
    ALTITUDE,
    ATTITUDE,
    CAMERA_FOV_STATUS,
    CAMERA_SETTINGS,
    DISTANCE_SENSOR,
    EKF_STATUS_REPORT,
    ESTIMATOR_STATUS,
    GIMBAL_DEVICE_ATTITUDE_STATUS,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    MOUNT_STATUS,
    OF_ANOTHER_ADDRESS,
    OF_AUTOPILOT,
    OF_POSES,
    ORIENTATION_DOWN,
    RANGEFINDER,
    SYSTEM_TIME,
    TERRAIN_REPORT,
    VIDEO_STREAM_INFORMATION,
    Followed,
    MavlinkDecoder,
    is_peripheral,
)
from aerodft.adapters.telemetry.mavlink.dialect import MESSAGES, frame_table, message_name, payload_dtype
from aerodft.adapters.telemetry.mavlink.framing import (
    FrameCounts,
    FrameSpans,
    StreamFramer,
    counts_of,
    headers,
    payload_rows,
)
from aerodft.adapters.telemetry.mavlink.kernels import (
    AT_QUIET,
    AT_SYNC,
    BACKWARDS,
    FRAME,
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
from aerodft.adapters.telemetry.mavlink.transport import Transport, open_transport
