"""Batches in, poses and measurements out: the one path that live, imported and recomputed flights take.

What comes out is a function of the batches alone. An image (or an observation) becomes a job at its stamp; a job is
done on the first tick at which its telemetry is complete on both sides, or when it has waited long enough. What
landmarks teach is used from the next stamp on: of what is done on one tick, in the order of the stamps.
"""

import threading
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from aerodft.dft.measure import Request, Setup, measure
from aerodft.model.batch import Batch
from aerodft.model.health import Health
from aerodft.model.image import Image, StampClock
from aerodft.model.measurement import Measurement
from aerodft.model.observation import Observation
from aerodft.model.pose import PoseSample
from aerodft.model.pose_columns import Posed, PoseRows, sample_of
from aerodft.model.status import Status
from aerodft.service.answering import Answering, Helpers
from aerodft.service.asked import Asked, AskedImages, Work
from aerodft.service.batches import Batches
from aerodft.service.coming import Coming
from aerodft.service.counts import Counts
from aerodft.service.feed import tick_after
from aerodft.service.intake import FEWEST_TOGETHER, Intake
from aerodft.service.made import Made
from aerodft.service.ports import Calibrator, LandmarkObserver, ObjectTracker, Output, TelemetryDecoder
from aerodft.service.poses import PoseSource
from aerodft.service.settings import PipelineSettings, TelemetrySettings
from aerodft.service.waiting import ImageMemory, Job, Ready


class Pipeline:
    """Measures every configured probe for every image.

    Args:
        settings: What the numbers depend on.
        decoder: Turns raw telemetry into tracks.
        calibrator: Refines every pose; None uses poses as they come.
        observer: Learns from observed landmarks; None where there are none.
        tracker: Follows what moves; None where nobody asks for that.
    """

    def __init__(
        self,
        settings: PipelineSettings,
        decoder: TelemetryDecoder,
        calibrator: Calibrator | None = None,
        observer: LandmarkObserver | None = None,
        tracker: ObjectTracker | None = None,
    ) -> None:
        self.counts = Counts()
        self._settings = settings
        self._setup = Setup(
            camera=settings.camera,
            model=settings.model,
            ground=settings.ground,
            max_range_m=settings.max_range_m,
            config_id=settings.config_id,
        )
        telemetry = settings.telemetry or TelemetrySettings()
        self._wait_ns = telemetry.wait_ns
        self._poses = PoseSource(
            telemetry,
            origin=settings.origin,
            time_std_s=settings.time_std_s,
            ground=settings.ground,
            camera=settings.camera,
        )
        self._intake = Intake(decoder, self._poses)
        self._jobs: deque[Job] = deque()
        self._images = ImageMemory()
        self._answering = Answering(
            settings,
            self._setup,
            Helpers(calibrator=calibrator, observer=observer, tracker=tracker),
            self._images,
            self._poses.height_switch,
        )
        self._lock = threading.Lock()  # between the ticks and the questions from outside

    def warm_up(self) -> None:
        """Load and compile now what would hold up the first measurements."""
        self._answering.warm_up()

    @property
    def last_pose(self) -> PoseSample | None:
        """The pose of the newest finished image; None before the first."""
        posed = self._answering.last_pose
        return None if posed is None else sample_of(posed)

    def step(self, batch: Batch) -> tuple[Output, ...]:
        """Advance by one tick.

        Returns:
            Finished work: for an image the image (stamp in UTC), its pose and its measurements; for an observation
            the observation with its image, and its measurement; for the landmarks of an image the new estimate.
        """
        with self._lock:
            work = Work()
            work.add_tick(self._tick(batch, None))
            return work.measured(self._setup, self._answering.fixed)[0]

    def advance(self, batches: Sequence[Batch]) -> Made:
        """Advance by some ticks at once.

        Returns:
            What ``step`` gives for each of them: it does not matter which ticks are together, only how long it takes.
            But poses that were made together are rows of their columns; ``sample_of`` makes samples of them.
        """
        with self._lock:
            work, together = Work(), Batches.of(batches)
            while work.count < len(together):
                self._work(together[work.count :], work)
            return work.measured(self._setup, self._answering.fixed)

    def _work(self, batches: Batches, work: Work) -> None:
        """Do what is to be done in the first of some ticks: in as many as can be taken in together."""
        before = self._wait_until(int(batches.now_ns[0]))
        together = self._intake.take_together(batches)
        if not together:
            for batch in batches[:FEWEST_TOGETHER]:
                work.add_tick(before + self._tick(batch, None))
                before = []
            return
        batches = batches[:together]
        coming = Coming.of(batches, self._poses.clock)
        self._poses.prepare(coming.asked(self._jobs))
        poses = self._poses.ready(coming.tick, coming.stamps_ns)
        odd = coming.odd_ticks(batches, poses, self._wait_ns, self._settings.tick_ns)
        tick = 0
        while tick < together:
            stop = int(odd[np.searchsorted(odd, tick)])
            if poses is None or stop == tick or before or self._jobs or not self._answering.may_be_rows(poses):
                work.add_tick(before + self._tick(batches[tick], tick))
                before, tick = [], tick + 1
            else:
                work.add_ticks(stop - tick, self._images_alone(coming, poses, tick, stop))
                tick = stop

    def _images_alone(self, coming: Coming, poses: PoseRows, first: int, stop: int) -> AskedImages:
        """What is done in ticks in which nothing comes but images, whose poses are ready."""
        own = coming.between(first, stop)
        images, rows = coming.images[own], poses[own]
        self._poses.see(stop - 1)
        self.counts.images += len(images)
        self._images.add_all(images, rows.stamp_ns)
        if images:
            self._answering.last_pose = rows[-1]
        return AskedImages(coming.tick[own] - first, images, rows)

    def _tick(self, batch: Batch, tick: int | None) -> list[Output | Asked]:
        """What is done in one tick, yet to be measured; its telemetry is there already where it has a number."""
        outputs = self._wait_until(batch.now_ns)
        if tick is not None:
            self._poses.see(tick)
        else:
            for shift_ns in self._intake.take(batch):
                self._shift(shift_ns)
        for image in batch.images:
            self._accept_image(image)
        for observation in batch.observations:
            self._accept_observation(observation)
        return outputs + self._finish(batch.now_ns)

    def _shift(self, by_ns: int) -> None:
        """What UTC is became known better: stamps made of this machine's are made anew."""
        if by_ns:
            self._jobs = deque(job.shifted(by_ns) for job in self._jobs)
            self._images.shift(by_ns)

    def finish(self) -> tuple[Output, ...]:
        """The end of the input: what still waits is answered with what there is."""
        with self._lock:
            work = Work()
            work.add_tick(self._wait_until(None))
            return work.measured(self._setup, self._answering.fixed)[0]

    def measure_at(self, requests: Iterable[Request], stamp_ns: int | None = None) -> list[Measurement]:
        """Answer a question from outside, from any thread.

        Args:
            requests: What to measure.
            stamp_ns: UTC of the recent past; None for the newest finished image, or a fixed camera's pose.
        """
        with self._lock:
            if stamp_ns is not None or self._settings.fixed_pose is not None:
                sample = self._pose(stamp_ns or 0, final=True)
            else:
                sample = self.last_pose
        if sample is None:
            reason = "no image has been measured yet"
            sample = PoseSample(stamp_ns=0, status=Status.NO_TELEMETRY, reasons=(reason,))
        return measure(self._setup, sample, tuple(requests))

    def pose_at(self, stamp_ns: int) -> PoseSample:
        """The pose at a stamp of the recent past, with what has arrived so far."""
        with self._lock:
            sample = self._pose(stamp_ns, final=True)
        return sample or PoseSample(stamp_ns=stamp_ns, status=Status.STALE_TELEMETRY)

    def health(self, host_ns: int) -> Health | None:
        """What the vehicle had said of itself by this machine's time; None of a fixed camera."""
        if self._settings.telemetry is None:
            return None
        with self._lock:
            return self._poses.health_at(self._utc(host_ns, StampClock.HOST))

    def rejected(self) -> dict[str, int]:
        """Telemetry that held no value so far, by ``MESSAGE: reason``."""
        with self._lock:
            return self._intake.rejected

    def in_utc(self, image: Image) -> Image:
        """The image with its stamp in UTC as it is known now, from any thread; what an observer's answer refers to."""
        with self._lock:
            return replace(image, stamp_ns=self._utc(image.stamp_ns, image.clock), clock=StampClock.UTC)

    def _accept_image(self, image: Image) -> None:
        self.counts.images += 1
        stamp_ns = self._utc(image.stamp_ns, image.clock)
        if image.width_px is not None:
            self._images.add(image.index, stamp_ns, image.clock)
        known = image
        if image.clock is not StampClock.UTC or image.pixels is not None:
            known = image.known_at(stamp_ns)
        deadline_ns = tick_after(image.arrival_ns + self._wait_ns, self._settings.tick_ns)
        self._jobs.append(Job(stamp_ns, deadline_ns, known, image.clock))

    def _accept_observation(self, observation: Observation) -> None:
        self.counts.observations += 1
        uses = self._answering.uses(observation)
        if not uses.is_known:
            self.counts.unknown_probe += 1
        elif not any(uses[1:]):
            self.counts.wrong_pixel_count += 1
        else:
            stamp_ns = self._seen_ns(observation)
            known = replace(observation, stamp_ns=stamp_ns, clock=StampClock.UTC)
            deadline_ns = tick_after(observation.arrival_ns + self._wait_ns, self._settings.tick_ns)
            self._jobs += uses.jobs(stamp_ns, deadline_ns, known, observation.clock)

    def _seen_ns(self, observation: Observation) -> int:
        """UTC of an observation: on the host's clock its image's own, though the clocks are known better by now."""
        stamp_ns = self._utc(observation.stamp_ns, observation.clock)
        if observation.clock is StampClock.UTC or observation.image is None:
            return stamp_ns
        own_ns = self._images.stamp_ns(observation.image)
        return stamp_ns if own_ns is None else own_ns

    def _utc(self, stamp_ns: int, clock: StampClock) -> int:
        return stamp_ns if clock is StampClock.UTC else self._poses.clock.host_to_utc(stamp_ns)

    def _wait_until(self, now_ns: int | None) -> list[Output | Asked]:
        """What the empty ticks before ``now_ns`` would have answered, whether they came or were left out."""
        if not self._jobs:
            return []
        deadlines_ns = {job.deadline_ns for job in self._jobs if now_ns is None or job.deadline_ns < now_ns}
        return [output for deadline_ns in sorted(deadlines_ns) for output in self._finish(deadline_ns)]

    def _finish(self, now_ns: int) -> list[Output | Asked]:
        ready: list[Ready] = []
        waiting: deque[Job] = deque()
        # An image and all that was seen in it share their pose.
        found: dict[tuple[int, bool, bool], Posed | None] = {}
        blocked_ns = None  # what one stamp waits for, later ones wait for too
        for job in self._jobs:
            final = job.deadline_ns <= now_ns
            if not final and self._images.are_behind(job, self._settings.match_tolerance_ns):
                waiting.append(job)
                continue
            look = final or blocked_ns is None or job.stamp_ns < blocked_ns
            by_utc = job.clock is StampClock.UTC
            key = (job.stamp_ns, by_utc, final)
            if look and key not in found:
                found[key] = self._telemetry_pose(job.stamp_ns, final=final, by_utc=by_utc)
            posed = found[key] if look else None
            if posed is None:
                waiting.append(job)
                blocked_ns = min(job.stamp_ns, blocked_ns or job.stamp_ns)
            else:
                ready.append(Ready(job, posed))
        self._jobs = waiting
        return self._answering.done(ready)

    def _pose(self, stamp_ns: int, *, final: bool) -> PoseSample | None:
        posed = self._telemetry_pose(stamp_ns, final=final)
        return None if posed is None else sample_of(self._answering.refined(posed))

    def _telemetry_pose(self, stamp_ns: int, *, final: bool, by_utc: bool = False) -> Posed | None:
        fixed = self._settings.fixed_pose
        if fixed is not None:
            return replace(fixed, stamp_ns=stamp_ns)
        return self._poses.posed_at(stamp_ns, final=final, by_utc=by_utc)
