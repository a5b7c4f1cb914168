"""``serve`` killed, ended and started again while telemetry and images come in.

``AERODFT_FAULTS=full`` is what a release is held to: 200 kills, 30 ends; a few minutes.
"""

import os
import random
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import orjson
import pytest
from mcap.reader import make_reader
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.recording.recover import recover_folder
from aerodft.conventions import SECOND_NS
from replay.recordings import Recording
from tests.nights import at_night

from .live_flight import IMAGES_HZ, Flight

IS_FULL = os.environ.get("AERODFT_FAULTS") == "full"
IS_ALONE = "PYTEST_XDIST_WORKER" not in os.environ
KILLS, ENDS = (200, 30) if IS_FULL else (20, 4)  # at night
AT_ONCE = 3
SHORTEST_S, LONGEST_S = 1.5, 4.0
MOST_LOST_S = 0.6


def numbers_in(recording: Recording) -> list[tuple[int, int]]:
    """Number and arrival of each recorded frame."""
    mav = dialect.MAVLink(None)
    mav.robust_parsing = True
    found = []
    for each in recording.messages():
        if each.channel.encoding == "mavlink":
            (decoded,) = mav.parse_buffer(each.data)
            found.append((decoded.time_boot_ms // 5, each.log_ns))
    return found


def is_lossy(folder: Path) -> bool:
    return recover_folder(folder).is_lossy


def check_stock(folder: Path) -> None:
    for path in folder.glob("*.mcap"):
        with path.open("rb") as file:
            assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) > 0


def killed(folder: Path, seconds: float) -> dict[str, float]:
    flight = Flight(folder)
    at_ns, _, _ = flight.fly(seconds, signal.SIGKILL)
    assert is_lossy(flight.recording), "what came last"
    assert not is_lossy(flight.recording), "nothing more"
    check_stock(flight.recording)
    recording = Recording(flight.recording)
    frames = numbers_in(recording)
    assert [number for number, _ in frames] == list(range(frames[0][0], frames[0][0] + len(frames)))
    made = [orjson.loads(payload) for payload in recording.measurements()]
    images = [orjson.loads(m.data)["index"] for m in recording.messages() if m.channel.schema == "aerodft.image/1"]
    assert images == sorted(set(images)), "none twice; a busy machine may have left some out before they came here"
    steps_s = np.diff([int(each["stamp_ns"]) for each in made]) / SECOND_NS
    assert all(steps_s > 0)
    assert len(images) - 1.5 * IMAGES_HZ < len(made) <= len(images), "but for those that still waited for a pose"
    sent = [number for number, when_ns in flight.sent if when_ns < at_ns]
    return {
        "lost_s": (at_ns - frames[-1][1]) / SECOND_NS,
        "rate_hz": (len(sent) - 1) / max(seconds, 1e-9),
        "made_hz": (len(made) - 1) / (sum(steps_s) or 1.0),
    }


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("count", [1, *at_night(KILLS)])
def test_a_kill_costs_half_a_second(tmp_path: Path, count: int) -> None:
    rng = random.Random(7)  # noqa: S311 - moments, no secrets
    moments = [rng.uniform(SHORTEST_S, LONGEST_S) for _ in range(count)]
    with ThreadPoolExecutor(AT_ONCE) as pool:
        figures = list(pool.map(killed, [tmp_path / f"{k}" for k in range(count)], moments))
    lost_s = [each["lost_s"] for each in figures]
    rates = [each["rate_hz"] for each in figures]
    made = [each["made_hz"] for each in figures]
    rate = f"{np.median(rates):.0f} messages/s and {np.median(made):.1f} measurements/s"
    print(
        f"\n{count} kills at {rate}: every file opens; lost {np.median(lost_s):.2f} s (median),"
        f" {max(lost_s):.2f} s (most); no duplicate, no gap"
    )
    assert max(lost_s) <= MOST_LOST_S * (1 if IS_FULL and IS_ALONE else 3)  # other tests run beside this one


def ended(folder: Path, seconds: float) -> dict[str, float]:
    flight = Flight(folder)
    _, took_s, code = flight.fly(seconds, signal.SIGTERM)
    assert code == 0, (folder / "said").read_text()
    assert not is_lossy(flight.recording)
    check_stock(flight.recording)
    frames = [number for number, _ in numbers_in(Recording(flight.recording))]
    assert frames == [number for number, _ in flight.sent], "all of them, once, in order"
    return {"took_s": took_s, "frames": len(frames)}


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("count", [1, *at_night(ENDS)])
def test_a_service_that_is_ended_loses_nothing(tmp_path: Path, count: int) -> None:
    rng = random.Random(8)  # noqa: S311
    moments = [rng.uniform(SHORTEST_S, LONGEST_S) for _ in range(count)]
    with ThreadPoolExecutor(2) as pool:
        figures = list(pool.map(ended, [tmp_path / f"{k}" for k in range(count)], moments))
    took_s = [each["took_s"] for each in figures]
    frames = sum(each["frames"] for each in figures)
    print(f"\n{count} SIGTERMs: none of {frames:.0f} messages lost; ended after {max(took_s):.2f} s at most")


if __name__ == "__main__":
    pytest.main([__file__, "-s", "-q"])
