"""The worker thread behind recorder and bus."""

import threading

import pytest

from aerodft.adapters.lane import Lane


def nothing() -> None:
    return


@pytest.mark.parametrize("at_once", [1, 7])
def test_work_is_done_in_order_and_finished_at_close(at_once: int) -> None:
    done: list[int] = []
    lane: Lane[int] = Lane("t", done.extend, nothing, capacity=1000, at_once=at_once)
    assert all(lane.put(index) for index in range(500))
    lane.close()
    assert done == list(range(500))


def test_what_does_not_fit_is_refused_but_one_item_always_fits() -> None:
    gate, begun = threading.Event(), threading.Event()

    def work(_: list[int]) -> None:
        begun.set()
        gate.wait(30)

    lane: Lane[int] = Lane("t", work, nothing, capacity=10)
    assert lane.put(0, size=99)
    assert begun.wait(30)
    assert [lane.put(1, size=99), lane.put(2, size=1)] == [True, False]
    gate.set()
    lane.close()


@pytest.mark.parametrize("lossless", [False, True])
def test_an_error_ends_the_lane_refuses_what_comes_and_is_raised_by_close(
    caplog: pytest.LogCaptureFixture, *, lossless: bool
) -> None:
    def work(_: list[int]) -> None:
        raise KeyError("bug")

    lane: Lane[int] = Lane("worker", work, nothing, capacity=1, lossless=lossless)
    lane.put(0)
    while lane.put(1):
        pass
    with pytest.raises(KeyError, match="bug"):
        lane.close()
    assert "worker ended early: KeyError('bug')" in caplog.text


def test_tending_goes_on_when_nothing_comes() -> None:
    tended = threading.Semaphore(0)
    lane: Lane[int] = Lane("t", lambda _: None, lambda: tended.release() and None, capacity=1, period_s=0.001)
    for _ in range(5):
        assert tended.acquire(timeout=30)
    lane.close()
