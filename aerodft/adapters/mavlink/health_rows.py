"""Payload rows of what a vehicle says of itself: that it is alive, how good its estimate is, what its camera sees."""

from collections import Counter
from typing import Final

import numpy as np

from aerodft.adapters.mavlink.rows import Rows, beyond
from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.model.health import EstimatorTrack, GpsTrack, HeartbeatTrack
from aerodft.model.telemetry import NO_BOOT_TIME, CameraTrack, Track
from aerodft.model.zoom import ZoomSource

_SATELLITES_UNKNOWN: Final = 255
_MAX_FIX: Final = 8
_MOST_MM: Final = 10**8  # what says that it is off by 100 km says nothing
_HAS_ATTITUDE: Final = 1  # of EKF_STATUS_FLAGS and ESTIMATOR_STATUS_FLAGS alike
_UNINITIALIZED: Final = 1024
_MAX_FOV_DEG: Final = 180.0
_FULL_LEVEL: Final = 100.0
_MOST_RATIO: Final = 1e6


def heartbeat_track(rows: Rows, _rejected: Counter[str]) -> Track:
    """HEARTBEAT of the autopilot."""
    return HeartbeatTrack(autopilot=rows.payload["autopilot"].astype(np.int64), **rows.stamps())


def gps_track(rows: Rows, rejected: Counter[str]) -> Track | None:
    """GPS_RAW_INT: the kind of fix, and the accuracy where the receiver states one (0: not stated)."""
    good = rows.kept(rejected, {"impossible fix type": rows.payload["fix_type"] > _MAX_FIX})
    if good is None:
        return None
    satellites = good.payload["satellites_visible"].astype(np.int64)
    sent = {**good.stamps(), "boot_ns": np.full(len(satellites), NO_BOOT_TIME, dtype=np.int64)}  # it has the fix's time
    return GpsTrack(
        fix=good.payload["fix_type"].astype(np.int64),
        satellites=np.where(satellites == _SATELLITES_UNKNOWN, -1, satellites),
        horizontal_std_m=_accuracy_m(good, "h_acc"),
        vertical_std_m=_accuracy_m(good, "v_acc"),
        **sent,
    )


def _accuracy_m(rows: Rows, field: str) -> FloatArray:
    accuracy_mm = rows.column(field)
    return np.where((accuracy_mm > 0) & (accuracy_mm < _MOST_MM), accuracy_mm / 1000, np.nan)


def ekf_track(rows: Rows, rejected: Counter[str]) -> Track | None:
    """EKF_STATUS_REPORT (ArduPilot); flags of 0 come from vehicles whose estimator does not report."""
    fields = ("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance")
    return _estimator_track(rows, rejected, fields, {"no estimator yet": rows.payload["flags"] == 0})


def estimator_track(rows: Rows, rejected: Counter[str]) -> Track | None:
    """ESTIMATOR_STATUS (PX4)."""
    return _estimator_track(rows, rejected, ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio"), {})


def _estimator_track(
    rows: Rows, rejected: Counter[str], fields: tuple[str, ...], faults: dict[str, BoolArray]
) -> Track | None:
    values = {field: rows.column(field) for field in fields}
    impossible = {f"{field} is no ratio": beyond(each, _MOST_RATIO) | (each < 0) for field, each in values.items()}
    good = rows.kept(rejected, {**faults, **impossible})
    if good is None:
        return None
    flags = good.payload["flags"].astype(np.int64)
    return EstimatorTrack(
        ratios=np.stack([good.column(field) for field in fields], axis=-1),
        has_attitude=((flags & _HAS_ATTITUDE) != 0) & ((flags & _UNINITIALIZED) == 0),
        **good.stamps(),
    )


def camera_fov_track(rows: Rows, rejected: Counter[str]) -> Track | None:
    """CAMERA_FOV_STATUS, degrees."""
    return _fov_track(ZoomSource.CAMERA_FOV_STATUS, rows, rejected, "camera_device_id")


def video_stream_track(rows: Rows, rejected: Counter[str]) -> Track | None:
    """VIDEO_STREAM_INFORMATION: whole degrees, 0 where not known; and the size of the images."""
    return _fov_track(
        ZoomSource.VIDEO_STREAM_INFORMATION, rows, rejected, "stream_id", ("resolution_h", "resolution_v")
    )


def _fov_track(
    source: ZoomSource, rows: Rows, rejected: Counter[str], device: str, size: tuple[str, ...] = ()
) -> Track | None:
    hfov_deg = rows.column("hfov")
    known = np.logical_or.reduce([rows.payload[field] > 0 for field in size]) if size else False
    impossible = ~((hfov_deg >= 0) & (hfov_deg < _MAX_FOV_DEG))
    good = rows.kept(
        rejected, {"impossible hfov": impossible, "hfov is not known": (hfov_deg == 0) & ~np.asarray(known)}
    )
    if good is None:
        return None
    hfov_deg = good.column("hfov")
    sizes = [good.payload[field].astype(np.int64) for field in size] or [np.zeros(len(hfov_deg), dtype=np.int64)] * 2
    return CameraTrack(
        source=source,
        device=_device(good, device),
        hfov_rad=np.where(hfov_deg > 0, np.radians(hfov_deg), np.nan),
        level=np.full(len(hfov_deg), np.nan),
        size_px=np.stack(sizes, axis=-1),
        **good.stamps(),
    )


def camera_settings_track(rows: Rows, rejected: Counter[str]) -> Track | None:
    """CAMERA_SETTINGS: the zoom in percent of its range, NaN of a camera that cannot zoom."""
    percent = rows.column("zoomLevel")
    outside = ~((percent >= 0) & (percent <= _FULL_LEVEL))
    good = rows.kept(rejected, {"zoomLevel is not known": np.isnan(percent), "impossible zoomLevel": outside})
    if good is None:
        return None
    count = len(good.arrival_ns)
    return CameraTrack(
        source=ZoomSource.CAMERA_SETTINGS,
        device=_device(good, "camera_device_id"),
        hfov_rad=np.full(count, np.nan),
        level=good.column("zoomLevel") / _FULL_LEVEL,
        size_px=np.zeros((count, 2), dtype=np.int64),
        **good.stamps(),
    )


def _device(rows: Rows, field: str) -> IntArray:
    names = rows.payload.dtype.names or ()
    return rows.payload[field].astype(np.int64) if field in names else np.zeros(len(rows.arrival_ns), dtype=np.int64)
