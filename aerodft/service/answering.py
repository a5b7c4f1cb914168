"""What is done with images and observations whose poses are there: measured, learned from, tracked."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count, pairwise
from typing import Any, Final, TypeAlias

import numpy as np

from aerodft.dft import NO_IMAGE, PROBE_KINDS, MeasurementBatch, Request, Setup, link_requests, measure
from aerodft.geometry import camera_pose, inverse, multiply, rotated_pixels
from aerodft.model import (
    Camera,
    HeightSource,
    HeightSwitch,
    IntArray,
    Observation,
    PixelSource,
    PoseBatch,
    PoseSample,
    PoseStd,
    Probe,
    Status,
)
from aerodft.service.outline_requests import can_answer, request_of, unseen
from aerodft.service.pending import Task, WorkList
from aerodft.service.ports import (
    Calibrator,
    Estimate,
    ImageOutputs,
    LandmarkObserver,
    ObjectTracker,
    ObservationOutputs,
    SingleOutput,
    StepOutputs,
)
from aerodft.service.settings import OBJECTS, PipelineSettings

_DECIMALS: Final = 3  # of a pixel that follows the ground; a turn is not known better
_UNCERTAIN: Final = camera_pose(height_agl_m=10.0, tilt_rad=0.5, std=PoseStd(height_agl_m=1.0))  # enough to be drawn
_LOOKING_DOWN: Final = PoseBatch.of([PoseSample(stamp_ns=0, status=Status.OK, pose=_UNCERTAIN)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Helpers:
    """Who else has a say; None where nobody asks for that.

    Attributes:
        calibrator: Refines every pose.
        observer: Learns from observed landmarks.
        tracker: Follows what moves.
    """

    calibrator: Calibrator[Any] | None = None
    observer: LandmarkObserver | None = None
    tracker: ObjectTracker | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ReadyWork:
    """Work ``(n,)`` with its poses, in the order in which it is answered.

    Attributes:
        work: The work.
        poses: Of each, as the telemetry has it.
        tick: ``(n,)`` on which of all ticks of the step each is answered.
        group: ``(n,)`` not decreasing number of the occasion on which it is: what is learned on one is used for the
            stamps after it only.
    """

    work: WorkList
    poses: PoseBatch
    tick: IntArray
    group: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """Images, or observations, ``(n,)`` that are yet to be refined and measured.

    Attributes:
        tick: Of the step, on which each is answered.
        order: Its place among the outputs of the step.
        work: What is answered.
        poses: As the telemetry has them.
        known: Which of the calibrator's states in this step each is refined with.
        fixed: The fixed probes' requests in them; empty before the poses are refined.
    """

    tick: IntArray
    order: IntArray
    work: WorkList
    poses: PoseBatch
    known: IntArray
    fixed: tuple[Request, ...] = ()

    def rows(self, rows: IntArray) -> "_Measured":
        tick, order, known = self.tick[rows], self.order[rows], self.known[rows]
        return _Measured(tick, order, self.work.rows(rows), self.poses.rows(rows), known)

    @staticmethod
    def joined(parts: Sequence["_Measured"]) -> "_Measured | None":
        """Parts as one, in the order of their answers; None where there is nothing in them."""
        parts = [part for part in parts if len(part.tick)]
        if not parts:
            return None
        return _Measured(
            np.concatenate([part.tick for part in parts]),
            np.concatenate([part.order for part in parts]),
            WorkList.joined([part.work for part in parts]),
            PoseBatch.joined([part.poses for part in parts]),
            np.concatenate([part.known for part in parts]),
        )


_DescribeSwitch: TypeAlias = Callable[[HeightSource, HeightSource, int, int], HeightSwitch]
"""Describes a change of the height's source at a stamp (UTC), which is that of a row of ``ReadyWork``."""

_RequestKey: TypeAlias = tuple[str, int, float | None]
"""Name of a probe, number of pixels (0 where it was not seen) and their std: what one request can be measured by."""


class Answering:
    """Turns work whose poses are there into outputs.

    Args:
        settings: Probes.
        setup: What all measurements share.
        helpers: Who refines, learns and follows.

    Attributes:
        last_pose: The pose of the newest answered image; None before the first.
    """

    def __init__(self, settings: PipelineSettings, setup: Setup, helpers: Helpers) -> None:
        self.last_pose: PoseSample | None = None
        self._observed = {p.name: p for p in settings.probes if p.source is not PixelSource.FIXED}
        fixed = [p for p in settings.probes if p.source is PixelSource.FIXED]
        self._fixed = link_requests(Request(probe=p, pixels=p.pixels, std_px=p.std_px) for p in fixed)
        self._setup = setup
        self._is_watched = settings.fixed_pose is not None and helpers.calibrator is not None
        self._calibrator, self._observer, self._tracker = helpers.calibrator, helpers.observer, helpers.tracker
        self._height_source: HeightSource | None = None
        self._known = [None if self._calibrator is None else self._calibrator.known()]
        self._begin_step()

    def warm_up(self) -> None:
        """Load and compile what answers are made with, whatever may be asked."""
        measure(self._setup, _LOOKING_DOWN, (*self._fixed, *_one_of_each_kind(self._setup.camera)))

    def tasks(self, observation: Observation) -> tuple[bool, list[Task]]:
        """Whether an observation's name says anything to anybody, and what it is good for."""
        probe, observer = self._observed.get(observation.name), self._observer
        is_landmark = observer is not None and observer.observes(observation.name)
        is_object = self._tracker is not None and observation.name == OBJECTS
        wanted = {
            Task.MEASURE: probe is not None and can_answer(probe, observation),
            Task.LEARN: is_landmark and observer is not None and observer.fits(observation),
            Task.TRACK: is_object,
        }
        return probe is not None or is_landmark or is_object, [task for task, is_so in wanted.items() if is_so]

    def add(self, ready: ReadyWork, describe_switch: _DescribeSwitch) -> None:
        """Take in what is answered in some ticks of a step: refine its poses, learn, track; it is measured later.

        Args:
            ready: What is answered.
            describe_switch: Describes a change of the height's source.
        """
        for task, rows in self._segments(ready):
            work, tick = ready.work.rows(rows), ready.tick[rows]
            if task is Task.LEARN:
                self._learn(work, ready.poses.rows(rows), tick)
                continue
            poses = ready.poses.rows(rows)
            if task is Task.TRACK:
                self._track(work, self.refined(poses), tick)
                continue
            order = np.empty(len(rows), dtype=np.int64)
            switches = self._switches(work, poses, rows, describe_switch)
            for row in range(len(rows)):
                if row in switches:
                    self._add_single(int(tick[row]), switches[row])
                order[row] = next(self._order)
            part = _Measured(tick, order, work, poses, np.full(len(rows), len(self._known) - 1))
            self._images.append(part.rows(np.flatnonzero(work.task == Task.IMAGE)))
            for key, own in _kinds(part):
                self._observed_parts.setdefault(key, []).append(part.rows(own))

    def outputs(self) -> StepOutputs:
        """The outputs of a step: what was taken in, with what is measured in it."""
        images = self._refined(self._images)
        if images is not None:
            self.last_pose = images.poses[len(images.tick) - 1]
        observed = [(name, self._refined(parts)) for (name, _, _), parts in self._observed_parts.items()]
        outputs = StepOutputs(
            images=() if images is None else (self._image_outputs(images),),
            observations=tuple(self._observation_outputs(name, part) for name, part in observed if part is not None),
            singles=tuple(self._singles),
        )
        self._begin_step()
        return outputs

    def _begin_step(self) -> None:
        self._order = count()
        self._known = self._known[-1:]
        self._singles: list[SingleOutput] = []
        self._images: list[_Measured] = []
        self._observed_parts: dict[_RequestKey, list[_Measured]] = {}

    def _add_single(self, tick: int, content: Observation | Estimate | HeightSwitch | MeasurementBatch) -> None:
        self._singles.append(SingleOutput(tick=tick, order=next(self._order), content=content))

    def refined(self, poses: PoseBatch, known: IntArray | None = None) -> PoseBatch:
        """Poses as the calibrator corrects them by its newest state, or by those of this step ``known (n,)``."""
        if self._calibrator is None:
            return poses
        which = np.full(len(poses), len(self._known) - 1) if known is None else known
        return self._calibrator.refine(poses, self._known, which)

    def _refined(self, parts: Sequence[_Measured]) -> _Measured | None:
        """Parts as one, with refined poses; None where there is nothing in them."""
        whole = _Measured.joined(parts)
        if whole is None:
            return None
        poses = self.refined(whole.poses, whole.known)
        return replace(whole, poses=poses, fixed=self._fixed_in(whole.poses, poses))

    def _fixed_in(self, stated: PoseBatch, refined: PoseBatch) -> tuple[Request, ...]:
        """Requests of the fixed probes in images ``(n,)``: a watched camera's pixels stay on the ground as it turns.

        Args:
            stated: The poses that the pixels were chosen at.
            refined: The poses after the camera's turn.
        """
        if not (self._is_watched and self._fixed):
            return self._fixed
        has_turned = refined.has_pose & np.any(refined.pose.wxyz != stated.pose.wxyz, axis=-1)
        if not np.any(has_turned):
            return self._fixed
        now_SO3_stated = multiply(inverse(refined.pose.wxyz[has_turned]), stated.pose.wxyz[has_turned])  # noqa: N806

        def held(request: Request) -> Request:
            pixels = np.tile(request.pixels_px, (len(refined), 1, 1))
            turned = rotated_pixels(self._setup.camera, now_SO3_stated, request.pixels_px)
            pixels[has_turned] = np.round(turned, _DECIMALS)
            return replace(request, pixels=pixels, on_top_of=None)

        return link_requests(map(held, self._fixed))

    def _segments(self, ready: ReadyWork) -> Iterator[tuple[Task, IntArray]]:
        """Rows that are answered one segment after the other.

        Of one occasion landmarks are learned from before what bears a later stamp, in order of their stamps; objects
        are tracked last. What neither waits for is one segment over all occasions.
        """
        task, stamp_ns, group = ready.work.task, ready.work.stamp_ns, ready.group
        is_plain = ~np.isin(task, (Task.LEARN, Task.TRACK))
        ahead_of = np.where(is_plain, np.arange(len(task)), len(task))  # the row that each is answered with or before
        for row in np.flatnonzero(task == Task.LEARN).tolist():
            later = np.flatnonzero(is_plain & (group == group[row]) & (stamp_ns > stamp_ns[row]))
            if len(later):  # else it is learned from at the end of its occasion
                ahead_of[row] = later[0]
        order = np.lexsort((stamp_ns, np.where(is_plain, len(Task), task), ahead_of, group))
        segment = np.where(is_plain, -1, len(Task) * group + task)[order]
        for rows in np.split(order, np.flatnonzero(np.diff(segment)) + 1):
            yield Task.IMAGE if is_plain[rows[0]] else Task(task[rows[0]]), rows

    def _learn(self, work: WorkList, poses: PoseBatch, tick: IntArray) -> None:
        """Learn from landmarks in order of their stamps, those of one image at once."""
        if self._observer is not None:
            for first, stop in _same_stamps(work.stamp_ns):
                estimate = self._observer.observe(poses[first], _observations(work, first, stop))
                self._add_single(int(tick[first]), estimate)
            if self._calibrator is not None:
                self._known.append(self._calibrator.known())

    def _track(self, work: WorkList, poses: PoseBatch, tick: IntArray) -> None:
        """Follow objects in order of their stamps, those of one image at once."""
        if self._tracker is not None:
            for first, stop in _same_stamps(work.stamp_ns):
                found = _observations(work, first, stop)
                tracks = self._tracker.follow(self._setup, poses[first], found, found[0].image)
                for content in (*found, *(() if tracks is None else (tracks,))):
                    self._add_single(int(tick[first]), content)

    def _switches(
        self, work: WorkList, poses: PoseBatch, rows: IntArray, describe_switch: _DescribeSwitch
    ) -> dict[int, HeightSwitch]:
        """By row, where an image's height is of another source than the last one's."""
        sources = [variant.height_source for variant in poses.variants]
        found: dict[int, HeightSwitch] = {}
        if len(set(sources) | {self._height_source}) == 1:
            return found
        for row in np.flatnonzero(work.task == Task.IMAGE).tolist():
            before, after = self._height_source, sources[int(poses.variant_index[row])]
            self._height_source = after or before
            if before is not None and after is not None and before != after:
                found[row] = describe_switch(before, after, int(work.stamp_ns[row]), int(rows[row]))
        return found

    def _image_outputs(self, part: _Measured) -> ImageOutputs:
        measured = measure(self._setup, part.poses, part.fixed, part.work.image) if part.fixed else None
        return ImageOutputs(
            tick=part.tick, order=part.order, images=part.work.image, poses=part.poses, measurements=measured
        )

    def _observation_outputs(self, name: str, part: _Measured) -> ObservationOutputs:
        probe, observations = self._observed[name], _observations(part.work, 0, len(part.work))
        if observations[0].is_empty:
            measured = unseen(self._setup, part.poses, probe, observations, part.work.image)
        else:
            request = request_of(probe, observations, self._setup, part.poses)
            measured = measure(self._setup, part.poses, link_requests([request], part.fixed), part.work.image)
        return ObservationOutputs(tick=part.tick, order=part.order, observations=observations, measurements=measured)


def _kinds(part: _Measured) -> Iterator[tuple[_RequestKey, IntArray]]:
    """Observations that one request can be measured by, as rows of the part; an outline's request is its own."""
    kinds: dict[_RequestKey, list[int]] = {}
    for row in np.flatnonzero(part.work.task == Task.MEASURE).tolist():
        seen = part.work.observations[row]
        if seen is not None:
            pixels = -1 - int(part.order[row]) if seen.has_outline else len(seen.pixels)
            kinds.setdefault((seen.name, pixels, seen.std_px), []).append(row)
    for key, rows in kinds.items():
        yield key, np.array(rows)


def _same_stamps(stamps_ns: IntArray) -> Iterator[tuple[int, int]]:
    """First and stop of each run of one stamp."""
    edges = np.flatnonzero(np.diff(stamps_ns)) + 1
    yield from pairwise([0, *edges.tolist(), len(stamps_ns)])


def _observations(work: WorkList, first: int, stop: int) -> tuple[Observation, ...]:
    """The observations of some rows, each with the number of its image."""
    pairs = zip(work.observations[first:stop], work.image[first:stop].tolist(), strict=True)
    return tuple(
        seen if seen.image is not None or image == NO_IMAGE else replace(seen, image=image)
        for seen, image in pairs
        if seen is not None
    )


def _one_of_each_kind(camera: Camera) -> tuple[Request, ...]:
    """A request of every kind, around the image's middle."""
    across, down = camera.width_px / 4, camera.height_px / 4
    corners = ((across, down), (3 * across, down), (3 * across, 3 * down), (across, 3 * down))
    pixels = {name: next(n for n in range(1, 5) if kind.takes_pixels(n)) for name, kind in PROBE_KINDS.items()}
    return tuple(
        Request(probe=Probe(name=name, kind=name, source=PixelSource.OBSERVED), pixels=corners[:count], std_px=1.0)
        for name, count in pixels.items()
    )
