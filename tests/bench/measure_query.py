"""Round trips of a ``measure`` query on loopback: prints p50 and p99 in milliseconds (goal: p99 below 10).

Run with ``python tests/bench/measure_query.py [N]``; the client is this process, the service another one.
"""

import json
import subprocess
import sys
import time

import numpy as np

from aerodft.adapters.zenoh.session import free_endpoint, session_on

SERVICE = """
import sys
from aerodft.adapters.zenoh.bus import BusSettings, ZenohBus
bus = ZenohBus(BusSettings(station="s", listen=sys.argv[1]), on_measure=lambda request: [])
print("ready", flush=True)
sys.stdin.read()
bus.close()
"""


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    endpoint = free_endpoint()
    question = json.dumps({"kind": "distance", "pixels": [[812, 604.5], [1377, 611]]}).encode()
    with subprocess.Popen(
        [sys.executable, "-c", SERVICE, endpoint], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as service:
        assert service.stdout is not None
        service.stdout.readline()
        with session_on(None, [endpoint]) as session:
            times_ms: list[float] = []
            for _ in range(count):
                start_s = time.perf_counter()
                replies = list(session.get("aerodft/s/measure", payload=question))
                times_ms.append((time.perf_counter() - start_s) * 1e3)
                assert len(replies) == 1
                assert replies[0].ok is not None
        assert service.stdin is not None
        service.stdin.close()
    p50_ms, p99_ms = np.percentile(times_ms, [50, 99])
    print(f"measure query, {count} round trips: p50 {p50_ms:.2f} ms, p99 {p99_ms:.2f} ms")


if __name__ == "__main__":
    main()
