"""``aerodft doctor``: what a telemetry log or link holds, and what it is good for."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.config.station import StationConfig, load_station
from aerodft.adapters.telemetry import followed_by
from aerodft.adapters.telemetry.mavlink import is_link, parse_address
from aerodft.cli.doctor_survey import Fixed, Listening, survey_link, survey_log
from aerodft.cli.option_values import MOST_SECONDS, TopicOption, parse_topics
from aerodft.cli.output import tables
from aerodft.diagnosis import SurveyReport, ValueSource, document, notes, problems
from aerodft.errors import NoAnswerError, UsageError
from aerodft.model import ReportFrame
from aerodft.service import SigningSettings
from aerodft.service.attitude import FrameEvidence


def doctor(
    target: Annotated[
        str, typer.Argument(metavar="LOG|LINK", help="A .tlog or .bin log, a recording, or a link such as udpin:14550.")
    ],
    *,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
    topic: TopicOption = None,
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
    camera: Annotated[
        Path | None, typer.Option(help="Camera file that the vehicle's reports of its camera are held against.")
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            "-c",
            help="Station configuration that is held against what comes; its vehicle and signing key count.",
        ),
    ] = None,
    fix: Annotated[
        bool, typer.Option("--fix", help="Ask the vehicle for the messages that are missing or too slow.")
    ] = False,
) -> None:
    """Say what there is, what is wrong with it, which messages to request, and which parameters to set.

    What is missing, stale, contradictory or set wrongly is said in a sentence each. With --fix every message that is
    missing or too slow is requested from the chosen vehicle (MAV_CMD_SET_MESSAGE_INTERVAL; what a camera says of its
    view once, MAV_CMD_REQUEST_MESSAGE; signed where the link is), one after the other, with its answer: accepted,
    denied, unsupported or none; without --fix nothing is asked.

    A measurement has no answer 5 s after the last HEARTBEAT, or while the autopilot's estimator has no attitude or
    refuses what it is told (test ratios from 1 on); a poor GPS fix, ratios from 0.8 on and more than 10 % of frames
    lost are said with it.

    Exit codes: 0 some image could be measured, with the configuration or the defaults; 2 wrong usage; 3 unreadable
    log, link, key or configuration; 4 no image could be measured, or no vehicle could be asked.

    Example: aerodft doctor flight.tlog --config station.toml

    Example: aerodft doctor udpin:14550 --seconds 5 --json

    Example: aerodft doctor udpin:14550 --fix --system 1

    Example: aerodft doctor udpin:14550 --signing-key vehicle.key
    """
    loaded = None if config is None else load_station(config)
    station = None if loaded is None else loaded.pipeline
    topics = parse_topics(topic, None if loaded is None else loaded.topics)
    settings = None if station is None else station.telemetry
    options = {"system": system, "component": component, "gimbal": gimbal}
    named = {key: value for key, value in options.items() if value is not None}
    followed = replace(followed_by(settings), **named)
    reference = load_camera(camera) if camera is not None else None if station is None else station.camera
    fixed: tuple[Fixed, ...] = ()
    if is_link(target):
        signing = _signing(loaded, signing_key)
        baud = baud or _baud(loaded, target)
        listening = Listening(address=target, seconds=seconds, followed=followed, settings=settings)
        report, fixed = survey_link(listening, baud=baud, signing=signing, fix=fix)
    else:
        _check_for_log(target, signing_key, fix=fix)
        report = survey_log(Path(target), followed=followed, settings=settings, topics=topics)
    report = replace(report, camera=reference)
    if as_json:
        asked = {"fix": [each.document() for each in fixed]} if fix else {}
        typer.echo(json.dumps({**document(report), **asked}))
    else:
        _print(report, fixed, tables())
    if not report.usable:
        what = "nothing could be used" if report.first_ns is None else "no image could be measured"
        raise NoAnswerError(what, where=target, hint="see the problems listed")


def _signing(station: StationConfig | None, key_file: Path | None) -> SigningSettings | None:
    """How a link is signed: as the configuration says, with the key that was given."""
    configured = None if station is None or station.link is None else station.link.signing
    if key_file is None:
        return configured
    return SigningSettings(key_file=key_file) if configured is None else replace(configured, key_file=key_file)


def _baud(station: StationConfig | None, target: str) -> int | None:
    """The configured one, where the link is the configured one."""
    return station.link.baud if station is not None and station.link and station.link.connection == target else None


def _check_for_log(target: str, signing_key: Path | None, *, fix: bool) -> None:
    if ":" in target and not Path(target).exists():
        parse_address(target)  # says which links there are
    if signing_key is not None:
        raise UsageError("--signing-key", got=f"a log ({target})", expected="a link: what a log holds was let in once")
    if fix:
        raise UsageError("--fix", got=f"a log ({target})", expected="a link such as udpin:14550: a log cannot be asked")


def _print_fixed(fixed: Sequence[Fixed]) -> None:
    for each in fixed:
        request = each.outcome.request
        came = "it came" if each.count else "it did not come"
        rates = f"{request.now_hz:.1f} Hz before, {each.after_hz:.1f} Hz now"
        what = f"{request.name} {request.often} from component {request.component}"
        typer.echo(f"- {what}: {each.outcome.answer} ({came if request.rate_hz is None else rates})")


def _print(report: SurveyReport, fixed: Sequence[Fixed], console: Console) -> None:
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
    for sentence in notes(report):
        console.print(sentence, soft_wrap=True)
    for sentence in problems(report):
        console.print(f"- {sentence}", soft_wrap=True)
    _print_fixed(fixed)


def _against(evidence: FrameEvidence | None) -> str:
    words = {ReportFrame.EARTH: " against the horizon", ReportFrame.BODY: " against the vehicle"}
    return "" if evidence is None or evidence.frame is None else words[evidence.frame]


def _span(source: ValueSource) -> str:
    low, high = (round(each, 2) + 0.0 for each in (source.low, source.high))  # no -0.00
    return f"{low:.2f} to {high:.2f} {source.unit}"
