"""The motion that a recorded autopilot log tells of, taken as the truth."""

from collections import Counter, defaultdict
from dataclasses import fields
from pathlib import Path
from typing import TypeVar

import numpy as np

from aerodft.adapters.mavlink.decoding import MavlinkDecoder
from aerodft.adapters.mavlink.logs import TlogSource
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError
from aerodft.geometry.geodesy import east_north
from aerodft.geometry.rotation import camera_from_gimbal, inverse, multiply, slerp
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import GeoOrigin
from aerodft.model.telemetry import (
    NO_BOOT_TIME,
    ClockTrack,
    GimbalTrack,
    PositionTrack,
    RawBlock,
    Track,
    VehicleTrack,
)
from aerodft.sim.trajectory import Trajectory, heading_wxyz

TrackT = TypeVar("TrackT", bound=Track)

MAX_GAP_NS = SECOND_NS
_HEADER = {0xFD: 10, 0xFE: 6}


def from_log(path: Path) -> Trajectory:
    """The flight in a telemetry log, one sample for every attitude of the gimbal that has a neighbour in each stream.

    Stamps are UTC: time since boot plus the median of SYSTEM_TIME. Heights are home-relative, so that the plane goes
    through home, where the ENU origin is.

    Raises:
        InputError: The file is missing, or not a telemetry log.
        NoAnswerError: The log lacks positions, vehicle attitudes, gimbal attitudes with their own time, or UTC.
    """
    tracks = _decoded(path)
    clock = _joined(path, tracks, ClockTrack, "SYSTEM_TIME with UTC")
    position = _joined(path, tracks, PositionTrack, "GLOBAL_POSITION_INT")
    vehicle = _joined(path, tracks, VehicleTrack, "ATTITUDE")
    gimbal = _joined(path, tracks, GimbalTrack, "gimbal attitude")
    if NO_BOOT_TIME in gimbal.boot_ns:
        expected = "GIMBAL_DEVICE_ATTITUDE_STATUS or MOUNT_ORIENTATION"
        raise NoAnswerError(
            "its gimbal attitudes have no time of their own", where=path, got=gimbal.source, expected=expected
        )
    utc_minus_boot = int(np.median(clock.unix_ns - clock.boot_ns))
    stamps, rows = _common_stamps(gimbal.boot_ns, position.boot_ns, vehicle.boot_ns)
    if len(stamps) < 2:  # noqa: PLR2004 (a motion has two ends)
        raise NoAnswerError("position, vehicle and gimbal attitude never come together", where=path)
    home, place = _placed(position)
    body = slerp(*_ends(vehicle.boot_ns, vehicle.wxyz, stamps))
    heading, reported, in_earth = heading_wxyz(body), gimbal.wxyz[rows], gimbal.yaw_in_earth[rows]
    ned_wxyz_gimbal = np.where(in_earth[:, None], reported, multiply(heading, reported))
    low, high, weight = _ends(position.boot_ns, place, stamps)
    return Trajectory(
        origin=home,
        stamp_ns=stamps + utc_minus_boot,
        position_enu_m=low + weight[:, None] * (high - low),
        ned_wxyz_body=body,
        level_wxyz_gimbal=multiply(inverse(heading), ned_wxyz_gimbal),
        enu_wxyz_cam=camera_from_gimbal(ned_wxyz_gimbal),
    )


def _decoded(path: Path) -> dict[type, list[Track]]:
    """The log's tracks by kind."""
    tracks: defaultdict[type, list[Track]] = defaultdict(list)
    decoder = MavlinkDecoder()
    for event in TlogSource(path).events():
        if isinstance(event, RawBlock):
            for track in decoder.decode(event):
                tracks[type(track)].append(track)
    return tracks


def thin_log(source: Path, target: Path, *, keep_every: int, offset: int = 0) -> None:
    """Copy a telemetry log with only every ``keep_every``-th frame of each message; clock and heartbeats are all kept.

    Raises:
        InputError: The source is missing, or not a telemetry log.
    """
    whole = {0, 2}
    seen: Counter[int] = Counter()
    with target.open("wb") as file:
        for event in TlogSource(source).events():
            if not isinstance(event, RawBlock):
                continue
            for arrival, start, length in zip(event.arrival_ns, event.offset, event.length, strict=True):
                frame = event.data[start : start + length]
                size = 3 if _HEADER[frame[0]] == _HEADER[0xFD] else 1
                at = _HEADER[frame[0]] - size
                message = int.from_bytes(frame[at : at + size], "little")
                seen[message] += 1
                if message in whole or (seen[message] - 1) % keep_every == offset:
                    file.write((int(arrival) // 1000).to_bytes(8, "big") + frame)


def _joined(path: Path, tracks: dict[type, list[Track]], kind: type[TrackT], what: str) -> TrackT:
    """All rows of one kind (of its first source, where there are several), ascending in time since boot, each once."""
    parts = [track for track in tracks[kind] if isinstance(track, kind)]
    sources = [track.source for track in parts if isinstance(track, GimbalTrack)]
    parts = [track for track in parts if not isinstance(track, GimbalTrack) or track.source == sources[0]]
    if not parts:
        raise NoAnswerError("the log holds none", where=path, got="nothing", expected=what)
    _, order = np.unique(np.concatenate([part.boot_ns for part in parts]), return_index=True)
    columns = {}
    for column in fields(kind):
        values = [getattr(part, column.name) for part in parts]
        columns[column.name] = np.concatenate(values)[order] if isinstance(values[0], np.ndarray) else values[0]
    return kind(**columns)


def _common_stamps(gimbal_ns: IntArray, *others_ns: IntArray) -> tuple[IntArray, IntArray]:
    """The gimbal's stamps (and their rows) that lie between two samples of all others, at most 1 s apart."""
    good = gimbal_ns > 0
    for other in others_ns:
        after = np.clip(np.searchsorted(other, gimbal_ns), 1, len(other) - 1)
        good &= (other[after - 1] <= gimbal_ns) & (gimbal_ns <= other[after])
        good &= other[after] - other[after - 1] <= MAX_GAP_NS
    rows = np.flatnonzero(good)
    return gimbal_ns[rows], rows


def _ends(stamps_ns: IntArray, values: FloatArray, at_ns: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The samples ``(n, k)`` before and after ``at_ns (n,)``, and the weight of the later ones."""
    after = np.clip(np.searchsorted(stamps_ns, at_ns), 1, len(stamps_ns) - 1)
    weight = (at_ns - stamps_ns[after - 1]) / (stamps_ns[after] - stamps_ns[after - 1])
    return values[after - 1], values[after], weight


def _placed(position: PositionTrack) -> tuple[GeoOrigin, FloatArray]:
    """Home (the first fix, on the home-relative height's datum) and the positions in its ENU, ``(n, 3)``."""
    home = GeoOrigin(
        lat_rad=float(position.lat_rad[0]),
        lon_rad=float(position.lon_rad[0]),
        alt_msl_m=float(position.alt_msl_m[0] - position.height_home_m[0]),
    )
    flat = east_north(home, position.lat_rad, position.lon_rad)
    return home, np.column_stack([flat, position.height_home_m])
