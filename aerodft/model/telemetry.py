"""Telemetry tracks and the health of a vehicle: struct-of-arrays in SI units, before their stamps are mapped to UTC.

One track per message type, rows in order of arrival; adapters decode them from MAVLink or DataFlash. ``boot_ns`` is
the sender's time since boot, or ``NO_BOOT_TIME`` where the message carries none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from typing import Any, ClassVar, TypeVar

import numpy as np

from aerodft.model.arrays import Batch, BoolArray, FloatArray, IntArray
from aerodft.model.camera import ZoomSource
from aerodft.model.pose import GimbalSource, HeightSource

NO_BOOT_TIME = -1

TrackOf = TypeVar("TrackOf", bound="Track")

RATIOS = ("velocity", "horizontal position", "vertical position", "compass")
"""Quantities of an EKF's test ratios: innovation over gate; the EKF rejects its inputs from 1 on."""

NO_CLIMB_MPS = 327.0
"""Vertical speeds from here on are unknown: the largest number of an int16 in cm/s says so."""

FIX_3D = 3
"""Lowest GPS_FIX_TYPE with a height."""


class WireProtocol(StrEnum):
    """Framing of raw telemetry bytes in the built-in formats; further log formats add names."""

    MAVLINK = "mavlink"
    DATAFLASH = "dataflash"


class ReportFrame(StrEnum):
    """Reference of roll and pitch in a gimbal's reports."""

    EARTH = "earth"  # the horizon, as MAVLink specifies
    BODY = "body"  # the vehicle, whatever the message's flags


class MountAxes(str):
    """Name of the order of a mount's servo axes behind yaw: how angles relative to the vehicle are composed.

    No enumeration: who adds a mount to ``GIMBAL_MOUNTS`` (``service/attitude/mounts.py``) gives it a name there.
    """

    __slots__ = ()
    ROLL_OUTER: ClassVar["MountAxes"]
    TILT_OUTER: ClassVar["MountAxes"]
    TILT_ONLY: ClassVar["MountAxes"]


MountAxes.ROLL_OUTER = MountAxes("roll-outer")  # the usual one: the roll servo carries the tilt servo
MountAxes.TILT_OUTER = MountAxes("tilt-outer")  # the tilt servo carries the roll servo: aerospace Euler angles
MountAxes.TILT_ONLY = MountAxes("tilt-only")  # no roll servo, whatever is reported of one: the camera rolls with it all


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawBlock(Batch):
    """Whole raw frames of one sender, in order of arrival.

    Attributes:
        protocol: Framing of the bytes: a ``WireProtocol``, or the name of another log format.
        sender: Address or file.
        arrival_ns: ``(n,)`` host UTC of each frame; not decreasing.
        offset: ``(n,)`` start of each frame in ``data``.
        length: ``(n,)`` bytes of each frame.
        data: The bytes; may hold more than the frames.
        checked: Whether every frame's checksum has been verified already.
    """

    protocol: str
    sender: str
    arrival_ns: IntArray
    offset: IntArray
    length: IntArray
    data: bytes
    checked: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track(Batch):
    """Columns of every track: arrival ``(n,)`` (host UTC) and time since boot ``(n,)``, both int64 ns."""

    arrival_ns: IntArray
    boot_ns: IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SyncTrack(Track):
    """A sender's time since boot (TIMESYNC), not necessarily the vehicle's."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClockTrack(Track):
    """The sender's UTC at its time since boot (SYSTEM_TIME); rows without a fix are left out.

    Attributes:
        unix_ns: ``(n,)``.
    """

    unix_ns: IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleTrack(Track):
    """The vehicle's attitude (ATTITUDE).

    Attributes:
        wxyz: ``(n, 4)`` unit quaternion ``ned_SO3_body`` (body: front, right, down).
        heading_std_rad: ``(n,)`` standard deviation of the heading, NaN for the settings'; None for all of them.
    """

    wxyz: FloatArray
    heading_std_rad: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GimbalTrack(Track):
    """The gimbal's attitude as reported.

    Attributes:
        source: The message.
        wxyz: ``(n, 4)`` unit quaternion ``ref_SO3_gimbal``; gimbal axes front (optical axis), right, down. Roll and
            pitch are relative to the horizon, if the sender keeps to MAVLink (see ``service.attitude``); the
            reference's x axis is north, or the vehicle's nose.
        yaw_in_earth: ``(n,)`` true where the reference's x axis is north, false where it is the vehicle's heading.
        std_rad: ``(n, 4)`` standard deviations of tilt, pan, roll and heading; None where the reports have none.
        is_scaled: Whether the decoder has applied the configured factors of the angles, as those of messages whose
            angles are no angles without; else ``CompositeDecoder`` applies them.
    """

    source: GimbalSource
    wxyz: FloatArray
    yaw_in_earth: BoolArray
    std_rad: FloatArray | None = None
    is_scaled: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PositionTrack(Track):
    """Position and home-relative height (GLOBAL_POSITION_INT); rows before the first fix are left out.

    A log whose heights come apart from its positions gives them as a ``HeightTrack`` of ``HeightSource.HOME``.

    Attributes:
        lat_rad: ``(n,)`` WGS84.
        lon_rad: ``(n,)`` WGS84.
        alt_msl_m: ``(n,)``; NaN in all rows of a log that does not state it.
        height_home_m: ``(n,)`` above home; NaN where the log does not state it with the position.
        std_m: ``(n,)`` standard deviation of east and of north; None where the log has none.
        climb_mps: ``(n,)`` the vertical speed that the sender states, positive upwards by MAVLink's definition (some
            firmware negates it); from ``NO_CLIMB_MPS`` on it is unknown, None where the message has none.
        home_alt_msl_m: ``(n,)`` altitude of home by a message of its own, NaN until it comes; None where the log has
            no such message.
    """

    lat_rad: FloatArray
    lon_rad: FloatArray
    alt_msl_m: FloatArray
    height_home_m: FloatArray
    std_m: FloatArray | None = None
    climb_mps: FloatArray | None = None
    home_alt_msl_m: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClimbTrack(Track):
    """Vertical speed from a message without a position (XKF1, NKF1).

    Attributes:
        climb_mps: ``(n,)`` positive upwards.
    """

    climb_mps: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandedTrack(Track):
    """Whether the vehicle stands on the ground (EXTENDED_SYS_STATE); rows that do not say are left out.

    Attributes:
        is_landed: ``(n,)``.
    """

    is_landed: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeightTrack(Track):
    """Heights above ground from a sensor or a terrain database, or above home; invalid rows are left out.

    Attributes:
        source: Rangefinder, terrain or home.
        value_m: ``(n,)`` a distance along the body's down axis (``slant``) or a vertical height.
        slant: Whether ``value_m`` must be multiplied by cos(roll) cos(pitch) of the vehicle.
        std_m: ``(n,)`` reported standard deviation, NaN where not reported.
        lat_lon_rad: ``(n, 2)`` the point on the ground below, where the message has it; else None.
    """

    source: HeightSource
    value_m: FloatArray
    slant: bool
    std_m: FloatArray
    lat_lon_rad: FloatArray | None = None


class TriggerSource(StrEnum):
    """Message that says when the camera was triggered; what is nearest to the exposure first."""

    IMAGE_CAPTURED = "CAMERA_IMAGE_CAPTURED"
    ULOG_CAPTURE = "camera_capture"
    DATAFLASH_CAM = "CAM"
    CAMERA_FEEDBACK = "CAMERA_FEEDBACK"
    CAMERA_TRIGGER = "CAMERA_TRIGGER"
    ULOG_TRIGGER = "camera_trigger"
    DATAFLASH_TRIG = "TRIG"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TriggerTrack(Track):
    """Triggers of the camera, or its reports of having taken an image.

    Attributes:
        source: The message.
        unix_ns: ``(n,)`` UTC of the trigger by the message itself; 0 where it states none.
    """

    source: TriggerSource
    unix_ns: IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraTrack(Track):
    """Reports of one message about the camera; no row is all unknown.

    Attributes:
        source: The message.
        device: ``(n,)`` number of the camera: up to 6 for one behind the autopilot, else a camera's component id.
        stream: ``(n,)`` number of the video stream, 0 for none.
        hfov_rad: ``(n,)`` full horizontal field of view, NaN where unknown.
        level: ``(n,)`` zoom as a fraction of its range, 0 to 1, NaN where unknown.
        size_px: ``(n, 2)`` width and height of the images, 0 where unknown.
    """

    source: ZoomSource
    device: IntArray
    stream: IntArray
    hfov_rad: FloatArray
    level: FloatArray
    size_px: IntArray


def concatenate_tracks(tracks: Sequence[TrackOf]) -> TrackOf:
    """Concatenate tracks of one kind and source; columns that some tracks lack become NaN there, false in masks."""
    columns: dict[str, Any] = {}
    for each in fields(tracks[0]):
        values = [getattr(track, each.name) for track in tracks]
        known = next((value for value in values if isinstance(value, np.ndarray)), None)
        if known is not None:
            missing = False if known.dtype == np.bool_ else np.nan
            shapes = [(len(track.boot_ns), *known.shape[1:]) for track in tracks]
            filled = (np.full(shape, missing) if v is None else v for shape, v in zip(shapes, values, strict=True))
            columns[each.name] = np.concatenate(list(filled))
    return replace(tracks[0], **columns)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeartbeatTrack(Track):
    """Heartbeats of the autopilot (HEARTBEAT).

    Attributes:
        autopilot: ``(n,)`` MAV_AUTOPILOT.
        is_armed: ``(n,)`` whether the motors may turn; None where unknown.
    """

    autopilot: IntArray
    is_armed: BoolArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GpsTrack(Track):
    """The receiver's fixes and their accuracy (GPS_RAW_INT).

    Attributes:
        fix: ``(n,)`` GPS_FIX_TYPE: ``FIX_3D`` and more are three-dimensional.
        satellites: ``(n,)``, -1 where not known.
        horizontal_std_m: ``(n,)``, NaN where not known.
        vertical_std_m: ``(n,)``, NaN where not known.
        alt_msl_m: ``(n,)``, without a meaning before a 3D fix; None where unknown.
    """

    fix: IntArray
    satellites: IntArray
    horizontal_std_m: FloatArray
    vertical_std_m: FloatArray
    alt_msl_m: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeadingTrack(Track):
    """The vehicle's heading by another message than its attitude (GLOBAL_POSITION_INT).

    Attributes:
        heading_rad: ``(n,)`` clockwise from true north.
    """

    heading_rad: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReceiverTrack(Track):
    """The receiver's own positions (GPS_RAW_INT), which the estimator's are held against; only those with a 3D fix.

    Attributes:
        lat_lon_rad: ``(n, 2)`` WGS84.
        std_m: ``(n,)`` horizontal standard deviation, NaN where not known.
    """

    lat_lon_rad: FloatArray
    std_m: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EstimatorTrack(Track):
    """Status of the autopilot's EKF (EKF_STATUS_REPORT, ESTIMATOR_STATUS).

    Attributes:
        ratios: ``(n, 4)`` of ``RATIOS``.
        has_attitude: ``(n,)`` whether it has an attitude.
    """

    ratios: FloatArray
    has_attitude: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkTrack(Track):
    """Frames received from the autopilot, with gaps in their sequence numbers.

    Attributes:
        lost: ``(n,)`` frames missing right before each.
    """

    lost: IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OtherSenderTrack(Track):
    """Messages of another sender that could have been followed as well, where the configuration names none.

    Attributes:
        what: Sentence: that sender, the one that is followed, and how to choose.
    """

    what: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GimbalFailureTrack(Track):
    """Failures reported by the followed gimbal (GIMBAL_DEVICE_ATTITUDE_STATUS).

    Attributes:
        what: What failed.
    """

    what: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GimbalTypeTrack(Track):
    """What is said of the followed gimbal (GIMBAL_DEVICE_INFORMATION, GIMBAL_MANAGER_INFORMATION).

    Attributes:
        message: Name of the message.
        identity: ``(n,)`` a number that is the same for the same maker, model, abilities and limits.
        cannot_roll: ``(n,)`` whether it is said to have a tilt axis and no roll axis.
    """

    message: str
    identity: IntArray
    cannot_roll: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """Health of a vehicle and its link at one stamp; None for what was never reported.

    Attributes:
        heartbeat_age_s: Since the autopilot's last HEARTBEAT, or since the link resumed after a silence.
        gps_fix: GPS_FIX_TYPE.
        gps_age_s: Since the report of the fix.
        satellites: Number of satellites.
        horizontal_std_m: Of the receiver's position.
        vertical_std_m: Of the receiver's altitude.
        ratios: The EKF's test ratios by quantity; empty where never reported.
        has_attitude: Whether the estimator has an attitude.
        received: Frames of the autopilot over the last seconds.
        lost: Frames missing between the received ones.
        ages_s: Age of the newest sample of each kind of telemetry, by its name.
    """

    heartbeat_age_s: float | None = None
    gps_fix: int | None = None
    gps_age_s: float | None = None
    satellites: int | None = None
    horizontal_std_m: float | None = None
    vertical_std_m: float | None = None
    ratios: dict[str, float] = field(default_factory=dict)
    has_attitude: bool | None = None
    received: int = 0
    lost: int = 0
    ages_s: dict[str, float] = field(default_factory=dict)

    @property
    def loss_share(self) -> float:
        """Fraction of the autopilot's frames that were lost."""
        return self.lost / (self.lost + self.received) if self.lost else 0.0
