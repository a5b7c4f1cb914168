"""How fast a recorded flight is computed again, as a multiple of real time, its memory, and where the time goes.

``python tests/bench/bench_recompute.py [--seconds 3600] [--rate 30] [--profile]``: a simulated flight of 195 messages a
second without images, ten fixed probes of five kinds with joint covariance. The flight is recorded, and ``aerodft
recompute`` makes a recording of it in a process of its own (goal: 300 times real time of one core, 300 MB); then
another one of that, so that what is read holds measurements as well.
"""

import argparse
import cProfile
import os
import pstats
import runpy
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from aerodft.adapters.config.loading import load_station
from aerodft.adapters.images.rate import RateSource
from aerodft.adapters.mavlink.tlog import TlogSource
from aerodft.cli.recompute import recompute
from aerodft.cli.wiring import Late, build_recorder
from aerodft.service.feed import MergedFeed
from aerodft.service.outputs import StepOutputs
from aerodft.sim.plan import Waypoint, fly
from aerodft.sim.scenario import EPOCH_NS
from aerodft.sim.telemetry import Autopilot, datagrams, write_tlog
from aerodft.sim.trajectory import Trajectory
from aerodft.sim.world import DEFAULT_ORIGIN

BENCH_IMPORT = runpy.run_path(str(Path(__file__).with_name("bench_import.py")))
CAMERA, RATES_HZ = BENCH_IMPORT["CAMERA"], BENCH_IMPORT["RATES_HZ"]
GOAL, GOAL_MB = 300.0, 300.0
LEG_S, GROUND_S = 60.0, 2.0
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


def _legs(seconds: float) -> Trajectory:
    """Two seconds on the ground, a climb, then back and forth at 5 m/s and 40 m, looking 45 to 55 deg down."""
    waypoints = [(0.0, 0.0, 0.0, 0.0), (GROUND_S, 0.0, 0.0, 0.0), (GROUND_S + 10.0, 0.0, 40.0, 0.0)]
    times = np.arange(GROUND_S + 10.0 + LEG_S, seconds + LEG_S, LEG_S)
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


def write_recording(folder: Path, seconds: float, rate_hz: float) -> Path:
    """Record a flight's input, and nothing that it came to."""
    config = folder / "bench.toml"
    config.write_text(
        f'[station]\nname = "bench"\n{CAMERA}\n[telemetry.height]\norder = ["home"]\n'
        f"[images]\nrate_hz = {rate_hz}\n{PROBES}"
    )
    log = folder / "flight.tlog"
    write_tlog(log, datagrams(_legs(seconds), Autopilot(rates_hz=RATES_HZ)))
    station = load_station(config)
    stamps = RateSource([(EPOCH_NS, EPOCH_NS + round(seconds * 1e9))], rate_hz)
    feed = MergedFeed([TlogSource(log), Late(stamps, lateness_ns=LATENESS_NS)], station.pipeline.tick_ns)
    recorder = build_recorder(station, folder / "flight", started_ns=EPOCH_NS, lossless=True)
    for batch in feed.batches():
        recorder.take(batch, StepOutputs())
    recorder.close()
    return folder / "flight"


def _timed(title: str, seconds: float, source: Path, target: Path) -> None:
    """Recompute in a process of its own on one processor, and print what it took of that and of memory."""
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
    ratio = seconds / cpu_s
    size_mb = sum(path.stat().st_size for path in target.iterdir()) / 1e6
    print(
        f"{title}: {ratio:.0f} times real time ({cpu_s:.1f} s of processor), {peak_mb:.0f} MB, {size_mb:.0f} MB on disk"
    )
    verdict = "within" if ratio >= GOAL and peak_mb < GOAL_MB else "beyond"
    print(f"{title}: {verdict} the goals of {GOAL:g} times real time on one core and {GOAL_MB:g} MB", flush=True)


def main(arguments: list[str] | None = None) -> None:
    """Print the multiples of real time, memory, and with ``--profile`` where the time goes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--rate", type=float, default=30.0)
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--keep", type=Path, help="folder to work in; a flight that is there is used again")
    parser.add_argument("--make", action="store_true", help="only record the flight")
    parser.add_argument("--write", type=Path, help="only write the flight, into this folder")
    args = parser.parse_args(arguments)
    if args.write is not None:
        write_recording(args.write, args.seconds, args.rate)
        return
    with tempfile.TemporaryDirectory(dir=args.keep) as name:
        kept = (args.keep or Path(name)) / f"{args.seconds:g}-{args.rate:g}"
        kept.mkdir(exist_ok=True)
        source = kept / "flight"
        if args.make:
            write_recording(kept, args.seconds, args.rate)
            return
        if not source.exists():  # in a process of its own: a child's peak memory counts what its parent had
            line = [__file__, "--seconds", args.seconds, "--rate", args.rate, "--keep", kept.parent, "--make"]
            subprocess.run([sys.executable, *map(str, line)], check=True)
        images = int(np.ceil(args.seconds * args.rate))
        print(
            f"{args.seconds:g} s, {sum(RATES_HZ.values()):g} messages/s, 10 probes at {args.rate:g}/s: {images} images"
        )
        _timed("from input alone", args.seconds, source, Path(name) / "a")
        _timed("recompute", args.seconds, Path(name) / "a", Path(name) / "b")
        if args.profile:
            with cProfile.Profile() as profile:
                recompute([str(Path(name) / "a")], Path(name) / "c")
            pstats.Stats(profile).sort_stats("tottime").print_stats(30)


if __name__ == "__main__":
    main()
