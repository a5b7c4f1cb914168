"""What doctor says of heights that disagree, of clocks that jump, and of two vehicles that are one."""

from pathlib import Path

import pytest

from aerodft.app.diagnose import diagnose
from aerodft.diagnosis.findings import clock_document, clock_sentences
from aerodft.diagnosis.flight_checks import HeightPairs
from aerodft.diagnosis.log_diagnosis import ClockSummary
from aerodft.model import HeightDifference, HeightSource
from aerodft.service.clocks import ClockHealth

SECOND = 1_000_000_000
QUIET = ClockHealth(drift=2.5e-6, restarts=0, wraps=0, jumps_s=(), left_out=0, rivals=False)
KNOWN = ClockSummary(known_after_s=0.0, host_minus_utc_s=0.0, reboots_at_s=(236.2,), jumps_at_s=(30.0, 41.0))


def difference(
    second: float,
    step_m: float,
    std_m: float = 1.0,
    *,
    source: HeightSource = HeightSource.RANGEFINDER,
    other: HeightSource = HeightSource.HOME,
) -> HeightDifference:
    return HeightDifference(
        stamp_ns=round(second * SECOND),
        source=source,
        other=other,
        height_m=40.0,
        other_m=40.0 + step_m,
        std_m=std_m,
    )


def test_a_pair_is_compared_once_a_second() -> None:
    pairs = HeightPairs()
    for k in range(40):
        pairs.add([difference(k / 4, float(k // 4))])
    (document,) = pairs.documents()
    assert document == {
        "source": "rangefinder",
        "other": "home",
        "compared": 10,
        "beyond_std": 8,
        "step_median_m": 4.5,
        "step_low_m": 0.0,
        "step_high_m": 9.0,
    }
    (sentence,) = pairs.sentences()
    assert "home is 4.50 m above rangefinder in the median (+0.00 to +9.00 m)" in sentence
    assert "beyond their std in 8 of 10 comparisons" in sentence


def test_noise_is_no_disagreement() -> None:
    pairs = HeightPairs()
    for k in range(40):
        pairs.add([difference(k, 3.0 if k == 7 else 0.5)])
    assert pairs.sentences() == []


@pytest.mark.parametrize(
    ("step_m", "added_m", "said"),
    [
        (-6.0, 0.0, "home is 6.00 m below rangefinder and 6.00 m below terrain in the median"),
        (-6.0, 0.0, "set telemetry.height.home_above_plane_m = 6"),
        (4.0, 1.5, "set telemetry.height.home_above_plane_m = -2.5"),
    ],
)
def test_a_source_that_is_alone_is_one_sentence_with_what_to_set(step_m: float, added_m: float, said: str) -> None:
    pairs, (rangefinder, terrain) = HeightPairs(), (HeightSource.RANGEFINDER, HeightSource.TERRAIN)
    for k in range(20):
        pairs.add([difference(k, 0.1, source=rangefinder, other=terrain)])
        pairs.add([difference(k, step_m, source=rangefinder), difference(k, step_m, source=terrain)])
    (sentence,) = pairs.sentences(added_m)
    assert said in sentence
    assert "beyond their std in 20 of 20 and 20 of 20 comparisons, while rangefinder and terrain agree" in sentence


def test_clocks_without_trouble_are_not_talked_about() -> None:
    assert clock_sentences(QUIET, KNOWN) == []
    assert clock_document(QUIET, KNOWN)["drift_ppm"] == 2.5


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"jumps_s": (18.0, -0.25)}, "the vehicle's UTC jumped by +18.000 s, -0.250 s about 30, 41 s after the start"),
        ({"rivals": True, "left_out": 300}, "300 messages of the other one are left out"),
        ({"restarts": 1}, "the vehicle rebooted once about 236 s after the start"),
    ],
)
def test_what_happened_to_clocks_is_a_sentence(changes: dict[str, object], said: str) -> None:
    base = {name: getattr(QUIET, name) for name in ("drift", "restarts", "wraps", "jumps_s", "left_out", "rivals")}
    (sentence,) = clock_sentences(ClockHealth(**{**base, **changes}), KNOWN)
    assert said in sentence


def test_a_real_flight_over_a_hill(data_folder: Path) -> None:
    """Home-relative heights know nothing of the hill; the rangefinder and the terrain do, and agree on it."""
    pairs = diagnose(data_folder / "sitl/servo_consumer.tlog").report.height_pairs
    (sentence,) = pairs.sentences()
    assert "while terrain and rangefinder agree: the ground below is not level with home" in sentence
    by_names = {(pair["source"], pair["other"]): pair for pair in pairs.documents()}
    agreed = by_names["rangefinder", "terrain"]
    assert agreed["beyond_std"] == 0
    assert max(abs(agreed["step_low_m"]), abs(agreed["step_high_m"])) < 0.25
    assert by_names["rangefinder", "home"]["step_high_m"] == pytest.approx(10.3, abs=0.3)
