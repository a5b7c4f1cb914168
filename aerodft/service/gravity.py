"""Where down is at a gimbal's reports: for the vehicle, and for the camera by either reading of the report."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from aerodft.geometry.rotation import from_yaw_pitch_roll, matrix, yaw_pitch_roll
from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.service.streams import Stream

LAGS_NS: Final = (0, 100_000_000, 200_000_000, 300_000_000)
"""How much older than its stamp a report may be: each is tried."""

_NEIGHBOURS = 3  # samples that a stamp's values are made of, those before it
_STEP_NS = 100_000_000  # reports closer than this tell nothing new


@dataclass(frozen=True, slots=True)
class Moment:
    """Unit vectors of gravity at one report.

    Attributes:
        stamp_ns: The report's.
        reported_pitch_rad: As it stands in the report.
        down_body: Three numbers, in the vehicle's axes.
        down_if_earth: ``(3,)`` in the gimbal's axes, if the report's roll and pitch are against the horizon.
        down_if_body: ``(lags, 3)`` in the gimbal's axes, if they are against the vehicle as it was that long before.
        bend_rad: How far ``down_body`` was from the mean of its neighbours, twice, in the vehicle's own last samples:
            between slow ones nothing is seen of their noise.
    """

    stamp_ns: int
    reported_pitch_rad: float
    down_body: Sequence[float]
    down_if_earth: FloatArray
    down_if_body: FloatArray
    bend_rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Those of ``n`` reports, in order, as columns.

    Attributes:
        is_known: ``(n,)`` whether the vehicle's attitude is known on both sides, and for the longest lag before.
        stamp_ns: ``(n,)``, see ``Moment`` for this and all others.
        reported_pitch_rad: ``(n,)``.
        down_body: ``(n, 3)``.
        down_if_earth: ``(n, 3)``.
        down_if_body: ``(n, lags, 3)``.
        bend_rad: ``(n,)``.
    """

    is_known: BoolArray
    stamp_ns: IntArray
    reported_pitch_rad: FloatArray
    down_body: FloatArray
    down_if_earth: FloatArray
    down_if_body: FloatArray
    bend_rad: FloatArray

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def rows(self, rows: slice) -> "Moments":
        """Some of them."""
        return Moments(*(getattr(self, each.name)[rows] for each in fields(self)))

    def row(self, row: int) -> Moment:
        """One of them."""
        return Moment(
            int(self.stamp_ns[row]),
            float(self.reported_pitch_rad[row]),
            self.down_body[row].tolist(),
            self.down_if_earth[row],
            self.down_if_body[row],
            float(self.bend_rad[row]),
        )


def moments(gimbal: Stream, vehicle: Stream, *, after_ns: int, until_ns: int) -> Moments | None:
    """The reports after a stamp and up to another, at most one in each tenth of a second; None where there are none."""
    rows = _rows(gimbal.stamps_ns, after_ns, until_ns)
    if not len(rows) or vehicle.last_ns is None:
        return None
    stamps = gimbal.stamps_ns[rows]
    reported = matrix(gimbal.column("wxyz")[rows])
    first = max(int(np.searchsorted(vehicle.stamps_ns, stamps[0] - max(LAGS_NS))) - _NEIGHBOURS, 0)
    samples_ns, attitudes = vehicle.stamps_ns[first:], vehicle.column("wxyz")[first:]
    before = np.stack([stamps - lag_ns for lag_ns in LAGS_NS], axis=-1)
    own_downs = matrix(attitudes)[:, 2]
    downs, known = _between(samples_ns, own_downs, before, vehicle.max_gap_ns)
    bends = _bends(own_downs)[np.searchsorted(samples_ns, stamps, side="right") - 1]
    latest = np.clip(np.searchsorted(samples_ns, stamps), 0, len(attitudes) - 1)
    yaws = np.where(gimbal.column("yaw_in_earth")[rows] > 0, yaw_pitch_roll(attitudes[latest])[0], 0.0)
    against_body = matrix(from_yaw_pitch_roll(-yaws, 0.0, 0.0)) @ reported
    pitches = yaw_pitch_roll(gimbal.column("wxyz")[rows])[1]
    return Moments(known, stamps, pitches, downs[:, 0], reported[:, 2], downs @ against_body, bends)


def _bends(downs: FloatArray) -> FloatArray:
    """Length ``(n,)`` of the second differences that end at each of ``downs (n, 3)``; 0 of the first two."""
    return np.concatenate([np.zeros(min(2, len(downs))), np.linalg.norm(np.diff(downs, n=2, axis=0), axis=-1)])


def _rows(stamps_ns: IntArray, after_ns: int, until_ns: int) -> IntArray:
    """The first report in each tenth of a second."""
    first, stop = np.searchsorted(stamps_ns, [after_ns, until_ns], side="right").tolist()
    tenths = stamps_ns[first:stop] // _STEP_NS
    fresh = np.diff(tenths, prepend=after_ns // _STEP_NS - 1) > 0
    return np.flatnonzero(fresh) + int(first)


def _between(
    samples_ns: IntArray, values: FloatArray, stamps_ns: IntArray, max_gap_ns: int
) -> tuple[FloatArray, BoolArray]:
    """The vehicle's ``values (m, 3)`` at ``stamps_ns (n, lags)`` and which rows ``(n,)`` are known, for all lags.

    Returns:
        ``(n, lags, 3)`` linear between samples, and ``(n,)``.
    """
    after = np.clip(np.searchsorted(samples_ns, stamps_ns), 1, len(samples_ns) - 1)
    gap = samples_ns[after] - samples_ns[after - 1]
    weight = (stamps_ns - samples_ns[after - 1]) / np.maximum(gap, 1)
    known = (weight >= 0) & (weight <= 1) & (gap <= max_gap_ns) & (gap > 0)
    return values[after - 1] + weight[..., None] * (values[after] - values[after - 1]), np.all(known, axis=-1)
