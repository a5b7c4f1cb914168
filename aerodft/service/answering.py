"""What is done with images and observations whose telemetry is there: answered, learned from, followed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import NamedTuple

from aerodft.dft.measure import measure
from aerodft.dft.projection import shared_count
from aerodft.dft.request import Request, Setup, linked
from aerodft.dft.sampling import standard_draws
from aerodft.dft.zoomed import zoomed
from aerodft.geometry.poses import camera_pose
from aerodft.model.camera import Camera
from aerodft.model.height import HeightSwitch
from aerodft.model.image import Image, StampClock
from aerodft.model.observation import Observation
from aerodft.model.pose import HeightSource, PoseSample
from aerodft.model.pose_columns import Posed, PoseRows, sample_of
from aerodft.model.probe import ASKED_KINDS, PixelSource, Probe, takes_pixels
from aerodft.model.status import Status
from aerodft.service.asked import Asked
from aerodft.service.objects import OBJECTS
from aerodft.service.outlined import can_answer, request_of, unseen
from aerodft.service.ports import Calibrator, LandmarkObserver, ObjectTracker, Output
from aerodft.service.settings import PipelineSettings
from aerodft.service.waiting import ImageMemory, Job, Ready


@dataclass(frozen=True, slots=True, kw_only=True)
class Helpers:
    """Who else has a say; None where nobody asks for that.

    Attributes:
        calibrator: Refines every pose.
        observer: Learns from observed landmarks.
        tracker: Follows what moves.
    """

    calibrator: Calibrator | None = None
    observer: LandmarkObserver | None = None
    tracker: ObjectTracker | None = None


class Uses(NamedTuple):
    """Who has a use for an observation.

    Attributes:
        is_known: Whether its name says anything to anybody.
        is_measured: Whether a probe is measured by it.
        is_landmark: Whether it is learned from.
        is_object: Whether it is followed.
    """

    is_known: bool
    is_measured: bool
    is_landmark: bool
    is_object: bool

    def jobs(self, stamp_ns: int, deadline_ns: int, seen: Observation, clock: StampClock) -> list[Job]:
        """What is to be done with it, seen at a stamp that came by that clock."""
        job = Job(stamp_ns, deadline_ns, seen, clock)
        roles = (
            (self.is_measured, job),
            (self.is_landmark, job._replace(is_landmark=True)),
            (self.is_object, job._replace(is_object=True)),
        )
        return [each for is_wanted, each in roles if is_wanted]


class Answering:
    """Turns jobs that have their poses into outputs, and into what is yet to be measured.

    Args:
        settings: Probes and tolerances.
        setup: What all measurements share.
        helpers: Who refines, learns and follows.
        images: The images that observations refer to.
        switched: Describes a change of the height's source.

    Attributes:
        fixed: What is asked in every image.
        observed: The probes whose pixels come as observations, by name.
        last_pose: The pose of the newest finished image; None before the first.
    """

    def __init__(
        self,
        settings: PipelineSettings,
        setup: Setup,
        helpers: Helpers,
        images: ImageMemory,
        switched: Callable[[HeightSource, HeightSource, int], HeightSwitch],
    ) -> None:
        self.observed = {p.name: p for p in settings.probes if p.source is not PixelSource.FIXED}
        fixed = [p for p in settings.probes if p.source is PixelSource.FIXED]
        self.fixed = linked(Request(probe=p, pixels=p.pixels, std_px=p.std_px) for p in fixed)
        self.last_pose: Posed | None = None
        self._setup = setup
        self._calibrator, self._observer, self._tracker = helpers.calibrator, helpers.observer, helpers.tracker
        self._images = images
        self._switched = switched
        self._match_tolerance_ns = settings.match_tolerance_ns
        self._height_source: HeightSource | None = None

    def warm_up(self) -> None:
        """Load and compile what answers are made with, whatever may be asked."""
        standard_draws(shared_count(self._setup.camera) + 2)
        down = PoseSample(stamp_ns=0, status=Status.OK, pose=camera_pose(height_agl_m=10.0, tilt_rad=0.5))
        measure(self._setup, down, self.fixed)
        measure(self._setup, down, _one_of_each_kind(self._setup.camera))

    def uses(self, observation: Observation) -> Uses:
        """What an observation is good for."""
        probe, observer = self.observed.get(observation.name), self._observer
        is_named = observer is not None and observer.observes(observation.name)
        is_object = self._tracker is not None and observation.name == OBJECTS
        return Uses(
            is_known=probe is not None or is_named or is_object,
            is_measured=probe is not None and can_answer(probe, observation),
            is_landmark=is_named and observer is not None and observer.fits(observation),
            is_object=is_object,
        )

    def done(self, ready: Sequence[Ready]) -> list[Output | Asked]:
        """The answers in order of arrival; landmarks are learned from before what bears a later stamp."""
        outputs: list[Output | Asked] = []
        landmarks = [each for each in ready if each.job.is_landmark]
        landmarks.sort(key=lambda each: each.job.stamp_ns)
        for each in ready:
            if each.job.is_landmark or each.job.is_object:
                continue
            if landmarks:
                earlier = [seen for seen in landmarks if seen.job.stamp_ns < each.job.stamp_ns]
                landmarks = landmarks[len(earlier) :]
                outputs += self._learn(earlier)
            outputs += self._answer(each.job.subject, self.refined(each.posed))
        if self._observer is not None:
            outputs += self._learn(landmarks)
        if self._tracker is not None:
            outputs += self._follow(self._tracker, [each for each in ready if each.job.is_object])
        return outputs

    def may_be_rows(self, poses: PoseRows) -> bool:
        """Whether images with such poses come to nothing but their answers: nobody refines, no height switches."""
        return self._calibrator is None and poses.columns.alike[0].height_source is self._height_source

    def _follow(self, tracker: ObjectTracker, seen: Sequence[Ready]) -> list[Output | Asked]:
        """Follow objects in order of their stamps, those of one image at once."""
        outputs: list[Output | Asked] = []
        seen = sorted(seen, key=lambda each: each.job.stamp_ns)
        for _, group in groupby(seen, key=lambda each: each.job.stamp_ns):
            image = tuple(group)
            sample = sample_of(self.refined(image[0].posed))
            found = tuple(self._linked(each.job.subject) for each in image if isinstance(each.job.subject, Observation))
            outputs += [*found, *tracker.follow(self._setup, sample, found, found[0].image)]
        return outputs

    def _learn(self, seen: Sequence[Ready]) -> list[Output]:
        """Learn from landmarks in order of their stamps, those of one image at once."""
        if self._observer is None:
            return []
        estimates: list[Output] = []
        for _, group in groupby(seen, key=lambda each: each.job.stamp_ns):
            image = tuple(group)
            observations = tuple(each.job.subject for each in image if isinstance(each.job.subject, Observation))
            estimates.append(self._observer.observe(sample_of(image[0].posed), observations))
        return estimates

    def refined(self, posed: Posed) -> Posed:
        """A pose with what the calibrator knows by now."""
        return self._calibrator.refine(sample_of(posed)) if self._calibrator else posed

    def _answer(self, subject: Image | Observation, posed: Posed) -> list[Output | Asked]:
        if isinstance(subject, Image):
            switch, self.last_pose = self._height_switch(posed), posed
            index = None if subject.width_px is None else subject.index
            asked = [Asked(posed, self.fixed, index)] if self.fixed else []
            return [subject, *switch, posed, *asked]
        sample = sample_of(posed)
        observation = self._linked(subject)
        probe = self.observed[observation.name]
        if observation.is_empty:
            return [observation, unseen(self._setup, sample, probe, observation)]
        request = request_of(probe, observation, zoomed(self._setup, sample)[0].camera, sample.pose)
        return [observation, Asked(sample, linked([request], self.fixed), observation.image)]

    def _height_switch(self, posed: Posed) -> list[Output]:
        """Whether an image's height is of another source than the last one's."""
        before, after = self._height_source, posed.height_source
        self._height_source = after or before
        if before is None or after is None or before is after:
            return []
        return [self._switched(before, after, posed.stamp_ns)]

    def _linked(self, observation: Observation) -> Observation:
        if observation.image is not None:
            return observation
        index = self._images.nearest(observation.stamp_ns, self._match_tolerance_ns)
        return observation if index is None else replace(observation, image=index)


def _one_of_each_kind(camera: Camera) -> tuple[Request, ...]:
    """A request of every kind, around the image's middle."""
    across, down = camera.width_px / 4, camera.height_px / 4
    corners = ((across, down), (3 * across, down), (3 * across, 3 * down), (across, 3 * down))
    pixels = {kind: next(n for n in range(1, 5) if takes_pixels(kind, n)) for kind in ASKED_KINDS}
    return tuple(
        Request(probe=Probe(name=kind, kind=kind, source=PixelSource.OBSERVED), pixels=corners[:count], std_px=1.0)
        for kind, count in pixels.items()
    )
