"""Whatever a live flight compiles is compiled before it: on the very first run that took 5 s out of the flight."""

import signal
import time
from pathlib import Path

from tests.cli import serving
from tests.faults.live_flight import Flight


def test_nothing_is_compiled_once_the_service_runs(tmp_path: Path) -> None:
    flight = Flight(tmp_path / "flight", program=(serving.__file__,))
    with flight.served(flight.recording) as (process, quiet):
        time.sleep(2.5)
        quiet()
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0
    said = (flight.folder / "said").read_text().splitlines()
    late = [line for line in said if line.startswith(serving.WORD)]
    assert len(late) == 1, late
    assert int(late[0].split()[-1]) > 10, "what was compiled before"
