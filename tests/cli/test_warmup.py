"""Whatever a live flight compiles is compiled before it: on the very first run that took 5 s out of the flight."""

import signal
import time
from pathlib import Path

import orjson

from aerodft.adapters.bus import session_on
from tests.cli import serving
from tests.faults.live_flight import Flight
from tests.ports import free_endpoint


def test_nothing_is_compiled_once_the_service_runs(tmp_path: Path) -> None:
    """Nor when somebody asks for what no probe of the station measures."""
    endpoint = free_endpoint()
    tables = {"zenoh": {"listen": endpoint}}
    flight = Flight(tmp_path / "flight", tables, program=(serving.__file__,))
    with flight.served(flight.recording) as (process, quiet), session_on(None, (endpoint,)) as session:
        time.sleep(2.0)
        question = orjson.dumps({"kind": "width", "pixels": [[250, 180], [390, 180]]})
        replies = session.get("aerodft/killed/measure", payload=question, timeout=10)
        ((answer,),) = [orjson.loads(reply.ok.payload.to_bytes()) for reply in replies]
        quiet()
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0
    said = (flight.folder / "said").read_text().splitlines()
    late = [line for line in said if line.startswith(serving.WORD)]
    assert answer["status"] == "ok"
    assert len(late) == 1, late
    assert int(late[0].split()[-1]) > 10, "what was compiled before"
