import threading
from fractions import Fraction
from itertools import pairwise

import pytest

from aerodft.adapters.images import LiveRate, RateSource
from aerodft.model import Image, StampClock
from aerodft.service.clocks import WallClock

START_NS = 1_795_226_246_000_000_007


@pytest.mark.parametrize("rate_hz", [10.0, 29.97, 0.1, 1000.0, 3])
def test_stamps_lie_on_the_exact_grid(rate_hz: float) -> None:
    stop_ns = START_NS + 30_000_000_000
    images = list(RateSource([(START_NS, stop_ns)], rate_hz).events())
    period_ns = Fraction(10**9) / Fraction(str(rate_hz))
    assert len(images) == -(-30_000_000_000 // period_ns)
    for image in images:
        assert abs(image.stamp_ns - START_NS - image.index * period_ns) <= Fraction(1, 2)
        assert image.arrival_ns == image.stamp_ns
        assert image.clock is StampClock.HOST
        assert (image.width_px, image.height_px, image.pixels) == (None, None, None)


def test_an_empty_span_has_no_stamps() -> None:
    assert not list(RateSource([(START_NS, START_NS)], 10.0).events())


def test_a_pause_has_no_stamps_and_does_not_restart_the_count() -> None:
    images = list(RateSource([(0, 10), (1_000, 1_010)], 2e8).events())
    assert [(image.index, image.stamp_ns) for image in images] == [(0, 0), (1, 5), (2, 1_000), (3, 1_005)]


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, float("nan")])
def test_a_rate_must_be_above_zero(rate_hz: float) -> None:
    with pytest.raises(ValueError, match="must be above 0"):
        RateSource([(0, 1)], rate_hz)


def test_live_stamps_lie_on_whole_multiples_of_the_period() -> None:
    seen: list[Image] = []
    enough = threading.Event()

    def take(image: Image) -> None:
        seen.append(image)
        if len(seen) == 10:
            enough.set()

    with LiveRate(200.0, take, WallClock()):
        assert enough.wait(5)
    count = len(seen)
    assert [image.index for image in seen] == list(range(count))
    assert all(image.stamp_ns % 5_000_000 == 0 for image in seen)
    assert all(after.stamp_ns > before.stamp_ns for before, after in pairwise(seen))
    assert all(image.arrival_ns >= image.stamp_ns for image in seen)
    assert not any(thread.name == "image-rate" for thread in threading.enumerate())


def test_a_slow_rate_stops_at_once() -> None:
    seen: list[Image] = []
    rate = LiveRate(0.001, seen.append, WallClock())
    rate.start()
    rate.stop()
    assert not seen
    assert not any(thread.name == "image-rate" for thread in threading.enumerate())
