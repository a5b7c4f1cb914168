"""Payload rows of what a vehicle says of itself: that it is alive, where it is fixed, how good its estimate is."""

from collections import Counter
from collections.abc import Iterator
from typing import Final

import numpy as np

from aerodft.adapters.mavlink.rows import GIMBAL_FAILURES, Rows, beyond
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.model.health import EstimatorTrack, GimbalFailureTrack, GpsTrack, HeartbeatTrack
from aerodft.model.telemetry import NO_BOOT_TIME, Track

_SATELLITES_UNKNOWN: Final = 255
_MAX_FIX: Final = 8
_MOST_MM: Final = 10**8  # what says that it is off by 100 km says nothing
_HAS_ATTITUDE: Final = 1  # of EKF_STATUS_FLAGS and ESTIMATOR_STATUS_FLAGS alike
_UNINITIALIZED: Final = 1024
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


def gimbal_failure_tracks(rows: Rows) -> Iterator[GimbalFailureTrack]:
    """What GIMBAL_DEVICE_ATTITUDE_STATUS says of failures: such rows hold no attitude, and others may fill the gap."""
    failures = rows.payload["failure_flags"]
    if not np.any(failures):
        return
    for words, bits in GIMBAL_FAILURES.items():
        failed = (failures & bits) != 0
        if np.any(failed):
            what = f"the gimbal reports a failure ({words})"
            yield GimbalFailureTrack(what=what, arrival_ns=rows.arrival_ns[failed], boot_ns=rows.boot_ns[failed])
