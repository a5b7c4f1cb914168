"""The level of the water over time: readings of a gauge, and what they say of a stamp between them."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import FloatArray, IntArray

MIN_READINGS: Final = 3
"""Fewest readings of a series: how fast a level bends shows in three."""

MIN_WALK_M_PER_ROOT_S: Final = 0.03 / 60.0
"""Least random walk of a level, m per root second: 3 cm in an hour, waves and wind over quiet water. Chosen; between
readings 15 minutes apart it adds 0.8 cm, at half 0.4 cm and at twice 1.5 cm."""

MIN_RATE_MPS: Final = 0.1 / 3600.0
"""Least rate (m/s) at which a level may go on to change behind its last reading, 10 cm in an hour. Chosen; half of it
is passed by most floods, twice is the tide of 0.4 m amplitude."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WaterLevel:
    """Level of the water, and so of the measured plane, at one stamp.

    Attributes:
        level_m: In its datum.
        std_m: Its standard deviation above the station's elevation 0: with that of ``zero_m``.
        zero_m: Level at which the water is at the station's elevation 0.
        datum: What ``level_m`` counts from.
        source: The file, or who states it.
        is_height_own: Whether the camera's height was measured to the water itself, whatever its level: such a height
            has none of the level's error.
    """

    level_m: float
    std_m: float
    zero_m: float
    datum: str
    source: str
    is_height_own: bool = False

    @property
    def elevation_m(self) -> float:
        """Height of the water above the station's elevation 0."""
        return self.level_m - self.zero_m


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LevelSeries:
    """Readings of a gauge, interpolated linearly; or one level that always holds.

    The std at a stamp holds the reading's, and how far the level may have left the straight line between two readings:
    by a random walk as strong as the series has (a Brownian bridge), and by bending as it does around the stamp
    (``1/2 c t0 t1``, with the second difference ``c`` over steps as long as the gap).

    Attributes:
        stamps_ns: ``(n,)`` UTC, increasing.
        level_m: ``(n,)`` in their datum.
        std_m: ``(n,)`` standard deviations.
        max_gap_ns: Longest gap that is interpolated over; None for one level that always holds.
        zero_m: As in ``WaterLevel``.
        zero_std_m: Its standard deviation.
        datum: As in ``WaterLevel``.
        source: As in ``WaterLevel``.

    Raises:
        ValueError: Fewer readings than ``MIN_READINGS``, or not in order.
    """

    stamps_ns: IntArray
    level_m: FloatArray
    std_m: FloatArray
    max_gap_ns: int | None
    zero_m: float = 0.0
    zero_std_m: float = 0.0
    datum: str
    source: str
    _walk_m2ps: float = field(init=False, repr=False, default=0.0)
    _usual_s: float = field(init=False, repr=False, default=0.0)
    _usual_mps: float = field(init=False, repr=False, default=0.0)

    def __post_init__(self) -> None:
        if self.max_gap_ns is not None and (len(self.stamps_ns) < MIN_READINGS or np.any(np.diff(self.stamps_ns) <= 0)):
            raise ValueError(f"got {len(self.stamps_ns)} readings, expected {MIN_READINGS} or more in increasing order")
        if self.max_gap_ns is not None:
            steps_s = np.diff(self.stamps_ns) / SECOND_NS
            rate_mps = float(np.sqrt(np.mean(np.square(np.diff(self.level_m) / steps_s))))
            object.__setattr__(self, "_walk_m2ps", self._walk())
            usual_s = float(np.median(steps_s))  # readings too far apart for a line say nothing of what is beside them
            object.__setattr__(self, "_usual_s", usual_s if usual_s <= self.max_gap_ns / SECOND_NS else 0.0)
            object.__setattr__(self, "_usual_mps", max(rate_mps, MIN_RATE_MPS))

    @staticmethod
    def constant(
        level_m: float, std_m: float, *, datum: str, source: str, zero_m: float = 0.0, zero_std_m: float = 0.0
    ) -> "LevelSeries":
        """One level that holds at every stamp."""
        return LevelSeries(
            stamps_ns=np.zeros(1, dtype=np.int64),
            level_m=np.array([level_m]),
            std_m=np.array([std_m]),
            max_gap_ns=None,
            zero_m=zero_m,
            zero_std_m=zero_std_m,
            datum=datum,
            source=source,
        )

    def at(self, stamps_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Levels ``(n,)`` at stamps ``(n,)``, and their stds with that of the zero; NaN where readings are too far."""
        if self.max_gap_ns is None:
            level_m, std_m = np.full(len(stamps_ns), self.level_m[0]), np.full(len(stamps_ns), self.std_m[0])
            return level_m, np.hypot(std_m, self.zero_std_m)
        last = len(self.stamps_ns) - 1
        after = np.searchsorted(self.stamps_ns, stamps_ns)
        is_reading = self.stamps_ns[np.minimum(after, last)] == stamps_ns
        after, before = np.minimum(after, last), np.maximum(np.where(is_reading, after, after - 1), 0)
        is_outside = (stamps_ns < self.stamps_ns[0]) | (stamps_ns > self.stamps_ns[-1])
        before = np.where(stamps_ns > self.stamps_ns[-1], last, before)
        since_s = self._seconds(self.stamps_ns[before], stamps_ns)
        until_s = self._seconds(stamps_ns, self.stamps_ns[after])
        is_between = ~is_outside & (self.stamps_ns[after] - self.stamps_ns[before] <= self.max_gap_ns)
        level_m, var_m2 = self._held(before, after, np.abs(since_s), np.abs(until_s))
        rows = np.flatnonzero(is_between)
        level_m[rows], var_m2[rows] = self._interpolated(before[rows], after[rows], since_s[rows], until_s[rows])
        return level_m, np.hypot(np.sqrt(var_m2), self.zero_std_m)

    def elevation_m(self, stamps_ns: IntArray) -> FloatArray:
        """Heights ``(n,)`` of the water above the station's elevation 0; 0 where readings are too far."""
        return np.nan_to_num(self.at(stamps_ns)[0] - self.zero_m, nan=0.0)

    def _interpolated(
        self, before: IntArray, after: IntArray, since_s: FloatArray, until_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Levels and variances ``(n,)`` between two readings, which may be one and the same."""
        gap_s = since_s + until_s
        weight = np.divide(since_s, gap_s, out=np.zeros_like(gap_s), where=gap_s > 0)
        level_m = self.level_m[before] + weight * (self.level_m[after] - self.level_m[before])
        # The errors of two readings are mostly one and the same, of the gauge's zero: no mean is better than the worse.
        read_m = np.maximum(self.std_m[before], self.std_m[after])
        bridge_m2 = self._walk_m2ps * weight * until_s
        bend_m = self._bend_mps2(before, after, gap_s) * since_s * until_s / 2
        return level_m, np.square(read_m) + bridge_m2 + np.square(bend_m)

    def _held(
        self, before: IntArray, after: IntArray, since_s: FloatArray, until_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Levels and variances ``(n,)`` by the nearer reading, for as long as one reading may be late; else NaN."""
        row, away_s = np.where(since_s <= until_s, before, after), np.minimum(since_s, until_s)
        beside = np.maximum(
            self._rate_mps(np.maximum(row - 1, 0)), self._rate_mps(np.minimum(row, len(self.level_m) - 2))
        )
        var_m2 = np.square(self.std_m[row]) + self._walk_m2ps * away_s
        var_m2 += np.square(np.maximum(beside, self._usual_mps) * away_s)
        is_near = away_s <= self._usual_s
        return np.where(is_near, self.level_m[row], np.nan), np.where(is_near, var_m2, np.nan)

    def _rate_mps(self, rows: IntArray) -> FloatArray:
        """Size of the rate ``(n,)`` from readings to the next ones."""
        rise_m = self.level_m[rows + 1] - self.level_m[rows]
        return np.asarray(np.abs(rise_m) / self._seconds(self.stamps_ns[rows], self.stamps_ns[rows + 1]))

    def _walk(self) -> float:
        """Variance per second of the walk that readings show, each against the line between its neighbours."""
        before_s, after_s = np.diff(self.stamps_ns)[:-1] / SECOND_NS, np.diff(self.stamps_ns)[1:] / SECOND_NS
        weight = before_s / (before_s + after_s)
        away_m = self.level_m[1:-1] - (1 - weight) * self.level_m[:-2] - weight * self.level_m[2:]
        noise_m2 = np.square(self.std_m[1:-1]) * (1 + np.square(weight) + np.square(1 - weight))
        walk = float(np.mean((np.square(away_m) - noise_m2) / (weight * after_s)))
        # Neighbours share a step: squares of second differences have a correlation of 1/4, so two thirds of them count.
        # The factor is about the square of Student's 97.5 % quantile over the normal one: 1.5 of 11 readings.
        freedom = 2 * len(away_m) / 3
        return max(walk * (1 + 3 / freedom + 10 / freedom**3), MIN_WALK_M_PER_ROOT_S**2)

    def _bend_mps2(self, before: IntArray, after: IntArray, gap_s: FloatArray) -> FloatArray:
        """Larger second difference ``(n,)`` at the two ends of gaps, over steps at least as long as these."""
        gap_ns = self.stamps_ns[after] - self.stamps_ns[before]
        earlier = np.maximum(np.searchsorted(self.stamps_ns, self.stamps_ns[before] - gap_ns, side="right") - 1, 0)
        later = np.minimum(np.searchsorted(self.stamps_ns, self.stamps_ns[after] + gap_ns), len(self.stamps_ns) - 1)
        bends = self._second_difference(earlier, before, after), self._second_difference(before, after, later)
        return np.where(gap_s > 0, np.maximum(*bends), 0.0)

    def _second_difference(self, first: IntArray, middle: IntArray, last: IntArray) -> FloatArray:
        """Size of the second derivative ``(n,)`` by three readings; 0 where two of them are the same."""
        before_s = self._seconds(self.stamps_ns[first], self.stamps_ns[middle])
        after_s = self._seconds(self.stamps_ns[middle], self.stamps_ns[last])
        is_known = (before_s > 0) & (after_s > 0)
        before_s, after_s = np.where(is_known, before_s, 1.0), np.where(is_known, after_s, 1.0)
        rise = (self.level_m[last] - self.level_m[middle]) / after_s
        rise -= (self.level_m[middle] - self.level_m[first]) / before_s
        return np.where(is_known, np.abs(2 * rise / (before_s + after_s)), 0.0)

    @staticmethod
    def _seconds(start_ns: IntArray, stop_ns: IntArray) -> FloatArray:
        return np.asarray((stop_ns - start_ns) / SECOND_NS)
