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
from aerodft.adapters.config.loading import load_station
from aerodft.adapters.mavlink.address import is_link
from aerodft.adapters.mavlink.findings import document, problems
from aerodft.adapters.mavlink.selection import Followed
from aerodft.adapters.mavlink.signing_settings import SigningSettings
from aerodft.adapters.mavlink.survey_report import SurveyReport, ValueSource
from aerodft.cli.doctor_survey import Fixed, survey_link, survey_log
from aerodft.cli.output import tables
from aerodft.cli.times import MOST_SECONDS
from aerodft.errors import NoAnswerError, UsageError
from aerodft.model.telemetry import ReportFrame
from aerodft.service.gimbal_frame import FrameEvidence


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
    camera: Annotated[
        Path | None, typer.Option(help="Camera file that the vehicle's reports of its camera are held against.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="Station configuration that is held against what comes.")
    ] = None,
    fix: Annotated[
        bool, typer.Option("--fix", help="Ask the vehicle for the messages that are missing or too slow.")
    ] = False,
) -> None:
    """Say what there is, what is wrong with it, which messages to request, and which parameters to set.

    What is missing, stale, contradictory or set wrongly is said in a sentence each. With --fix every message that is
    missing or too slow is requested from the chosen vehicle (MAV_CMD_SET_MESSAGE_INTERVAL, signed where the link is),
    one after the other, with its answer: accepted, denied, unsupported or none; without --fix nothing is asked.

    A measurement has no answer 5 s after the last HEARTBEAT, or while the autopilot's estimator has no attitude or
    refuses what it is told (test ratios from 1 on); a poor GPS fix, ratios from 0.8 on and more than 10 % of frames
    lost are said with it.

    Example: aerodft doctor flight.tlog --config station.toml

    Example: aerodft doctor udpin:14550 --seconds 5 --json

    Example: aerodft doctor udpin:14550 --fix --system 1

    Example: aerodft doctor udpin:14550 --signing-key vehicle.key
    """
    followed = Followed(system=system, component=component, gimbal=gimbal)
    station = None if config is None else load_station(config).pipeline
    reference = load_camera(camera) if camera is not None else None if station is None else station.camera
    fixed: tuple[Fixed, ...] = ()
    if is_link(target):
        signing = None if signing_key is None else SigningSettings(key_file=signing_key)
        report, fixed = survey_link(target, seconds=seconds, followed=followed, baud=baud, signing=signing, fix=fix)
    else:
        _check_for_log(target, signing_key, fix=fix)
        report = survey_log(Path(target), followed=followed)
    report = replace(report, camera=reference, settings=None if station is None else station.telemetry)
    if as_json:
        asked = {"fix": [each.document() for each in fixed]} if fix else {}
        typer.echo(json.dumps({**document(report), **asked}))
    else:
        _print(report, tables())
        _print_fixed(fixed)
    if not report.usable:
        missing = "height" if not report.heights else "attitude"
        raise NoAnswerError(f"no source of {missing} could serve", where=target, hint="see the problems listed")


def _check_for_log(target: str, signing_key: Path | None, *, fix: bool) -> None:
    if signing_key is not None:
        raise UsageError("--signing-key", got=f"a log ({target})", expected="a link: what a log holds was let in once")
    if fix:
        raise UsageError("--fix", got=f"a log ({target})", expected="a link such as udpin:14550: a log cannot be asked")


def _print_fixed(fixed: Sequence[Fixed]) -> None:
    for each in fixed:
        request = each.outcome.request
        rates = f"{request.now_hz:.1f} Hz before, {each.after_hz:.1f} Hz now"
        typer.echo(f"- {request.name} at {request.rate_hz:g} Hz: {each.outcome.answer} ({rates})")


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
