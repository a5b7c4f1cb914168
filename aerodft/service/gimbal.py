"""One gimbal's reports: their samples, what they are against, and whether they are demands or measurements."""

from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.interpolation import Bracket
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.telemetry import GimbalTrack, ReportFrame
from aerodft.service.gimbal_frame import FrameDetector, FrameEvidence
from aerodft.service.gravity import moments
from aerodft.service.settings import AttitudeSettings
from aerodft.service.slew import jump_std, lag_std
from aerodft.service.streams import Stream

_LONGEST_WAIT_NS: Final = 10 * SECOND_NS  # reports are weighed when their verdict is asked for, at the latest by then
_ENOUGH_REPORTS: Final = 100
_MOST_REPEATS: Final = 0.1  # share; no two measurements are alike to the last bit


class Gimbal:
    """The reports of one source.

    Attributes:
        stream: Their samples.
        reports: How many came.
    """

    def __init__(self, settings: AttitudeSettings) -> None:
        self.stream = Stream(settings.max_gap_ns)
        self._settings = settings
        self._detector = FrameDetector()
        self._weighed_ns: int | None = None
        self.reports = self._repeats = 0
        self._last_wxyz: FloatArray | None = None

    def append(self, track: GimbalTrack, stamps_ns: IntArray, vehicle: Stream) -> None:
        """Take reports in; they count from when the camera follows them."""
        if not len(stamps_ns):
            return
        stamps_ns = stamps_ns + self._settings.delay_ns
        earth = track.yaw_in_earth.astype(np.float64)
        self.stream.append(stamps_ns, wxyz=track.wxyz, yaw_in_earth=earth)
        before = track.wxyz[:1] + 1 if self._last_wxyz is None else self._last_wxyz
        same = np.diff(track.wxyz, axis=0, prepend=before) == 0
        self._repeats += int(np.count_nonzero(np.all(same, axis=-1)))
        self.reports += len(stamps_ns)
        self._last_wxyz = track.wxyz[-1:]
        if (self.stream.last_ns or 0) - (self._weighed_ns or 0) > _LONGEST_WAIT_NS:
            self._weigh(vehicle)

    def clear(self, vehicle: Stream) -> None:
        """Forget samples whose stamps are of another clock; what they taught stays."""
        self._weigh(vehicle)
        self._detector.break_off()
        self._weighed_ns = None
        self.stream.clear()

    def shift(self, by_ns: int, vehicle: Stream) -> None:
        """Move all samples, before the vehicle's are."""
        self._weigh(vehicle)
        self._detector.break_off()
        self._weighed_ns = None if self._weighed_ns is None else self._weighed_ns + by_ns
        self.stream.shift(by_ns)

    def evidence(self, vehicle: Stream) -> FrameEvidence:
        """What is known of the reports' frame."""
        self._weigh(vehicle)
        return self._detector.evidence

    def is_demand(self, vehicle: Stream) -> bool:
        """Whether the reports may be demands; only what moves by itself and keeps to the horizon is a measurement."""
        if self._settings.is_demand is not None:
            return self._settings.is_demand
        frame = self._settings.frame or self.evidence(vehicle).frame
        varied = self.reports >= _ENOUGH_REPORTS and self._repeats < _MOST_REPEATS * self.reports
        return frame is not ReportFrame.EARTH or not varied

    def std_rad(self, found: Bracket, stamp_ns: int, vehicle: Stream) -> FloatArray:
        """How far the camera may be from the report ``(3,)``, in gimbal axes, because that jumps or leads."""
        reported, limits = self.stream.column("wxyz"), self._settings
        jump = jump_std(reported, found)
        if not self.is_demand(vehicle):
            return np.abs(jump)
        stamps = self.stream.stamps_ns
        lag = lag_std(reported, stamps, found, stamp_ns, lag_ns=limits.lag_ns, slew_radps=limits.slew_radps)
        return np.hypot(jump, lag)

    def _weigh(self, vehicle: Stream) -> None:
        """Weigh what came since, up to the last whole second that both streams have passed: the same for any cut."""
        last = min(self.stream.last_ns or 0, vehicle.last_ns or 0) // SECOND_NS * SECOND_NS
        if self._weighed_ns is not None and last <= self._weighed_ns:
            return
        for moment in moments(self.stream, vehicle, after_ns=self._weighed_ns or 0, until_ns=last):
            if moment is None:
                self._detector.break_off()
            else:
                self._detector.weigh(moment)
        self._weighed_ns = last
