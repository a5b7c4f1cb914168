"""``aerodft doctor``: what a telemetry log or link holds, and what it is good for."""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from aerodft.cli.options import (
    LOG_FORMATS,
    MOST_SECONDS,
    ConfigOption,
    JsonOption,
    TopicOption,
    as_typed,
    grouped,
    parse_topics,
)
from aerodft.cli.output import tables
from aerodft.errors import NoAnswerError
from aerodft.model import ReportFrame

if TYPE_CHECKING:
    from aerodft.adapters.telemetry.mavlink import FollowedIds
    from aerodft.app.diagnose import Diagnosis
    from aerodft.diagnosis import DiagnosisReport, RequestOutcome, SourceSummary
    from aerodft.service.attitude import FrameEvidence


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedOptions:
    """Options on the vehicle to follow; None for the configured one, or the first that is heard."""

    system: Annotated[int | None, typer.Option(min=1, max=255, help="MAVLink system to follow.")] = None
    component: Annotated[int | None, typer.Option(min=1, max=255, help="Its autopilot, where it has several.")] = None
    gimbal: Annotated[
        int | None, typer.Option(min=1, max=255, help="Gimbal to follow: 1 to 6 its number, else its component.")
    ] = None

    def followed(self, configured: "FollowedIds") -> "FollowedIds":
        """Ids of the vehicle to follow."""
        return replace(configured, **{name: number for name, number in asdict(self).items() if number is not None})


@dataclass(frozen=True, slots=True, kw_only=True)
class ListeningOptions:
    """Options for listening to a live link."""

    seconds: Annotated[float, typer.Option(min=0.1, max=MOST_SECONDS, help="How long to listen to a link.")] = 10.0
    baud: Annotated[int | None, typer.Option(min=1, help="Baud rate of a serial link.")] = None
    signing_key: Annotated[
        Path | None, typer.Option(help="Key file of a signed link; its time stamps are kept beside it.")
    ] = None
    request_messages: Annotated[
        bool, typer.Option("--request-messages", help="Ask the vehicle for the messages that are missing or too slow.")
    ] = False


@grouped
def doctor(
    target: Annotated[
        str,
        typer.Argument(metavar="LOG|LINK", help=f"A log ({LOG_FORMATS}), a recording, or a link such as udpin:14550."),
    ],
    follow: FollowedOptions,
    listen: ListeningOptions,
    *,
    as_json: JsonOption = False,
    topic: TopicOption = None,
    camera: Annotated[
        Path | None, typer.Option(help="Camera file that the vehicle's reports of its camera are held against.")
    ] = None,
    config: ConfigOption = None,
) -> None:
    """Say what there is, what is wrong with it, which messages to request, and which parameters to set.

    The station file of --config is held against what comes; its vehicle and signing key count.

    What is missing, stale, contradictory or set wrongly is said in a sentence each. With --request-messages every
    message that is missing or too slow is requested from the chosen vehicle (MAV_CMD_SET_MESSAGE_INTERVAL; what a
    camera says of its view once, MAV_CMD_REQUEST_MESSAGE; signed where the link is), one after the other, with its
    answer: accepted, denied, unsupported or none; without --request-messages nothing is asked.

    A measurement has no answer 5 s after the last HEARTBEAT, or while the EKF has no attitude or rejects its inputs
    (test ratio >= 1); a poor GPS fix, ratios from 0.8 on and more than 10 % of frames lost are said with it.

    Exit codes: 0 some image could be measured, with the configuration or the defaults; 2 wrong usage; 3 unreadable
    log, link, key or configuration; 4 no image could be measured, or no vehicle could be asked.

    Example: aerodft doctor flight.tlog --config station.toml

    Example: aerodft doctor udpin:14550 --seconds 5 --json

    Example: aerodft doctor udpin:14550 --request-messages --system 1

    Example: aerodft doctor udpin:14550 --signing-key vehicle.key
    """
    from aerodft.adapters.config.station import load_station
    from aerodft.adapters.telemetry import followed_by
    from aerodft.app.diagnose import LinkOptions, diagnose

    station = None if config is None else load_station(config)
    diagnosis = diagnose(
        target,
        station=station,
        camera=camera,
        followed=follow.followed(followed_by(None if station is None else station.pipeline.telemetry)),
        link=LinkOptions(**asdict(listen)),
        topics=parse_topics(topic, None if station is None else station.topics),
    )
    if as_json:
        typer.echo(json.dumps(diagnosis.to_dict()))
    else:
        _print(diagnosis, tables())
    if not diagnosis.usable:
        what = "nothing could be used" if diagnosis.report.first_ns is None else "no image could be measured"
        raise NoAnswerError(what, where=target, hint="see the problems listed")


def _print_outcome(outcome: "RequestOutcome") -> None:
    request = outcome.request
    came = "it came" if outcome.count else "it did not come"
    rates = f"{request.now_hz:.1f} Hz before, {outcome.after_hz:.1f} Hz now"
    what = f"{request.name} {request.rate_text} from component {request.component}"
    typer.echo(f"- {what}: {outcome.answer} ({came if request.rate_hz is None else rates})")


def _print(diagnosis: "Diagnosis", console: Console) -> None:
    report = diagnosis.report
    clock = report.clock
    for sentence in diagnosis.notes:
        console.print(as_typed(sentence), soft_wrap=True)
    for sentence in diagnosis.problems:
        console.print(f"- {as_typed(sentence)}", soft_wrap=True)
    for outcome in diagnosis.requests or ():
        _print_outcome(outcome)
    if clock.known_after_s is not None:
        console.print(
            f"UTC known after {clock.known_after_s:.1f} s; arrival minus UTC {clock.host_minus_utc_s:.3f} s",
        )
    console.print(_source_table(report))
    console.print(_stream_table(report))


def _stream_table(report: "DiagnosisReport") -> Table:
    streams = Table(title=f"{report.target}: {report.duration_s:.1f} s", title_justify="left")
    for column in ("message", "from", "count", "rate Hz"):
        streams.add_column(column, justify="left" if column in {"message", "from"} else "right")
    for stream in report.streams:
        sender = "" if stream.system is None else f"{stream.system}/{stream.component}"
        streams.add_row(stream.name, sender, str(stream.count), f"{stream.rate_hz:.1f}" if stream.rate_hz else "")
    return streams


def _source_table(report: "DiagnosisReport") -> Table:
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
    return sources


def _against(evidence: "FrameEvidence | None") -> str:
    words = {ReportFrame.EARTH: " against the horizon", ReportFrame.BODY: " against the vehicle"}
    return "" if evidence is None or evidence.frame is None else words[evidence.frame]


def _span(source: "SourceSummary") -> str:
    low, high = (round(each, 2) + 0.0 for each in (source.low, source.high))  # no -0.00
    return f"{low:.2f} to {high:.2f} {source.unit}"
