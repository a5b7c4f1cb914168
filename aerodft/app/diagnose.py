"""Diagnosing a log or a live link: what it holds, what is wrong with it, and what to do about it."""

import logging
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.config.station import StationConfig, Topics, load_station
from aerodft.adapters.telemetry import LogSource, PhotographLog, SubtitleLog, followed_by, opened_signing
from aerodft.adapters.telemetry.mavlink import FollowedIds, FrameCounts, MavlinkLink, is_link, parse_address
from aerodft.app.assembly import build_calibrator, open_telemetry_log
from aerodft.app.matching import over_cues
from aerodft.app.measure import camera_of_photograph
from aerodft.conventions import SECOND_NS
from aerodft.diagnosis import (
    DiagnosisReport,
    ImageCheck,
    LogDiagnosis,
    RequestOutcome,
    document,
    notes,
    problems,
    request_messages,
)
from aerodft.errors import InputError, NoAnswerError, UsageError
from aerodft.model import Camera, GimbalSource, RawBlock
from aerodft.service import (
    AttitudeSettings,
    Batches,
    Inbox,
    LiveFeed,
    PipelineSettings,
    SigningSettings,
    TelemetrySettings,
)
from aerodft.service.clocks import WallClock

_TICK_NS: Final = 50_000_000

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """Options for listening to a live link.

    Attributes:
        seconds: For how long.
        baud: Baud rate of a serial link; None for the station's.
        signing_key: Key file of a signed link; None for the station's.
        request_messages: Whether the vehicle is asked for messages that are missing or too slow.
    """

    seconds: float = 10.0
    baud: int | None = None
    signing_key: Path | None = None
    request_messages: bool = False


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Diagnosis of a log or link: its report, problems and notes.

    Attributes:
        report: Streams, sources, clocks and health, as found.
        requests: What became of requests for messages; None where nothing was asked for.
    """

    report: DiagnosisReport
    requests: tuple[RequestOutcome, ...] | None = None

    @property
    def problems(self) -> list[str]:
        """One sentence for each thing that limits what can be measured, with what to do; empty where all is well."""
        return problems(self.report)

    @property
    def notes(self) -> list[str]:
        """Notes worth knowing that are no problems."""
        return notes(self.report)

    @property
    def usable(self) -> bool:
        """Whether any image could be measured with this telemetry."""
        return self.report.usable

    def to_dict(self) -> dict[str, Any]:
        """The JSON document of ``aerodft doctor --json`` (``aerodft.doctor/1``)."""
        requested = {} if self.requests is None else {"fix": [each.document() for each in self.requests]}
        return {**document(self.report), **requested}


def diagnose(
    target: str | Path,
    *,
    station: str | Path | StationConfig | None = None,
    camera: str | Path | Camera | None = None,
    followed: FollowedIds | None = None,
    link: LinkOptions | None = None,
    topics: Topics | None = None,
) -> Diagnosis:
    """Diagnose the telemetry of a log, a recording or a live link.

    Args:
        target: A log of any registered format, a recording, an MCAP file with MAVLink, or a link such as
            ``udpin:14550``.
        station: Station file, or a station, that is held against what comes.
        camera: Camera file, or a camera, that the vehicle's reports of its camera are held against.
        followed: Vehicle, autopilot and gimbal to follow, instead of the station's or the first ones heard.
        link: How a link is listened to; None for 10 s without requests.
        topics: Which topic of another tool's recording is what; None for the station's.

    Raises:
        InputError: A file cannot be read, or the link cannot be opened.
        ConfigError: The station or camera file is wrong, or the signing key cannot be used.
        NoAnswerError: There is no vehicle that messages could be requested from.
        UsageError: Messages are to be requested of a log, or of one of several vehicles.

    Examples:
        >>> import aerodft as ad
        >>> found = ad.diagnose("samples/copter.tlog")
        >>> found.usable
        True
        >>> found.problems[1].partition(":")[0]
        "the vehicle did not move enough to tell the gimbal's frame"
    """
    against = load_station(Path(station)) if isinstance(station, str | Path) else station
    settings = None if against is None else against.pipeline.telemetry
    if camera is None:
        reference = None if against is None else against.pipeline.camera
    else:
        reference = camera if isinstance(camera, Camera) else load_camera(Path(camera))
    followed = followed or followed_by(settings)

    def new(own: TelemetrySettings | None = None) -> LogDiagnosis:
        images = _image_check(against, reference, own)
        return LogDiagnosis(str(target), followed=followed, settings=settings, images=images)

    requests = None
    if is_link(str(target)):
        report, requests = _diagnose_link(str(target), new, followed, link or LinkOptions(), against)
    else:
        _check_for_log(str(target), link)
        topics = topics or (None if against is None else against.topics)
        source, _ = open_telemetry_log(Path(target), topics, settings)
        if against is not None and settings is not None and isinstance(source, SubtitleLog):
            settings = over_cues(settings, source)
            against = replace(against, pipeline=replace(against.pipeline, telemetry=settings))
        report = _diagnose_log(source, new(_by_own_statements(source)))
    return Diagnosis(replace(report, camera=reference), requests)


def diagnose_heard(blocks: Iterable[RawBlock], pipeline: PipelineSettings) -> Diagnosis:
    """Diagnose what a station has heard.

    Args:
        blocks: In order of arrival.
        pipeline: The station's settings.
    """
    settings, images = pipeline.telemetry, ImageCheck(pipeline)
    followed = followed_by(settings)
    diagnosis, frames = LogDiagnosis("the station's link", followed=followed, settings=settings, images=images), 0
    for block in blocks:
        diagnosis.add(block)
        frames += len(block.arrival_ns)
    return Diagnosis(diagnosis.report(counts=FrameCounts(frames=frames)))


def _by_own_statements(log: LogSource) -> TelemetrySettings | None:
    """Settings for a log in which the camera's angles are its own statement; None for logs of gimbals' messages."""
    if not isinstance(log, SubtitleLog):
        return None
    return over_cues(TelemetrySettings(attitude=AttitudeSettings(order=(GimbalSource.SUBTITLES,))), log)


def _image_check(
    station: StationConfig | None, camera: Camera | None, telemetry: TelemetrySettings | None
) -> ImageCheck:
    """What measures images as an import with the station would; without one by these settings of telemetry."""
    if station is None or station.pipeline.telemetry is None:
        return ImageCheck(camera=camera, telemetry=telemetry)
    pipeline = station.pipeline if camera is None else replace(station.pipeline, camera=camera)
    return ImageCheck(pipeline, calibrator=build_calibrator(station)[0])


def _check_for_log(target: str, link: LinkOptions | None) -> None:
    """Refuse what makes sense for a link alone."""
    if ":" in target and not Path(target).exists():
        parse_address(target)  # says which links there are
    if link is not None and link.signing_key is not None:
        raise UsageError("`signing_key`", got=f"a log ({target})", expected="a link: what a log holds was let in once")
    if link is not None and link.request_messages:
        expected = "a link such as udpin:14550: a log cannot be asked"
        raise UsageError("`request_messages`", got=f"a log ({target})", expected=expected)


def _diagnose_log(source: LogSource, diagnosis: LogDiagnosis) -> DiagnosisReport:
    """The report on a whole log, or on the telemetry of a recording."""
    for event in source.events():
        if isinstance(event, RawBlock):
            diagnosis.add(event)
    report = diagnosis.report(counts=source.counts, warnings=source.warnings())
    if not isinstance(source, PhotographLog):
        return report
    return replace(report, photographs=tuple(_photograph_notes(source)))


def _photograph_notes(log: PhotographLog) -> Iterator[str]:
    """Who took photographs, and with which camera they are measured unless a station names another."""
    yield "; ".join(f"{count} photograph{'s' * (count > 1)} by {dialect}" for dialect, count in log.dialects.items())
    try:
        yield camera_of_photograph(log.first_photo)[1]
    except InputError as error:
        yield f"camera: {error}"


def _diagnose_link(
    address: str,
    new: Callable[[], LogDiagnosis],
    followed: FollowedIds,
    options: LinkOptions,
    station: StationConfig | None,
) -> tuple[DiagnosisReport, tuple[RequestOutcome, ...] | None]:
    """Listen to a link for a while; where messages are requested then, listen again.

    Returns:
        The last report in which the vehicle was heard, and what became of the requests; None where nothing was asked.
    """
    clock = WallClock()
    inbox = Inbox(clock)
    configured = None if station is None else station.link
    own_baud = configured.baud if configured is not None and configured.connection == address else None
    place = parse_address(address, baud=options.baud or own_baud)
    signing = None if configured is None else configured.signing
    if options.signing_key is not None:
        signing = replace(signing or SigningSettings(key_file=options.signing_key), key_file=options.signing_key)
    with opened_signing(signing) as check, MavlinkLink(place, inbox, signing=check) as link:
        batches, diagnosis = LiveFeed(inbox, clock, _TICK_NS).batches(), new()
        report = _listen(link, _noted(batches, diagnosis), diagnosis, options.seconds)
        if not options.request_messages:
            return report, None
        _check_one_vehicle(report, followed)
        _log.info("asking system %s for %d messages", report.system, len(report.requests))
        outcomes = request_messages(link, batches, (each for each in report.requests if each.rate_hz is not None))
        again = new()  # hears what is said once, and rates only after they have changed
        noted = _noted(batches, again)
        outcomes += request_messages(link, noted, (each for each in report.requests if each.rate_hz is None))
        after = _listen(link, noted, again, options.seconds)
    outcomes = tuple(each.with_effect(after.streams) for each in outcomes)
    return (after if after.first_ns is not None and after.is_heard else replace(report, is_silent_since=True)), outcomes


def _noted(batches: Iterator[Batches], diagnosis: LogDiagnosis) -> Iterator[Batches]:
    """The batches, each added to a diagnosis."""
    for batch in batches:
        for block in batch.raw:
            diagnosis.add(block)
        yield batch


def _listen(link: MavlinkLink, noted: Iterator[Batches], diagnosis: LogDiagnosis, seconds: float) -> DiagnosisReport:
    """The report after the next seconds of an open link."""
    end_ns = None
    for batch in noted:
        now_ns = int(batch.now_ns[-1])
        end_ns = now_ns + int(seconds * SECOND_NS) if end_ns is None else end_ns
        if now_ns >= end_ns:
            break
    return diagnosis.report(counts=link.counts, signing=link.signing)


def _check_one_vehicle(report: DiagnosisReport, followed: FollowedIds) -> None:
    """Refuse to request messages where no vehicle was heard, or several and none was chosen."""
    if report.system is None or not report.is_heard:
        got = f"systems {', '.join(map(str, report.heard))}" if report.heard else "no autopilot heard"
        raise NoAnswerError("no vehicle could be asked", where=report.target, got=got, hint="is it on?")
    if len(report.systems) > 1 and followed.system is None:
        got = f"several vehicles (systems {', '.join(map(str, report.systems))})"
        raise UsageError("`request_messages`", got=got, expected="`system` with one of them")
