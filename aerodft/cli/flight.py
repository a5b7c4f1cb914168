"""A recorded flight: its sources on one axis of arrival times, and the way through the pipeline to a new recording."""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from aerodft.adapters.config.station import Rate, StationConfig, Stills, VideoFile
from aerodft.adapters.images import RateSource, StillsFolderSource, ThinnedPixels
from aerodft.adapters.outputs import open_outputs
from aerodft.adapters.telemetry import LogSource, decoder_of
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.adapters.wire.observations import load_observations
from aerodft.app.assembly import (
    DelayedSource,
    RunStatistics,
    SizeChecked,
    build_observers,
    build_pipeline,
    build_recorder,
    closing_recorder,
    open_telemetry_log,
    outputs_run,
    run,
)
from aerodft.cli.ending import Interruptible
from aerodft.cli.output import progress_bar, say
from aerodft.cli.summary import report
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, NoAnswerError
from aerodft.model import Camera, GimbalSource, HeightSource, Image
from aerodft.service import MergedFeed, ObservedImages, ObserverSchedule, Source, TelemetrySettings
from aerodft.service.clocks import LogSpan, OnClock, survey_span
from replay.foreign import ForeignImages, ForeignRecording
from replay.recordings import is_mcap

DEFAULT_RATE_HZ = 5.0

_STDS = 3.0
_SHARE = 0.01  # what two calibrations of one camera differ by, or a zoom by the least


@dataclass(frozen=True, slots=True)
class Flight:
    """Everything that an import runs over.

    Attributes:
        sources: Telemetry, images and observations.
        first_ns: First arrival, roughly; for the progress bar.
        last_ns: Last arrival, roughly.
        looked: The images among them, and what is seen in them.
        log: The log among them; None for a fixed camera.
    """

    sources: tuple[Source, ...]
    first_ns: int
    last_ns: int
    looked: ObservedImages
    log: LogSource | None = None

    def warnings(self) -> tuple[str, ...]:
        """What is wrong with the log, one sentence each; complete once it was read."""
        return () if self.log is None else self.log.warnings()


def open_flight(
    station: StationConfig,
    log: Path | None,
    observation_files: tuple[Path, ...],
    lookouts: Sequence[ObserverSchedule] = (),
) -> Flight:
    """Open and check all sources of a station's recorded flight.

    Args:
        station: The station.
        log: Its log or recording; for a fixed camera None, or another tool's recording of its images.
        observation_files: What others have seen in the images.
        lookouts: Who looks at the images on the way.

    Raises:
        InputError: A source cannot be read, or images and log do not overlap in time.
        NoAnswerError: The log holds no height or no camera attitude that the configuration could use.
    """
    span, source, recording = LogSpan(), None, None
    sources: list[Source] = []
    telemetry = station.pipeline.telemetry
    if log is not None and telemetry is None:
        recording = ForeignRecording(log, station.topics)
    elif log is not None and telemetry is not None:
        source, recording = open_telemetry_log(log, station.topics)
        sources.append(source)
        with _quiet():
            span = survey_span(source, decoder_of(telemetry))
        _check_sources(log, span, telemetry)
    images, stamps = _images(station, span, recording, decode=station.record.image_hz > 0 or bool(lookouts))
    if lookouts and isinstance(images, RateSource) and recording is not None:
        raise recording.refusal_without("images")
    _check_overlap(span, stamps, log, station)
    files = [load_observations(path, stamps) for path in observation_files]
    offset_ns = round(station.observations.time_offset_s * SECOND_NS)
    by_host = isinstance(images, RateSource) or _has_own_images(station, recording)
    lateness_ns = span.jitter_ns if by_host else span.lateness_at
    late: Source = DelayedSource(images, lateness_ns=lateness_ns)
    looked = ObservedImages(late if lookouts else ThinnedPixels(late, station.record.image_hz), lookouts)
    sources.append(looked)
    sources += [DelayedSource(file, lateness_ns=span.lateness_at, offset_ns=offset_ns) for file in files]
    ends = [n for n in (span.first_arrival_ns, span.last_arrival_ns) if n is not None]
    if stamps:
        ends += [stamp_ns + span.lateness_at(stamp_ns) for stamp_ns in (min(stamps.values()), max(stamps.values()))]
    return Flight(tuple(sources), min(ends), max(ends), looked, source)


def _has_own_images(station: StationConfig, recording: ForeignRecording | None) -> bool:
    """Whether another tool's recording gives the images too: unless others, or a rate, were asked for."""
    asked = isinstance(station.images.source, VideoFile | Stills | Rate)
    return recording is not None and recording.images is not None and not asked


def _images(
    station: StationConfig, span: LogSpan, recording: ForeignRecording | None, *, decode: bool
) -> tuple[Source, dict[int, int]]:
    """The image source and all its stamps by index; without images, stamps at a rate over the log."""
    chosen, clock, camera = station.images.source, station.image_clock, station.pipeline.camera
    if isinstance(chosen, VideoFile):
        from aerodft.adapters.images import VideoFileSource

        video = VideoFileSource(chosen.path, start_ns=chosen.start_ns, decode=decode)
        with _quiet():
            bare = OnClock(VideoFileSource(chosen.path, start_ns=video.start_ns, decode=False), clock)
            stamps = _stamps(bare, camera, chosen.path)
        return SizeChecked(OnClock(video, clock), camera, chosen.path), stamps
    if isinstance(chosen, Stills):
        stills = OnClock(_stills(chosen, decode=decode), clock)
        with _quiet():
            stamps = _stamps(OnClock(_stills(chosen, decode=False), clock), camera, chosen.folder)
        return SizeChecked(stills, camera, chosen.folder), stamps
    if recording is not None and _has_own_images(station, recording):
        check_camera(recording, camera)
        bare = OnClock(ForeignImages(recording, decode=False), clock)
        with _quiet():
            stamps = _stamps(bare, camera, recording.path)
        images = OnClock(ForeignImages(recording, decode=decode), clock)
        return SizeChecked(images, camera, recording.path), stamps
    if not span.arrivals_ns:
        raise InputError("a fixed camera's import needs images", expected="--video FILE or --images DIR")
    rate_hz = chosen.rate_hz if isinstance(chosen, Rate) else DEFAULT_RATE_HZ
    return RateSource(span.arrivals_ns, rate_hz), {}


def _stills(chosen: Stills, *, decode: bool) -> StillsFolderSource:
    return StillsFolderSource(chosen.folder, pattern=chosen.pattern, utc_offset=chosen.utc_offset, decode=decode)


def _stamps(source: Source, camera: Camera, where: Path) -> dict[int, int]:
    """The stamps of all images by index; refuses a wrong size here, before anything is written."""
    images = (event for event in SizeChecked(source, camera, where).events() if isinstance(event, Image))
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
                hint="see `aerodft doctor`, and telemetry.height.order / telemetry.attitude.order in the config",
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
        hint="check --video-start and images.time_offset_s, or let --sync auto find it",
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence warnings of a first pass: the second says them."""
    loggers = [logging.getLogger(name) for name in ("aerodft.adapters", "replay")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def measure_flight(
    station: StationConfig,
    log: Path | None,
    observations: tuple[Path, ...],
    output: Path,
    *,
    where: Path,
    as_json: bool,
) -> None:
    """Measure a flight from its files, record it, and say what came of it.

    Args:
        station: The station, complete.
        log: As for :func:`aerodft.cli.flight.open_flight`.
        observations: Files of observed pixels, beside those of the station.
        output: A new folder.
        where: The configuration's name in messages.
        as_json: Print the summary as JSON.

    Raises:
        AerodftError: A file cannot be read, or nothing could be measured.
    """
    statistics, pipeline = RunStatistics(), build_pipeline(station)
    eyes = build_observers(station, pipeline, where, may_record=log is not None and is_mcap(log))
    flight = open_flight(station, log, (*station.observations.files, *observations), eyes.schedules)
    recorder = build_recorder(station, output, started_ns=flight.first_ns, lossless=True)
    with (
        closing_recorder(recorder, output),
        open_outputs(station.outputs, outputs_run(station, pipeline)) as outputs,
        progress_bar("importing", flight.first_ns, flight.last_ns) as progress,
    ):
        feed = Interruptible(MergedFeed(flight.sources, station.pipeline.tick_ns))
        run(feed, pipeline, (*outputs, recorder, statistics), progress)
    seen = eyes.report(flight.looked.counts)
    report(recorder.totals, statistics, pipeline.counts, as_json=as_json, warnings=flight.warnings(), seen=seen)


def check_camera(recording: ForeignRecording, camera: Camera) -> None:
    """Say where the recording's own camera is another one; the camera that was asked for counts.

    Args:
        recording: With or without a camera.
        camera: What is measured with.
    """
    try:
        recorded = recording.camera()
    except InputError as error:
        say(f"aerodft: {error}; not compared with {camera.name!r}")
        return
    if recorded is None:
        return
    scale = camera.width_px / recorded.width_px
    apart_px = abs(recorded.fx_px * scale - camera.fx_px)
    if apart_px > max(_STDS * camera.std.focal_px, _SHARE * camera.fx_px):
        say(
            f"aerodft: {recording.path}: its camera ({recorded.name}) has a focal length of"
            f" {recorded.fx_px * scale:.1f} px, {camera.name!r} of {camera.fx_px:.1f} px, which is measured with"
        )
