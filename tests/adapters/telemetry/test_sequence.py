"""Lost frames against links of which it is known what they lost, held back, and sent twice."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.adapters.telemetry.mavlink.decoding import SequenceWatch

WINDOW = 64


def heard(numbers, cuts=()):
    """What is found to be lost at each of the frames with these numbers, which come in blocks."""
    watch, numbers = SequenceWatch(), (np.asarray(numbers, dtype=np.int64) % 256).astype(np.uint8)
    return np.concatenate([watch.lost(part) for part in np.split(numbers, sorted(cuts)) if len(part)])


def late(count, by, seed=1):
    """The numbers of frames that are held back by up to so many."""
    numbers = np.arange(count)
    return numbers[np.argsort(numbers + np.random.default_rng(seed).uniform(0, by, count), kind="stable")]


@pytest.mark.parametrize("by", [0, 2, 20, 60])
def test_late_frames_are_not_lost(by):
    assert not heard(late(3000, by)).any()


def test_frames_that_come_twice_are_not_lost():
    numbers = np.arange(2000)
    twice = np.sort(np.concatenate([numbers, numbers[::3] + 5]))
    assert not heard(twice).any()


@pytest.mark.parametrize("by", [0, 30])
def test_lost_frames_are_counted_among_late_ones(by):
    order = late(5000, by)
    drop = np.random.default_rng(2).random(5000) < 0.2
    drop[0] = False
    came = order[~drop[order]]
    lost = heard(came)
    assert lost.sum() == np.count_nonzero(drop[: came.max() - WINDOW + 1])
    at, top = np.repeat(np.arange(len(came)), lost), np.maximum.accumulate(came)
    missing = np.flatnonzero(drop)[: len(at)]
    assert np.all((top[at] - WINDOW >= missing) & (top[at - 1] - WINDOW < missing))  # each when the window passes it


def test_a_gap_of_many_is_counted_in_full():
    assert heard([*range(100), *range(200, 400)]).sum() == 100


@pytest.mark.parametrize("again", [0, 7, 130, 250])
def test_a_counter_that_starts_anew_is_no_loss(again):
    numbers = [*range(1000), *range(again, again + 1000)]
    before, after = 999 % 256, again
    ahead = (after - before - 1) % 256
    assert heard(numbers).sum() == (ahead if ahead < 127 else 0)  # less than half a turn ahead cannot be told from loss


@given(st.lists(st.integers(0, 600), max_size=20), st.integers(0, 5))
def test_how_frames_are_cut_into_blocks_makes_no_difference(cuts, seed):
    rng = np.random.default_rng(seed)
    numbers = late(600, 25, seed)
    numbers = numbers[rng.random(600) > 0.15]
    numbers[300:] += int(rng.integers(0, 256))
    np.testing.assert_array_equal(heard(numbers, cuts), heard(numbers))
