"""``aerodft doctor``: what a telemetry log or link holds, and what it is good for."""

import json
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console
from rich.table import Table

from aerodft.adapters.mavlink.address import is_link, parse_address
from aerodft.adapters.mavlink.composite import open_log
from aerodft.adapters.mavlink.findings import document, problems
from aerodft.adapters.mavlink.link import MavlinkLink
from aerodft.adapters.mavlink.selection import Followed
from aerodft.adapters.mavlink.signing_settings import SigningSettings
from aerodft.adapters.mavlink.survey import Survey
from aerodft.adapters.mavlink.survey_report import SurveyReport, ValueSource
from aerodft.cli.output import tables
from aerodft.cli.signed import opened_signing
from aerodft.cli.times import MOST_SECONDS
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError, UsageError
from aerodft.model.telemetry import RawBlock, ReportFrame
from aerodft.service.clock import WallClock
from aerodft.service.feed import Inbox, LiveFeed
from aerodft.service.gimbal_frame import FrameEvidence

_TICK_NS: Final = 50_000_000


def doctor(
    target: Annotated[
        str, typer.Argument(metavar="LOG|LINK", help="A .tlog or .bin log, or a link such as udpin:14550.")
    ],
    *,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
    seconds: Annotated[float, typer.Option(min=0.1, max=MOST_SECONDS, help="How long to listen to a link.")] = 10.0,
    system: Annotated[int | None, typer.Option(min=1, max=255, help="MAVLink system to follow.")] = None,
    component: Annotated[int | None, typer.Option(min=1, max=255, help="Its autopilot, where it has several.")] = None,
    gimbal: Annotated[
        int | None, typer.Option(min=1, max=255, help="Gimbal to follow: 1 to 6 its number, else its component.")
    ] = None,
    baud: Annotated[int | None, typer.Option(min=1, help="Baud rate of a serial link.")] = None,
    signing_key: Annotated[
        Path | None, typer.Option(help="Key file of a signed link; its time stamps are kept beside it.")
    ] = None,
) -> None:
    """Say which messages there are, which heights and attitudes they give, and what is wrong.

    Example: aerodft doctor flight.tlog

    Example: aerodft doctor udpin:14550 --seconds 5 --json

    Example: aerodft doctor udpin:14550 --signing-key vehicle.key
    """
    followed = Followed(system=system, component=component, gimbal=gimbal)
    if is_link(target):
        signing = None if signing_key is None else SigningSettings(key_file=signing_key)
        report = survey_link(target, seconds=seconds, followed=followed, baud=baud, signing=signing)
    elif signing_key is not None:
        raise UsageError("--signing-key", got=f"a log ({target})", expected="a link: what a log holds was let in once")
    else:
        report = survey_log(Path(target), followed=followed)
    if as_json:
        typer.echo(json.dumps(document(report)))
    else:
        _print(report, tables())
    if not report.usable:
        missing = "height" if not report.heights else "attitude"
        raise NoAnswerError(f"no source of {missing} could serve", where=target, hint="see the problems listed")


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
) -> SurveyReport:
    """Listen to a link for a while.

    Raises:
        LinkError: It cannot be opened.
        ConfigError: Its signing key cannot be used.
    """
    clock = WallClock()
    inbox = Inbox(clock)
    feed = LiveFeed(inbox, clock, _TICK_NS)
    survey = Survey(address, followed=followed)
    place = parse_address(address, baud=baud)
    with opened_signing(signing) as check, MavlinkLink(place, inbox, signing=check) as link:
        end_ns = clock.now_ns() + int(seconds * SECOND_NS)
        for batch in feed.batches():
            for block in batch.raw:
                survey.add(block)
            if batch.now_ns >= end_ns:
                feed.stop()
        return survey.report(counts=link.counts, signing=link.signing)


def _print(report: SurveyReport, console: Console) -> None:
    streams = Table(title=f"{report.target}: {report.duration_s:.1f} s", title_justify="left")
    for column in ("message", "from", "count", "rate Hz"):
        streams.add_column(column, justify="left" if column in {"message", "from"} else "right")
    for stream in report.streams:
        sender = "" if stream.system is None else f"{stream.system}/{stream.component}"
        streams.add_row(stream.name, sender, str(stream.count), f"{stream.rate_hz:.1f}")
    console.print(streams)
    sources = Table(title="Sources", title_justify="left")
    for column in ("of", "source", "usable", "range"):
        sources.add_column(column)
    for height in report.heights:
        sources.add_row("height", height.name, str(height.count), _span(height))
    for attitude in report.attitudes:
        pitch = f"pitch {_span(attitude)}{_against(report.frames.get(attitude.name))}"
        sources.add_row("camera attitude", attitude.name, str(attitude.count), pitch)
    if report.vehicle_attitude:
        vehicle = report.vehicle_attitude
        sources.add_row("vehicle attitude", vehicle.name, str(vehicle.count), f"pitch {_span(vehicle)}")
    console.print(sources)
    clock = report.clock
    if clock.known_after_s is not None:
        console.print(
            f"UTC known after {clock.known_after_s:.1f} s; arrival minus UTC {clock.host_minus_utc_s:.3f} s",
        )
    for sentence in problems(report):
        console.print(f"- {sentence}", soft_wrap=True)


def _against(evidence: FrameEvidence | None) -> str:
    words = {ReportFrame.EARTH: " against the horizon", ReportFrame.BODY: " against the vehicle"}
    return "" if evidence is None or evidence.frame is None else words[evidence.frame]


def _span(source: ValueSource) -> str:
    return f"{source.low:.2f} to {source.high:.2f} {source.unit}"
