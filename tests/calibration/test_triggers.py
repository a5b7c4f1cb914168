"""Photos matched to triggers: simulated surveys with photos lost, doubled and renumbered, and clocks that are off."""

import numpy as np
import pytest

from calibration.sync import match_photos
from tests.calibration.photo_flights import UTC_S, PhotoFlight, photo_flight, with_step
from tests.nights import at_night


@pytest.mark.parametrize("first", [0, *at_night(*range(20, 200, 20))])
def test_each_photo_gets_its_trigger_or_is_refused(first: int) -> None:
    photos = matchable = right = 0
    deviations = []
    for seed in range(first, first + 20):
        flight = photo_flight(seed)
        found = match_photos(
            flight.photo_s - UTC_S, flight.trigger_s - UTC_S, resolution_s=1.0, is_ordered=flight.is_ordered
        )
        is_matched = found.trigger >= 0
        event = np.where(is_matched, flight.events[np.maximum(found.trigger, 0)], -1)
        assert np.array_equal(event[is_matched], flight.truth[is_matched]), seed
        photos += len(is_matched)
        matchable += int(np.count_nonzero((flight.truth >= 0) & flight.is_ordered))
        right += int(np.count_nonzero(is_matched))
        if not found.why:
            deviations.append((found.offset_s - flight.offset_s) / np.hypot(found.offset_std_s, 0.01))
            assert np.array_equal(found.doubled[1:], flight.events[1:] == flight.events[:-1]), seed
            assert set(flight.events[found.lost].tolist()) <= set(flight.lost.tolist()), seed
    assert right > 0.9 * matchable, f"{right} of {matchable} photos with a trigger ({photos} in all)"
    assert len(deviations) >= 19
    assert np.sqrt(np.mean(np.square(deviations))) < 2.0
    assert np.max(np.abs(deviations)) < 5.0


def _without(flight: PhotoFlight, kind: str, rng: np.random.Generator) -> np.ndarray:
    """Which photos ``(p,)`` are left."""
    count = len(flight.photo_s)
    kept = np.ones(count, dtype=bool)
    if kind == "burst":
        lost = int(rng.integers(5, max(6, min(40, count // 3))))
        first = int(rng.integers(0, count - lost))
        kept[first : first + lost] = False
    elif kind == "first minute":
        kept &= flight.photo_s + flight.offset_s >= flight.trigger_s[0] + 60
    return kept


@pytest.mark.parametrize("kind", ["burst", "first minute", "hour ahead", "hour behind"])
@pytest.mark.parametrize("every", [False, *at_night(True)])
def test_no_photo_gets_a_wrong_trigger_where_many_are_lost(kind: str, *, every: bool) -> None:
    """The flight of 1035 was one trigger off: no start lay near its clock."""
    matched = 0
    for seed in range(1000, 1200) if every else (1002, 1035, 1044, 1112):
        flight, rng = photo_flight(seed), np.random.default_rng(seed + 77)
        kept = _without(flight, kind, rng)
        if np.count_nonzero(kept) < 20:
            continue
        shift_s = {"hour ahead": 3600.0, "hour behind": -3600.0}.get(kind, 0.0)
        found = match_photos(
            flight.photo_s[kept] + shift_s - UTC_S,
            flight.trigger_s - UTC_S,
            resolution_s=1.0,
            is_ordered=flight.is_ordered[kept],
            clock_std_s=6 * 3600.0,
        )
        is_matched = found.trigger >= 0
        assert np.array_equal(flight.events[found.trigger[is_matched]], flight.truth[kept][is_matched]), seed
        matched += int(np.count_nonzero(is_matched))
    assert matched > 0


@pytest.mark.parametrize("whole_seconds", [False, True])
@pytest.mark.parametrize(("first", "stop", "most_wrong"), [(0, 10, 0.0), *at_night((10, 200, 0.005))])
def test_a_clock_that_is_set_in_mid_flight_is_split_or_refused(
    first: int, stop: int, most_wrong: float, *, whole_seconds: bool
) -> None:
    """Without a look for steps a fifth of these photos got the trigger of another one.

    What is left: a step of one interval, behind which a strip of equal intervals follows, is a lost photo as well.
    """
    matched = photos = wrong = 0
    for seed in range(first, stop):
        flight = with_step(photo_flight(seed), np.random.default_rng(seed + 991), whole_seconds=whole_seconds)
        found = match_photos(
            flight.photo_s - UTC_S,
            flight.trigger_s - UTC_S,
            resolution_s=1.0,
            is_ordered=flight.is_ordered,
            clock_std_s=6 * 3600.0,
        )
        is_matched = found.trigger >= 0
        wrong += int(np.count_nonzero(flight.events[found.trigger[is_matched]] != flight.truth[is_matched]))
        matched, photos = matched + int(np.count_nonzero(is_matched)), photos + len(is_matched)
    assert wrong <= most_wrong * photos
    assert matched > 0.25 * photos


@pytest.mark.parametrize("first", [0, *at_night(*range(20, 200, 20))])
def test_no_photo_of_another_flight_gets_a_trigger(first: int) -> None:
    for seed in range(first, first + 20):
        flight, other, rng = photo_flight(seed), photo_flight(seed + 5000), np.random.default_rng(seed + 991)
        shift_s = flight.photo_s[0] - other.photo_s[0] + rng.integers(-30, 30)
        found = match_photos(
            other.photo_s + shift_s - UTC_S,
            flight.trigger_s - UTC_S,
            resolution_s=1.0,
            is_ordered=other.is_ordered,
            clock_std_s=6 * 3600.0,
        )
        assert (found.trigger == -1).all(), seed


def test_a_clock_that_was_set_in_a_turn_is_split_there() -> None:
    rng = np.random.default_rng(8)
    steps = np.where(np.arange(120) % 15 == 0, rng.uniform(8, 20, 120), 2.0 + 0.1 * rng.standard_normal(120))
    trigger_s = np.cumsum(steps)
    stamps = np.floor(trigger_s - 77.7 + 0.05)
    stamps[60:] += 2.0  # one interval: as if a photo had been lost
    found = match_photos(stamps, trigger_s, resolution_s=1.0)
    is_matched = found.trigger >= 0
    assert np.array_equal(found.trigger[is_matched], np.flatnonzero(is_matched))
    assert is_matched.sum() > 100
    assert len(found.steps) == 1
    assert abs(found.steps[0] - 60) <= 2


def test_equal_intervals_with_a_photo_missing_at_an_end_do_not_tell() -> None:
    trigger_s = np.arange(40) * 2.0
    found = match_photos(np.floor(trigger_s[1:] + 700.3), trigger_s, resolution_s=1.0)
    assert (found.trigger == -1).all()
    assert "intervals do not tell" in found.why


def test_equal_intervals_with_a_turn_do() -> None:
    trigger_s = np.concatenate([np.arange(20) * 2.0, 60.45 + np.arange(20) * 2.0])
    found = match_photos(np.floor(trigger_s[1:] + 700.3), trigger_s, resolution_s=1.0)
    assert found.trigger.tolist() == list(range(1, 40))
    # stamps at two phases of the second leave the clock open by more than a residual's mean would say
    assert abs(found.offset_s + 700.3) < 3 * found.offset_std_s
    assert 0.05 < found.offset_std_s < 0.3


def test_photos_of_one_second_in_an_unknown_order_are_refused() -> None:
    rng = np.random.default_rng(5)
    trigger_s = np.cumsum(rng.uniform(1.5, 4.0, 30))
    trigger_s[11] = trigger_s[10] + 0.6
    trigger_s[10:12] += 0.2 - trigger_s[10] % 1
    stamps = np.floor(trigger_s - 55.0)
    assert stamps[10] == stamps[11]
    is_ordered = np.ones(30, dtype=bool)
    is_ordered[10:12] = False
    found = match_photos(stamps, trigger_s, resolution_s=1.0, is_ordered=is_ordered)
    assert found.trigger[10:12].tolist() == [-1, -1]
    assert (np.delete(found.trigger, [10, 11]) == np.delete(np.arange(30), [10, 11])).all()
    ordered = match_photos(stamps, trigger_s, resolution_s=1.0)
    assert ordered.trigger.tolist() == list(range(30))


@pytest.mark.parametrize("count", [0, 1, 4])
def test_a_few_photos_are_refused(count: int) -> None:
    found = match_photos(np.arange(count) * 3.0, np.arange(9) * 3.0, resolution_s=1.0)
    assert found.trigger.tolist() == [-1] * count
    assert "too few" in found.why


def test_photos_of_another_flight_are_refused() -> None:
    rng = np.random.default_rng(3)
    trigger_s, photo_s = (np.cumsum(rng.uniform(2.0, 9.0, 60)) for _ in range(2))
    found = match_photos(np.floor(photo_s), trigger_s, resolution_s=1.0)
    assert (found.trigger == -1).all()


def test_fractions_of_a_second_make_the_clock_known_to_milliseconds() -> None:
    rng = np.random.default_rng(4)
    trigger_s = np.cumsum(rng.uniform(1.0, 6.0, 100))
    photo_s = np.floor((trigger_s - 12.345 + rng.normal(0, 0.02, 100)) * 100) / 100
    found = match_photos(photo_s, trigger_s, resolution_s=0.01)
    assert found.trigger.tolist() == list(range(100))
    assert found.offset_std_s < 0.005
    assert abs(found.offset_s - 12.345) < 4 * found.offset_std_s
