"""Poses by telemetry of a file's images, as it states them or as a log or recording has them, in the file's frame."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerodft.adapters.config import LOCAL
from aerodft.adapters.config.evidence import EvidenceFile, Flight, ImageEvidence, LocalFrame, StatedPose
from aerodft.adapters.config.station import Device, Stills, StreamInput, VideoFile
from aerodft.adapters.telemetry import decoder_of, open_log
from aerodft.adapters.timestamps import unix_ns_to_iso, zone_hint
from aerodft.app.assembly import recorded_station
from aerodft.conventions import SECOND_NS
from aerodft.errors import ConfigError, InputError, Reason, UsageError
from aerodft.geometry import Ground, camera_attitude, from_rotation_vector, matrix, multiply
from aerodft.model import (
    FloatArray,
    GeoOrigin,
    HeightSource,
    Image,
    Landmark,
    LevelSeries,
    Pose,
    PoseSample,
    PoseStd,
    Prior,
    RawBlock,
    StampClock,
    Status,
)
from aerodft.service import LAST, MergedFeed, Source, TelemetrySettings
from aerodft.service.clocks import LogSpan, Ticks, survey_span
from aerodft.service.pose import PoseSource
from calibration.flight import ImageView, PoseTrack, split_stds
from replay.foreign import ForeignTelemetry, open_recording
from replay.recordings import Recording, RecordingSource, is_mcap

_REACH_S, _MIN_STEP_S, _STEPS, _STDS = 2.0, 0.05, 40, 4.0
_TICK_NS = SECOND_NS // 20


@dataclass(frozen=True, slots=True, eq=False)
class _Reported:
    """The poses of an image by telemetry."""

    track: PoseTrack
    std: PoseStd
    height_source: HeightSource | None = None


def views_of(
    evidence: EvidenceFile, flight: Flight, telemetry: Path | None, *, needs_time: bool
) -> tuple[tuple[ImageView, ...], dict[str, Prior]]:
    """The images, and what is known beforehand of biases, lens and ground.

    Args:
        evidence: A file of evidence.
        flight: Its images.
        telemetry: Log or recording to take the place of the file's.
        needs_time: The time offset is unknown: poses are needed around the stamps.

    Raises:
        AerodftError: An image has no pose, or the telemetry cannot be used.
    """
    reach_s = 0.0
    if flight.time is not None:
        reach_s = abs(flight.time.value) + (_STDS * flight.time.std or _REACH_S)
    elif needs_time:
        reach_s = _REACH_S
    reported = _stated(evidence, flight, reach_s) | _looked_up(evidence, flight, telemetry, reach_s)
    _check_heights(reported, evidence.path)
    stds = [reported[image.name].std for image in flight.images]
    priors, noises = split_stds(stds, flight.noise_share, flight.noise)
    if flight.time is not None:
        priors["time"] = flight.time
    views = tuple(
        ImageView(image.name, image.evidence, reported[image.name].track, noise)
        for image, noise in zip(flight.images, noises, strict=True)
    )
    return views, priors | evidence.known.priors


def _needs_place(image: ImageEvidence) -> bool:
    return any(isinstance(each, Landmark) for each in image.evidence)


def _stated(evidence: EvidenceFile, flight: Flight, reach_s: float) -> dict[str, _Reported]:
    reported = {}
    for image in flight.images:
        if image.pose is None:
            continue
        for name, key in (("heading", "heading_deg"), ("east", "position_m, or lat_deg and lon_deg")):
            if name not in image.pose.known and _needs_place(image):
                expected = f"{key} by telemetry: landmarks are seen in it"
                raise ConfigError(f'image "{image.name}"', where=evidence.path, got=f"no {key}", expected=expected)
        reported[image.name] = _as_stated(image.pose, flight.settings, reach_s)
    return reported


def _as_stated(pose: StatedPose, settings: TelemetrySettings, reach_s: float) -> _Reported:
    usual = settings.attitude.std

    def value(name: str) -> float:
        return pose.known.get(name, (0.0, None))[0]

    def std(name: str, otherwise: float) -> float:
        stated = pose.known.get(name, (0.0, None))[1]
        return otherwise if stated is None else stated

    moving = Pose(
        position_enu_m=np.array([value("east"), value("north"), value("height")]),
        wxyz=camera_attitude(value("tilt"), value("roll"), value("heading")),
        velocity_enu_mps=np.array(pose.velocity_mps),
        rate_cam_radps=np.array(pose.rate_cam_radps),
    )
    return _Reported(
        PoseTrack.at_constant_rates(moving, reach_s),
        PoseStd(
            height_agl_m=std("height", settings.height.std_m[HeightSource.HOME]),
            horizontal_m=math.hypot(std("east", usual.horizontal_m), std("north", usual.horizontal_m)) / math.sqrt(2),
            tilt_rad=std("tilt", usual.tilt_rad),
            pan_rad=usual.pan_rad,
            roll_rad=std("roll", usual.roll_rad),
            heading_rad=std("heading", usual.heading_rad),
        ),
    )


def _looked_up(evidence: EvidenceFile, flight: Flight, telemetry: Path | None, reach_s: float) -> dict[str, _Reported]:
    images = [image for image in flight.images if image.pose is None]
    path = telemetry or flight.log
    if not images:
        if telemetry is not None:
            raise UsageError("`telemetry`", got="images with poses in the file", expected="utc or index in [[image]]")
        return {}
    if path is None:
        expected = 'telemetry = "flight.tlog" at its top, or `telemetry`'
        raise ConfigError(f'image "{images[0].name}"', where=evidence.path, got="no pose", expected=expected)
    origin = flight.origin or evidence.frame.geo_origin
    opened = _open_telemetry(path, flight.settings, origin, are_settings_stated=flight.says_settings)
    if opened.origin is None and any(map(_needs_place, images)):
        expected = f'{{ lat_deg, lon_deg }} of the zero of crs = "{LOCAL}"'
        raise ConfigError("telemetry.origin", where=evidence.path, got="nothing", expected=expected)
    step_s = max(_MIN_STEP_S, reach_s / _STEPS)
    count = round(reach_s / step_s)
    offsets_s: FloatArray = np.asarray(np.arange(-count, count + 1) * step_s)
    poses = _poses_of(opened, images, offsets_s.tolist())
    return {
        image.name: _as_reported(image, samples, offsets_s, evidence.frame, path)
        for image, samples in zip(images, poses, strict=True)
    }


def _as_reported(
    image: ImageEvidence, samples: tuple[PoseSample, ...], offsets_s: FloatArray, frame: LocalFrame, path: Path
) -> _Reported:
    middle = samples[len(samples) // 2]
    if middle.pose is None or middle.reasons:
        got = "; ".join((str(middle.status), *middle.reasons))
        hint = "see `diagnose`, and height and attitude in [telemetry]"
        raise InputError(f'image "{image.name}" has no pose', where=path, got=Reason(got), hint=hint)
    if middle.lat_rad is None and _needs_place(image):
        expected = "a position: landmarks are seen in it"
        raise InputError(f'image "{image.name}"', where=path, got="no position in the telemetry", expected=expected)
    chosen = _unbroken(samples)
    poses = [pose for pose in (samples[index].pose for index in chosen) if pose is not None]
    turn = from_rotation_vector(np.array([0.0, 0.0, frame.true_heading_rad(0.0) or 0.0]))
    positions = np.array([pose.position_enu_m for pose in poses]) @ matrix(turn).T
    track = PoseTrack(offsets_s[chosen], positions, multiply(turn, np.array([pose.wxyz for pose in poses])))
    return _Reported(track, middle.std, middle.height_source)


def _check_heights(reported: dict[str, _Reported], path: Path) -> None:
    """Refuse heights of two sources, which have two biases."""
    first: dict[HeightSource, str] = {}
    for name, each in reported.items():
        if each.height_source is not None:
            first.setdefault(each.height_source, name)
    if len(first) > 1:
        (one, where), (other, there) = list(first.items())[:2]
        got = f"heights by {one} ({where}) and by {other} ({there})"
        hint = 'name one in [telemetry], like height = { order = ["home"] }'
        raise ConfigError("telemetry.height", where=path, got=got, expected="one source, which has one bias", hint=hint)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Telemetry:
    """A log or recording, and how it becomes poses.

    Attributes:
        path: Of the log or recording.
        source: Its events.
        settings: How they become poses.
        origin: East and north count from it; None for the first fix.
        ground: What heights count from; None for the level plane at 0.
        level: The water's level, for heights that were measured to it; None where it is always 0.
        has_images: It is a recording, which has images.
        offset_ns: Of these, what an older calibration had added to their stamps.
    """

    path: Path
    source: Source
    settings: TelemetrySettings
    origin: GeoOrigin | None
    ground: Ground | None = None
    level: LevelSeries | None = None
    has_images: bool = False
    offset_ns: int = 0

    def pose_source(self) -> PoseSource:
        """Poses of events that are appended to it."""
        return PoseSource(self.settings, origin=self.origin, time_std_s=0.0, ground=self.ground, level=self.level)


def _open_telemetry(
    path: Path, settings: TelemetrySettings, origin: GeoOrigin | None, *, are_settings_stated: bool
) -> _Telemetry:
    """Open a log or a recording.

    Args:
        path: A .tlog, a .bin, a recording, or another tool's MCAP file.
        settings: How telemetry becomes a pose.
        origin: Of the coordinates; None for a recording's own.
        are_settings_stated: Somebody stated the settings; else a recording's own are taken.

    Raises:
        InputError: It is missing, unreadable, or of a fixed camera.
    """
    if not is_mcap(path) and not path.is_dir():
        return _Telemetry(path=path, source=open_log(path), settings=settings, origin=origin)
    recording = open_recording(path)
    if not isinstance(recording, Recording):
        return _Telemetry(path=path, source=ForeignTelemetry(recording), settings=settings, origin=origin)
    station = recorded_station(recording)
    own = station.pipeline.telemetry
    if own is None:
        raise InputError("a fixed camera's recording", where=path, got="[pose]", expected="one with telemetry")
    has_stamps = isinstance(
        station.images.source, VideoFile | Stills | StreamInput | Device
    )  # others' are the pipeline's
    before = station.calibration.bias.time_s if station.calibration is not None and has_stamps else 0.0
    return _Telemetry(
        path=path,
        source=RecordingSource(recording),
        settings=settings if are_settings_stated else own,
        origin=origin or station.pipeline.origin,
        ground=station.pipeline.ground,
        level=station.pipeline.level,
        has_images=True,
        offset_ns=round(before * SECOND_NS),
    )


def _poses_of(
    telemetry: _Telemetry, images: Sequence[ImageEvidence], offsets_s: Sequence[float]
) -> tuple[tuple[PoseSample, ...], ...]:
    """For each image its poses at some times around its stamp.

    Args:
        telemetry: Where from.
        images: Each with a stamp or an index.
        offsets_s: Seconds from the stamp, ascending, with 0.

    Raises:
        InputError: A stamp outside the telemetry, or an index that no image has.
    """
    span = survey_span(telemetry.source, decoder_of(telemetry.settings))
    stamps = _stamps(telemetry, images)
    for image, stamp_ns in zip(images, stamps, strict=True):
        _check_inside(image, stamp_ns, span, telemetry.path)
    offsets_ns = [round(offset_s * SECOND_NS) for offset_s in offsets_s]
    found: dict[int, tuple[PoseSample, ...]] = {}
    waiting = sorted(set(stamps), reverse=True)
    poses, decoder = telemetry.pose_source(), decoder_of(telemetry.settings)
    late_ns = offsets_ns[-1] + span.lateness_ns + 2 * telemetry.settings.height.max_gap_ns
    for batches in MergedFeed([telemetry.source], _TICK_NS, idle_ticks_ns=0, longest_ns=0).batches():
        for block in batches.raw:
            poses.append(Ticks.one(decoder.decode(block)))
        while waiting and waiting[-1] + late_ns < int(batches.now_ns[-1]):
            stamp_ns = waiting.pop()
            found[stamp_ns] = _around(poses, stamp_ns, offsets_ns)
    found |= {stamp_ns: _around(poses, stamp_ns, offsets_ns) for stamp_ns in waiting}
    return tuple(found[stamp_ns] for stamp_ns in stamps)


def _around(poses: PoseSource, stamp_ns: int, offsets_ns: Sequence[int]) -> tuple[PoseSample, ...]:
    stamps_ns = stamp_ns + np.array(offsets_ns)
    no = np.full(len(stamps_ns), fill_value=False)
    found, _ = poses.at(stamps_ns, np.broadcast_to(LAST, stamps_ns.shape), is_final=~no, by_utc=no)
    return tuple(found)


def _stamps(telemetry: _Telemetry, images: Sequence[ImageEvidence]) -> list[int]:
    """UTC of each image, without what an older calibration had added."""
    by_index: dict[int, int] = {}
    if any(image.index is not None for image in images):
        if not telemetry.has_images:
            first = next(image for image in images if image.index is not None)
            expected = "utc: a log has no images, a recording does"
            raise InputError(f'image "{first.name}": index', where=telemetry.path, got="a log", expected=expected)
        by_index = _recorded_stamps(telemetry)
    for image in images:
        if image.index is not None and image.index not in by_index:
            expected = f"0 to {max(by_index)}" if by_index else "a recording with images"
            raise InputError(f'image "{image.name}": index', where=telemetry.path, got=image.index, expected=expected)
    return [by_index[image.index] if image.index is not None else image.stamp_ns or 0 for image in images]


def _recorded_stamps(telemetry: _Telemetry) -> dict[int, int]:
    poses, decoder = telemetry.pose_source(), decoder_of(telemetry.settings)
    stamps: dict[int, int] = {}
    by_host: set[int] = set()
    for event in telemetry.source.events():
        if isinstance(event, Image):
            stamp_ns = event.stamp_ns
            if event.clock is StampClock.HOST:
                by_host.add(event.index)
                stamp_ns = int(poses.clock.host_to_utc(np.array([stamp_ns]))[0])
            stamps[event.index] = stamp_ns - telemetry.offset_ns
        elif isinstance(event, RawBlock) and (shift_ns := poses.append(Ticks.one(decoder.decode(event)))):
            stamps |= {index: stamps[index] + shift_ns for index in by_host}
    return stamps


def _check_inside(image: ImageEvidence, stamp_ns: int, span: LogSpan, path: Path) -> None:
    if span.first_ns is None or span.last_ns is None:
        raise InputError("no telemetry in it", where=path, expected="a flight's log")
    if not span.first_ns <= stamp_ns <= span.last_ns:
        raise InputError(
            f'image "{image.name}" is outside the telemetry',
            where=path,
            got=unix_ns_to_iso(stamp_ns),
            expected=f"{unix_ns_to_iso(span.first_ns)} to {unix_ns_to_iso(span.last_ns)}",
            hint=zone_hint((stamp_ns, stamp_ns), (span.first_ns, span.last_ns)) or "check utc, and whose clock it is",
        )


def _unbroken(samples: Sequence[PoseSample]) -> np.ndarray:
    """Indices of the poses around the middle one that come in one run without a gap."""
    middle = len(samples) // 2
    gaps = [index for index, sample in enumerate(samples) if sample.status is not Status.OK or sample.pose is None]
    first = max((gap + 1 for gap in gaps if gap < middle), default=0)
    return np.arange(first, min((gap for gap in gaps if gap > middle), default=len(samples)))
