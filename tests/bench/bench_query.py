"""Round trips of a ``measure`` query on loopback, to a live service that is at work: p50 and p99 (goal: p99 <= 10 ms).

``python tests/bench/bench_query.py [--queries 3000] [--rate 30] [--probes 10]``: the service is ``aerodft serve`` with
a fixed camera, which measures its probes, publishes and records all the while; the client is this process.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import zenoh

sys.path.insert(0, str(Path(__file__).parents[2]))

from aerodft.adapters.bus import session_on
from tests.ports import free_endpoint

GOAL_MS = 10.0
STATION = """
[station]
name = "bench"
[camera]
name = "bench"
width_px = 1920
height_px = 1080
fx_px = 1598.0
fy_px = 1598.0
cx_px = 959.5
cy_px = 539.5
distortion = [-0.08, 0.02, 0.0005, -0.0003, 0.0]
[pose]
height_agl_m = 12.0
tilt_deg = 55.0
[record]
image_hz = 0
"""


def _write_station(path: Path, endpoint: str, rate_hz: float, probes: int) -> None:
    text = f'{STATION}[images]\nrate_hz = {rate_hz}\n[zenoh]\nlisten = "{endpoint}"\n'
    for number in range(probes):
        text += f'[[probe]]\nname = "p{number}"\nkind = "position"\npixels = [[{300 + 100 * number}, 600]]\n'
    path.write_text(text)


@contextmanager
def _service(folder: Path, endpoint: str, rate_hz: float, probes: int) -> Iterator[None]:
    """``aerodft serve`` in a process of its own."""
    _write_station(folder / "station.toml", endpoint, rate_hz, probes)
    command = [sys.executable, "-m", "aerodft", "serve", str(folder / "station.toml"), "-o", str(folder / "recording")]
    with (folder / "said.txt").open("wb") as said:
        process = subprocess.Popen(command, stdout=said, stderr=said)
        try:
            yield
        finally:
            process.terminate()
            code = process.wait(30)
    if code != 0:
        sys.exit((folder / "said.txt").read_text())


def _ask(session: zenoh.Session, u_px: float) -> dict:
    question = json.dumps({"kind": "distance", "pixels": [[u_px, 604.5], [u_px + 500, 611]]}).encode()
    replies = list(session.get("aerodft/bench/measure", payload=question))
    return json.loads(replies[0].ok.payload.to_bytes())[0] if replies and replies[0].ok else {}


def _wait_for_answer(session: zenoh.Session) -> None:
    until_s = time.monotonic() + 30
    while "value" not in _ask(session, 800.0):
        if time.monotonic() > until_s:
            sys.exit("the service does not answer")
        time.sleep(0.05)


def _round_trips_ms(session: zenoh.Session, count: int) -> list[float]:
    times_ms = []
    for number in range(count):
        start_s = time.perf_counter()
        answer = _ask(session, 700.0 + number % 500)
        times_ms.append((time.perf_counter() - start_s) * 1e3)
        if not answer.get("value"):
            sys.exit(f"no number: {answer}")
    return times_ms


def main(arguments: list[str] | None = None) -> None:
    """Print the percentiles, and how many measurements the service made meanwhile."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--queries", type=int, default=3000)
    parser.add_argument("--rate", type=float, default=30.0)
    parser.add_argument("--probes", type=int, default=10)
    args = parser.parse_args(arguments)
    endpoint = free_endpoint()
    with tempfile.TemporaryDirectory() as name, _service(Path(name), endpoint, args.rate, args.probes):
        received: list[int] = []
        with session_on(None, [endpoint]) as session:
            _wait_for_answer(session)
            subscriber = session.declare_subscriber("aerodft/bench/measurement/*", lambda _: received.append(1))
            start_s = time.perf_counter()
            times_ms = _round_trips_ms(session, args.queries)
            took_s = time.perf_counter() - start_s
            subscriber.undeclare()
    p50, p99, worst = np.percentile(times_ms, [50, 99, 100])
    print(f"{args.queries} measure queries while {len(received) / took_s:.0f} measurements/s were made and published:")
    verdict = "within" if p99 <= GOAL_MS else "beyond"
    print(f"p50 {p50:.2f} ms, p99 {p99:.2f} ms, worst {worst:.2f} ms; p99 is {verdict} the goal of {GOAL_MS:g} ms")


if __name__ == "__main__":
    main()
