"""No more frames in a second than a link gives, however a clock was set."""

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.service import ArrivalLimiter

START_NS, MOST = 10**18, 5000


def test_what_a_link_gives_is_kept_as_it_came() -> None:
    rng = np.random.default_rng(1)
    given_ns = START_NS + np.cumsum(rng.integers(0, 2 * SECOND_NS // 1000, 20_000))
    given_ns[3000:4000] = given_ns[3000]  # written at once
    given_ns = np.maximum.accumulate(given_ns)
    pace = ArrivalLimiter()
    kept_ns = np.concatenate([pace.limited(part) for part in np.array_split(given_ns, 7)])
    np.testing.assert_array_equal(kept_ns, given_ns)


def test_what_was_held_is_spread_and_catches_up() -> None:
    held_ns = np.full(23_456, START_NS)
    later_ns = START_NS + SECOND_NS * np.arange(1, 21)
    given_ns = np.concatenate([held_ns, later_ns])
    for parts in (1, 9, 100):
        pace = ArrivalLimiter()
        kept_ns = np.concatenate([pace.limited(part) for part in np.array_split(given_ns, parts)])
        whole = [START_NS + k // MOST * SECOND_NS for k in range(len(held_ns))]
        np.testing.assert_array_equal(kept_ns[: len(held_ns)], whole)
        np.testing.assert_array_equal(kept_ns[-10:], later_ns[-10:])
        assert np.all(np.diff(kept_ns) >= 0)
        assert np.all(kept_ns >= given_ns)
        np.testing.assert_array_equal(ArrivalLimiter().limited(kept_ns), kept_ns)
