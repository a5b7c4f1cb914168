"""How fast a recorded flight is imported and recomputed, as a multiple of real time, and where the time goes.

``python tests/bench/bench_import.py [--seconds 600] [--probes 10] [--rate 30]``: a simulated flight that sends 195
messages a second, evaluated without images.
"""

import argparse
import cProfile
import pstats
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from aerodft.adapters.config.station import load_station
from aerodft.app.assembly import RunStatistics, build_pipeline, run
from aerodft.app.importing import import_flight, open_flight
from aerodft.app.recompute import recompute
from aerodft.service import MergedFeed
from aerodft.sim import Autopilot, datagrams
from aerodft.sim.scenario import EPOCH_NS
from aerodft.sim.telemetry import write_tlog
from aerodft.sim.trajectory import survey
from aerodft.sim.world import DEFAULT_ORIGIN, River

RATES_HZ = {
    "HEARTBEAT": 1.0,
    "SYSTEM_TIME": 2.0,
    "ATTITUDE": 50.0,
    "GLOBAL_POSITION_INT": 50.0,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": 50.0,
    "DISTANCE_SENSOR": 20.0,
    "TERRAIN_REPORT": 12.0,
    "GPS_RAW_INT": 10.0,
}
CAMERA = """
[camera]
name = "bench"
width_px = 1920
height_px = 1080
fx_px = 1598.0
fy_px = 1598.0
cx_px = 959.5
cy_px = 539.5
distortion = [-0.08, 0.02, 0.0005, -0.0003, 0.0]
"""


def write_flight(folder: Path, seconds: float, probes: int, rate_hz: float) -> tuple[Path, Path]:
    """Simulate the flight; returns its log and a configuration that measures it."""
    river = River(origin_en_m=(0.0, -26.0))
    flight = survey(river, origin=DEFAULT_ORIGIN, duration_s=seconds, start_ns=EPOCH_NS)
    write_tlog(folder / "flight.tlog", datagrams(flight, Autopilot(rates_hz=RATES_HZ)))
    text = f'[station]\nname = "bench"\n{CAMERA}\n[telemetry.height]\norder = ["home"]\n[images]\nrate_hz = {rate_hz}\n'
    for number in range(probes):
        u_px = 300 + 100 * number
        text += f'[[probe]]\nname = "p{number}"\n'
        if number % 2:
            text += f'kind = "distance"\npixels = [[{u_px}, 400], [{u_px + 200}, 700]]\n'
        else:
            text += f'kind = "position"\npixels = [[{u_px}, 600]]\n'
    (folder / "bench.toml").write_text(text)
    return folder / "flight.tlog", folder / "bench.toml"


def _timed(title: str, seconds: float, work: Callable[[], object]) -> None:
    start_s, cpu_s = time.perf_counter(), time.process_time()
    work()
    took_s, cpu_s = time.perf_counter() - start_s, time.process_time() - cpu_s
    print(
        f"{title:24} {took_s:7.2f} s, {cpu_s:7.2f} s of processor, {seconds / took_s:6.1f} times real time", flush=True
    )


def _measure_alone(log: Path, config: Path) -> RunStatistics:
    station, statistics = load_station(config), RunStatistics()
    flight = open_flight(station, log)
    run(MergedFeed(flight.sources, station.pipeline.tick_ns), build_pipeline(station), (statistics,))
    return statistics


def main(arguments: list[str] | None = None) -> None:
    """Print the multiples of real time, and a profile of the measuring."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--probes", type=int, default=10)
    parser.add_argument("--rate", type=float, default=30.0)
    args = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log, config = write_flight(folder, args.seconds, args.probes, args.rate)
        print(f"{args.seconds:g} s, {sum(RATES_HZ.values()):g} messages/s, {args.probes} probes at {args.rate:g}/s")
        _timed("measure, not recorded", args.seconds, lambda: _measure_alone(log, config))
        _timed("import", args.seconds, lambda: import_flight(log, station=config, output=folder / "a"))
        _timed("recompute", args.seconds, lambda: recompute(folder / "a", folder / "b"))
        with cProfile.Profile() as profile:
            _measure_alone(log, config)
        pstats.Stats(profile).sort_stats("tottime").print_stats(15)


if __name__ == "__main__":
    main()
