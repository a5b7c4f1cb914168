"""Batches in, poses and measurements out: the one path that live, imported and recomputed flights take.

What comes out is a function of the ticks alone, however many of them are advanced by at once. An image (or an
observation) waits at its stamp until the first tick as of which its telemetry is complete on both sides, or until it
has waited long enough; it is answered no earlier than what came before it with an earlier stamp. What landmarks teach
is used from the next stamp on: of what is done on one tick, in the order of the stamps.
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
from aerodft.service.answering import Answering, Helpers, ReadyWork
from aerodft.service.batches import Batches, numbers_of, stamps_of
from aerodft.service.clocks import Ticks
from aerodft.service.pending import AnswerTimes, RecentImages, Task, WorkList, answer_in_order
from aerodft.service.ports import Calibrator, LandmarkObserver, ObjectTracker, StepOutputs, TelemetryDecoder
from aerodft.service.pose import PoseSource
from aerodft.service.settings import PipelineSettings, TelemetrySettings
from aerodft.service.streams import LAST

_ANY_IMAGE: Final = np.iinfo(np.int64).min


@dataclass(slots=True)
class Counts:
    """What came in and what could not be used."""

    images: int = 0
    observations: int = 0
    unknown_probe: int = 0
    wrong_pixel_count: int = 0


class Pipeline:
    """Measures every configured probe for every image.

    Args:
        settings: What the numbers depend on.
        decoder: Turns raw telemetry into tracks.
        calibrator: Refines every pose; None uses poses as they come.
        observer: Learns from observed landmarks; None where there are none.
        tracker: Follows what moves; None where nobody asks for that.

    Attributes:
        counts: What came in, and what could not be used.
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
        )
        self._intake = _Intake(decoder, self._poses)
        self._work = WorkList.none()
        self._images = RecentImages()
        helpers = Helpers(calibrator=calibrator, observer=observer, tracker=tracker)
        self._answering = Answering(settings, self._setup, helpers)
        self._lock = threading.Lock()  # between the ticks and the questions from outside

    def warm_up(self) -> None:
        """Load and compile now what would hold up the first measurements."""
        self._answering.warm_up()

    @property
    def last_pose(self) -> PoseSample | None:
        """The pose of the newest answered image; None before the first."""
        return self._answering.last_pose

    def advance(self, batches: Batches) -> StepOutputs:
        """Advance by some ticks: one, live, or many, recorded.

        Returns:
            For an image its pose and its measurements; for an observation its measurement; for the landmarks of an
            image the new estimate. They do not depend on which ticks are advanced by together.
        """
        with self._lock:
            first = 0
            while first < len(batches):
                rest = batches[first:]
                self._answer_overdue(int(rest.now_ns[0]), first)
                count, shift_ns = self._intake.take(rest)
                self._work = self._work.shifted(shift_ns)
                self._images.shift(shift_ns)
                part = rest[:count]
                self._work = WorkList.joined([self._work, self._accept(part)]).in_order_of_ticks()
                self._answer(part.now_ns, first)
                first += count
            return self._answering.outputs()

    def finish(self) -> StepOutputs:
        """The end of the input: what still waits is answered with what there is, on a tick of its own."""
        with self._lock:
            self._answer_overdue(None, 0)
            return self._answering.outputs()

    def measure_at(self, requests: Iterable[Request], stamp_ns: int | None = None) -> list[Measurement]:
        """Answer a question from outside, from any thread.

        Args:
            requests: What to measure.
            stamp_ns: UTC of the recent past; None for the newest answered image, or a fixed camera's pose.
        """
        with self._lock:
            is_asked = stamp_ns is not None or self._settings.fixed_pose is not None
            sample = self._refined_at(stamp_ns or 0) if is_asked else self.last_pose
        if sample is None:
            reason = "no image has been measured yet"
            sample = PoseSample(stamp_ns=0, status=Status.NO_TELEMETRY, reasons=(reason,))
        return measure(self._setup, PoseBatch.of([sample]), tuple(requests))[0]

    def pose_at(self, stamp_ns: int) -> PoseSample:
        """The pose at a stamp of the recent past, with what has arrived so far."""
        with self._lock:
            return self._refined_at(stamp_ns)

    def health(self, host_ns: int) -> Health | None:
        """What the vehicle had said of itself by this machine's time; None of a fixed camera."""
        if self._settings.telemetry is None:
            return None
        with self._lock:
            return self._poses.health_at(self._host_to_utc(host_ns))

    def rejected(self) -> dict[str, int]:
        """Telemetry that held no value so far, by ``MESSAGE: reason``."""
        with self._lock:
            return self._intake.rejected

    def in_utc(self, image: Image) -> Image:
        """The image with its stamp in UTC as it is known now, from any thread; what an observer's answer refers to."""
        if image.clock is StampClock.UTC:
            return image
        with self._lock:
            return replace(image, stamp_ns=self._host_to_utc(image.stamp_ns), clock=StampClock.UTC)

    def _accept(self, batches: Batches) -> WorkList:
        """What comes in some ticks."""
        images, tick = batches.images, batches.image_tick
        self.counts.images += len(images)
        stamps_ns, by_utc = stamps_of(images)
        stamps_ns = np.where(by_utc, stamps_ns, self._poses.clock.host_to_utc(stamps_ns, tick))
        numbers = numbers_of(images)
        has_pixels = numbers != NO_IMAGE
        remembered = numbers[has_pixels], stamps_ns[has_pixels], by_utc[has_pixels], tick[has_pixels]
        self._images.add(*remembered, len(batches))
        of_images = WorkList(
            task=np.full(len(images), int(Task.IMAGE)),
            stamp_ns=stamps_ns,
            by_utc=by_utc,
            deadline_ns=self._deadline_ns(batches.image_arrival_ns),
            tick=tick,
            image=numbers,
            observations=[None] * len(images),
            samples=[None] * len(images),
        )
        return WorkList.joined([of_images, self._accept_observations(batches)])

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
            observations=[replace(seen, stamp_ns=own_ns, clock=StampClock.UTC) for seen, own_ns in pairs],
            samples=[None] * len(observations),
        )

    def _stamps_of_observations(self, observations: list[Observation], tick: IntArray) -> IntArray:
        """UTC ``(n,)``: on the host's clock that of the image, though the clocks are known better by now."""
        stamps_ns, by_utc = stamps_of(observations)
        stamps_ns = np.where(by_utc, stamps_ns, self._poses.clock.host_to_utc(stamps_ns, tick))
        for row in np.flatnonzero(~by_utc).tolist():
            image = observations[row].image
            own_ns = None if image is None else self._images.stamp_ns(image, int(tick[row]))
            stamps_ns[row] = stamps_ns[row] if own_ns is None else own_ns
        return stamps_ns

    def _deadline_ns(self, arrival_ns: IntArray) -> IntArray:
        """The tick ``(n,)`` on which what arrived then is answered with what there is."""
        tick_ns = self._settings.tick_ns
        return -(-(arrival_ns + self._wait_ns) // tick_ns) * tick_ns

    def _answer_overdue(self, now_ns: int | None, tick: int) -> None:
        """Answer what was due before a time, or all there is, as of the last tick; on the tick of that number.

        And what it held up.
        """
        work = self._work
        due_ns = np.unique(work.deadline_ns if now_ns is None else work.deadline_ns[work.deadline_ns < now_ns])
        if not len(due_ns):
            return
        answer_times = AnswerTimes(due_ns, np.zeros_like(due_ns), np.full(len(due_ns), fill_value=False))
        last_image_ns = np.full(len(due_ns), self._images.last_ns()[-1])
        is_ready = np.array([sample is not None for sample in work.samples], dtype=np.bool_)
        answer = self._in_order(work, np.where(is_ready, 0, 1), answer_times, last_image_ns)
        parts = self._ready_poses(work)
        final = np.flatnonzero((answer >= 0) & ~is_ready)
        parts += self._final(work, final, np.full(len(final), -1))
        self._apply_answers(work, parts, answer, answer_times, tick)

    def _answer(self, now_ns: IntArray, first: int) -> None:
        """Answer what is ready in the ticks ``now_ns (n,)`` of the newest step, numbered from ``first``."""
        work, count = self._work, len(now_ns)
        if not len(work):
            return
        deadline_tick = np.searchsorted(now_ns, work.deadline_ns)
        ready_tick, parts = self._ready(work, np.minimum(deadline_tick, count), count)
        is_final = (ready_tick >= deadline_tick) & (deadline_tick < count)
        final = np.flatnonzero(is_final)
        is_on_tick = now_ns[deadline_tick[final]] == work.deadline_ns[final]
        # What came after its deadline, in one long tick, is answered on that tick.
        parts += self._final(work, final, np.maximum(deadline_tick[final] - ~is_on_tick, work.tick[final]))
        answer_times = AnswerTimes.of(now_ns, work.deadline_ns)
        last_image_ns = self._images.last_ns()[answer_times.ticks - 1]
        answer = self._in_order(work, ready_tick + 1, answer_times, last_image_ns)
        self._apply_answers(work, parts, answer, answer_times, first)

    def _in_order(self, work: WorkList, ready: IntArray, times: AnswerTimes, last_image_ns: IntArray) -> IntArray:
        """The answer times ``(n,)`` of work that is ready after some ticks ``(n,)``; -1 where it goes on waiting."""
        columns = work.stamp_ns, work.tick + 1, ready, work.deadline_ns, self._near_ns(work)
        return answer_in_order(columns, (times.time_ns, times.ticks), last_image_ns)

    def _apply_answers(
        self,
        work: WorkList,
        parts: list[tuple[IntArray, PoseBatch]],
        answer: IntArray,
        answer_times: AnswerTimes,
        first: int,
    ) -> None:
        """Have work answered on occasions ``(n,)``, of ticks that are numbered from ``first``; the rest waits on.

        ``parts`` are all poses that are known, with the rows of the work that they are of.
        """
        place = np.full(len(work), -1)
        if parts:
            place[np.concatenate([rows for rows, _ in parts])] = np.arange(sum(len(rows) for rows, _ in parts))
        poses = PoseBatch.joined([poses for _, poses in parts]) if parts else None
        left = np.flatnonzero(answer < 0)
        samples = [None if poses is None or k < 0 else poses[k] for k in place[left].tolist()]
        self._work = work.rows(left).left(samples)
        rows = np.flatnonzero(answer >= 0)
        if poses is None or not len(rows):
            return
        rows = rows[np.argsort(answer[rows], kind="stable")]
        on = answer[rows]
        as_of = answer_times.ticks[on] - 1
        # What is due between two ticks comes out on the second of them, before what is answered there.
        tick = first + as_of + ~answer_times.is_tick[on]
        self._add(ReadyWork(work.rows(rows), poses.rows(place[rows]), tick, on), as_of)

    def _near_ns(self, work: WorkList) -> IntArray:
        """Least stamps ``(n,)`` of the last image for work to be looked at: an observation may be faster than it."""
        waits = (work.task != Task.IMAGE) & (work.image == NO_IMAGE)
        return np.where(waits, work.stamp_ns - self._settings.match_tolerance_ns, _ANY_IMAGE)

    def _final(self, work: WorkList, rows: IntArray, as_of: IntArray) -> list[tuple[IntArray, PoseBatch]]:
        """The poses of rows as of ticks ``(n,)`` with what there is, with their rows."""
        if not len(rows):
            return []
        known = np.full(len(rows), fill_value=True)
        return [(rows, self._poses_at(work.stamp_ns[rows], as_of, final=known, by_utc=work.by_utc[rows])[0])]

    @staticmethod
    def _ready_poses(work: WorkList) -> list[tuple[IntArray, PoseBatch]]:
        """The poses that are there already, with their rows."""
        rows = [row for row, sample in enumerate(work.samples) if sample is not None]
        samples = [sample for sample in work.samples if sample is not None]
        return [(np.array(rows), PoseBatch.of(samples))] if rows else []

    def _ready(
        self, work: WorkList, until_tick: IntArray, count: int
    ) -> tuple[IntArray, list[tuple[IntArray, PoseBatch]]]:
        """Ticks ``(n,)`` as of which the telemetry of work is complete, before ``until_tick (n,)``; else ``count``.

        And the poses as of these ticks, with the rows of the work that they are of; -1 for what was ready before.
        """
        near_ns, tick = self._near_ns(work), np.maximum(work.tick, 0)
        if self._settings.fixed_pose is None:
            passed = np.searchsorted(np.maximum.accumulate(self._poses.watermark_ns(count)), work.stamp_ns)
            tick = np.maximum(tick, passed)
        ready_tick, parts = np.full(len(work), count), self._ready_poses(work)
        for rows, _ in parts:
            ready_tick[rows] = -1
        rows = np.flatnonzero((tick < until_tick) & (ready_tick >= 0))
        tick = tick[rows]
        while len(rows):
            waits = np.flatnonzero(near_ns[rows] != _ANY_IMAGE)
            tick[waits] = self._images.ticks_with(near_ns[rows[waits]], tick[waits])
            is_early = tick < until_tick[rows]
            rows, tick = rows[is_early], tick[is_early]
            no = np.full(len(rows), fill_value=False)
            poses, is_pending = self._poses_at(work.stamp_ns[rows], tick, final=no, by_utc=work.by_utc[rows])
            done = np.flatnonzero(~is_pending)
            ready_tick[rows[done]] = tick[done]
            parts.append((rows[done], poses.rows(done)))
            rows, tick = rows[is_pending], tick[is_pending] + 1
        return ready_tick, [part for part in parts if len(part[0])]

    def _add(self, ready: ReadyWork, as_of: IntArray) -> None:
        """Have work answered, each as of a tick ``(n,)`` of the newest step."""
        work = ready.work
        for row in np.flatnonzero((work.task != Task.IMAGE) & (work.image == NO_IMAGE)).tolist():
            tolerance_ns = self._settings.match_tolerance_ns
            work.image[row] = self._images.nearest(int(work.stamp_ns[row]), tolerance_ns, int(as_of[row]))

        def describe_switch(before: HeightSource, after: HeightSource, stamp_ns: int, row: int) -> HeightSwitch:
            return self._poses.height_switch(before, after, stamp_ns, int(as_of[row]))

        self._answering.add(ready, describe_switch)

    def _poses_at(
        self, stamps_ns: IntArray, ticks: IntArray, *, final: BoolArray, by_utc: BoolArray
    ) -> tuple[PoseBatch, BoolArray]:
        """Poses at stamps, and where telemetry may still come; a fixed camera waits for nothing."""
        fixed = self._settings.fixed_pose
        if fixed is not None:
            return PoseBatch.repeated(fixed, stamps_ns), np.full(len(stamps_ns), fill_value=False)
        return self._poses.at(stamps_ns, ticks, final=final, by_utc=by_utc)

    def _refined_at(self, stamp_ns: int) -> PoseSample:
        """The refined pose at a stamp (UTC), as of the last tick."""
        asked, no = (np.array([stamp_ns]), LAST), np.array([False])
        poses, _ = self._poses_at(*asked, final=~no, by_utc=no)
        return self._answering.refined(poses)[0]

    def _host_to_utc(self, host_ns: int) -> int:
        return int(self._poses.clock.host_to_utc(np.array([host_ns]))[0])


class _Intake:
    """Decodes batches, and hands their tracks to the poses in steps of as many ticks as can be taken in at once.

    Args:
        decoder: Turns raw telemetry into tracks.
        poses: Where they go.
    """

    def __init__(self, decoder: TelemetryDecoder, poses: PoseSource) -> None:
        self._decoder = decoder
        self._poses = poses
        self._decoded = Ticks((), (), 0)  # of the batches that are being taken in
        self._first = 0  # the first of these ticks that is yet to be taken in
        self._most = 1  # ticks that are tried at once: twice as many as went well last

    @property
    def rejected(self) -> dict[str, int]:
        """Telemetry that held no value so far, by ``MESSAGE: reason``."""
        return dict(self._decoder.rejected)

    def take(self, batches: Batches) -> tuple[int, int]:
        """Take in the telemetry of the first ticks, as of which the poses can then be asked.

        Args:
            batches: What is left of the ticks that are being taken in; all of them at first.

        Returns:
            Of how many ticks, and by how much UTC that was made of this machine's stamps before has changed (ns).
        """
        if self._first == self._decoded.count:
            if len(batches.raw) > 1:  # senders whose frames take turns
                return 1, self._take_senders(batches[:1])
            tracks = tuple(track for block in batches.raw for track in self._decoder.decode(block))
            self._decoded, self._first = Ticks.of(tracks, batches.now_ns), 0
        count = min(self._most, self._decoded.count - self._first) if self._poses.clock.is_settled else 1
        while True:
            shift_ns = self._poses.append(self._decoded.between(self._first, self._first + count))
            if shift_ns is not None:
                self._first += count
                self._most = 2 * count
                return count, shift_ns
            count //= 2

    def _take_senders(self, batches: Batches) -> int:
        """Take in a tick, sender by sender."""
        senders = [self._decoder.decode(block) for block in batches.raw] or [()]
        return sum(self._poses.append(Ticks.one(tracks)) or 0 for tracks in senders)
