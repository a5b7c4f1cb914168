"""One gimbal's reports: their samples, what they are against, and whether they are demands or measurements."""

from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import BoolArray, FloatArray, GimbalTrack, IntArray, MountAxes, ReportFrame
from aerodft.service.attitude.gimbal_frame import FrameDetector, FrameEvidence, gravity_samples
from aerodft.service.attitude.servo_mount import mounted_wxyz
from aerodft.service.attitude.slew import Demands, demands_before
from aerodft.service.batches import tick_after
from aerodft.service.settings import AttitudeSettings
from aerodft.service.streams import LAST, Stream

_LONGEST_WAIT_NS: Final = 10 * SECOND_NS  # reports are weighed when their verdict is asked for, at the latest by then
_ENOUGH_REPORTS: Final = 100
_MOST_REPEATS: Final = 0.1  # share; no two measurements are alike to the last bit


class Gimbal:
    """The reports of one source.

    Attributes:
        stream: Their samples.
    """

    def __init__(self, settings: AttitudeSettings) -> None:
        self.stream = Stream(settings.max_gap_ns)
        self._settings = settings
        self._detector = FrameDetector()
        self._weighed_ns: int | None = None
        self._last_wxyz: FloatArray | None = None
        self._unweighed = self._detector.evidence
        self._verdicts: list[tuple[int, FrameEvidence]] = []  # other ones, and from which whole second on they hold
        self._counts: IntArray = np.zeros((1, 2), dtype=np.int64)  # reports and repeats by each tick

    @property
    def has_reported(self) -> bool:
        """Whether there was any report."""
        return bool(self._counts[-1, 0] > 0)

    def append(self, track: GimbalTrack, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Take in the reports of a step, as ``Stream.append``; they count from when the camera follows them."""
        if not len(stamps_ns):
            return
        stamps_ns = stamps_ns + self._settings.delay_ns
        earth = track.yaw_in_earth.astype(np.float64)
        self.stream.append(stamps_ns, row_end_by_tick, wxyz=track.wxyz, yaw_in_earth=earth)
        before = track.wxyz[:1] + 1 if self._last_wxyz is None else self._last_wxyz
        same = np.diff(track.wxyz, axis=0, prepend=before) == 0
        repeats = np.concatenate([[0], np.cumsum(np.all(same, axis=-1))])
        ends = np.array([len(stamps_ns)]) if row_end_by_tick is None else row_end_by_tick
        self._counts = self._counts[-1] + np.stack([ends, repeats[ends]], axis=-1)
        self._last_wxyz = track.wxyz[-1:]

    def commit(self, vehicle: Stream) -> None:
        """The ticks so far are over: weigh what waits for it too long."""
        self.stream.commit()
        self._counts = self._counts[-1:]
        self._forget_verdicts()
        if (self.stream.last_ns or 0) - (self._weighed_ns or 0) > _LONGEST_WAIT_NS:
            self._weigh(vehicle)

    def _forget_verdicts(self) -> None:
        """No tick before now will be looked at: all that was learned counts."""
        self._unweighed = self._detector.evidence
        self._verdicts = []

    def clear(self) -> None:
        """Forget samples of another boot, and what they taught: the gimbal may be another one since."""
        self._detector = FrameDetector()
        self._weighed_ns = self._last_wxyz = None
        self._counts = np.zeros((1, 2), dtype=np.int64)
        self._forget_verdicts()
        self.stream.clear()

    def shift(self, by_ns: int, vehicle: Stream) -> None:
        """Move all samples, before the vehicle's are."""
        self._weigh(vehicle)
        self._detector.break_off()
        self._weighed_ns = None if self._weighed_ns is None else self._weighed_ns + by_ns
        self._forget_verdicts()
        self.stream.shift(by_ns)

    def evidence(self, vehicle: Stream) -> FrameEvidence:
        """What is known of the reports' frame as of the last tick."""
        known, evidence_index = self.evidence_at(vehicle, LAST)
        return known[int(evidence_index[0])]

    def evidence_at(self, vehicle: Stream, ticks: IntArray) -> tuple[list[FrameEvidence], IntArray]:
        """What was known as of ticks ``(n,)``: all that was, and which of it each time."""
        self._weigh(vehicle)
        passed_ns = np.minimum(self.stream.newest_ns(ticks), vehicle.newest_ns(ticks)) // SECOND_NS * SECOND_NS
        held_from = np.array([from_ns for from_ns, _ in self._verdicts], dtype=np.int64)
        return [self._unweighed, *(known for _, known in self._verdicts)], held_from.searchsorted(passed_ns, "right")

    def is_demand(self, frame: ReportFrame | None, ticks: IntArray) -> BoolArray:
        """Whether the reports may be demands as of ticks ``(n,)``.

        Only what moves by itself and keeps to the horizon is a measurement.

        Args:
            frame: The evidence's verdict.
            ticks: As in ``Stream.find``.
        """
        counts = self._counts[ticks if len(self._counts) > 1 else np.zeros_like(ticks)]
        return self._are_demands(frame, counts)

    def _are_demands(self, frame: ReportFrame | None, counts: IntArray) -> BoolArray:
        """Whether reports may be demands, by so many reports and repeats ``(n, 2)``."""
        if self._settings.is_demand is not None:
            return np.full(len(counts), self._settings.is_demand)
        reports, repeats = counts.T
        varied = (reports >= _ENOUGH_REPORTS) & (repeats < _MOST_REPEATS * reports)
        return np.asarray(~varied | ((self._settings.frame or frame) is not ReportFrame.EARTH))

    def demands(
        self, before: IntArray, stamps_ns: IntArray, ticks: IntArray, axes: MountAxes, vehicle: Stream
    ) -> tuple[Demands, FloatArray]:
        """What was demanded before stamps ``(n,)`` as of ticks ``(n,)``, and these attitudes ``(k, 4)``.

        Args:
            before: ``(n,)`` rows of the last samples that are not after the stamps.
            stamps_ns: When.
            ticks: Samples of later ones are not known.
            axes: What the reports' angles come to, as in ``mounted_wxyz``.
            vehicle: The vehicle's attitude.
        """
        limits, stream = self._settings, self.stream
        demands = demands_before(
            stream.stamps_ns,
            before,
            stamps_ns,
            stream.rows_known_at(ticks)[0],
            lag_ns=limits.lag_ns,
            slew_radps=limits.slew_radps,
        )
        first, stop = int(np.min(demands.first)), int(np.max(demands.stop))
        own = slice(first, max(first, stop))
        wxyz, in_earth = stream.column("wxyz")[own], stream.column("yaw_in_earth")[own] > 0
        if axes is MountAxes.ROLL_OUTER:
            at = np.searchsorted(vehicle.stamps_ns, stream.stamps_ns[own], side="right")
            bodies = vehicle.column("wxyz")[np.maximum(at, 1) - 1]
            wxyz = mounted_wxyz(wxyz, axes, bodies, yaw_in_earth=in_earth)
        rows = Demands(demands.first - first, demands.stop - first, demands.since_ns[own], demands.stamps_ns)
        return rows, wxyz

    def _passed_ns(self, vehicle: Stream) -> int:
        """The last whole second that both streams have passed."""
        return min(self.stream.last_ns or 0, vehicle.last_ns or 0) // SECOND_NS * SECOND_NS

    def _weigh(self, vehicle: Stream) -> None:
        """Weigh what came since, up to what both streams have passed: the same for any cut."""
        last_ns = self._passed_ns(vehicle)
        if self._weighed_ns is not None and last_ns <= self._weighed_ns:
            return
        found = gravity_samples(self.stream, vehicle, after_ns=self._weighed_ns or 0, until_ns=last_ns)
        if found is not None:
            for stamp_ns, evidence in self._detector.weigh_all(found):
                self._verdicts.append((tick_after(stamp_ns, SECOND_NS), evidence))
        self._weighed_ns = last_ns
