"""A subscriber in a process of its own: every measurement of a station on the bus, as JSON lines.

``python -m aerodft.cli.demo_listener tcp/127.0.0.1:7447 demo received.jsonl``
"""

import signal
import sys
import threading
from pathlib import Path

import zenoh

from aerodft.adapters.bus import session_on


def listen(endpoint: str, station: str, path: Path) -> int:
    """Write every measurement that comes until SIGTERM; returns how many there were."""
    done = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: done.set())
    received = 0
    with path.open("wb") as out, session_on(None, [endpoint]) as session:

        def take(sample: zenoh.Sample) -> None:
            nonlocal received
            received += 1
            out.write(sample.payload.to_bytes() + b"\n")

        subscriber = session.declare_subscriber(f"aerodft/{station}/measurement/*", take)
        done.wait()
        subscriber.undeclare()  # type: ignore[no-untyped-call]  # zenoh is annotated in part
    return received


if __name__ == "__main__":
    listen(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
