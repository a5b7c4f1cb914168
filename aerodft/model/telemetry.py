"""Telemetry as struct-of-arrays, in SI units, before its stamps are mapped to UTC.

One track a message type; rows in order of arrival. Adapters fill them from MAVLink or DataFlash, the service knows
only these. ``boot_ns`` is the sender's time since boot, or ``NO_BOOT_TIME`` where the message carries none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Any, Self, TypeVar

import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.model.camera import ZoomSource
from aerodft.model.pose import GimbalSource, HeightSource

NO_BOOT_TIME = -1

TrackOf = TypeVar("TrackOf", bound="Track")


class WireProtocol(StrEnum):
    """How raw telemetry bytes of the built-in formats are framed; further log formats bring names of their own."""

    MAVLINK = "mavlink"
    DATAFLASH = "dataflash"


class ReportFrame(StrEnum):
    """What roll and pitch in a gimbal's reports are against."""

    EARTH = "earth"  # the horizon, as the standard says
    BODY = "body"  # the vehicle, whatever the flags say


class MountAxes(StrEnum):
    """Which servo of a mount carries the other behind its yaw: how angles against the vehicle are composed."""

    ROLL_OUTER = "roll-outer"  # the usual one: the roll servo carries the tilt servo
    TILT_OUTER = "tilt-outer"  # the tilt servo carries the roll servo: the angles are aerospace Euler angles


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawBlock:
    """Whole frames as they came, from one sender, in order of arrival.

    Attributes:
        protocol: How the bytes are framed: a ``WireProtocol``, or the name that another log format has.
        sender: Address or file that they came from.
        arrival_ns: ``(n,)`` host UTC of each frame; not decreasing.
        offset: ``(n,)`` start of each frame in ``data``.
        length: ``(n,)`` bytes of each frame.
        data: The bytes; may hold more than the frames.
        checked: Whether every frame has just passed its check, so that it need not be made again.
    """

    protocol: str
    sender: str
    arrival_ns: IntArray
    offset: IntArray
    length: IntArray
    data: bytes
    checked: bool = False

    def rows(self, start: int, stop: int) -> "RawBlock":
        """Frames ``start`` to ``stop`` (half-open), sharing the bytes."""
        return RawBlock(
            protocol=self.protocol,
            sender=self.sender,
            arrival_ns=self.arrival_ns[start:stop],
            offset=self.offset[start:stop],
            length=self.length[start:stop],
            data=self.data,
            checked=self.checked,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """What every track has: ``(n,)`` arrival (host UTC) and time since boot, both int64 ns."""

    arrival_ns: IntArray
    boot_ns: IntArray

    def rows(self, good: BoolArray | IntArray | slice, *, boot_ns: IntArray) -> Self:
        """The rows where ``good (n,)``, or these rows, or this part of them, with these times since boot."""
        columns = {each.name: getattr(self, each.name) for each in fields(self)}
        arrays = {name: value for name, value in columns.items() if isinstance(value, np.ndarray)}
        return replace(self, **{name: value[good] for name, value in {**arrays, "boot_ns": boot_ns}.items()})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SyncTrack(Track):
    """What somebody says that its time since boot is (TIMESYNC); it need not be the vehicle's."""


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
    """

    wxyz: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GimbalTrack(Track):
    """The gimbal's attitude as reported.

    Attributes:
        source: The message.
        wxyz: ``(n, 4)`` unit quaternion ``ref_SO3_gimbal``; gimbal axes front (optical axis), right, down. Roll and
            pitch are against the horizon, if the sender keeps to the standard (see ``service.gimbal_frame``); the
            reference's x axis is north, or the vehicle's nose.
        yaw_in_earth: ``(n,)`` true where the reference's x axis is north, false where it is the vehicle's heading.
    """

    source: GimbalSource
    wxyz: FloatArray
    yaw_in_earth: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PositionTrack(Track):
    """Position and home-relative height (GLOBAL_POSITION_INT); rows before the first fix are left out.

    Attributes:
        lat_rad: ``(n,)`` WGS84.
        lon_rad: ``(n,)`` WGS84.
        alt_msl_m: ``(n,)``.
        height_home_m: ``(n,)`` above home.
    """

    lat_rad: FloatArray
    lon_rad: FloatArray
    alt_msl_m: FloatArray
    height_home_m: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeightTrack(Track):
    """Heights above ground from a sensor or a terrain database; invalid rows are left out.

    Attributes:
        source: Rangefinder or terrain.
        value_m: ``(n,)`` a distance along the body's down axis (``slant``) or a vertical height.
        slant: Whether ``value_m`` must be multiplied by cos(roll) cos(pitch) of the vehicle.
        std_m: ``(n,)`` reported standard deviation, NaN where not reported.
        lat_lon_rad: ``(n, 2)`` the place that it is the height above, where the message says it; else None.
    """

    source: HeightSource
    value_m: FloatArray
    slant: bool
    std_m: FloatArray
    lat_lon_rad: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraTrack(Track):
    """What one message says of the camera; a row says something at least.

    Attributes:
        source: The message.
        device: ``(n,)`` number of the camera: up to 6 one that the autopilot speaks for, else a camera's component id.
        stream: ``(n,)`` number of the video stream that it is of, 0 where it is of none.
        hfov_rad: ``(n,)`` full horizontal field of view, NaN where not known.
        level: ``(n,)`` zoom as a share of its range, 0 to 1, NaN where not known.
        size_px: ``(n, 2)`` width and height of the images, 0 where not known.
    """

    source: ZoomSource
    device: IntArray
    stream: IntArray
    hfov_rad: FloatArray
    level: FloatArray
    size_px: IntArray


def joined(tracks: Sequence[TrackOf]) -> TrackOf:
    """The rows of tracks of one kind and source, one track after the other; places that are not known are NaN."""
    columns: dict[str, Any] = {}
    for each in fields(tracks[0]):
        values = [getattr(track, each.name) for track in tracks]
        if any(isinstance(value, np.ndarray) for value in values):
            unknown = [np.full((len(track.boot_ns), 2), np.nan) for track in tracks]  # only places may be left out
            columns[each.name] = np.concatenate([u if v is None else v for u, v in zip(unknown, values, strict=True)])
    return replace(tracks[0], **columns)
