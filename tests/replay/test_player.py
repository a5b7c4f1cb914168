"""The player: when each message is sent, on a clock that only it moves, and what keys do to that."""

from collections.abc import Callable, Iterator

import pytest

from aerodft.adapters.recording import Channel, ChannelMessage
from replay.player import Controls, Player
from replay.player.player import TimelineMessage
from tests.clock import VirtualClock

CHANNEL = Channel(topic="/t", encoding="json", schema="")
START_NS, SECOND_NS = 1_795_221_278_000_000_000, 1_000_000_000


class Sent:
    """An outlet that remembers, and lets something happen at a message."""

    def __init__(self, clock: VirtualClock, at: dict[int, Callable[[], None]] | None = None) -> None:
        self._clock, self._at = clock, at or {}
        self.got: list[tuple[float, float, int]] = []

    def send(self, item: TimelineMessage, shift_ns: int) -> None:
        self.got.append(((item.log_ns - START_NS) / SECOND_NS, self._clock.now_ns() / SECOND_NS, shift_ns))
        self._at.get(len(self.got), lambda: None)()


def row(times_s: list[float], marks: set[float] | None = None) -> Callable[[], Iterator[TimelineMessage]]:
    def items() -> Iterator[TimelineMessage]:
        for time_s in times_s:
            log_ns = START_NS + round(time_s * SECOND_NS)
            message = ChannelMessage(log_ns, CHANNEL, b"{}", 0)
            yield TimelineMessage(log_ns, None, message, marks is None or time_s in marks)  # type: ignore[arg-type]

    return items


@pytest.mark.parametrize("rate", [0.1, 1.0, 4.0, 250.0])
def test_the_pace_is_the_recordings_times_the_rate(rate: float) -> None:
    clock = VirtualClock(7 * SECOND_NS)
    sent = Sent(clock)
    Player(outlets=[sent], clock=clock, rate=rate).play(row([0.0, 0.5, 0.5, 3.0]))
    assert [now_s for _, now_s, _ in sent.got] == pytest.approx([7 + time_s / rate for time_s in (0, 0.5, 0.5, 3)])
    assert {shift_ns for _, _, shift_ns in sent.got} == {0}


def test_as_fast_as_it_goes_never_waits() -> None:
    clock = VirtualClock(5)
    Player(outlets=[Sent(clock)], clock=clock, rate=None).play(row([0.0, 100.0]))
    assert clock.now_ns() == 5


def test_stamps_are_moved_by_one_amount_and_anew_in_each_round() -> None:
    clock, controls = VirtualClock(9 * SECOND_NS), Controls(looping=True)
    sent = Sent(clock, {6: lambda: setattr(controls, "looping", False)})
    player = Player(outlets=[sent], clock=clock, rate=2.0, is_now=True, controls=controls)
    player.play(row([0.0, 1.0, 4.0]))
    assert player.rounds == 2
    assert [shift_ns for _, _, shift_ns in sent.got] == [9 * SECOND_NS - START_NS] * 3 + [11 * SECOND_NS - START_NS] * 3


def test_minutes_of_nothing_are_left_out_and_said(caplog: pytest.LogCaptureFixture) -> None:
    clock = VirtualClock(0)
    sent = Sent(clock)
    Player(outlets=[sent], clock=clock).play(row([0.0, 1.0, 1e9, 1e9 + 1, 1e9 + 500]))
    assert [now_s for _, now_s, _ in sent.got] == pytest.approx([0.0, 1.0, 1.0, 2.0, 501.0])
    assert "nothing for 999999999 s: left out" in caplog.text


def test_a_clock_that_goes_back_costs_no_time_and_no_message() -> None:
    clock = VirtualClock(0)
    sent = Sent(clock)
    Player(outlets=[sent], clock=clock).play(row([0.0, 5.0, 1.0, 6.0]))
    assert [now_s for _, now_s, _ in sent.got] == pytest.approx([0.0, 5.0, 5.0, 6.0])


class Watcher(VirtualClock):
    """A clock on which keys are pressed at times."""

    def __init__(self, keys: list[tuple[float, Callable[[], None]]]) -> None:
        super().__init__(0)
        self._keys = list(keys)

    def sleep_until(self, when_ns: int) -> None:
        super().sleep_until(when_ns)
        while self._keys and self.now_ns() >= self._keys[0][0] * SECOND_NS:
            self._keys.pop(0)[1]()


def test_a_pause_lasts_until_it_is_ended_and_nothing_is_caught_up_after_it() -> None:
    controls = Controls()
    clock = Watcher([(1.5, controls.pause_or_go), (9.5, controls.pause_or_go)])
    sent, paused = Sent(clock), list[int]()
    Player(outlets=[sent], clock=clock, controls=controls, on_pause=paused.append).play(row([0.0, 1.0, 2.0, 3.0]))
    assert [now_s for _, now_s, _ in sent.got] == pytest.approx([0.0, 1.0, 9.5, 10.5], abs=0.05)
    assert paused == [START_NS + 2 * SECOND_NS]


def test_a_step_goes_to_the_next_image_with_what_comes_before_it() -> None:
    controls = Controls(paused=True)
    clock = Watcher([(1.0, controls.step), (20.0, controls.step), (40.0, lambda: setattr(controls, "ended", True))])
    sent = Sent(clock)
    Player(outlets=[sent], clock=clock, rate=100.0, controls=controls).play(
        row([0.0, 1.0, 1.5, 2.0, 2.5, 3.0], marks={1.0, 2.0, 3.0})
    )
    assert [time_s for time_s, _, _ in sent.got] == [0.0, 1.0, 1.5, 2.0, 2.5]
    assert [now_s for _, now_s, _ in sent.got] == pytest.approx([1, 1, 1, 20, 20], abs=0.1)


def test_it_ends_when_it_is_told_to_in_the_middle_of_a_wait() -> None:
    controls = Controls(looping=True)
    clock = Watcher([(0.3, lambda: setattr(controls, "ended", True))])
    sent = Sent(clock)
    Player(outlets=[sent], clock=clock, controls=controls).play(row([0.0, 500.0]))
    assert len(sent.got) == 1
    assert clock.now_ns() < SECOND_NS


def test_a_row_without_messages_is_not_played_for_ever() -> None:
    player = Player(outlets=[], clock=VirtualClock(0), controls=Controls(looping=True))
    player.play(row([]))
    assert player.rounds == 1
