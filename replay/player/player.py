"""Plays messages at a pace that people change while they watch: pause, single steps, loops."""

import heapq
import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, TypeAlias

from aerodft.adapters.recording import Channel, ChannelMessage
from aerodft.conventions import SECOND_NS
from aerodft.service import Clock
from aerodft.service.clocks import PAUSE_NS
from replay.foreign import AnyRecording
from replay.recordings import Recording

RecordingFilter: TypeAlias = Callable[[AnyRecording, Channel], bool]

_SLICE_NS = SECOND_NS // 50  # how long a key may wait

_log = logging.getLogger(__name__)


class TimelineMessage(NamedTuple):
    """One message of one recording.

    Attributes:
        log_ns: Its log time.
        recording: Where it is from.
        message: The message.
        is_step: Whether a step ends before it: an image, or where there are none any message.
    """

    log_ns: int
    recording: AnyRecording
    message: ChannelMessage
    is_step: bool


def timeline(
    recordings: Sequence[AnyRecording], from_ns: int | None, to_ns: int | None, wanted: RecordingFilter
) -> Iterator[TimelineMessage]:
    """All messages with log times in ``[from_ns, to_ns)``; of equal ones the first recording's come first.

    Args:
        recordings: Each in its own order.
        from_ns: None for the start.
        to_ns: None for the end.
        wanted: Whose messages; the images' stamps come in any case.

    Raises:
        InputError: A file cannot be read.
    """

    def messages_of(recording: AnyRecording) -> Iterator[TimelineMessage]:
        def is_wanted(channel: Channel) -> bool:
            is_image = isinstance(recording, Recording) or recording.images is not None
            return (is_image and recording.is_step(channel)) or wanted(recording, channel)

        for message in recording.by_time(from_ns, to_ns, is_wanted):
            yield TimelineMessage(message.log_ns, recording, message, recording.is_step(message.channel))

    return heapq.merge(*map(messages_of, recordings), key=lambda item: item.log_ns)


class Outlet(Protocol):
    """Destination of messages."""

    def send(self, item: TimelineMessage, shift_ns: int) -> None:
        """Send one, with this much added to its stamps."""
        ...


@dataclass(slots=True)
class Controls:
    """Controls of a player, changed from another thread.

    Attributes:
        paused: Nothing is sent.
        looping: The end is followed by the start.
        ended: It is over.
        steps: Single steps that were asked for while it is paused.
    """

    paused: bool = False
    looping: bool = False
    ended: bool = False
    steps: int = 0

    def pause_or_go(self) -> None:
        """Pause, or go on."""
        self.paused, self.steps = not self.paused, 0

    def end(self) -> None:
        """End it."""
        self.ended = True

    def step(self) -> None:
        """Pause, and go to the next image."""
        self.paused, self.steps = True, self.steps + 1


@dataclass(slots=True, kw_only=True)
class Player:
    """Plays a row of messages, once or again and again.

    Attributes:
        outlets: Where to.
        clock: Paces it.
        rate: Times real time; None for as fast as it goes.
        is_now: Stamps are moved, all of them by one amount, so that the first message is sent when it says.
        controls: What whoever watches wants.
        on_time: Called with each log time that has been reached.
        on_pause: Called with the log time that it stops at.
        rounds: How often the end was reached.
    """

    outlets: Sequence[Outlet]
    clock: Clock
    rate: float | None = 1.0
    is_now: bool = False
    controls: Controls = field(default_factory=Controls)
    on_time: Callable[[int], None] | None = None
    on_pause: Callable[[int], None] | None = None
    rounds: int = 0
    _anchor: tuple[int, int] | None = None
    _last_ns: int = 0
    _shift_ns: int = 0
    _in_step: bool = False
    _passed_step: bool = False

    def play(self, items: Callable[[], Iterator[TimelineMessage]]) -> None:
        """Play from the start, until the end or until it is ended.

        Args:
            items: Gives the row, in order of log time; once for each round.

        Raises:
            AerodftError: A recording cannot be read.
        """
        while not self.controls.ended:
            self._anchor = None
            sent = False
            for item in items():
                self._wait(item)
                if self.controls.ended:
                    return
                for outlet in self.outlets:
                    outlet.send(item, self._shift_ns)
                sent = True
                if self.on_time is not None:
                    self.on_time(item.log_ns)
            self.rounds += 1
            if not self.controls.looping or not sent:
                return

    def _wait(self, item: TimelineMessage) -> None:
        """Until the item is due."""
        if self._anchor is None:
            self._anchor_at(item.log_ns, is_first=True)
        elif item.log_ns - self._last_ns > PAUSE_NS:
            gap_s = (item.log_ns - self._last_ns) / SECOND_NS
            _log.warning("nothing for %.0f s: left out", gap_s)
            self._anchor_at(item.log_ns, is_first=True)
        self._last_ns = item.log_ns
        if self._gate(item):
            self._anchor_at(item.log_ns, is_first=False)
        if self.rate is None or self._anchor is None:
            return
        anchor_log_ns, anchor_ns = self._anchor
        due_ns = anchor_ns + int((item.log_ns - anchor_log_ns) / self.rate)
        while (now_ns := self.clock.now_ns()) < due_ns and not self.controls.ended:
            self.clock.sleep_until(min(due_ns, now_ns + _SLICE_NS))
            if self.controls.paused and not self._in_step:
                self._gate(item)
                self._anchor_at(item.log_ns, is_first=False)
                return

    def _anchor_at(self, log_ns: int, *, is_first: bool) -> None:
        """The log time is now; stamps keep their distances, so they are moved anew at the first message only."""
        now_ns = self.clock.now_ns()
        self._anchor = (log_ns, now_ns)
        if is_first and self.is_now:
            self._shift_ns = now_ns - log_ns

    def _gate(self, item: TimelineMessage) -> bool:
        """Wait while it is paused; True where that was so."""
        if not self.controls.paused or (item.is_step and self._passed_step):
            self._in_step = False
        waited = False
        while self.controls.paused and not self._in_step and not self.controls.ended:
            if self.controls.steps:
                self.controls.steps -= 1
                self._in_step, self._passed_step = True, False
                break
            if not waited and self.on_pause is not None:
                self.on_pause(item.log_ns)
            waited = True
            self.clock.sleep_until(self.clock.now_ns() + _SLICE_NS)
        if item.is_step:
            self._passed_step = True
        return waited
