import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.model import Image, WireProtocol
from aerodft.service import block_of
from aerodft.service.clocks import ImageClock, MappedToUtc

NOW_NS = 1_795_221_278_000_000_000
STAMPS = st.integers(NOW_NS - 10**13, NOW_NS + 10**13)


@given(STAMPS, st.integers(-(10**12), 10**12), st.floats(-0.05, 0.05))
def test_stamps_come_back(stamp_ns, offset_ns, drift):
    clock = ImageClock(offset_ns=offset_ns, drift=drift, reference_ns=NOW_NS)
    assert abs(clock.stamp_ns(clock.utc_ns(stamp_ns)) - stamp_ns) <= 1


@given(STAMPS, st.integers(-(10**12), 10**12))
def test_without_drift_they_come_back_exactly(stamp_ns, offset_ns):
    clock = ImageClock(offset_ns=offset_ns)
    assert clock.utc_ns(stamp_ns) == stamp_ns + offset_ns
    assert clock.stamp_ns(clock.utc_ns(stamp_ns)) == stamp_ns


def test_a_clock_that_is_slow_by_two_percent_is_a_second_off_after_fifty():
    clock = ImageClock(offset_ns=3_000_000_000, drift=0.02, reference_ns=NOW_NS)
    assert clock.utc_ns(NOW_NS) - NOW_NS == 3_000_000_000
    after_ns = NOW_NS + 50_000_000_000
    assert math.isclose(clock.utc_ns(after_ns) - after_ns, 4_000_000_000, abs_tol=300)


def test_images_and_their_arrivals_move_and_telemetry_does_not():
    class Source:
        def events(self):
            yield Image(index=0, stamp_ns=NOW_NS, arrival_ns=NOW_NS + 5)
            yield block_of(WireProtocol.MAVLINK, "log", [NOW_NS], [b"frame"])

    image, block = MappedToUtc(Source(), ImageClock(offset_ns=7)).events()
    assert (image.stamp_ns, image.arrival_ns) == (NOW_NS + 7, NOW_NS + 12)
    assert block.arrival_ns[0] == NOW_NS


@pytest.mark.parametrize("drift", [-0.02, 0.02])
def test_order_is_kept(drift):
    clock = ImageClock(drift=drift, reference_ns=NOW_NS)
    stamps = [clock.utc_ns(NOW_NS + step) for step in range(-500, 500, 100)]
    assert stamps == sorted(set(stamps))
