"""Surveys of logs and links for ``doctor``; and with ``--fix`` the requests that a survey calls for."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from aerodft.adapters.config.station import Topics
from aerodft.adapters.telemetry.mavlink import Followed, MavlinkLink, parse_address
from aerodft.app.assembly import open_telemetry_log, opened_signing
from aerodft.cli.output import say
from aerodft.conventions import SECOND_NS
from aerodft.diagnosis import LogDiagnosis, Outcome, SurveyReport, ask
from aerodft.errors import NoAnswerError, UsageError
from aerodft.model import RawBlock
from aerodft.service import Batches, Inbox, LiveFeed, SigningSettings, TelemetrySettings
from aerodft.service.clocks import WallClock

_TICK_NS: Final = 50_000_000


@dataclass(frozen=True, slots=True)
class Fixed:
    """What became of one request.

    Attributes:
        outcome: The request and its answer.
        after_hz: The message's rate afterwards.
        count: How often it came since.
    """

    outcome: Outcome
    after_hz: float
    count: int

    def document(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {**self.outcome.document(self.after_hz), "count": self.count}


@dataclass(frozen=True, slots=True, kw_only=True)
class Listening:
    """What is listened to, and for how long.

    Attributes:
        address: Of a link.
        seconds: How long.
        followed: The vehicle; None for the first one heard.
        settings: What a station's configuration asks of the telemetry; None for no configuration.
    """

    address: str
    seconds: float
    followed: Followed | None = None
    settings: TelemetrySettings | None = None

    def survey(self) -> LogDiagnosis:
        """A survey that has heard nothing yet."""
        return LogDiagnosis(self.address, followed=self.followed, settings=self.settings)


def survey_log(
    path: Path,
    *,
    followed: Followed | None = None,
    settings: TelemetrySettings | None = None,
    topics: Topics | None = None,
) -> SurveyReport:
    """Survey a whole log, or the telemetry of a recording.

    Args:
        path: The log or recording.
        followed: The vehicle to follow; None for the first one heard.
        settings: What a station wants of it; None for the defaults.
        topics: Which topic of another tool's recording is what.

    Raises:
        InputError: It cannot be read.
    """
    source, _ = open_telemetry_log(path, topics)
    survey = LogDiagnosis(str(path), followed=followed, settings=settings)
    for event in source.events():
        if isinstance(event, RawBlock):
            survey.add(event)
    return survey.report(counts=source.counts, warnings=source.warnings())


def survey_link(
    wanted: Listening, *, baud: int | None = None, signing: SigningSettings | None = None, fix: bool = False
) -> tuple[SurveyReport, tuple[Fixed, ...]]:
    """Listen to a link for a while; with ``fix`` ask for what is missing then, and listen again.

    Returns:
        The last survey in which the vehicle was heard, and what became of the requests.

    Raises:
        LinkError: It cannot be opened.
        ConfigError: Its signing key cannot be used.
        NoAnswerError: There is no vehicle that could be asked.
        UsageError: There is more than one, and none was chosen.
    """
    clock = WallClock()
    inbox = Inbox(clock)
    place = parse_address(wanted.address, baud=baud)
    with opened_signing(signing) as check, MavlinkLink(place, inbox, signing=check) as link:
        batches = LiveFeed(inbox, clock, _TICK_NS).batches()
        survey = wanted.survey()
        report = _listened(wanted, link, _surveyed(batches, survey), survey)
        if not fix:
            return report, ()
        _check_chosen(report, wanted.followed)
        say(f"asking system {report.system} for {len(report.requests)} messages")
        outcomes = ask(link, batches, (each for each in report.requests if each.rate_hz is not None))
        survey = wanted.survey()  # hears what is said once, and rates only after they have changed
        surveyed = _surveyed(batches, survey)
        outcomes += ask(link, surveyed, (each for each in report.requests if each.rate_hz is None))
        after = _listened(wanted, link, surveyed, survey)
    fixed = tuple(_fixed(after, outcome) for outcome in outcomes)
    return (after if after.first_ns is not None and after.is_heard else replace(report, is_silent_since=True)), fixed


def _surveyed(batches: Iterator[Batches], survey: LogDiagnosis) -> Iterator[Batches]:
    """The batches, each taken in by a survey."""
    for batch in batches:
        for block in batch.raw:
            survey.add(block)
        yield batch


def _listened(wanted: Listening, link: MavlinkLink, surveyed: Iterator[Batches], survey: LogDiagnosis) -> SurveyReport:
    """The survey that takes these batches in, after the next seconds of an open link."""
    end_ns = None
    for batch in surveyed:
        now_ns = int(batch.now_ns[-1])
        end_ns = now_ns + int(wanted.seconds * SECOND_NS) if end_ns is None else end_ns
        if now_ns >= end_ns:
            break
    return survey.report(counts=link.counts, signing=link.signing)


def _check_chosen(report: SurveyReport, followed: Followed | None) -> None:
    if report.system is None or not report.is_heard:
        got = f"systems {', '.join(map(str, report.heard))}" if report.heard else "no autopilot heard"
        raise NoAnswerError("no vehicle could be asked", where=report.target, got=got, hint="is it on?")
    if len(report.systems) > 1 and (followed is None or followed.system is None):
        systems = ", ".join(map(str, report.systems))
        raise UsageError("--fix", got=f"several vehicles (systems {systems})", expected="--system with one of them")


def _fixed(report: SurveyReport, outcome: Outcome) -> Fixed:
    asked = (outcome.request.name, outcome.request.system, outcome.request.component)
    stream = next((each for each in report.streams if (each.name, each.system, each.component) == asked), None)
    return Fixed(outcome, *((0.0, 0) if stream is None else (stream.rate_hz, stream.count)))
