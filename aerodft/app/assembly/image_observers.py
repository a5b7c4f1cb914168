"""What finds pixels in a station's images: what each of its tables and probes asks for."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from aerodft.adapters.config.station import Rate, StationConfig, Watch, river_probes
from aerodft.adapters.images import read_camera_image
from aerodft.conventions import SECOND_NS
from aerodft.errors import ConfigError, InputError
from aerodft.geometry import moved_on
from aerodft.model import Image, PixelSource, PoseSample, Status
from aerodft.service import ObjectSettings, ObserverCounts, ObserverSchedule, Pipeline
from aerodft.vision.camera_motion import LEAST_CORNERS, SteadyPoints
from aerodft.vision.objects import MovingObjects, MovingOverGround
from aerodft.vision.plane_lock import TrackedProbes
from aerodft.vision.river import RiverObserver
from calibration.markers import CameraPlace, MarkerObserver

_RECENT_S = 1.0  # a pose that is older does not tell how far a marker is


@dataclass(frozen=True, slots=True)
class ImageObservers:
    """All that looks at a station's images.

    Attributes:
        schedules: What a feed shows images to.
        names: Of the tables that ask for each.
        notes: What some of them have to say of their own, by that name.
    """

    schedules: tuple[ObserverSchedule, ...] = ()
    names: tuple[str, ...] = ()
    notes: Mapping[str, Callable[[], dict[str, object]]] = field(default_factory=dict)

    def report(self, counts: Sequence[ObserverCounts]) -> dict[str, object]:
        """What was looked at, for the summary; empty where nobody looked.

        Args:
            counts: Of each schedule.
        """
        looks: dict[str, object] = {}
        for name, count in zip(self.names, counts, strict=True):
            found = {"images": count.looked, "skipped": count.skipped, "unreadable": count.unreadable}
            looks[name] = found | (self.notes[name]() if name in self.notes else {})
        return looks


def build_observers(
    station: StationConfig, pipeline: Pipeline, where: object, *, may_record: bool = False
) -> ImageObservers:
    """Who looks at the images of a station.

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
    if station.watch is not None:
        _check_images(station, "[watch]", where, may_record=may_record)
        schedules["watch"] = _camera_motion_schedule(station.watch, station)
    if (markers := station.markers) is not None:
        _check_images(station, "[markers]", where, may_record=may_record)
        observer = MarkerObserver(
            markers.survey, station.pipeline.camera, markers.ignore, lambda image: _place_near(pipeline, image)
        )
        schedules["markers"] = ObserverSchedule(observer, markers.every_s)
        notes["markers"] = partial(_marker_notes, observer)
    if (objects := station.objects) is not None and objects.detect:
        _check_images(station, "[objects]", where, may_record=may_record)
        moving = _who_sees_objects(station, objects, pipeline)
        schedules["objects"] = ObserverSchedule(moving, objects.every_s)
        notes["objects"] = lambda: {"restless": moving.flickering}
    if station.river is not None:
        _check_images(station, "[river]", where, may_record=may_record)
        probes = river_probes(station.pipeline.probes)
        river = RiverObserver(station.pipeline.camera, station.river, probes, lambda image: _pose_now(pipeline, image))
        schedules["river"] = ObserverSchedule(river, station.river.every_s)
        notes["river"] = lambda: {"without_river": dict(river.misses)}
    tracked = tuple(probe for probe in station.pipeline.probes if probe.source is PixelSource.TRACKED)
    if tracked:
        _check_images(station, "tracked probes", where, may_record=may_record)
        camera, ground = station.pipeline.camera, station.pipeline.ground
        schedules["tracked"] = ObserverSchedule(
            TrackedProbes(camera, tracked, lambda image: _pose_now(pipeline, image), ground)
        )
    return ImageObservers(tuple(schedules.values()), tuple(schedules), notes)


def _camera_motion_schedule(watch: Watch, station: StationConfig) -> ObserverSchedule:
    """Who looks for steady points.

    Raises:
        InputError: The reference image cannot be read, is of another size, or shows too little.
    """
    camera, settings, pixels = station.pipeline.camera, watch.settings, None
    if watch.reference is not None:
        hint = "watch.reference is an image that the camera took in the mode that it is in now"
        pixels = read_camera_image(watch.reference, camera, hint)
    points = SteadyPoints(camera, settings.ignore, pixels)
    if points.corners is not None and points.corners < LEAST_CORNERS:
        raise InputError(
            "the reference image shows too little that can be found again",
            where=watch.reference,
            got=f"{points.corners} corners outside watch.ignore",
            expected=f"at least {LEAST_CORNERS}",
        )
    return ObserverSchedule(points, settings.every_s)


def _who_sees_objects(
    station: StationConfig, objects: ObjectSettings, pipeline: Pipeline
) -> MovingObjects | MovingOverGround:
    """Before a fixed camera what changes moves; before one that flies, what changes on the held ground."""
    camera, ground = station.pipeline.camera, station.pipeline.ground
    if station.pipeline.fixed_pose is not None:
        return MovingObjects(camera, objects)
    return MovingOverGround(camera, objects, lambda image: _pose_now(pipeline, image), ground)


def _marker_notes(observer: MarkerObserver) -> dict[str, object]:
    return {"not_surveyed": _by_text(observer.strangers), "wrong_size": _by_text(observer.false)}


def _by_text(counts: Mapping[int, int]) -> dict[str, int]:
    """The same with ids as JSON's keys are."""
    return {str(marker): count for marker, count in counts.items()}


def _check_images(station: StationConfig, table: str, where: object, *, may_record: bool) -> None:
    if may_record and not isinstance(station.images.source, Rate):
        return
    if station.images.source is None or isinstance(station.images.source, Rate):
        expected = "a stream or a device; for import a video or stills"
        raise ConfigError("images", where=where, got=f"none to look into for {table}", expected=expected)


def _pose_near(pipeline: Pipeline, image: Image) -> PoseSample | None:
    """The newest pose that is finished; None where that is not of about the same time."""
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
    return replace(sample, pose=moved_on(sample.pose, elapsed_s))


def _place_near(pipeline: Pipeline, image: Image) -> CameraPlace | None:
    """Where the camera is by that pose; None where there is none, or nobody knows where."""
    sample = _pose_near(pipeline, image)
    if sample is None or sample.pose is None or sample.origin is None:
        return None
    elapsed_s = (pipeline.in_utc(image).stamp_ns - sample.stamp_ns) / SECOND_NS
    std_m = float(np.sqrt(np.trace(sample.pose.cov[:3, :3])))
    return CameraPlace(sample.pose.position_enu_m + elapsed_s * sample.pose.velocity_enu_mps, std_m)
