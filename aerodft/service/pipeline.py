"""The pipeline from batches to poses and measurements, for live, imported and recomputed flights alike.

Outputs depend on the ticks alone, not on how many of them a batch has. An image (or an observation) waits until the
first tick at which its stamp is bracketed by telemetry, or until its deadline, and is answered no earlier than what
arrived before it with an earlier stamp. A calibration updated by landmarks applies from the next stamp on; within a
tick, work is answered in the order of stamps.
"""

import threading
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aerodft.dft import NO_IMAGE, Request, measure
from aerodft.model import (
    BoolArray,
    Health,
    Image,
    IntArray,
    Measurement,
    Observation,
    PoseBatch,
    PoseSample,
    StampClock,
    Status,
)
from aerodft.service.batches import Batches, numbers_of, stamps_of
from aerodft.service.clocks import Ticks
from aerodft.service.ports import Calibrator, LandmarkObserver, ObjectTracker, StepOutputs, TelemetryDecoder
from aerodft.service.pose import PoseSource
from aerodft.service.settings import PipelineSettings, TelemetrySettings
from aerodft.service.streams import LAST
from aerodft.service.work import Answering, Estimators, PendingWork, ReadyWork, Task, WorkList


@dataclass(slots=True)
class Counts:
    """Numbers of images and observations received, and of observations that could not be used."""

    images: int = 0
    observations: int = 0
    unknown_probe: int = 0
    wrong_pixel_count: int = 0


class Pipeline:
    """Measures every configured probe in every image.

    Args:
        settings: Configuration that the outputs depend on.
        decoder: Decodes raw telemetry to tracks.
        calibrator: Refines every pose; None for unrefined poses.
        observer: Updates the calibration by observed landmarks; None without landmarks.
        tracker: Tracks moving objects; None without them.

    Attributes:
        counts: Numbers of inputs received and rejected.
    """

    def __init__(
        self,
        settings: PipelineSettings,
        decoder: TelemetryDecoder,
        calibrator: Calibrator[Any] | None = None,
        observer: LandmarkObserver | None = None,
        tracker: ObjectTracker | None = None,
    ) -> None:
        self.counts = Counts()
        self._settings = settings
        self._setup = settings.setup
        telemetry = settings.telemetry or TelemetrySettings()
        self._wait_ns = telemetry.wait_ns
        self._poses = PoseSource(
            telemetry,
            origin=settings.origin,
            time_std_s=settings.time_std_s,
            ground=settings.ground,
            camera=settings.camera,
            level=settings.level,
        )
        self._telemetry_intake = _TelemetryIntake(decoder, self._poses)
        watermark_ns = self._poses.watermark_ns if settings.fixed_pose is None else None
        self._pending = PendingWork(self._poses_at, watermark_ns, settings.match_tolerance_ns)
        estimators = Estimators(calibrator=calibrator, observer=observer, tracker=tracker)
        self._answering = Answering(settings, self._setup, estimators)
        self._lock = threading.Lock()  # between ``advance`` and queries by other threads

    def warm_up(self) -> None:
        """Load and compile ahead what would delay the first measurements."""
        self._answering.warm_up()

    @property
    def last_pose(self) -> PoseSample | None:
        """The pose of the newest answered image; None before the first."""
        return self._answering.last_pose

    def advance(self, batches: Batches) -> StepOutputs:
        """Process the ticks of some batches.

        Returns:
            For an image its pose and its measurements; for an observation its measurement; for the landmarks of an
            image the new estimate. They do not depend on how ticks are grouped into calls.
        """
        with self._lock:
            first = 0
            while first < len(batches):
                rest = batches[first:]
                self._answer(self._pending.take_overdue(int(rest.now_ns[0]), first))
                count, shift_ns = self._telemetry_intake.take(rest)
                self._pending.shift(shift_ns)
                part = rest[:count]
                self._pending.add(self._accept(part))
                self._answer(self._pending.take_ready(part.now_ns, first))
                first += count
            return self._answering.outputs()

    def finish(self) -> StepOutputs:
        """Answer all waiting work with the telemetry at hand, on a tick of its own: the input has ended."""
        with self._lock:
            self._answer(self._pending.take_overdue(None, 0))
            return self._answering.outputs()

    def measure_at(self, requests: Iterable[Request], stamp_ns: int | None = None) -> list[Measurement]:
        """Measure requests at a stamp; from any thread.

        Args:
            requests: Probes with pixels.
            stamp_ns: UTC of the recent past; None for the newest answered image, or for a fixed camera's pose where
                the water's level is always the same.
        """
        with self._lock:
            is_always_the_same = self._settings.fixed_pose is not None and self._settings.level is None
            has_pose = stamp_ns is not None or is_always_the_same
            sample = self._refined_at(stamp_ns or 0) if has_pose else self.last_pose
        if sample is None:
            reason = "no image has been measured yet"
            sample = PoseSample(stamp_ns=0, status=Status.NO_TELEMETRY, reasons=(reason,))
        return measure(self._setup, PoseBatch.from_samples([sample]), tuple(requests))[0]

    def pose_at(self, stamp_ns: int) -> PoseSample:
        """The refined pose at a stamp of the recent past, from the telemetry received so far."""
        with self._lock:
            return self._refined_at(stamp_ns)

    def health(self, host_ns: int) -> Health | None:
        """Health of the vehicle at this machine's time ``host_ns``; None for a fixed camera."""
        if self._settings.telemetry is None:
            return None
        with self._lock:
            return self._poses.health_at(self._host_to_utc(host_ns))

    def rejected(self) -> dict[str, int]:
        """Numbers of telemetry messages without a usable value, by ``MESSAGE: reason``."""
        with self._lock:
            return self._telemetry_intake.rejected

    def in_utc(self, image: Image) -> Image:
        """The image with its stamp in UTC by the current clock map; for observers, from any thread."""
        if image.clock is StampClock.UTC:
            return image
        with self._lock:
            return replace(image, stamp_ns=self._host_to_utc(image.stamp_ns), clock=StampClock.UTC)

    def _accept(self, batches: Batches) -> WorkList:
        """Work of the images and observations of some ticks."""
        images, tick = batches.images, batches.image_tick
        self.counts.images += len(images)
        stamps_ns, by_utc = stamps_of(images)
        stamps_ns = np.where(by_utc, stamps_ns, self._poses.clock.host_to_utc(stamps_ns, tick))
        numbers = numbers_of(images)
        has_pixels = numbers != NO_IMAGE
        columns = numbers[has_pixels], stamps_ns[has_pixels], by_utc[has_pixels], tick[has_pixels]
        self._pending.images.add(*columns, len(batches))
        image_work = WorkList(
            task=np.full(len(images), int(Task.IMAGE)),
            stamp_ns=stamps_ns,
            by_utc=by_utc,
            deadline_ns=self._deadline_ns(batches.image_arrival_ns),
            tick=tick,
            image=numbers,
            observations=[None] * len(images),
            samples=[None] * len(images),
        )
        return WorkList.concatenate([image_work, self._accept_observations(batches)])

    def _accept_observations(self, batches: Batches) -> WorkList:
        accepted: list[tuple[Task, int, Observation]] = []
        self.counts.observations += len(batches.observations)
        for tick, seen in zip(batches.observation_tick.tolist(), batches.observations, strict=True):
            is_known, tasks = self._answering.tasks(seen)
            self.counts.unknown_probe += not is_known
            self.counts.wrong_pixel_count += is_known and not tasks
            accepted += [(task, tick, seen) for task in tasks]
        observations = [seen for _, _, seen in accepted]
        task, tick = (np.array([each[k] for each in accepted], dtype=np.int64) for k in (0, 1))
        stamps_ns = self._stamps_of_observations(observations, tick)
        arrivals_ns = np.array([seen.arrival_ns for seen in observations], dtype=np.int64)
        pairs = zip(observations, stamps_ns.tolist(), strict=True)
        return WorkList(
            task=task,
            stamp_ns=stamps_ns,
            by_utc=np.array([seen.clock is StampClock.UTC for seen in observations], dtype=np.bool_),
            deadline_ns=self._deadline_ns(arrivals_ns),
            tick=tick,
            image=np.array([NO_IMAGE if seen.image is None else seen.image for seen in observations], dtype=np.int64),
            observations=[replace(seen, stamp_ns=stamp_ns, clock=StampClock.UTC) for seen, stamp_ns in pairs],
            samples=[None] * len(observations),
        )

    def _stamps_of_observations(self, observations: list[Observation], tick: IntArray) -> IntArray:
        """UTC stamps ``(n,)``; a host-clock stamp takes that of its image, also after the clock map has improved."""
        stamps_ns, by_utc = stamps_of(observations)
        stamps_ns = np.where(by_utc, stamps_ns, self._poses.clock.host_to_utc(stamps_ns, tick))
        for row in np.flatnonzero(~by_utc).tolist():
            image = observations[row].image
            image_stamp_ns = None if image is None else self._pending.images.stamp_ns(image, int(tick[row]))
            stamps_ns[row] = stamps_ns[row] if image_stamp_ns is None else image_stamp_ns
        return stamps_ns

    def _deadline_ns(self, arrival_ns: IntArray) -> IntArray:
        """Deadlines ``(n,)``: the tick at which an arrival is answered with the telemetry at hand."""
        tick_ns = self._settings.tick_ns
        return -(-(arrival_ns + self._wait_ns) // tick_ns) * tick_ns

    def _answer(self, ready: ReadyWork | None) -> None:
        """Answer work that is ready, if any is."""
        if ready is not None:
            self._answering.add(ready, self._poses.height_switch)

    def _poses_at(
        self, stamps_ns: IntArray, ticks: IntArray, *, is_final: BoolArray, by_utc: BoolArray
    ) -> tuple[PoseBatch, BoolArray]:
        """Poses at stamps ``(n,)``, and where telemetry is pending; a fixed camera's pose never is."""
        fixed = self._settings.fixed_pose
        if fixed is not None:
            return PoseBatch.repeated(fixed, stamps_ns), np.full(len(stamps_ns), fill_value=False)
        return self._poses.at(stamps_ns, ticks, is_final=is_final, by_utc=by_utc)

    def _refined_at(self, stamp_ns: int) -> PoseSample:
        """The refined pose at a stamp (UTC), as of the last tick."""
        stamps, false = (np.array([stamp_ns]), LAST), np.array([False])
        poses, _ = self._poses_at(*stamps, is_final=~false, by_utc=false)
        return self._answering.refined(poses)[0]

    def _host_to_utc(self, host_ns: int) -> int:
        return int(self._poses.clock.host_to_utc(np.array([host_ns]))[0])


class _TelemetryIntake:
    """Decodes batches and appends their tracks to the pose source, as many ticks at a time as possible.

    Args:
        decoder: Decodes raw telemetry to tracks.
        poses: The pose source.
    """

    def __init__(self, decoder: TelemetryDecoder, poses: PoseSource) -> None:
        self._decoder = decoder
        self._poses = poses
        self._decoded = Ticks((), (), 0)  # of the current batches
        self._first = 0  # first of these ticks not yet appended
        self._refused = 0  # ticks from that one on which could not be appended at once; 0 if not tried

    @property
    def rejected(self) -> dict[str, int]:
        """Numbers of telemetry messages without a usable value, by ``MESSAGE: reason``."""
        return dict(self._decoder.rejected)

    def take(self, batches: Batches) -> tuple[int, int]:
        """Append the telemetry of the first ticks, so that poses as of these are available.

        Args:
            batches: Ticks not yet appended; all of them at first.

        Returns:
            Number of ticks appended, and change (ns) of the UTC of earlier stamps on this machine's clock.
        """
        if self._first == self._decoded.count:
            if len(batches.raw) > 1:  # senders with interleaved frames
                return 1, self._take_senders(batches[:1])
            tracks = tuple(track for block in batches.raw for track in self._decoder.decode(block))
            self._decoded, self._first = Ticks.from_tracks(tracks, batches.now_ns), 0
        count = max(self._refused // 2, 1) if self._refused else self._decoded.count - self._first
        count = count if self._poses.clock.is_settled else 1
        while True:
            shift_ns = self._poses.append(self._decoded.between(self._first, self._first + count))
            if shift_ns is not None:
                self._first += count
                self._refused = max(self._refused - count, 0)
                return count, shift_ns
            self._refused, count = count, count // 2

    def _take_senders(self, batches: Batches) -> int:
        """Append a tick, sender by sender; returns the change (ns) of UTC."""
        senders = [self._decoder.decode(block) for block in batches.raw] or [()]
        return sum(self._poses.append(Ticks.one(tracks)) or 0 for tracks in senders)
