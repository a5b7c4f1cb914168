"""Surveys of logs and links for ``doctor``; and with ``--fix`` the requests that a survey calls for."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from aerodft.adapters.mavlink.address import parse_address
from aerodft.adapters.mavlink.commanding import Outcome, ask
from aerodft.adapters.mavlink.composite import open_log
from aerodft.adapters.mavlink.link import MavlinkLink
from aerodft.adapters.mavlink.selection import Followed
from aerodft.adapters.mavlink.signing_settings import SigningSettings
from aerodft.adapters.mavlink.survey import Survey
from aerodft.adapters.mavlink.survey_report import SurveyReport
from aerodft.cli.output import say
from aerodft.cli.signed import opened_signing
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError, UsageError
from aerodft.model.batch import Batch
from aerodft.model.telemetry import RawBlock
from aerodft.service.clock import WallClock
from aerodft.service.feed import Inbox, LiveFeed

_TICK_NS: Final = 50_000_000


@dataclass(frozen=True, slots=True)
class Fixed:
    """What became of one request.

    Attributes:
        outcome: The request and its answer.
        after_hz: The message's rate afterwards.
    """

    outcome: Outcome
    after_hz: float

    def document(self) -> dict[str, Any]:
        """Plain JSON values."""
        return self.outcome.document(self.after_hz)


def survey_log(path: Path, *, followed: Followed | None = None) -> SurveyReport:
    """Survey a whole log.

    Raises:
        InputError: It cannot be read.
    """
    source = open_log(path)
    survey = Survey(str(path), followed=followed)
    for event in source.events():
        if isinstance(event, RawBlock):
            survey.add(event)
    return survey.report(counts=source.counts, warnings=source.warnings())


def survey_link(
    address: str,
    *,
    seconds: float,
    followed: Followed | None = None,
    baud: int | None = None,
    signing: SigningSettings | None = None,
    fix: bool = False,
) -> tuple[SurveyReport, tuple[Fixed, ...]]:
    """Listen to a link for a while; with ``fix`` ask for what is missing then, and listen again.

    Returns:
        The last survey, and what became of the requests.

    Raises:
        LinkError: It cannot be opened.
        ConfigError: Its signing key cannot be used.
        NoAnswerError: There is no vehicle that could be asked.
        UsageError: There is more than one, and none was chosen.
    """
    clock = WallClock()
    inbox = Inbox(clock)
    place = parse_address(address, baud=baud)
    with opened_signing(signing) as check, MavlinkLink(place, inbox, signing=check) as link:
        batches = LiveFeed(inbox, clock, _TICK_NS).batches()
        report = _listened(address, link, batches, seconds, followed)
        if not fix:
            return report, ()
        _check_chosen(report, followed)
        say(f"asking system {report.system} for {len(report.requests)} messages")
        outcomes = ask(link, batches, report.requests)
        after = _listened(address, link, batches, seconds, followed)
    return after, tuple(Fixed(outcome, _rate_hz(after, outcome)) for outcome in outcomes)


def _listened(
    address: str, link: MavlinkLink, batches: Iterator[Batch], seconds: float, followed: Followed | None
) -> SurveyReport:
    """A survey of the next seconds of an open link."""
    survey, end_ns = Survey(address, followed=followed), None
    for batch in batches:
        end_ns = batch.now_ns + int(seconds * SECOND_NS) if end_ns is None else end_ns
        for block in batch.raw:
            survey.add(block)
        if batch.now_ns >= end_ns:
            break
    return survey.report(counts=link.counts, signing=link.signing)


def _check_chosen(report: SurveyReport, followed: Followed | None) -> None:
    if report.system is None:
        raise NoAnswerError(
            "no vehicle could be asked", where=report.target, got="no autopilot heard", hint="is it on?"
        )
    if len(report.systems) > 1 and (followed is None or followed.system is None):
        systems = ", ".join(map(str, report.systems))
        raise UsageError("--fix", got=f"several vehicles (systems {systems})", expected="--system with one of them")


def _rate_hz(report: SurveyReport, outcome: Outcome) -> float:
    request = outcome.request
    own = [each for each in report.streams if each.name == request.name and each.system == request.system]
    return max((each.rate_hz for each in own), default=0.0)
