"""Where ports meet adapters: pipelines, recorders, feeds and observers of images out of a station's configuration."""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerodft.adapters.config.station import (
    COPY_NAME,
    Rate,
    StationConfig,
    copy_terrain,
    resolved_toml,
    river_probes,
    travels,
)
from aerodft.adapters.images import read_camera_image
from aerodft.adapters.outputs import Run
from aerodft.adapters.recording.write import CopiedSegment, McapRecorder, RecorderSettings
from aerodft.adapters.telemetry import decoder_of
from aerodft.adapters.wire.requests import MeasureRequest
from aerodft.conventions import SECOND_NS
from aerodft.dft import Request
from aerodft.errors import ConfigError, InputError, counted
from aerodft.geometry import extrapolate_pose
from aerodft.model import Camera, Image, Measurement, PixelSource, PoseSample, Status
from aerodft.service import (
    Batches,
    Calibrator,
    CameraMotionSettings,
    Feed,
    Inbox,
    LandmarkObserver,
    ObserverCounts,
    ObserverSchedule,
    Pipeline,
    Sink,
)

if TYPE_CHECKING:
    from calibration.markers import CameraPlace

_log = logging.getLogger(__name__)

_RECENT_S = 1.0  # a pose that is older does not tell how far a marker is

_CONFIGURED_BY = {"watch": "[camera_motion]", "tracked": "tracked probes"}


@dataclass(frozen=True, slots=True)
class ImageObservers:
    """Observers that find pixels in a station's images.

    Attributes:
        by_name: How often each looks, by its name in summaries.
        notes: What some of them say of their own, by name.
    """

    by_name: Mapping[str, ObserverSchedule] = field(default_factory=dict)
    notes: Mapping[str, Callable[[], dict[str, object]]] = field(default_factory=dict)

    @property
    def schedules(self) -> tuple[ObserverSchedule, ...]:
        """Schedules of all observers, for a feed."""
        return tuple(self.by_name.values())

    def report(self, counts: Sequence[ObserverCounts]) -> dict[str, object]:
        """Counts and notes of each observer's looks; empty without any.

        Args:
            counts: Of each schedule.
        """
        looks: dict[str, object] = {}
        for name, count in zip(self.by_name, counts, strict=True):
            found = {"images": count.looked, "skipped": count.skipped, "unreadable": count.unreadable}
            looks[name] = found | (self.notes[name]() if name in self.notes else {})
        return looks


def build_observers(
    station: StationConfig, pipeline: Pipeline, where: object, *, may_record: bool = False
) -> ImageObservers:
    """The observers that a station's tables and probes ask for.

    Args:
        station: The station.
        pipeline: Its pipeline, which knows about where the camera is.
        where: The configuration's name in messages.
        may_record: Images may come with a recording, whatever the configuration says of their source.

    Raises:
        ConfigError: There is something to look for, and no images.
        InputError: The reference image of a watched camera is of no use.
    """
    schedules: dict[str, ObserverSchedule] = {}
    notes: dict[str, Callable[[], dict[str, object]]] = {}
    camera, ground, probes = station.pipeline.camera, station.pipeline.ground, station.pipeline.probes
    pose_of = partial(_pose_now, pipeline)
    if station.camera_motion is not None:
        schedules["watch"] = _camera_motion_schedule(station.camera_motion, camera)
    if (markers := station.markers) is not None:
        from calibration.markers import MarkerObserver  # slow to load and rare, as each observer here

        observer = MarkerObserver(markers.survey, camera, markers.ignore, partial(_place_near, pipeline))
        schedules["markers"] = ObserverSchedule(observer, markers.every_s)
        notes["markers"] = lambda: {
            "not_surveyed": _by_text(observer.strangers),
            "wrong_size": _by_text(observer.false),
        }
    if (objects := station.objects) is not None and objects.detect:
        from aerodft.vision.objects import MovingObjects, MovingOverGround

        is_fixed = station.pipeline.fixed_pose is not None
        # Before a fixed camera what changes moves; before one that flies, what changes on the held ground.
        moving = MovingObjects(camera, objects) if is_fixed else MovingOverGround(camera, objects, pose_of, ground)
        schedules["objects"] = ObserverSchedule(moving, objects.every_s)
        notes["objects"] = lambda: {"restless": moving.flickering}
    if station.river is not None:
        from aerodft.vision.river import RiverObserver

        river = RiverObserver(camera, station.river, river_probes(probes), pose_of)
        schedules["river"] = ObserverSchedule(river, station.river.every_s)
        notes["river"] = lambda: {"without_river": dict(river.misses)}
    if tracked := tuple(probe for probe in probes if probe.source is PixelSource.TRACKED):
        from aerodft.vision.plane_lock import TrackedProbes

        schedules["tracked"] = ObserverSchedule(TrackedProbes(camera, tracked, pose_of, ground))
    source = station.images.source
    if schedules and (isinstance(source, Rate) or (source is None and not may_record)):
        first = next(iter(schedules))
        got = f"none to look into for {_CONFIGURED_BY.get(first, f'[{first}]')}"
        raise ConfigError("images", where=where, got=got, expected="a stream or a device; for import a video or stills")
    return ImageObservers(schedules, notes)


def _camera_motion_schedule(settings: CameraMotionSettings, camera: Camera) -> ObserverSchedule:
    """Schedule of the observer of steady points, by which a camera's motion is found.

    Raises:
        InputError: The reference image cannot be read, is of another size, or shows too little.
    """
    from aerodft.vision.camera_motion import LEAST_CORNERS, SteadyPoints

    pixels = None
    if settings.reference is not None:
        hint = "camera_motion.reference is an image that the camera took in the mode that it is in now"
        pixels = read_camera_image(settings.reference, camera, hint)
    else:
        _log.warning(
            "no camera_motion.reference: the first good image counts as the view in which pose and pixels were found;"
            " a bump before it is not seen"
        )
    points = SteadyPoints(camera, settings.ignore, pixels)
    if points.corners is not None and points.corners < LEAST_CORNERS:
        raise InputError(
            "the reference image shows too little that can be found again",
            where=settings.reference,
            got=f"{counted(points.corners, 'corner')} outside camera_motion.ignore",
            expected=f"at least {LEAST_CORNERS}",
        )
    return ObserverSchedule(points, settings.every_s)


def _by_text(counts: Mapping[int, int]) -> dict[str, int]:
    """Counts of markers with their ids as JSON has keys."""
    return {str(marker): count for marker, count in counts.items()}


def _pose_near(pipeline: Pipeline, image: Image) -> PoseSample | None:
    """The newest pose that is finished; None where it is farther than a second from the image's stamp."""
    sample = pipeline.last_pose
    if sample is None or abs(pipeline.in_utc(image).stamp_ns - sample.stamp_ns) > _RECENT_S * SECOND_NS:
        return None
    return sample


def _pose_now(pipeline: Pipeline, image: Image) -> PoseSample | None:
    """The pose at an image's stamp; before its telemetry is there, the newest one, moved on."""
    known = pipeline.pose_at(pipeline.in_utc(image).stamp_ns)
    if known.status is Status.OK:
        return known
    sample = _pose_near(pipeline, image)
    if sample is None or sample.pose is None:
        return None
    elapsed_s = (pipeline.in_utc(image).stamp_ns - sample.stamp_ns) / SECOND_NS
    return replace(sample, pose=extrapolate_pose(sample.pose, elapsed_s))


def _place_near(pipeline: Pipeline, image: Image) -> "CameraPlace | None":
    """Camera's place by the newest pose; None where that is too old, or has no place on the map."""
    from calibration.markers import CameraPlace

    sample = _pose_near(pipeline, image)
    if sample is None or sample.pose is None or sample.origin is None:
        return None
    elapsed_s = (pipeline.in_utc(image).stamp_ns - sample.stamp_ns) / SECOND_NS
    std_m = float(np.sqrt(np.trace(sample.pose.cov[:3, :3])))
    position_m = sample.pose.position_enu_m + [0.0, 0.0, sample.plane_elevation_m]
    return CameraPlace(position_m + elapsed_s * sample.pose.velocity_enu_mps, std_m)


def build_pipeline(station: StationConfig) -> Pipeline:
    """The pipeline of a station, with its decoder and its calibration, which landmarks or steady points refine.

    Raises:
        ConfigError: The images' clock is still to be found.
    """
    if station.images.is_auto:
        hint = "`import_flight` finds it, `align` says it"
        raise ConfigError("images.time_offset_s", got='"auto"', expected="a number", hint=hint)
    decoder = decoder_of(station.pipeline.telemetry)
    tracker = None
    if station.objects is not None:
        from aerodft.vision.objects import ObjectTracks  # slow to load, as each calibrator is

        tracker = ObjectTracks(station.objects)
    return Pipeline(station.pipeline, decoder, *build_calibrator(station), tracker)


def build_calibrator(station: StationConfig) -> tuple[Calibrator[Any] | None, LandmarkObserver | None]:
    """What refines the poses of a station, by landmarks, steady points or a calibration file, and what it learns by."""
    if station.live is not None:
        from calibration.live import LiveCalibrator

        live = LiveCalibrator(station.live, station.pipeline, station.calibration)
        return live, live
    if station.camera_motion is not None:
        from calibration.camera_motion import CameraMotionCalibrator

        steady = CameraMotionCalibrator(station.camera_motion, station.pipeline)
        return steady, steady
    if station.calibration is not None:
        from calibration.flight import BiasCalibrator

        return BiasCalibrator(station.calibration), None
    return None, None


def outputs_run(station: StationConfig, pipeline: Pipeline, inbox: Inbox | None = None) -> Run:
    """A run as its outputs see it: live with an inbox, else from files."""

    def measure(question: MeasureRequest) -> list[Measurement]:
        probe = question.probe
        request = Request(probe=probe, pixels=probe.pixels, std_px=probe.std_px)
        return pipeline.measure_at((request,), question.stamp_ns)

    return Run(
        station=station.pipeline.station,
        camera=station.pipeline.camera,
        probes=station.pipeline.probes,
        points=station.pipeline.setup.points,
        is_live=inbox is not None,
        measure=measure,
        put_observation=inbox.put_observation if inbox is not None and station.observations.topic else None,
        in_utc=pipeline.in_utc,
    )


def build_recorder(
    station: StationConfig,
    folder: Path,
    *,
    started_ns: int,
    lossless: bool,
    image_hz: float | None = None,
    texts: Mapping[str, str] | None = None,
    copied: tuple[CopiedSegment, ...] = (),
) -> McapRecorder:
    """A recorder into a new folder; the configuration is written beside the segments, complete in itself.

    An elevation model travels with it, where it is one file of moderate size; its name there is in the configuration.

    ``image_hz`` takes the place of the configuration's; ``texts`` are further files, by name, that go with it;
    ``copied`` are image segments that the caller copies into the folder afterwards.
    """
    settings = RecorderSettings(
        station=station.pipeline.station,
        camera=station.pipeline.camera,
        lossless=lossless,
        max_image_hz=station.record.image_hz if image_hz is None else image_hz,
        video=station.record.video,
        jpeg_quality=station.record.jpeg_quality,
        segment_s=station.record.segment_s,
        segment_bytes=round(station.record.segment_mb * 1e6),
        copied=copied,
    )
    terrain = None if station.ground is None else station.ground.path
    has_terrain = terrain is not None and travels(terrain)
    text = resolved_toml(station, terrain_file=COPY_NAME if has_terrain else None)
    recorder = McapRecorder(folder, settings, started_ns=started_ns, texts={"config.toml": text, **(texts or {})})
    if terrain is not None and not has_terrain:
        _log.warning("%s is not copied into the recording, which needs it to be computed anew", terrain)
    elif terrain is not None:
        try:
            copy_terrain(terrain, folder)
        except InputError:
            recorder.close()
            raise
    return recorder


@contextmanager
def closing_recorder(recorder: McapRecorder, folder: Path) -> Iterator[None]:
    """Close a recorder at the end; where an error came early, say that what there is was kept."""
    try:
        yield
    except BaseException as error:
        recorder.close()
        if isinstance(error, Exception):  # of a signal the command line says it
            _log.warning("not finished; %s holds what was read so far", folder)
        raise
    recorder.close()


def run(feed: Feed, pipeline: Pipeline, sinks: Sequence[Sink], on_tick: Callable[[int], None] | None = None) -> None:
    """Drive a pipeline with a feed until it ends; every sink sees every input and output.

    Args:
        feed: What is read.
        pipeline: What measures.
        sinks: Who takes inputs and outputs.
        on_tick: Called between two batches with the time that has been reached; what it raises ends the run there.
    """
    now_ns = 0
    for batches in feed.batches():
        now_ns = int(batches.now_ns[-1])
        outputs = pipeline.advance(batches)
        for sink in sinks:
            sink.take(batches, outputs)
        del outputs  # some megabytes, which are not kept while the next are made
        if on_tick is not None:
            on_tick(now_ns)
    outputs = pipeline.finish()
    for sink in sinks:
        sink.take(Batches(now_ns=np.array([now_ns])), outputs)
