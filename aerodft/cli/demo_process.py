"""Processes of the demo that end with it, also where the demo is killed: their standard input ends then.

``python -m aerodft.cli.demo_process -m MODULE ARGUMENTS`` runs a module so, with a pipe that only the demo holds the
other end of; ``... listen ENDPOINT STATION FILE`` writes a station's measurements from the bus as JSON lines.
"""

import os
import runpy
import signal
import sys
import threading
from pathlib import Path


def listen(endpoint: str, station: str, path: Path) -> int:
    """Write every measurement that comes until SIGTERM; returns how many there were."""
    import zenoh

    from aerodft.adapters.bus import session_on
    from aerodft.cli.interrupts import wait_in_main_thread

    done = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: done.set())
    received = 0
    with path.open("wb") as out, session_on(None, [endpoint]) as session:

        def write(sample: zenoh.Sample) -> None:
            nonlocal received
            received += 1
            out.write(sample.payload.to_bytes() + b"\n")

        subscriber = session.declare_subscriber(f"aerodft/{station}/measurement/*", write)
        wait_in_main_thread(done)
        subscriber.undeclare()
    return received


def _end_with_parent() -> None:
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)  # which all of the demo's processes take as the end


def main() -> None:
    """Listen, or run the module that the arguments name as if it had been started itself."""
    if sys.argv[1] == "listen":
        listen(sys.argv[2], sys.argv[3], Path(sys.argv[4]))
        return
    module = sys.argv[2]
    sys.argv = sys.argv[2:]
    threading.Thread(target=_end_with_parent, name="end-with-parent", daemon=True).start()
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
