"""How fast a recorded flight is computed again, as a multiple of real time, its memory, and where the time goes.

``python tests/bench/bench_recompute.py [--seconds 3600] [--rate 30] [--log FLIGHT.tlog] [--profile]``: a simulated
flight of 195 messages a second without images, ten fixed probes of five kinds with joint covariance. The flight is
recorded, and ``aerodft recompute`` makes a recording of it in a process of its own (goal: 250 times real time of one
core, 500 MB); then another one of that, so that what is read holds measurements as well. Then come flights that differ
in one thing, as multiples of the first one's processor time (goal: 1.5): heights of a rangefinder, heights above
terrain, biases that landmarks tell in flight, a camera that zooms. ``--log`` adds an autopilot's own flight with ten
distances, of which the farthest lie close to the horizon (goal: 80 times real time). ``--ticks`` takes the first flight
tick by tick, as a live station does (goal: 10 ms).
"""

import argparse
import cProfile
import json
import math
import os
import pstats
import runpy
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.config.station import load_station
from aerodft.adapters.images import RateSource
from aerodft.adapters.telemetry import TlogSource
from aerodft.app.assembly import DelayedSource, build_pipeline, build_recorder, recorded_station
from aerodft.app.recompute import recompute
from aerodft.model import Camera, Observation
from aerodft.service import MergedFeed, StepOutputs
from aerodft.sim import Autopilot, Waypoint, datagrams, fly
from aerodft.sim.observations import pixels_of
from aerodft.sim.scenario import EPOCH_NS
from aerodft.sim.telemetry import Datagram, write_tlog
from aerodft.sim.trajectory import Trajectory
from aerodft.sim.world import DEFAULT_ORIGIN
from replay.recordings import Recording, RecordingSource

BENCH_IMPORT = runpy.run_path(str(Path(__file__).with_name("bench_import.py")))
CAMERA, RATES_HZ = BENCH_IMPORT["CAMERA"], BENCH_IMPORT["RATES_HZ"]
GOAL, GOAL_MB, GOAL_OF_HOME, GOAL_OF_LOG, GOAL_TICK_MS = 250.0, 500.0, 1.5, 80.0, 10.0
TICKS, SETTLED_TICK = 3000, 800
HOME = '[telemetry.height]\norder = ["home"]\n'
VARIANTS = {
    "home": HOME,
    "rangefinder": '[telemetry.height]\norder = ["rangefinder", "home"]\n',
    "terrain": '[telemetry.height]\norder = ["terrain", "home"]\nstd_m = { terrain = 1.0 }\n',
    "landmarks": HOME,
    "zoom": HOME + "[telemetry.zoom]\ncurve = [[0, 1.0], [100, 6.0]]\n",
}
"""What a flight's configuration says of its telemetry; terrain is believed as home is, so that as much is drawn."""
STATION = '[station]\nname = "bench"\n'
ORIGIN = f"""\
origin = {{ lat_deg = {math.degrees(DEFAULT_ORIGIN.lat_rad)}, lon_deg = {math.degrees(DEFAULT_ORIGIN.lon_rad)}, \
alt_msl_m = {DEFAULT_ORIGIN.alt_msl_m} }}
"""
LANDMARKS_EN_M = [(east, north) for north in range(0, 301, 25) for east in (-20.0, 20.0)]
LANDMARKS_HZ, ZOOM_HZ, CAMERA_COMPONENT = 2.0, 5.0, 100
LEG_S, GROUND_S, CLIMB_S = 60.0, 2.0, 10.0
LATENESS_NS = 60_000_000
PROBES = """
[[probe]]
name = "p-centre"
kind = "position"
pixels = [[960, 620]]
[[probe]]
name = "p-left"
kind = "position"
pixels = [[420, 760]]
[[probe]]
name = "p-right"
kind = "position"
pixels = [[1530, 800]]
[[probe]]
name = "w-near"
kind = "width"
pixels = [[300, 900], [1600, 880]]
std_px = 0.5
[[probe]]
name = "w-far"
kind = "width"
pixels = [[420, 560], [1480, 570]]
[[probe]]
name = "d-along"
kind = "distance"
pixels = [[980, 980], [940, 560]]
[[probe]]
name = "d-across"
kind = "distance"
pixels = [[640, 700], [1300, 900]]
[[probe]]
name = "h-post"
kind = "height"
pixels = [[700, 900], [702, 840]]
[[probe]]
name = "h-tree"
kind = "height"
pixels = [[1250, 860], [1252, 760]]
[[probe]]
name = "r-middle"
kind = "range"
pixels = [[960, 540]]
"""
DISTANCES = "".join(
    f'[[probe]]\nname = "d{k}"\nkind = "distance"\npixels = [[{300 + 60 * k}, {700 - 35 * k}], '
    f"[{1500 - 40 * k}, {700 - 35 * k}]]\n"
    for k in range(10)
)


def _legs(seconds: float) -> Trajectory:
    """Two seconds on the ground, a climb, then back and forth at 5 m/s and 40 m, looking 45 to 55 deg down."""
    waypoints = [(0.0, 0.0, 0.0, 0.0), (GROUND_S, 0.0, 0.0, 0.0), (GROUND_S + CLIMB_S, 0.0, 40.0, 0.0)]
    times = np.arange(GROUND_S + CLIMB_S + LEG_S, seconds + LEG_S, LEG_S)
    waypoints += [(time, 300.0 * (1 - number % 2), 40.0, 90.0 * number) for number, time in enumerate(times.tolist())]
    return fly(
        tuple(
            Waypoint(
                time_s=time,
                east_m=0.0,
                north_m=north,
                height_m=height,
                heading_rad=np.radians(heading),
                gimbal_pitch_rad=np.radians(-50.0 + 5.0 * (number % 3 - 1)),
            )
            for number, (time, north, height, heading) in enumerate(waypoints)
        ),
        origin=DEFAULT_ORIGIN,
        start_ns=EPOCH_NS,
    )


class Listed:
    """Events that are there already."""

    def __init__(self, events: list[Observation]) -> None:
        self._events = events

    def events(self) -> Iterator[Observation]:
        """All of them, by arrival."""
        return iter(self._events)


def write_recording(folder: Path, variant: str, seconds: float, rate_hz: float) -> None:
    """Record a flight's input, and nothing that it came to, as ``folder / variant``."""
    trajectory, autopilot = _legs(seconds), Autopilot(rates_hz=RATES_HZ)
    sent, landmarks = datagrams(trajectory, autopilot), ""
    if variant == "landmarks":
        landmarks = "".join(
            f'[[landmark]]\nname = "l{number}"\nposition_m = [{east}, {north}, 0.0]\nstd_m = 0.05\n'
            for number, (east, north) in enumerate(LANDMARKS_EN_M)
        )
    elif variant == "zoom":
        sent = sorted([*sent, *_zooms(autopilot, seconds)], key=lambda each: each.due_ns)
    log, config = folder / "flight.tlog", folder / "bench.toml"
    write_tlog(log, sent)
    text = f"{STATION}{ORIGIN}{CAMERA}\n{VARIANTS[variant]}[images]\nrate_hz = {rate_hz}\n{PROBES}{landmarks}"
    config.write_text(text)
    station = load_station(config)
    stamps = RateSource([(EPOCH_NS, EPOCH_NS + round(seconds * 1e9))], rate_hz)
    seen = list(_landmarks_seen(trajectory, station.pipeline.camera, seconds)) if landmarks else []
    sources = [TlogSource(log), DelayedSource(stamps, lateness_ns=LATENESS_NS), Listed(seen)]
    recorder = build_recorder(station, folder / variant, started_ns=EPOCH_NS, lossless=True)
    for batches in MergedFeed(sources, station.pipeline.tick_ns).batches():
        recorder.take(batches, StepOutputs())
    recorder.close()


def _landmarks_seen(trajectory: Trajectory, camera: Camera, seconds: float) -> Iterator[Observation]:
    """The landmark nearest to the middle of an image now and then, in flight."""
    places = np.array([(east, north, 0.0) for east, north in LANDMARKS_EN_M])
    draw = np.random.default_rng(1)
    for elapsed_s in np.arange(GROUND_S + CLIMB_S, seconds, 1 / LANDMARKS_HZ).tolist():
        stamp_ns = EPOCH_NS + round(elapsed_s * 1e9)
        pixels = pixels_of(camera, trajectory.pose(stamp_ns), places)
        off_px = np.hypot(*(pixels - [camera.width_px / 2, camera.height_px / 2]).T)
        if not np.any(off_px < camera.height_px / 2):
            continue
        nearest = int(np.nanargmin(off_px))
        yield Observation(
            name=f"l{nearest}",
            stamp_ns=stamp_ns,
            arrival_ns=stamp_ns + 2 * LATENESS_NS,
            pixels=(tuple((pixels[nearest] + draw.normal(0, 1.0, 2)).tolist()),),
            std_px=1.0,
        )


def _zooms(autopilot: Autopilot, seconds: float) -> Iterator[Datagram]:
    """What a camera says of its zoom, which goes up and down between 0 and 30 %."""
    mav = dialect.MAVLink(None, srcSystem=autopilot.system, srcComponent=CAMERA_COMPONENT)
    for elapsed_s in np.arange(0.5, seconds, 1 / ZOOM_HZ).tolist():
        boot_ms = round(autopilot.booted_ns / 1e6 + 1e3 * elapsed_s)
        level = 15.0 * (1 - math.cos(2 * math.pi * elapsed_s / 60.0))
        message = dialect.MAVLink_camera_settings_message(boot_ms, 1, zoomLevel=level, focusLevel=math.nan)
        yield Datagram(due_ns=EPOCH_NS + round(elapsed_s * 1e9), data=bytes(message.pack(mav)))


def import_log(folder: Path, log: Path, rate_hz: float) -> float:
    """Record an autopilot's log with ten distances, as ``folder / "log"``; its length in seconds."""
    config = folder / "bench.toml"
    config.write_text(f"{STATION}{CAMERA}\n[telemetry]\n[images]\nrate_hz = {rate_hz}\n{DISTANCES}")
    command = ["import", str(log), "--config", str(config), "-o", str(folder / "log"), "--json"]
    said = subprocess.run([sys.executable, "-m", "aerodft", *command], check=True, capture_output=True)
    return json.loads(said.stdout)["images"] / rate_hz


def _timed(title: str, seconds: float, source: Path, target: Path) -> float:
    """Recompute in a process of its own on one processor, and print what it took of that (s) and of memory."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "aerodft", "recompute", str(source), "-o", str(target)]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
        os.sched_setaffinity(process.pid, {max(os.sched_getaffinity(0))})  # threads on two would slow each other down
        said = process.stderr.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(said)
    cpu_s, peak_mb = used.ru_utime + used.ru_stime, used.ru_maxrss / 1024
    size_mb = sum(path.stat().st_size for path in target.iterdir()) / 1e6
    ratio = f"{seconds / cpu_s:.0f} times real time ({cpu_s:.1f} s of processor)"
    print(f"{title}: {ratio}, {peak_mb:.0f} MB, {size_mb:.0f} MB on disk", flush=True)
    return cpu_s


def _flights(args: argparse.Namespace, kept: Path, folder: Path) -> None:
    """Recompute the flights, and hold them against the first one."""
    home_s = math.nan
    for variant in [args.only] if args.only else VARIANTS:
        if not (kept / variant).exists():  # in a process of its own: a child's peak memory counts what its parent had
            line = [__file__, "--seconds", args.seconds, "--rate", args.rate, "--keep", kept.parent, "--make", variant]
            subprocess.run([sys.executable, *map(str, line)], check=True)
        cpu_s = _timed(f"{variant}, from input alone", args.seconds, kept / variant, folder / variant)
        if variant == "home":
            home_s = cpu_s
            _timed("home, recompute", args.seconds, folder / variant, folder / "again")
            print(f"home: the goals are {GOAL:g} times real time on one core and {GOAL_MB:g} MB", flush=True)
        else:
            print(f"{variant}: {cpu_s / home_s:.2f} of home's processor time; goal {GOAL_OF_HOME:g}", flush=True)


def _ticks(folder: Path) -> None:
    """Print what the pipeline takes for each tick in which the images and probes of a flight are measured."""
    recording = Recording(folder)
    station = recorded_station(recording)
    pipeline, times_ms = build_pipeline(station), []
    pipeline.warm_up()
    feed = MergedFeed([RecordingSource(recording)], station.pipeline.tick_ns, longest_ns=0)
    for batches in islice(feed.batches(), TICKS):
        start_s = time.process_time()
        outputs = pipeline.advance(batches)
        times_ms.append((time.process_time() - start_s) * 1e3 if outputs.images else math.nan)
    p50, p99 = np.nanpercentile(times_ms[SETTLED_TICK:], [50, 99])
    print(f"a tick of one image with ten probes: p50 {p50:.1f} ms, p99 {p99:.1f} ms; the goal is {GOAL_TICK_MS:g} ms")


def main(arguments: list[str] | None = None) -> None:
    """Print the multiples of real time, memory, and with ``--profile`` where the time goes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--rate", type=float, default=30.0)
    parser.add_argument("--log", type=Path, help="an autopilot's telemetry log")
    parser.add_argument("--ticks", action="store_true", help="also tick by tick, as live")
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--only", choices=VARIANTS, help="one of the flights alone")
    parser.add_argument("--keep", type=Path, help="folder to work in; a flight that is there is used again")
    parser.add_argument("--make", choices=VARIANTS, help="only record this flight")
    args = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(dir=args.keep) as name:
        kept = (args.keep or Path(name)) / f"{args.seconds:g}-{args.rate:g}"
        kept.mkdir(exist_ok=True)
        if args.make:
            write_recording(kept, args.make, args.seconds, args.rate)
            return
        images = int(np.ceil(args.seconds * args.rate))
        print(
            f"{args.seconds:g} s, {sum(RATES_HZ.values()):g} messages/s, 10 probes at {args.rate:g}/s: {images} images"
        )
        _flights(args, kept, Path(name))
        if args.ticks:
            _ticks(kept / (args.only or "home"))
        if args.log:
            length_s = import_log(Path(name), args.log, args.rate)
            _timed(f"{args.log.name}, {length_s:.0f} s, recompute", length_s, Path(name) / "log", Path(name) / "logged")
            print(f"{args.log.name}: the goal is {GOAL_OF_LOG:g} times real time", flush=True)
        if args.profile:
            with cProfile.Profile() as profile:
                recompute(kept / (args.only or "home"), Path(name) / "profiled")
            pstats.Stats(profile).sort_stats("tottime").print_stats(30)


if __name__ == "__main__":
    main()
