"""The pipeline from batches to poses and measurements, for live, imported and recomputed flights alike.

Outputs depend on the ticks alone, not on how many of them a batch has. An image (or an observation) waits until the
first tick at which its stamp is bracketed by telemetry, or until its deadline, and is answered no earlier than what
arrived before it with an earlier stamp. A calibration updated by landmarks applies from the next stamp on; within a
tick, work is answered in the order of stamps.
"""

import threading
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from aerodft.dft import NO_IMAGE, Request, measure
from aerodft.model import (
    BoolArray,
    Health,
    HeightSource,
    HeightSwitch,
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
from aerodft.service.work import (
    Answering,
    AnswerTimes,
    Estimators,
    ReadyWork,
    RecentImages,
    Task,
    WorkList,
    answer_in_order,
)

_ANY_IMAGE: Final = np.iinfo(np.int64).min


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
        self._work = WorkList.empty()
        self._images = RecentImages()
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
                self._answer_overdue(int(rest.now_ns[0]), first)
                count, shift_ns = self._telemetry_intake.take(rest)
                self._work = self._work.shifted(shift_ns)
                self._images.shift(shift_ns)
                part = rest[:count]
                self._work = WorkList.concatenate([self._work, self._accept(part)]).in_order_of_ticks()
                self._answer(part.now_ns, first)
                first += count
            return self._answering.outputs()

    def finish(self) -> StepOutputs:
        """Answer all waiting work with the telemetry at hand, on a tick of its own: the input has ended."""
        with self._lock:
            self._answer_overdue(None, 0)
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
        self._images.add(*columns, len(batches))
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
            image_stamp_ns = None if image is None else self._images.stamp_ns(image, int(tick[row]))
            stamps_ns[row] = stamps_ns[row] if image_stamp_ns is None else image_stamp_ns
        return stamps_ns

    def _deadline_ns(self, arrival_ns: IntArray) -> IntArray:
        """Deadlines ``(n,)``: the tick at which an arrival is answered with the telemetry at hand."""
        tick_ns = self._settings.tick_ns
        return -(-(arrival_ns + self._wait_ns) // tick_ns) * tick_ns

    def _answer_overdue(self, now_ns: int | None, tick: int) -> None:
        """Answer work with deadlines before ``now_ns`` (None: all work), and work that it held up.

        Telemetry is as of the last tick; outputs get the number ``tick``.
        """
        work = self._work
        due_ns = np.unique(work.deadline_ns if now_ns is None else work.deadline_ns[work.deadline_ns < now_ns])
        if not len(due_ns):
            return
        answer_times = AnswerTimes(due_ns, np.zeros_like(due_ns), np.full(len(due_ns), fill_value=False))
        last_image_ns = np.full(len(due_ns), self._images.last_ns()[-1])
        is_ready = np.array([sample is not None for sample in work.samples], dtype=np.bool_)
        answer = self._answer_order(work, np.where(is_ready, 0, 1), answer_times, last_image_ns)
        parts = self._stored_poses(work)
        overdue = np.flatnonzero((answer >= 0) & ~is_ready)
        parts += self._poses_at_deadline(work, overdue, np.full(len(overdue), -1))
        self._answer_work(work, parts, answer, answer_times, tick)

    def _answer(self, now_ns: IntArray, first: int) -> None:
        """Answer work that is ready in the ticks ``now_ns (n,)`` of the newest step, numbered from ``first``."""
        work, count = self._work, len(now_ns)
        if not len(work):
            return
        deadline_tick = np.searchsorted(now_ns, work.deadline_ns)
        ready_tick, parts = self._complete_poses(work, np.minimum(deadline_tick, count), count)
        overdue = np.flatnonzero((ready_tick >= deadline_tick) & (deadline_tick < count))
        is_on_tick = now_ns[deadline_tick[overdue]] == work.deadline_ns[overdue]
        # Work that arrived after its deadline, within one long tick, is answered on that tick.
        parts += self._poses_at_deadline(
            work, overdue, np.maximum(deadline_tick[overdue] - ~is_on_tick, work.tick[overdue])
        )
        answer_times = AnswerTimes.from_ticks(now_ns, work.deadline_ns)
        last_image_ns = self._images.last_ns()[answer_times.ticks - 1]
        answer = self._answer_order(work, ready_tick + 1, answer_times, last_image_ns)
        self._answer_work(work, parts, answer, answer_times, first)

    def _answer_order(self, work: WorkList, ready: IntArray, times: AnswerTimes, last_image_ns: IntArray) -> IntArray:
        """Answer times ``(n,)`` of work that is ready after some ticks ``(n,)``; -1 where it keeps waiting."""
        columns = work.stamp_ns, work.tick + 1, ready, work.deadline_ns, self._required_image_ns(work)
        return answer_in_order(columns, (times.time_ns, times.ticks), last_image_ns)

    def _answer_work(
        self,
        work: WorkList,
        parts: list[tuple[IntArray, PoseBatch]],
        answer: IntArray,
        answer_times: AnswerTimes,
        first: int,
    ) -> None:
        """Answer work at answer times ``answer (n,)``, ticks numbered from ``first``; work with -1 keeps waiting.

        ``parts`` are all known poses, with the rows of the work that they belong to.
        """
        pose_index = np.full(len(work), -1)
        if parts:
            pose_index[np.concatenate([rows for rows, _ in parts])] = np.arange(sum(len(rows) for rows, _ in parts))
        poses = PoseBatch.concatenate([poses for _, poses in parts]) if parts else None
        waiting = np.flatnonzero(answer < 0)
        samples = [None if poses is None or k < 0 else poses[k] for k in pose_index[waiting].tolist()]
        self._work = work.rows(waiting).waiting(samples)
        rows = np.flatnonzero(answer >= 0)
        if poses is None or not len(rows):
            return
        rows = rows[np.argsort(answer[rows], kind="stable")]
        time_index = answer[rows]
        as_of_tick = answer_times.ticks[time_index] - 1
        # Deadlines between two ticks are answered on the second of them, before its own work.
        tick = first + as_of_tick + ~answer_times.is_tick[time_index]
        self._pass_on(ReadyWork(work.rows(rows), poses.rows(pose_index[rows]), tick, time_index), as_of_tick)

    def _required_image_ns(self, work: WorkList) -> IntArray:
        """Stamps ``(n,)`` that the last image must have reached: an observation may arrive before its image."""
        has_no_image = (work.task != Task.IMAGE) & (work.image == NO_IMAGE)
        return np.where(has_no_image, work.stamp_ns - self._settings.match_tolerance_ns, _ANY_IMAGE)

    def _poses_at_deadline(
        self, work: WorkList, rows: IntArray, as_of_tick: IntArray
    ) -> list[tuple[IntArray, PoseBatch]]:
        """Poses of rows as of ticks ``(n,)`` from the telemetry at hand, with the rows."""
        if not len(rows):
            return []
        is_final = np.full(len(rows), fill_value=True)
        return [(rows, self._poses_at(work.stamp_ns[rows], as_of_tick, is_final=is_final, by_utc=work.by_utc[rows])[0])]

    @staticmethod
    def _stored_poses(work: WorkList) -> list[tuple[IntArray, PoseBatch]]:
        """Poses stored with waiting work, with the rows."""
        rows = [row for row, sample in enumerate(work.samples) if sample is not None]
        samples = [sample for sample in work.samples if sample is not None]
        return [(np.array(rows), PoseBatch.from_samples(samples))] if rows else []

    def _complete_poses(
        self, work: WorkList, until_tick: IntArray, count: int
    ) -> tuple[IntArray, list[tuple[IntArray, PoseBatch]]]:
        """Ticks ``(n,)`` at which the telemetry of work is complete, before ``until_tick (n,)``; else ``count``.

        Also the poses at these ticks, with the rows of the work; the tick is -1 for work with a stored pose.
        """
        required_image_ns, tick = self._required_image_ns(work), np.maximum(work.tick, 0)
        if self._settings.fixed_pose is None:
            watermark_tick = np.searchsorted(np.maximum.accumulate(self._poses.watermark_ns(count)), work.stamp_ns)
            tick = np.maximum(tick, watermark_tick)
        ready_tick, parts = np.full(len(work), count), self._stored_poses(work)
        for rows, _ in parts:
            ready_tick[rows] = -1
        rows = np.flatnonzero((tick < until_tick) & (ready_tick >= 0))
        tick = tick[rows]
        while len(rows):
            has_no_image = np.flatnonzero(required_image_ns[rows] != _ANY_IMAGE)
            tick[has_no_image] = self._images.ticks_with(required_image_ns[rows[has_no_image]], tick[has_no_image])
            is_early = tick < until_tick[rows]
            rows, tick = rows[is_early], tick[is_early]
            is_final = np.full(len(rows), fill_value=False)
            poses, is_pending = self._poses_at(work.stamp_ns[rows], tick, is_final=is_final, by_utc=work.by_utc[rows])
            done = np.flatnonzero(~is_pending)
            ready_tick[rows[done]] = tick[done]
            parts.append((rows[done], poses.rows(done)))
            rows, tick = rows[is_pending], tick[is_pending] + 1
        return ready_tick, [part for part in parts if len(part[0])]

    def _pass_on(self, ready: ReadyWork, as_of_tick: IntArray) -> None:
        """Pass work on to be answered, each as of a tick ``(n,)`` of the newest step, with observations' images."""
        work = ready.work
        for row in np.flatnonzero((work.task != Task.IMAGE) & (work.image == NO_IMAGE)).tolist():
            tolerance_ns = self._settings.match_tolerance_ns
            work.image[row] = self._images.nearest(int(work.stamp_ns[row]), tolerance_ns, int(as_of_tick[row]))

        def describe_switch(before: HeightSource, after: HeightSource, stamp_ns: int, row: int) -> HeightSwitch:
            return self._poses.height_switch(before, after, stamp_ns, int(as_of_tick[row]))

        self._answering.add(ready, describe_switch)

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
