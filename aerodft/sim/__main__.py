"""Command line of the simulator, ``python -m aerodft.sim``: a flight as files or live."""

import math
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import orjson
import typer
from rich.console import Console
from rich.progress import Progress as Bar

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.telemetry import load_key
from aerodft.conventions import SECOND_NS
from aerodft.errors import AerodftError, UsageError
from aerodft.model import BiasValues, PoseStd
from aerodft.service.clocks import WallClock
from aerodft.sim.live import Outlets, encode_packets, observation_publisher, send_live, signing_sender, udp_sender
from aerodft.sim.scenario import Progress, Scenario, default_camera, scenario_from_log, survey_scenario, write_files
from aerodft.sim.telemetry import Radio, draw_biases

_MAX_VALUE = 1e5  # metres, degrees, seconds, pixels: fits into MAVLink's integers
_MAX_CLOCK_S = 1e9
_ANGLES = ("tilt", "pan", "roll", "heading")
_FRACTIONS = ("drop", "duplicate", "reorder")


def parse_size(text: str) -> tuple[int, int]:
    """Image size from ``1280x720``: width and height in pixels, even as H.264 requires.

    Raises:
        UsageError: Anything else.
    """
    match = re.fullmatch(r"(\d{2,5})x(\d{2,5})", text)
    if match is None or int(match[1]) % 2 or int(match[2]) % 2:
        raise UsageError("--size", got=text, expected="two even numbers like 1280x720")
    return int(match[1]), int(match[2])


def parse_stds(option: str, text: str) -> PoseStd:
    """Standard deviations by name: height and position in m, tilt, pan, roll, heading in degrees, none negative."""
    values = parse_numbers(option, text, dict.fromkeys(("height", "position", *_ANGLES), 0.0))
    return PoseStd(height_agl_m=values["height"], horizontal_m=values["position"], **_angles_rad(values))


def parse_biases(option: str, text: str) -> BiasValues:
    """Biases by name: height in m, tilt, pan, roll, heading in degrees."""
    names = ("height", *_ANGLES)
    bounds = dict.fromkeys(names, (-_MAX_VALUE, _MAX_VALUE))
    values = parse_numbers(option, text, dict.fromkeys(names, 0.0), bounds)
    return BiasValues(height_m=values["height"], **_angles_rad(values))


def _angles_rad(values: Mapping[str, float]) -> dict[str, float]:
    return {f"{name}_rad": math.radians(values[name]) for name in _ANGLES}


def parse_radio(option: str, text: str, *, seed: int) -> Radio:
    """Radio by name: latency, jitter, an outage from ``mute`` to ``unmute`` (s); fractions drop, duplicate, reorder."""
    names = ("latency", "jitter", *_FRACTIONS, "mute", "unmute")
    values = parse_numbers(option, text, dict.fromkeys(names, 0.0), dict.fromkeys(_FRACTIONS, (0.0, 1.0)))
    outage = (round(values["mute"] * SECOND_NS), round(values["unmute"] * SECOND_NS))
    return Radio(
        latency_ns=round(values["latency"] * SECOND_NS),
        jitter_ns=round(values["jitter"] * SECOND_NS),
        **{name: values[name] for name in _FRACTIONS},
        outages_ns=(outage,) if outage[1] > outage[0] else (),
        seed=seed,
    )


def parse_autopilot(option: str, text: str) -> tuple[int, int]:
    """The camera's lag behind the gimbal's reports, and the autopilot's UTC minus the host's: from s to ns."""
    values = parse_numbers(option, text, {"lag": 0.0, "clock": 0.0}, {"clock": (-_MAX_CLOCK_S, _MAX_CLOCK_S)})
    return round(values["lag"] * SECOND_NS), round(values["clock"] * SECOND_NS)


def parse_numbers(
    option: str,
    text: str,
    defaults: Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> dict[str, float]:
    """Numbers by name; defaults for names that are not given.

    Raises:
        UsageError: An unknown name, or a value that is no number within the name's bounds, else from 0 to 100000.
    """
    values = dict(defaults)
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        name, _, number = part.partition("=")
        if name not in values:
            raise UsageError(f"{option} {part}", got=f"name {name!r}", expected=f"one of {', '.join(values)}")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        low, high = bounds.get(name, (0.0, _MAX_VALUE))
        if not low <= value <= high:
            expected = f"a number of at least {low:g}, at most {high:g}, e.g. {name}=0.3"
            raise UsageError(f"{option} {part}", got=repr(number), expected=expected)
        values[name] = value
    return values


_LEAD_NS = SECOND_NS
_INTERRUPTED = 130  # how typer exits on Ctrl-C
_EXAMPLE = (
    "Examples: python -m aerodft.sim --out flight --duration 20    "
    "python -m aerodft.sim --out flight --live --mavlink udpout:127.0.0.1:14550 --video udp://127.0.0.1:5600 "
    "--std height=0.3,tilt=0.3"
)

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command(epilog=_EXAMPLE, no_args_is_help=True)
def simulate(
    out: Annotated[Path, typer.Option(help="Folder for the flight's files.")],
    log: Annotated[Path | None, typer.Option(help="Fly as this telemetry log (.tlog) did.")] = None,
    start: Annotated[float, typer.Option(min=0.0, help="With --log: seconds to leave out at its start.")] = 0.0,
    duration: Annotated[
        float | None, typer.Option(min=2.0, max=36_000.0, help="Seconds; 20, or with --log the rest of it.")
    ] = None,
    thin: Annotated[int, typer.Option(min=1, help="With --log: write every n-th frame of each message.")] = 1,
    fps: Annotated[
        float | None, typer.Option(min=0.1, max=1000.0, help="Images a second; 10, with --log every sample.")
    ] = None,
    size: Annotated[str, typer.Option(help="Image size.")] = "1280x720",
    camera: Annotated[Path | None, typer.Option(help="Camera file; its size replaces --size.")] = None,
    height: Annotated[float, typer.Option(min=2.0, max=10_000.0, help="Height of a generated flight, m.")] = 40.0,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 1,
    std: Annotated[str, typer.Option(help="Draw biases with these stds: height=0.3,tilt=0.3,roll=0.2,heading=1")] = "",
    bias: Annotated[str, typer.Option(help="Add these biases (said minus true): tilt=0.4,height=-1")] = "",
    noise: Annotated[str, typer.Option(help="White noise of every sample: height=0.05,tilt=0.05,position=0.1")] = "",
    autopilot: Annotated[str, typer.Option(help="Camera behind the gimbal, UTC minus host's, s: lag=0.1,clock=2")] = "",
    radio: Annotated[
        str, typer.Option(help="latency=0.02,jitter=0.005,drop=0.01,duplicate=0.01,reorder=0.01,mute=5,unmute=7")
    ] = "",
    observe: Annotated[str, typer.Option(help="Observations: std=0.5 (px), delay=0.05 (s, live)")] = "",
    image: Annotated[str, typer.Option(help="Images: noise=2 (grey levels), exposure=0 (s; motion blur)")] = "",
    no_video: Annotated[bool, typer.Option("--no-video", help="Write no video file.")] = False,
    live: Annotated[bool, typer.Option("--live", help="Fly now, in real time.")] = False,
    mavlink: Annotated[str | None, typer.Option(help="With --live: udpout:HOST:PORT")] = None,
    signing_key: Annotated[Path | None, typer.Option(help="With --mavlink: sign it with this key file.")] = None,
    video: Annotated[str | None, typer.Option(help="With --live: udp://HOST:PORT (H.264 in MPEG-TS)")] = None,
    zenoh: Annotated[str | None, typer.Option(help="With --live: publish observations, tcp/HOST:PORT")] = None,
    station: Annotated[str, typer.Option(help="Station's name in zenoh keys.")] = "sim",
) -> None:
    """Simulate a flight over a river with known truth: images, MAVLink, observations.

    Writes flight.tlog, video.mp4, observations.jsonl, truth.jsonl, poses.jsonl, camera.toml and world.geojson. With
    --live the flight takes place now: it is rendered first, then one line of JSON on stdout says when it starts, and
    every byte is sent at its time; no video file is written.
    """
    if not live and (mavlink or video or zenoh):
        raise UsageError("--mavlink, --video and --zenoh send a live flight", expected="--live with them")
    if signing_key is not None and mavlink is None:
        raise UsageError("--signing-key signs what is sent", expected="--mavlink with it")
    key = None if signing_key is None else load_key(signing_key)
    lens = default_camera(*parse_size(size)) if camera is None else load_camera(camera)
    if log is None:
        scenario = survey_scenario(lens, duration_s=duration or 20.0, fps=fps or 10.0, height_m=height, seed=seed)
    else:
        scenario = scenario_from_log(lens, log, interval_s=(start, duration), fps=fps, seed=seed, thin=thin)
    lag_ns, clock_ns = parse_autopilot("--autopilot", autopilot)
    drawn, stated = draw_biases(parse_stds("--std", std), seed), parse_biases("--bias", bias)
    sums = {each.name: getattr(drawn, each.name) + getattr(stated, each.name) for each in fields(BiasValues)}
    reporting = replace(scenario.autopilot, biases=BiasValues(**sums), noise=parse_stds("--noise", noise))
    observing = parse_numbers("--observe", observe, {"std": 0.5, "delay": 0.05})
    imaging = parse_numbers("--image", image, {"noise": 2.0, "exposure": 0.0})
    scenario = replace(
        scenario,
        autopilot=replace(reporting, gimbal_lag_ns=lag_ns, clock_offset_ns=clock_ns),
        radio=parse_radio("--radio", radio, seed=seed),
        imaging=replace(scenario.imaging, noise_std=imaging["noise"]),
        observing=replace(scenario.observing, std_px=observing["std"]),
        exposure_ns=round(imaging["exposure"] * SECOND_NS),
    )
    if live:
        delay_ns = round(observing["delay"] * SECOND_NS)
        _fly(scenario, out, (mavlink, video, zenoh), key=key, station=station, observe_delay_ns=delay_ns)
    else:
        with _progress() as progress:
            write_files(scenario, out, video=not no_video, progress=progress)
        _print_summary(scenario)


def _fly(
    scenario: Scenario,
    out: Path,
    addresses: tuple[str | None, str | None, str | None],
    *,
    key: bytes | None,
    station: str,
    observe_delay_ns: int,
) -> None:
    """Render, then fly at once; ``addresses`` are for MAVLink, video and zenoh, ``key`` signs MAVLink."""
    mavlink, video, zenoh = addresses
    clock = WallClock()
    with ExitStack() as stack:
        telemetry = stack.enter_context(udp_sender(mavlink)) if mavlink else None
        outlets = Outlets(
            telemetry=telemetry if telemetry is None or key is None else signing_sender(telemetry, key, clock),
            video=stack.enter_context(udp_sender(video)) if video else None,
            observe=stack.enter_context(observation_publisher(zenoh, station)) if zenoh else None,
            observe_delay_ns=observe_delay_ns,
        )
        packets: list[list[bytes]] = []
        if video:
            with _progress() as progress:
                packets = encode_packets(scenario, progress)
        # Whole microseconds: the resolution of logs and video.
        start_ns = (clock.now_ns() + _LEAD_NS) // 1000 * 1000
        scenario = scenario.shifted(start_ns - scenario.trajectory.start_ns)
        write_files(scenario, out, video=False)
        _print_summary(scenario)
        send_live(scenario, packets, outlets, clock)


def _print_summary(scenario: Scenario) -> None:
    """Print one line of JSON on stdout: the flight's time and its biases."""
    biases = scenario.autopilot.biases
    document = {
        "start_ns": str(scenario.trajectory.start_ns),
        "end_ns": str(scenario.trajectory.end_ns),
        "images": len(scenario.image_stamps_ns),
        "stations_m": scenario.observing.stations_m,
        "bias": {
            "height_m": biases.height_m,
            **{f"{name}_deg": math.degrees(getattr(biases, f"{name}_rad")) for name in _ANGLES},
        },
    }
    sys.stdout.buffer.write(orjson.dumps(document, option=orjson.OPT_APPEND_NEWLINE))
    sys.stdout.flush()


@contextmanager
def _progress() -> Iterator[Progress]:
    """A progress bar on stderr if that is a terminal."""
    console = Console(stderr=True)
    with Bar(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("rendering")
        yield lambda done, total: bar.update(task, completed=done, total=total)


def main() -> None:
    """Run the command; errors are one sentence and an exit code."""
    try:
        app()
    except AerodftError as error:
        print(f"aerodft.sim: {error}", file=sys.stderr)  # noqa: T201 - the command line speaks on stderr
        sys.exit(error.exit_code)
    except SystemExit as ending:
        if ending.code == _INTERRUPTED:
            print("aerodft.sim: stopped before the flight's end; its files may not be whole", file=sys.stderr)  # noqa: T201
        raise


if __name__ == "__main__":
    main()
