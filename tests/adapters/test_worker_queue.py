"""The worker thread behind recorder and bus."""

import threading
import time

import pytest

from aerodft.adapters.worker_queue import WorkerQueue


def test_work_is_done_in_order_and_finished_at_close() -> None:
    done: list[int] = []
    queue: WorkerQueue[int] = WorkerQueue("t", done.append, capacity=1000)
    assert all(queue.put(index) for index in range(500))
    queue.close()
    assert done == list(range(500))


def test_what_does_not_fit_is_refused_but_one_item_always_fits() -> None:
    gate, begun = threading.Event(), threading.Event()

    def work(_: int) -> None:
        begun.set()
        gate.wait(30)

    queue: WorkerQueue[int] = WorkerQueue("t", work, capacity=10)
    assert queue.put(0, size=99)
    assert begun.wait(30)
    assert [queue.put(1, size=99), queue.put(2, size=1)] == [True, False]
    gate.set()
    queue.close()


@pytest.mark.parametrize("lossless", [False, True])
def test_an_error_ends_the_queue_refuses_what_comes_and_is_raised_by_close(
    caplog: pytest.LogCaptureFixture, *, lossless: bool
) -> None:
    def work(_: int) -> None:
        raise KeyError("bug")

    queue: WorkerQueue[int] = WorkerQueue("worker", work, capacity=1, lossless=lossless)
    queue.put(0)
    while queue.put(1):
        pass
    with pytest.raises(KeyError, match="bug"):
        queue.close()
    assert "worker ended early: KeyError('bug')" in caplog.text


def test_tending_goes_on_when_nothing_comes() -> None:
    tended = threading.Semaphore(0)
    queue: WorkerQueue[int] = WorkerQueue("t", lambda _: None, capacity=1, tend=tended.release)
    for _ in range(5):
        assert tended.acquire(timeout=30)
    queue.close()


def test_a_lossless_queues_work_takes_room_until_it_is_done() -> None:
    said, begun, may_end = [], threading.Event(), threading.Event()

    def work(item: str) -> None:
        begun.set()
        assert may_end.wait(30)
        said.append(f"done {item}")

    queue: WorkerQueue[str] = WorkerQueue("test", work, capacity=1, lossless=True)
    assert queue.put("a")
    assert begun.wait(30)

    def bring() -> None:
        assert queue.put("b")
        said.append("took b")

    other = threading.Thread(target=bring)
    other.start()
    until_s = time.monotonic() + 30
    while not queue._waiting_callers and "took b" not in said and time.monotonic() < until_s:  # noqa: SLF001 - nobody else tells
        time.sleep(0.001)
    may_end.set()
    other.join()
    queue.close()
    assert said.index("done a") < said.index("took b")
    assert sorted(said) == ["done a", "done b", "took b"]
