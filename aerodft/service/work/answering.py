"""Turns images and observations with poses into outputs: measurements, calibration updates, object tracks.

An observation becomes a request of its pixels, or of points of the object in its box or contour.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count, pairwise
from typing import Any, Final, TypeAlias

import numpy as np

from aerodft.dft import (
    NO_IMAGE,
    PROBE_KINDS,
    MeasurementBatch,
    Request,
    Setup,
    link_requests,
    measure,
)
from aerodft.geometry import camera_pose, inverse, multiply, rotated_pixels
from aerodft.model import (
    FIXED_POINTS,
    Batch,
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
from aerodft.service.pose import over_water
from aerodft.service.settings import OBJECTS, PipelineSettings
from aerodft.service.work.observed_requests import can_answer, fixed_requests, request_of, unseen_batch
from aerodft.service.work.work_list import ReadyWork, Task, WorkList

_PIXEL_DECIMALS: Final = 3  # of pixels moved with a camera's rotation, which is not known better
_UNCERTAIN_POSE: Final = camera_pose(height_agl_m=10.0, tilt_rad=0.5, std=PoseStd(height_agl_m=1.0))  # has draws
_WARM_UP_POSES: Final = PoseBatch.from_samples([PoseSample(stamp_ns=0, status=Status.OK, pose=_UNCERTAIN_POSE)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimators:
    """Optional estimators beside the engine.

    Attributes:
        calibrator: Refines every pose.
        observer: Updates the calibration by observed landmarks.
        tracker: Tracks moving objects.
    """

    calibrator: Calibrator[Any] | None = None
    observer: LandmarkObserver | None = None
    tracker: ObjectTracker | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _WorkPart(Batch):
    """Images or observations ``(n,)`` to be refined and measured.

    Attributes:
        tick: Number of the tick in the step.
        order: Position among the outputs of the step.
        work: The work.
        poses: Unrefined poses.
        state_index: Index of the calibrator's state in this step.
        fixed: Requests of the fixed probes; empty before the poses are refined.
    """

    tick: IntArray
    order: IntArray
    work: WorkList
    poses: PoseBatch
    state_index: IntArray
    fixed: tuple[Request, ...] = ()


_DescribeSwitch: TypeAlias = Callable[[HeightSource, HeightSource, int, int], HeightSwitch]
"""Describes a change of the height source from the sources before and after, the stamp (UTC), as of a tick."""

_RequestKey: TypeAlias = tuple[str, int, float | None]
"""Name of a probe, number of pixels (0 where not detected) and their std: equal for observations in one request."""


class Answering:
    """Turns work with poses into outputs.

    Args:
        settings: Probes and fixed pose.
        setup: Camera, model and ground.
        estimators: Calibrator, landmark observer and tracker.

    Attributes:
        last_pose: The pose of the newest answered image; None before the first.
    """

    def __init__(self, settings: PipelineSettings, setup: Setup, estimators: Estimators) -> None:
        self.last_pose: PoseSample | None = None
        self._observed = {p.name: p for p in settings.probes if p.source is not PixelSource.FIXED}
        self._fixed = fixed_requests(settings.probes)
        self._setup = setup
        self._level = settings.level
        self._is_watched = settings.fixed_pose is not None and estimators.calibrator is not None
        self._calibrator, self._observer, self._tracker = estimators.calibrator, estimators.observer, estimators.tracker
        self._learns_of_same_image = self._observer is not None and self._observer.observes(FIXED_POINTS)
        self._height_source: HeightSource | None = None
        self._states = [None if self._calibrator is None else self._calibrator.known()]
        self._begin_step()

    def warm_up(self) -> None:
        """Load and compile what measurements of any kind need."""
        measure(self._setup, _WARM_UP_POSES, (*self._fixed, *_one_of_each_kind(self._setup.camera)))

    def tasks(self, observation: Observation) -> tuple[bool, list[Task]]:
        """Whether an observation's name is known, and the tasks that the observation is used for."""
        probe, observer = self._observed.get(observation.name), self._observer
        is_landmark = observer is not None and observer.observes(observation.name)
        is_object = self._tracker is not None and observation.name == OBJECTS
        applies = {
            Task.MEASURE: probe is not None and can_answer(probe, observation),
            Task.LEARN: is_landmark and observer is not None and observer.fits(observation),
            Task.TRACK: is_object,
        }
        return probe is not None or is_landmark or is_object, [task for task, applies in applies.items() if applies]

    def add(self, ready: ReadyWork, describe_switch: _DescribeSwitch) -> None:
        """Process work of some ticks: refine poses, learn from landmarks, track; measurements follow in ``outputs``.

        Args:
            ready: Work to answer.
            describe_switch: Describes a change of the height source.
        """
        for task, rows in self._in_answer_order(ready):
            work, tick = ready.work.rows(rows), ready.tick[rows]
            if task is Task.LEARN:
                self._learn(work, ready.poses.rows(rows), tick)
                continue
            poses = ready.poses.rows(rows)
            if task is Task.TRACK:
                self._track(work, self.refined(poses), tick)
                continue
            order = np.empty(len(rows), dtype=np.int64)
            switches = self._switches(work, poses, ready.as_of_tick[rows], describe_switch)
            for row in range(len(rows)):
                if row in switches:
                    self._add_single(int(tick[row]), switches[row])
                order[row] = next(self._order)
            part = _WorkPart(tick, order, work, poses, np.full(len(rows), len(self._states) - 1))
            self._images.append(part.rows(np.flatnonzero(work.task == Task.IMAGE)))
            for key, rows_of_request in _group_by_request(part):
                self._observed_parts.setdefault(key, []).append(part.rows(rows_of_request))

    def outputs(self) -> StepOutputs:
        """Measure the work of a step and return the step's outputs."""
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
        self._states = self._states[-1:]
        self._singles: list[SingleOutput] = []
        self._images: list[_WorkPart] = []
        self._observed_parts: dict[_RequestKey, list[_WorkPart]] = {}

    def _add_single(self, tick: int, content: Observation | Estimate | HeightSwitch | MeasurementBatch) -> None:
        self._singles.append(SingleOutput(tick=tick, order=next(self._order), content=content))

    def refined(self, poses: PoseBatch, state_index: IntArray | None = None) -> PoseBatch:
        """Poses over the water of their time, refined by the calibrator's newest state.

        Args:
            poses: ``(n,)``.
            state_index: ``(n,)`` of the calibrator's states in this step; None for the newest.
        """
        if self._calibrator is not None:
            state_index = np.full(len(poses), len(self._states) - 1) if state_index is None else state_index
            poses = self._calibrator.refine(poses, self._states, state_index)
        return over_water(poses, self._level)

    def _refined(self, parts: Sequence[_WorkPart]) -> _WorkPart | None:
        """Parts as one, with refined poses; None if all are empty."""
        parts = [part for part in parts if len(part.tick)]
        if not parts:
            return None
        joined = _WorkPart.concatenate(parts)
        poses = self.refined(joined.poses, joined.state_index)
        return replace(joined, poses=poses, fixed=self._fixed_in(joined.poses, poses))

    def _fixed_in(self, original: PoseBatch, refined: PoseBatch) -> tuple[Request, ...]:
        """Requests of the fixed probes in images ``(n,)``; pixels follow the ground as a fixed camera rotates.

        Args:
            original: Poses at which the pixels were chosen.
            refined: Poses after the camera's rotation.
        """
        if not (self._is_watched and self._fixed):
            return self._fixed
        has_rotated = refined.has_pose & np.any(refined.pose.wxyz != original.pose.wxyz, axis=-1)
        if not np.any(has_rotated):
            return self._fixed
        now_SO3_original = multiply(inverse(refined.pose.wxyz[has_rotated]), original.pose.wxyz[has_rotated])  # noqa: N806

        def moved(request: Request) -> Request:
            pixels = np.tile(request.pixels_px, (len(refined), 1, 1))
            moved_px = rotated_pixels(self._setup.camera, now_SO3_original, request.pixels_px)
            pixels[has_rotated] = np.round(moved_px, _PIXEL_DECIMALS)
            return replace(request, pixels=pixels, on_top_of=None)

        return link_requests(map(moved, self._fixed))

    def _in_answer_order(self, ready: ReadyWork) -> Iterator[tuple[Task, IntArray]]:
        """Segments of rows in the order of their answers, with their task.

        Within a group, landmarks are used in the order of their stamps, before work with later stamps; steady points
        before that of their own image too, which may be the first after a bump. Objects are tracked last. Other work is
        one segment across groups where nothing is between.
        """
        task, stamp_ns, group = ready.work.task, ready.work.stamp_ns, ready.group
        is_measured = ~np.isin(task, (Task.LEARN, Task.TRACK))
        answered_with = np.where(is_measured, np.arange(len(task)), len(task))  # or before that row
        for row in np.flatnonzero(task == Task.LEARN).tolist():
            first_ns = stamp_ns[row] + (not self._learns_of_same_image)
            later = np.flatnonzero(is_measured & (group == group[row]) & (stamp_ns >= first_ns))
            if len(later):  # else it is used at the end of its group
                answered_with[row] = later[0]
        order = np.lexsort((stamp_ns, np.where(is_measured, len(Task), task), answered_with, group))
        segment = np.where(is_measured, -1, len(Task) * group + task)[order]
        for rows in np.split(order, np.flatnonzero(np.diff(segment)) + 1):
            yield Task.IMAGE if is_measured[rows[0]] else Task(task[rows[0]]), rows

    def _learn(self, work: WorkList, poses: PoseBatch, tick: IntArray) -> None:
        """Update the calibration by landmarks in the order of their stamps, one image at a time."""
        if self._observer is not None:
            for first, stop in _runs_of_stamps(work.stamp_ns):
                estimate = self._observer.observe(poses[first], _observations(work, first, stop))
                self._add_single(int(tick[first]), estimate)
            if self._calibrator is not None:
                self._states.append(self._calibrator.known())

    def _track(self, work: WorkList, poses: PoseBatch, tick: IntArray) -> None:
        """Track objects in the order of their stamps, one image at a time."""
        if self._tracker is not None:
            for first, stop in _runs_of_stamps(work.stamp_ns):
                observations = _observations(work, first, stop)
                tracks = self._tracker.follow(self._setup, poses[first], observations, observations[0].image)
                for content in (*observations, *(() if tracks is None else (tracks,))):
                    self._add_single(int(tick[first]), content)

    def _switches(
        self, work: WorkList, poses: PoseBatch, as_of_tick: IntArray, describe_switch: _DescribeSwitch
    ) -> dict[int, HeightSwitch]:
        """Changes of the height source from image to image, by row."""
        sources = [variant.height_source for variant in poses.variants]
        switches: dict[int, HeightSwitch] = {}
        if len(set(sources) | {self._height_source}) == 1:
            return switches
        for row in np.flatnonzero(work.task == Task.IMAGE).tolist():
            before, after = self._height_source, sources[int(poses.variant_index[row])]
            self._height_source = after or before
            if before is not None and after is not None and before != after:
                switches[row] = describe_switch(before, after, int(work.stamp_ns[row]), int(as_of_tick[row]))
        return switches

    def _image_outputs(self, part: _WorkPart) -> ImageOutputs:
        measured = measure(self._setup, part.poses, part.fixed, part.work.image) if part.fixed else None
        return ImageOutputs(
            tick=part.tick, order=part.order, images=part.work.image, poses=part.poses, measurements=measured
        )

    def _observation_outputs(self, name: str, part: _WorkPart) -> ObservationOutputs:
        probe, observations = self._observed[name], _observations(part.work, 0, len(part.work))
        if observations[0].is_empty:
            measured = unseen_batch(self._setup, part.poses, probe, observations, part.work.image)
        else:
            request = request_of(probe, observations, self._setup, part.poses)
            measured = measure(self._setup, part.poses, link_requests([request], part.fixed), part.work.image)
        return ObservationOutputs(tick=part.tick, order=part.order, observations=observations, measurements=measured)


def _group_by_request(part: _WorkPart) -> Iterator[tuple[_RequestKey, IntArray]]:
    """Keys of requests and rows of the observations that one request can hold; an outline has a request of its own."""
    rows_by_key: dict[_RequestKey, list[int]] = {}
    for row in np.flatnonzero(part.work.task == Task.MEASURE).tolist():
        observation = part.work.observations[row]
        if observation is not None:
            pixels = -1 - int(part.order[row]) if observation.has_outline else len(observation.pixels)
            rows_by_key.setdefault((observation.name, pixels, observation.std_px), []).append(row)
    for key, rows in rows_by_key.items():
        yield key, np.array(rows)


def _runs_of_stamps(stamps_ns: IntArray) -> Iterator[tuple[int, int]]:
    """Start and stop of each run of equal stamps."""
    edges = np.flatnonzero(np.diff(stamps_ns)) + 1
    yield from pairwise([0, *edges.tolist(), len(stamps_ns)])


def _observations(work: WorkList, first: int, stop: int) -> tuple[Observation, ...]:
    """Observations of the rows ``first`` to ``stop``, with their images' numbers."""
    pairs = zip(work.observations[first:stop], work.image[first:stop].tolist(), strict=True)
    return tuple(
        observation if observation.image is not None or image == NO_IMAGE else replace(observation, image=image)
        for observation, image in pairs
        if observation is not None
    )


def _one_of_each_kind(camera: Camera) -> tuple[Request, ...]:
    """A request of every kind around the image's middle."""
    quarter_px, down = camera.width_px / 4, camera.height_px / 4
    corners = ((quarter_px, down), (3 * quarter_px, down), (3 * quarter_px, 3 * down), (quarter_px, 3 * down))
    pixels = {name: next(n for n in range(1, 5) if kind.takes_pixels(n)) for name, kind in PROBE_KINDS.items()}
    return tuple(
        Request(probe=Probe(name=name, kind=name, source=PixelSource.OBSERVED), pixels=corners[:count], std_px=1.0)
        for name, count in pixels.items()
    )
