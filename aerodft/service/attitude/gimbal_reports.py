"""One gimbal's reports with their frame, and whether they are demands or measurements."""

from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import BoolArray, FloatArray, GimbalTrack, IntArray, MountAxes, ReportFrame
from aerodft.service.attitude.gimbal_frame import FrameDetector, FrameEvidence, gravity_samples, mounted_wxyz
from aerodft.service.attitude.slew import Demands, demands_before
from aerodft.service.batches import tick_after
from aerodft.service.settings import AttitudeSettings
from aerodft.service.streams import LAST, Stream

_MAX_PENDING_NS: Final = 10 * SECOND_NS  # of reports that wait for a query of their frame
_MIN_REPORTS: Final = 100
_MAX_REPEAT_FRACTION: Final = 0.1  # no two measurements are equal to the last bit


class Gimbal:
    """Reports of one gimbal source.

    Attributes:
        stream: Samples of the reports.
    """

    def __init__(self, settings: AttitudeSettings) -> None:
        self.stream = Stream(settings.max_gap_ns)
        self._settings = settings
        self._detector = FrameDetector()
        self._processed_ns: int | None = None
        self._last_wxyz: FloatArray | None = None
        self._initial = self._detector.evidence
        self._later: list[tuple[int, FrameEvidence]] = []  # with the whole second from which on each applies
        self._counts: IntArray = np.zeros((1, 2), dtype=np.int64)  # reports and repeats by each tick

    @property
    def has_reported(self) -> bool:
        """Whether there was any report."""
        return bool(self._counts[-1, 0] > 0)

    def append(self, track: GimbalTrack, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append the reports of a step, as ``Stream.append``, delayed to when the camera follows them."""
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
        """End the step; process reports that have been pending too long."""
        self.stream.commit()
        self._counts = self._counts[-1:]
        self._keep_last_evidence()
        if (self.stream.last_ns or 0) - (self._processed_ns or 0) > _MAX_PENDING_NS:
            self._process_pending(vehicle)

    def _keep_last_evidence(self) -> None:
        """Drop earlier evidence: no later query is as of an earlier tick."""
        self._initial = self._detector.evidence
        self._later = []

    def clear(self) -> None:
        """Remove samples of another boot, and their evidence: the gimbal may be another one."""
        self._detector = FrameDetector()
        self._processed_ns = self._last_wxyz = None
        self._counts = np.zeros((1, 2), dtype=np.int64)
        self._keep_last_evidence()
        self.stream.clear()

    def shift(self, by_ns: int, vehicle: Stream) -> None:
        """Shift all stamps; call it before shifting the vehicle's."""
        self._process_pending(vehicle)
        self._detector.end_motion()
        self._processed_ns = None if self._processed_ns is None else self._processed_ns + by_ns
        self._keep_last_evidence()
        self.stream.shift(by_ns)

    def evidence(self, vehicle: Stream) -> FrameEvidence:
        """Evidence on the reports' frame as of the last tick."""
        evidences, evidence_index = self.evidence_at(vehicle, LAST)
        return evidences[int(evidence_index[0])]

    def evidence_at(self, vehicle: Stream, ticks: IntArray) -> tuple[list[FrameEvidence], IntArray]:
        """Evidence as of ticks ``(n,)``: a list, and the index of each tick's."""
        self._process_pending(vehicle)
        passed_ns = np.minimum(self.stream.newest_ns(ticks), vehicle.newest_ns(ticks)) // SECOND_NS * SECOND_NS
        held_from = np.array([from_ns for from_ns, _ in self._later], dtype=np.int64)
        return [self._initial, *(evidence for _, evidence in self._later)], held_from.searchsorted(passed_ns, "right")

    def is_demand(self, frame: ReportFrame | None, ticks: IntArray) -> BoolArray:
        """Whether the reports may be demands as of ticks ``(n,)``.

        Only reports that vary and are relative to the horizon are measurements.

        Args:
            frame: The frame decided by the evidence.
            ticks: As in ``Stream.find``.
        """
        counts = self._counts[ticks if len(self._counts) > 1 else np.zeros_like(ticks)]
        return self._are_demands(frame, counts)

    def _are_demands(self, frame: ReportFrame | None, counts: IntArray) -> BoolArray:
        """Whether reports may be demands, by numbers of reports and repeats ``(n, 2)``."""
        if self._settings.is_demand is not None:
            return np.full(len(counts), self._settings.is_demand)
        reports, repeats = counts.T
        varied = (reports >= _MIN_REPORTS) & (repeats < _MAX_REPEAT_FRACTION * reports)
        return np.asarray(~varied | ((self._settings.frame or frame) is not ReportFrame.EARTH))

    def demands(
        self, before: IntArray, stamps_ns: IntArray, ticks: IntArray, axes: MountAxes, vehicle: Stream
    ) -> tuple[Demands, FloatArray]:
        """Demands before stamps ``(n,)`` as of ticks ``(n,)``, and their attitudes ``(k, 4)``.

        Args:
            before: ``(n,)`` rows of the last samples that are not after the stamps.
            stamps_ns: ``(n,)``.
            ticks: ``(n,)`` as in ``Stream.find``.
            axes: Servo order of the reports' angles, as in ``mounted_wxyz``.
            vehicle: The vehicle's attitude.
        """
        settings, stream = self._settings, self.stream
        demands = demands_before(
            stream.stamps_ns,
            before,
            stamps_ns,
            stream.rows_known_at(ticks)[0],
            lag_ns=settings.lag_ns,
            slew_radps=settings.slew_radps,
        )
        first, stop = int(np.min(demands.first)), int(np.max(demands.stop))
        rows_used = slice(first, max(first, stop))
        wxyz, in_earth = stream.column("wxyz")[rows_used], stream.column("yaw_in_earth")[rows_used] > 0
        if axes is MountAxes.ROLL_OUTER:
            body_rows = np.searchsorted(vehicle.stamps_ns, stream.stamps_ns[rows_used], side="right")
            bodies = vehicle.column("wxyz")[np.maximum(body_rows, 1) - 1]
            wxyz = mounted_wxyz(wxyz, axes, bodies, yaw_in_earth=in_earth)
        rows = Demands(demands.first - first, demands.stop - first, demands.since_ns[rows_used], demands.stamps_ns)
        return rows, wxyz

    def _common_second_ns(self, vehicle: Stream) -> int:
        """Last whole second that both streams have passed."""
        return min(self.stream.last_ns or 0, vehicle.last_ns or 0) // SECOND_NS * SECOND_NS

    def _process_pending(self, vehicle: Stream) -> None:
        """Process new reports up to the last common whole second, independently of how ticks are grouped."""
        last_ns = self._common_second_ns(vehicle)
        if self._processed_ns is not None and last_ns <= self._processed_ns:
            return
        samples = gravity_samples(self.stream, vehicle, after_ns=self._processed_ns or 0, until_ns=last_ns)
        if samples is not None:
            for stamp_ns, evidence in self._detector.update_all(samples):
                self._later.append((tick_after(stamp_ns, SECOND_NS), evidence))
        self._processed_ns = last_ns
