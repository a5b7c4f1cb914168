"""Lying telemetry: what the log itself contradicts is refused or wide, never ``ok`` with a narrow interval.

Each kind of lie of ``tests/truth/lying_flights.py`` is flown and imported. Of its ``ok`` intervals at most 1 % miss the
truth by more than 3 standard deviations. Honest flights of the same curves keep 99 % of their images ``ok`` once the
vehicle is in the air.

Not flown, because nothing in the log contradicts it:

- a constant offset of a gimbal's yaw, pitch or roll, or a wrong scale of its angles, that all of its messages share;
- reports of a gimbal that follow its demands while the gimbal stands still, or that are all late;
- an offset of the heading that ATTITUDE and GLOBAL_POSITION_INT share;
- a position that the receiver and the estimator share, and a lie about it where GPS_RAW_INT is not in the log;
- a home that is not as high above the measured plane as configured;
- an offset that all clocks share.
"""

from pathlib import Path

import numpy as np
import pytest

import aerodft as ad
from tests.nights import at_night
from tests.truth.lying_flights import HONEST, LIES, RATE_HZ, STATION, Floats, Kind, write

MAX_MISS_STDS, MAX_MISS_SHARE, MIN_OK_SHARE = 3.0, 0.01, 0.99
CHI2_2D_OF_3_STDS = 11.829  # as likely to be exceeded by two standard normals' squares as 3 std by one
AIRBORNE_S = 24.0
MAX_GAP_S = 1.0
BY_DAY = (
    "pitch is negated",
    "yaw is off by 60 deg",
    "roll and pitch are zero",
    "heading is off by 90 deg",
    "position is frozen",
    "swapped from the start",
    "time since boot is frozen",
    "UTC steps by 10 s",
)
SEEDS = (1, *at_night(2, 3))


def fly(folder: Path, seed: int, kind: Kind) -> tuple[int, dict[str, Floats], int]:
    """Import a flight.

    Returns:
        Number of answers in the air; by probe how many standard deviations each ``ok`` one is off; number of these.
    """
    flight, came_s, made_s = write(folder / "lie.tlog", seed, kind)
    (folder / "station.toml").write_text(STATION)
    try:
        ad.import_flight(folder / "lie.tlog", station=folder / "station.toml", output=folder / "out")
    except ad.NoAnswerError:
        return 0, {}, 0
    rows = list(ad.open_recording(folder / "out").measurements())
    probes = len({row["name"] for row in rows})
    host_s = came_s[0] + np.arange(len(rows)) // probes / RATE_HZ
    at_s = np.interp(host_s, came_s, made_s)
    after = np.minimum(np.searchsorted(came_s, host_s), len(came_s) - 1)
    is_gap = came_s[after] - came_s[after - 1] > MAX_GAP_S  # the recording machine's clock was never there
    truth, misses, images, ok = flight.truth(at_s), {}, 0, 0
    truth["place from foot"] = truth["place"] - flight.enu_m(at_s)[:, :2]
    assert abs(len(rows) / probes / RATE_HZ - (came_s[-1] - came_s[0])) < 1
    for number, row in enumerate(rows):
        if at_s[number] < AIRBORNE_S or is_gap[number]:
            continue
        images += 1
        if row["status"] != "ok":
            continue
        ok += 1
        is_relative = row["kind"] == "position" and row["lat_deg"] is None  # the place is not stated
        true = truth["place from foot" if is_relative else row["name"]][number]
        misses.setdefault(row["name"], []).append(_miss_stds(row, true))
    return images, {name: np.array(each) for name, each in misses.items()}, ok


def _miss_stds(row: dict[str, object], truth: Floats) -> float:
    """How far a measurement is from the truth; of a place the distance in units of which 3 are as rare as 3 std."""
    if row["kind"] != "position":
        return abs(row["value"] - truth) / row["std"]
    off = np.array(row["enu_m"][0][:2]) - truth
    shared = row["cov_east_north_m2"]
    cov = np.array([[row["cov_east_m2"], shared], [shared, row["cov_north_m2"]]])
    return float(np.sqrt(off @ np.linalg.solve(cov, off) * MAX_MISS_STDS**2 / CHI2_2D_OF_3_STDS))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", [*BY_DAY, *at_night(*(name for name in LIES if name not in BY_DAY))])
def test_a_lie_gives_no_narrow_interval(tmp_path: Path, name: str, seed: int) -> None:
    _, misses, ok = fly(tmp_path, seed, LIES[name])
    missed = {probe: int(np.count_nonzero(each > MAX_MISS_STDS)) for probe, each in misses.items()}
    assert sum(missed.values()) <= MAX_MISS_SHARE * ok, f"{missed} of {ok} ok intervals"


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ["honest", *at_night(*(name for name in HONEST if name != "honest"))])
def test_an_honest_flight_is_measured(tmp_path: Path, name: str, seed: int) -> None:
    images, misses, ok = fly(tmp_path, seed, HONEST[name])
    assert images > 100
    assert ok >= MIN_OK_SHARE * images
    missed = sum(int(np.count_nonzero(each > MAX_MISS_STDS)) for each in misses.values())
    assert missed <= MAX_MISS_SHARE * ok
