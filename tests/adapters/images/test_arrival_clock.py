import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.adapters.images.stream import ArrivalClock

MS = 1_000_000
ZERO_NS = 1_795_226_246_000_000_000  # host UTC at the stream's time 0
PERIOD_NS = 40 * MS


@given(delays_ms=st.lists(st.integers(0, 400), min_size=1, max_size=400))
def test_a_stamp_is_late_by_the_least_delay_of_five_seconds(delays_ms: list[int]) -> None:
    clock = ArrivalClock()
    seen: list[tuple[int, int]] = []
    arrival_ns = 0
    for index, delay_ms in enumerate(delays_ms):
        pts_ns = index * PERIOD_NS
        arrival_ns = max(arrival_ns, ZERO_NS + pts_ns + delay_ms * MS)  # nothing overtakes on the wire
        clock.observe(pts_ns, arrival_ns)
        seen.append((arrival_ns, arrival_ns - pts_ns))
        least_ns = min(delay_ns for when_ns, delay_ns in seen if when_ns >= arrival_ns - 5000 * MS)
        assert clock.stamp_ns(pts_ns) == pts_ns + least_ns
    assert clock.resets == 0


def test_a_steady_stream_is_stamped_exactly() -> None:
    clock = ArrivalClock()
    noise = np.random.default_rng(3)
    for index in range(200):
        late_ms = 7 if index % 10 == 0 else int(noise.integers(7, 40))
        clock.observe(index * PERIOD_NS, ZERO_NS + index * PERIOD_NS + late_ms * MS)
        if index:
            assert clock.stamp_ns(index * PERIOD_NS) == ZERO_NS + index * PERIOD_NS + 7 * MS


def test_it_follows_a_clock_that_drifts() -> None:
    clock = ArrivalClock()
    for index in range(25 * 60):  # a minute of a stream whose clock runs 0.1 % slow
        clock.observe(round(index * PERIOD_NS * 0.999), ZERO_NS + index * PERIOD_NS)
    error_ns = clock.stamp_ns(round(index * PERIOD_NS * 0.999)) - (ZERO_NS + index * PERIOD_NS)
    assert abs(error_ns) <= 5 * MS + PERIOD_NS  # what it drifts in the five seconds of memory


@pytest.mark.parametrize("step_ns", [-3_600_000 * MS, -1500 * MS, 2000 * MS, 3_600_000 * MS])
def test_a_sender_that_starts_anew_is_believed_at_once(step_ns: int) -> None:
    clock = ArrivalClock()
    for index in range(50):
        clock.observe(index * PERIOD_NS, ZERO_NS + index * PERIOD_NS)
    clock.observe(50 * PERIOD_NS + step_ns, ZERO_NS + 50 * PERIOD_NS + 3 * MS)
    assert clock.resets == 1
    assert not clock.settled
    assert clock.stamp_ns(50 * PERIOD_NS + step_ns) == ZERO_NS + 50 * PERIOD_NS + 3 * MS


def test_images_stored_out_of_order_are_no_new_start() -> None:
    clock = ArrivalClock()
    for index, shown in enumerate([0, 4, 2, 1, 3, 8, 6, 5, 7]):
        clock.observe(shown * PERIOD_NS, ZERO_NS + (index + 3) * PERIOD_NS)
    assert clock.resets == 0


def test_a_pause_of_the_network_is_no_new_start() -> None:
    clock = ArrivalClock()
    clock.observe(0, ZERO_NS)
    clock.observe(4000 * MS, ZERO_NS + 4000 * MS)
    assert clock.resets == 0


def test_a_burst_at_the_start_is_waited_out() -> None:
    clock = ArrivalClock()
    assert not clock.settled
    for index in range(12):  # half a second of images that had been waiting somewhere
        clock.observe(index * PERIOD_NS, ZERO_NS + 500 * MS + index * MS)
        assert not clock.settled
    for index in range(12, 40):
        clock.observe(index * PERIOD_NS, ZERO_NS + max(511 * MS, index * PERIOD_NS) + MS)
    assert clock.settled
    assert clock.stamp_ns(39 * PERIOD_NS) == ZERO_NS + 39 * PERIOD_NS + MS


def test_no_stamp_before_the_first_packet() -> None:
    with pytest.raises(ValueError, match="no packet was observed yet"):
        ArrivalClock().stamp_ns(0)
