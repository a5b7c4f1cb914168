"""Work that the caller does, where a thread would not help."""

import pytest

from aerodft.adapters.own_hands import OwnHands


def nothing() -> None:
    return


def test_items_are_done_in_order_once_there_are_enough_and_the_rest_at_close() -> None:
    done: list[list[int]] = []
    hands: OwnHands[int] = OwnHands(done.append, nothing, enough=10, period_s=1e9)
    assert all(hands.put(size, size=size) for size in (3, 4, 5, 1, 20, 2))
    assert done == [[3, 4, 5], [1, 20]]
    hands.close()
    assert done == [[3, 4, 5], [1, 20], [2]]


def test_no_item_waits_for_long_and_what_is_done_is_tended_to() -> None:
    done: list[list[int]] = []
    tended: list[int] = []
    hands: OwnHands[int] = OwnHands(done.append, lambda: tended.append(len(done)), enough=10, period_s=0.0)
    hands.put(1)
    hands.put(2)
    hands.close()
    assert (done, tended) == ([[1], [2]], [1, 2, 2])


def test_an_error_is_the_caller_s() -> None:
    def work(_: list[int]) -> None:
        raise KeyError("bug")

    hands: OwnHands[int] = OwnHands(work, nothing, enough=1)
    with pytest.raises(KeyError, match="bug"):
        hands.put(1)
