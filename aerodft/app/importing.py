"""Importing a recorded flight: its sources on one axis of arrival times, through the pipeline into a recording."""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Final

from aerodft.adapters.config.station import (
    ImageInput,
    Rate,
    StationConfig,
    Stills,
    Topics,
    VideoFile,
    load_station,
    stated_start_ns,
    with_calibration,
    with_derived_settings,
)
from aerodft.adapters.images import (
    RateSource,
    StillsFolderSource,
    ThinnedPixels,
    VideoFilesSource,
    depend_on_zone,
    video_info,
)
from aerodft.adapters.outputs import open_outputs
from aerodft.adapters.telemetry import LogSource, PhotographLog, SubtitleLog, decoder_of
from aerodft.adapters.timestamps import offset_text, parse_offset, unix_ns_to_iso, zone_hint
from aerodft.adapters.wire.requests import load_observations
from aerodft.app import Progress, assembly, no_progress
from aerodft.app.align import DEFAULT_MAX_OFFSET_S, MAX_OFFSET_LIMIT_S, aligned_station
from aerodft.app.matching import (
    RestampedPhotos,
    TriggeredPhotos,
    subtitled_flight,
    triggered_photos,
    with_carrying_video,
    with_own_videos,
    with_tilt,
)
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, NoAnswerError, UsageError, named_in
from aerodft.model import Camera, GimbalSource, HeightSource, Image
from aerodft.service import MergedFeed, ObservedImages, ObserverSchedule, Source, TelemetrySettings
from aerodft.service.clocks import ImageClock, LogSpan, MappedToUtc, survey_span
from replay.foreign import ForeignImages, ForeignRecording
from replay.recordings import LeftOut, is_mcap

_WHOLE_SECONDS_STD_S: Final = 3**-0.5
"""Root mean square of the part that truncation to whole seconds cuts off."""

MAX_RATE_HZ: Final = 1000
"""Far beyond any camera."""

_TILT_HINT: Final = (
    "state the camera's tilt from straight down with `tilt_deg`, or its mount with telemetry.attitude.fixed_mount and "
    '"fixed" in telemetry.attitude.order'
)
_STDS: Final = 3.0
_SHARE: Final = 0.01  # what two calibrations of one camera differ by, or a zoom by the least

_log = logging.getLogger(__name__)


def import_flight(  # noqa: PLR0913 - what a user may choose, by name
    log: str | Path | Sequence[str | Path] | None = None,
    *,
    station: str | Path | StationConfig,
    output: str | Path,
    video: str | Path | None = None,
    video_start_ns: int | None = None,
    images: str | Path | None = None,
    utc_offset: str | None = None,
    rate_hz: float | None = None,
    observations: Sequence[str | Path] = (),
    calibration: str | Path | None = None,
    sync: bool | None = None,
    max_offset_s: float | None = None,
    tilt_deg: float | None = None,
    topics: Topics | None = None,
    progress: Progress = no_progress,
) -> assembly.RunResult:
    """Turn a flight's log, and video or stills, into a recording with measurements.

    Args:
        log: A log of any registered format, or an MCAP file or folder with MAVLink; None for a fixed camera. Of a
            flight with subtitles its video, or the videos that the drone has cut it into.
        station: Station file, or a station.
        output: New folder for the recording.
        video: Video file, in place of the station's images.
        video_start_ns: UTC of the video's first image in ns; None for the station's, or the file's.
        images: Folder of stills, in place of the station's images.
        utc_offset: Whose time the stills tell where neither EXIF nor names say so, like ``+02:00``; None for the
            station's.
        rate_hz: Without images: evaluations per second, at most 1000.
        observations: JSON-lines files of observed pixels, beside those of the station.
        calibration: Calibration file, in place of the station's.
        sync: Whether the video's clock is found as by ``align``; None as the station says. False keeps photos' own
            stamps, where the log holds triggers.
        max_offset_s: With ``sync``: by how much the video's start may be wrong, either way; None for 20 s.
        tilt_deg: Tilt of the camera from straight down where no gimbal reports it; None for the station's.
        topics: Which topic of another tool's recording is what; None for the station's.
        progress: Called between batches with nanoseconds of the flight; what it raises ends the import there, and
            the recording holds what was read so far.

    Returns:
        What was recorded and measured. Where no image had a usable pose, ``statistics.reasons`` say why.

    Raises:
        UsageError: More than one of ``video``, ``images`` and ``rate_hz`` is given, the start of no video, the zone
            of no stills, ``max_offset_s`` without ``sync``, or an impossible value.
        InputError: A file cannot be read, the folder cannot be written, or images and log do not overlap in time.
        NoAnswerError: The log holds no height or no camera attitude that the station could use.

    Examples:
        >>> import aerodft as ad
        >>> result = ad.import_flight("samples/copter.tlog", station="configs/services/river-flight.toml", output="rec")
        >>> result.statistics.images, result.statistics.poses["ok"], result.lost
        (300, 266, 0)
    """
    where = "" if isinstance(station, StationConfig) else str(station)
    station = station if isinstance(station, StationConfig) else load_station(Path(station))
    source = _image_input(station.images.source, video, video_start_ns, images, rate_hz)
    source = source if utc_offset is None else _in_zone(source, utc_offset)
    station = replace(station, images=replace(station.images, source=source), topics=topics or station.topics)
    station = with_derived_settings(station) if calibration is None else with_calibration(station, Path(calibration))
    logs = [] if log is None else [Path(log)] if isinstance(log, str | Path) else list(map(Path, log))
    log = _checked_log(station, logs[0] if logs else None, where)
    if tilt_deg is not None:
        station = with_derived_settings(with_tilt(station, tilt_deg))
    flight = None if station.pipeline.telemetry is None else subtitled_flight(logs)
    if flight is not None:
        station, flight = with_own_videos(station, flight)
    elif log is not None:
        station = with_carrying_video(station, log)
    with named_in(Path(where)):
        if sync or (sync is None and station.images.is_auto):
            reach_s = DEFAULT_MAX_OFFSET_S if max_offset_s is None else max_offset_s
            if not 0 < reach_s <= MAX_OFFSET_LIMIT_S:
                expected = f"above 0, at most {MAX_OFFSET_LIMIT_S:g} s"
                raise UsageError("`max_offset_s`", got=f"{reach_s:g}", expected=expected)
            station = with_derived_settings(aligned_station(station, log, where, reach_s, progress))
        elif max_offset_s is not None:
            raise UsageError("`max_offset_s` without `sync`", expected="both")
        else:
            station = with_derived_settings(
                _with_start_std(replace(station, images=replace(station.images, is_auto=False)))
            )
    files = (*station.observations.files, *map(Path, observations))
    inputs = _Inputs(log if flight is None else flight, files, by_triggers=sync is not False)
    return _recorded(station, inputs, Path(output), where, progress)


@dataclass(frozen=True, slots=True)
class _Inputs:
    """Files of an import, beside those that the station names, and whether triggers stamp its photos."""

    log: Path | SubtitleLog | None
    observations: Sequence[Path]
    by_triggers: bool


def _checked_log(station: StationConfig, log: Path | None, where: str) -> Path | None:
    """Refuse telemetry that a station does not read, and none where it reads some; a recording may be of images."""
    if (log is None) != (station.pipeline.telemetry is None) and not (log is not None and is_mcap(log)):
        have, need = ("[pose]", "no LOG") if log is not None else ("[telemetry]", "a LOG")
        raise InputError(f"the configuration has {have}", where=where, expected=need)
    return log


def _recorded(
    station: StationConfig, inputs: _Inputs, output: Path, where: str, progress: Progress
) -> assembly.RunResult:
    """Run a station over its log and images into a recording; ``where`` names its file."""
    log = inputs.log
    with named_in(Path(where)):
        statistics, pipeline = assembly.RunStatistics(), assembly.build_pipeline(station)
        may_record = isinstance(log, Path) and is_mcap(log)
        observers = assembly.build_observers(station, pipeline, where, may_record=may_record)
        flight = open_flight(station, log, inputs.observations, observers.schedules, by_triggers=inputs.by_triggers)
    recorder = assembly.build_recorder(station, output, started_ns=flight.first_ns, lossless=True)
    run_outputs = open_outputs(station.outputs, assembly.outputs_run(station, pipeline))
    with assembly.closing_recorder(recorder, output), run_outputs as outputs:
        first_ns, span_ns = flight.first_ns, flight.last_ns - flight.first_ns
        progress(0, span_ns)
        feed = MergedFeed(flight.sources, station.pipeline.tick_ns)
        assembly.run(
            feed, pipeline, (*outputs, recorder, statistics), lambda now_ns: progress(now_ns - first_ns, span_ns)
        )
        recorder.unmeasured = {"damaged": max(flight.stamped - statistics.images, 0)}
    return assembly.RunResult(
        totals=recorder.totals,
        statistics=statistics,
        counts=pipeline.counts,
        observers=observers.report(flight.observed.counts),
        unmeasured=recorder.unmeasured,
        warnings=(*(() if flight.log is None else flight.log.warnings()), *flight.remarks),
        left_out=flight.log.left_out() if isinstance(flight.log, assembly.RecordedTelemetry) else LeftOut(),
    )


def _image_input(
    configured: ImageInput | None,
    video: str | Path | None,
    video_start_ns: int | None,
    images: str | Path | None,
    rate_hz: float | None,
) -> ImageInput | None:
    """The images' source that the arguments name, else the configured one."""
    choices = (("`video`", video), ("`images`", images), ("`rate_hz`", rate_hz))
    given = [name for name, value in choices if value is not None]
    if len(given) > 1:
        raise UsageError(f"{' and '.join(given)} together", expected="one of them")
    if video is None and video_start_ns is not None:
        if given or not isinstance(configured, VideoFile):
            raise UsageError("`video_start_ns` without a video", expected="`video`")
        video = configured.path
    if images is not None:
        folder = Path(images)
        return replace(configured, folder=folder) if isinstance(configured, Stills) else Stills(folder=folder)
    if rate_hz is not None:
        if not 0 < rate_hz <= MAX_RATE_HZ:
            raise UsageError("`rate_hz`", got=f"{rate_hz:g}", expected=f"above 0, at most {MAX_RATE_HZ} per second")
        return Rate(rate_hz=rate_hz)
    if video is None:
        return configured
    start_ns = stated_start_ns(configured, Path(video)) if video_start_ns is None else video_start_ns
    return VideoFile(path=Path(video), start_ns=start_ns)


def _in_zone(source: ImageInput | None, utc_offset: str) -> Stills:
    """Stills whose silent times are of a zone.

    Raises:
        UsageError: The images are no stills, or the text is no offset.
    """
    if not isinstance(source, Stills):
        raise UsageError("`utc_offset` without stills", expected="`images`, a folder of stills")
    try:
        parse_offset(utc_offset)
    except ValueError:
        raise UsageError("`utc_offset`", got=utc_offset, expected="an offset from UTC like +02:00") from None
    return replace(source, utc_offset=utc_offset)


def _with_start_std(station: StationConfig) -> StationConfig:
    """Widen the std in time to that of whole seconds where the video's start was read in whole seconds.

    A larger std that the station states covers the rounding already.
    """
    source = station.images.source
    if not isinstance(source, VideoFile) or source.start_ns is not None:
        return station
    start_ns = video_info(source.path).start_ns
    if start_ns is None or start_ns % SECOND_NS:
        return station
    time_std_s = max(station.pipeline.time_std_s, _WHOLE_SECONDS_STD_S)
    _log.warning("%s: start in whole seconds: every interval covers %.2f s of std in time", source.path, time_std_s)
    return replace(station, pipeline=replace(station.pipeline, time_std_s=time_std_s))


@dataclass(frozen=True, slots=True)
class Flight:
    """Everything that an import runs over.

    Attributes:
        sources: Telemetry, images and observations.
        first_ns: First arrival, roughly; for the progress bar.
        last_ns: Last arrival, roughly.
        observed: The images among them, and what is seen in them.
        stamped: How many images there are with a stamp, damaged ones too; 0 where stamps come at a rate.
        log: The log among them; None for a fixed camera.
        remarks: What became of photos that are stamped by the log's triggers.
    """

    sources: tuple[Source, ...]
    first_ns: int
    last_ns: int
    observed: ObservedImages
    stamped: int
    log: LogSource | None = None
    remarks: tuple[str, ...] = ()


def open_flight(
    station: StationConfig,
    log: Path | SubtitleLog | None,
    observation_files: Sequence[Path] = (),
    schedules: Sequence[ObserverSchedule] = (),
    *,
    by_triggers: bool = True,
) -> Flight:
    """Open and check all sources of a station's recorded flight.

    Args:
        station: The station.
        log: Its log or recording, or the flight's opened subtitles; for a fixed camera None, or another tool's
            recording of its images.
        observation_files: What others have seen in the images.
        schedules: What looks at the images on the way.
        by_triggers: Whether photos are stamped by the log's triggers, where it has some and the station states nothing
            of the camera's clock.

    Raises:
        InputError: A source cannot be read, or images and log do not overlap in time.
        NoAnswerError: The log holds no height or no camera attitude that the configuration could use.
    """
    span, source, recording = LogSpan(), None, None
    sources: list[Source] = []
    telemetry, opened = station.pipeline.telemetry, log if isinstance(log, SubtitleLog) else None
    log = log.path if isinstance(log, SubtitleLog) else log
    if log is not None and telemetry is None:
        recording = ForeignRecording(log, station.topics)
    elif log is not None and telemetry is not None:
        source, recording = (opened, None) if opened else assembly.open_telemetry_log(log, station.topics, telemetry)
        source = _stamped_as(source, station.images.source)
        sources.append(source)
        with _quiet():
            span = survey_span(source, decoder_of(telemetry))
        _check_sources(log, span, telemetry)
    photos = TriggeredPhotos()
    if by_triggers and isinstance(station.images.source, Stills) and station.image_clock == ImageClock():
        photos = _triggered(station.images.source, span)
    images, stamps = _images(
        station, span, recording, source, photos.stamps_ns, decode=station.record.image_hz > 0 or bool(schedules)
    )
    if schedules and isinstance(images, RateSource) and recording is not None:
        raise recording.refusal_without("images")
    _check_overlap(span, stamps, log, station)
    files = [load_observations(path, stamps) for path in observation_files]
    offset_ns = round(station.observations.time_offset_s * SECOND_NS)
    by_host = isinstance(images, RateSource) or _has_own_images(station, recording)
    lateness_ns = span.jitter_ns if by_host else span.lateness_at
    late: Source = assembly.DelayedSource(images, lateness_ns=lateness_ns)
    observed = ObservedImages(late if schedules else ThinnedPixels(late, station.record.image_hz), schedules)
    sources.append(observed)
    sources += [assembly.DelayedSource(file, lateness_ns=span.lateness_at, offset_ns=offset_ns) for file in files]
    ends = [n for n in (span.first_arrival_ns, span.last_arrival_ns) if n is not None]
    if stamps:
        ends += [stamp_ns + span.lateness_at(stamp_ns) for stamp_ns in (min(stamps.values()), max(stamps.values()))]
    return Flight(tuple(sources), min(ends), max(ends), observed, len(stamps), source, photos.remarks)


def _are_own_photos(log: PhotographLog, configured: ImageInput | None) -> bool:
    """Whether a station's images are the photographs that carry the poses: unless it names others, or a rate."""
    return configured is None or (isinstance(configured, Stills) and configured.folder.resolve() == log.path.resolve())


def _stamped_as(log: LogSource, configured: ImageInput | None) -> LogSource:
    """Photographs that carry their poses, stamped as the station says of them as images."""
    if not isinstance(log, PhotographLog) or not isinstance(configured, Stills) or not _are_own_photos(log, configured):
        return log
    return log.stamped_by(configured.pattern, configured.utc_offset)


def _has_own_images(station: StationConfig, recording: ForeignRecording | None) -> bool:
    """Whether another tool's recording gives the images too: unless the station names others, or a rate."""
    is_elsewhere = isinstance(station.images.source, VideoFile | Stills | Rate)
    return recording is not None and recording.images is not None and not is_elsewhere


def _images(
    station: StationConfig,
    span: LogSpan,
    recording: ForeignRecording | None,
    log: LogSource | None,
    triggered_ns: Mapping[int, int] | None,
    *,
    decode: bool,
) -> tuple[Source, dict[int, int]]:
    """The image source and all its stamps by index; without images, stamps at a rate over the log."""
    configured, clock, camera = station.images.source, station.image_clock, station.pipeline.camera
    open_images: Callable[..., Source]
    if isinstance(configured, VideoFile):
        files = ((configured.path, configured.start_ns), *configured.later)
        where, open_images = configured.path, partial(VideoFilesSource, files)
    elif isinstance(log, PhotographLog) and _are_own_photos(log, configured):
        where, open_images = log.path, log.images
    elif isinstance(configured, Stills):
        where = configured.folder
        open_images = partial(StillsFolderSource, where, pattern=configured.pattern, utc_offset=configured.utc_offset)
    elif recording is not None and _has_own_images(station, recording):
        _check_camera(recording, camera)
        where, open_images = recording.path, partial(ForeignImages, recording)
    elif not span.arrivals_ns:
        raise InputError("a fixed camera's import needs images", expected="`video` or `images`")
    else:
        rate_hz = configured.rate_hz if isinstance(configured, Rate) else assembly.DEFAULT_RATE_HZ
        return RateSource(span.arrivals_ns, rate_hz), {}

    def opened(*, decode: bool) -> Source:
        source = open_images(decode=decode)
        return MappedToUtc(source, clock) if triggered_ns is None else RestampedPhotos(source, triggered_ns)

    images = assembly.size_checked(opened(decode=decode), camera, where)
    with _quiet():
        return images, _stamps(opened(decode=False), camera, where)


def _triggered(stills: Stills, span: LogSpan) -> TriggeredPhotos:
    """Stamps of a folder's photos by the triggers of the log."""
    if not span.triggers:
        return TriggeredPhotos()
    with _quiet():
        source = StillsFolderSource(stills.folder, pattern=stills.pattern, utc_offset=stills.utc_offset, decode=False)
    photos = triggered_photos(source.stamped, span.triggers)
    for remark in photos.remarks:
        _log.warning("%s: %s", stills.folder, remark)
    return photos


def _stamps(source: Source, camera: Camera, where: Path) -> dict[int, int]:
    """The stamps of all images by index; refuses a wrong size here, before anything is written."""
    images = (event for event in assembly.size_checked(source, camera, where).events() if isinstance(event, Image))
    stamps = {image.index: image.stamp_ns for image in images}
    if not stamps:
        raise InputError("holds no image", where=where, expected="at least one", hint="it is cut or damaged")
    return stamps


def _check_sources(log: Path, span: LogSpan, telemetry: TelemetrySettings) -> None:
    heights = {*span.heights, *([HeightSource.MANUAL] if telemetry.height.manual_m is not None else [])}
    for what, order, there in (
        ("height", telemetry.height.order, heights),
        ("camera attitude", telemetry.attitude.order, span.attitudes),
    ):
        usable = set(order) & set(there)
        if what == "camera attitude" and telemetry.attitude.fixed_mount is None:
            usable -= {GimbalSource.FIXED_MOUNT}
        if not usable:
            others = ", ".join(sorted(map(str, set(there) - {GimbalSource.FIXED_MOUNT}))) or "none"
            raise NoAnswerError(
                f"no {what} in the log",
                where=log,
                got=others,
                expected=f"one of {', '.join(order)}",
                hint=_TILT_HINT
                if what == "camera attitude" and GimbalSource.FIXED_MOUNT in there
                else "see `diagnose`, and telemetry.height.order / telemetry.attitude.order in the config",
            )


def _check_overlap(span: LogSpan, stamps: dict[int, int], log: Path | None, station: StationConfig) -> None:
    if not stamps or span.first_ns is None or span.last_ns is None:
        return
    first_ns, last_ns = min(stamps.values()), max(stamps.values())
    if last_ns >= span.first_ns and first_ns <= span.last_ns:
        return
    source = station.images.source
    where = source.path if isinstance(source, VideoFile) else getattr(source, "folder", "images")
    raise InputError(
        f"images and log {log} do not overlap in time",
        where=where,
        got=f"images {unix_ns_to_iso(first_ns)} to {unix_ns_to_iso(last_ns)}",
        expected=f"within {unix_ns_to_iso(span.first_ns)} to {unix_ns_to_iso(span.last_ns)}",
        hint=zone_hint((first_ns, last_ns), (span.first_ns, span.last_ns), _zone_remedy(source))
        or _other_clock_hint(source),
    )


def _zone_remedy(source: ImageInput | None) -> Callable[[timedelta], str] | None:
    """What corrects a clock of local time, by how much it is ahead; None for a video, whose start does."""
    if isinstance(source, VideoFile):
        return None
    if isinstance(source, Stills):
        with _quiet():
            is_silent = depend_on_zone(source.folder, source.pattern)
        if is_silent:
            stated = timedelta() if source.utc_offset is None else parse_offset(source.utc_offset)
            return lambda ahead: f"`utc_offset` {offset_text(stated + ahead)}"
    return lambda ahead: f"images.time_offset_s = {-ahead.total_seconds():g}"


def _other_clock_hint(source: ImageInput | None) -> str:
    """What to do about a clock that is off by no whole hours."""
    if isinstance(source, VideoFile):
        return "check `video_start_ns` and images.time_offset_s, or have `sync` find it"
    return "is this the flight's log? state in images.time_offset_s by how much the camera's clock is off"


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence warnings while input is looked through: they come again when it is read."""
    loggers = [logging.getLogger(name) for name in ("aerodft.adapters", "replay")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def _check_camera(recording: ForeignRecording, camera: Camera) -> None:
    """Warn where the recording's own camera is another one than ``camera``, which is measured with."""
    try:
        recorded = recording.camera()
    except InputError as error:
        _log.warning("%s; not compared with %r", error, camera.name)
        return
    if recorded is None:
        return
    scale = camera.width_px / recorded.width_px
    apart_px = abs(recorded.fx_px * scale - camera.fx_px)
    if apart_px > max(_STDS * camera.std.focal_px, _SHARE * camera.fx_px):
        recorded_px = recorded.fx_px * scale
        _log.warning(
            "%s: its camera (%s) has a focal length of %.1f px, %r of %.1f px, which is measured with",
            *(recording.path, recorded.name, recorded_px, camera.name, camera.fx_px),
        )
