"""Publishing recordings again: on the bus, where they answer queries too, and their MAVLink on a link."""

import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

import zenoh

from aerodft.adapters.bus import StationQueries, session_on
from aerodft.adapters.recording import Channel
from aerodft.adapters.telemetry.mavlink import LinkKind, open_transport, parse_address
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.adapters.wire.keys import DEFAULT_LISTEN, Keys
from aerodft.adapters.wire.measurement import encode_measurements
from aerodft.adapters.wire.requests import parse_measure_request
from aerodft.app import Progress, no_progress
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError, UsageError
from aerodft.model import Probe
from aerodft.service.clocks import WallClock
from replay.foreign import AnyRecording
from replay.player import (
    Controls,
    MavlinkOut,
    Player,
    Republisher,
    TimelineMessage,
    check_mavlink,
    is_published,
    shift_stamps,
    timeline,
)
from replay.recordings import LeftOut, Recording

if TYPE_CHECKING:
    from aerodft.app.assembly import RecordedRun

_LINK_S: Final = 5.0  # for a peer that is named to answer
_SLOWEST, _FASTEST = 0.01, 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayResult:
    """Counts of what a replay published.

    Attributes:
        measurements: Measurements published.
        images: Images published.
        others: Poses and states published.
        rounds: How often the end was reached.
        has_listeners: Whether anybody had subscribed to something that was published.
        mavlink_frames: Frames sent on the MAVLink link; None without one.
        is_stopped: Whether it was ended before its end.
        left_out: What the recordings lack, and payloads that could not be decoded; of other tools' nothing is known.
    """

    measurements: int
    images: int
    others: int
    rounds: int
    has_listeners: bool
    mavlink_frames: int | None
    is_stopped: bool
    left_out: LeftOut

    @property
    def is_empty(self) -> bool:
        """Whether nothing went out, neither on the bus nor on the link."""
        return not (self.measurements or self.images or self.others or self.mavlink_frames)


class _ReplayedQueries:
    """Answers the queries of the recordings' stations as the stations did when they were where the replay is.

    An outlet of the player, before the one that publishes. Of several recordings of one station the one answers of
    which something was published last.

    Args:
        session: Where to.
        recordings: The recordings.
    """

    def __init__(self, session: zenoh.Session, recordings: Sequence[AnyRecording]) -> None:
        self._lock = threading.Lock()  # between the queries: a run goes on from one to the next
        self._runs: dict[int, RecordedRun] = {}
        self._places: dict[
            str, tuple[AnyRecording, int, int]
        ] = {}  # by station: log time and shift of the last message
        self._queries: dict[str, StationQueries] = {}
        for recording in reversed(recordings):
            keys = Keys(recording.station)
            self._places[keys.root] = recording, 0, 0
            if keys.root not in self._queries:
                self._queries[keys.root] = StationQueries(
                    session,
                    keys,
                    probes=partial(self._probes, keys.root),
                    measure=partial(self._measure, keys.root),
                )

    def send(self, item: TimelineMessage, shift_ns: int) -> None:
        """Take note of the time that is reached; where it goes back, what was measured is of another round."""
        root = Keys(item.recording.station).root
        if item.log_ns < self._places[root][1]:
            self._queries[root].forget()
        self._places[root] = item.recording, item.log_ns, shift_ns

    def remember(self, recording: AnyRecording, probe: str, payload: bytes) -> None:
        """Take a measurement that is published into the history of its station."""
        self._queries[Keys(recording.station).root].remember(probe, payload)

    def close(self) -> None:
        """Answer nothing any more."""
        for each in self._queries.values():
            each.close()

    def _probes(self, root: str) -> Sequence[Probe]:
        with self._lock:
            return self._run_of(self._places[root][0]).station.pipeline.probes

    def _measure(self, root: str, question: bytes) -> bytes:
        recording, log_ns, shift_ns = self._places[root]
        with self._lock:
            points = self._run_of(recording).station.pipeline.setup.points
        request = parse_measure_request(question, points)
        if request.stamp_ns is not None:
            request = replace(request, stamp_ns=request.stamp_ns - shift_ns)
        with self._lock:
            measurements = self._run_of(recording).at(log_ns).measure(request)
        return shift_stamps(encode_measurements(measurements), shift_ns)

    def _run_of(self, recording: AnyRecording) -> "RecordedRun":
        """The run of a recording's station.

        Raises:
            NoAnswerError: Another tool made the recording.
            InputError: It has no configuration, or one that this version cannot read.
        """
        if not isinstance(recording, Recording):
            hint = "`import_flight` makes a recording of a station from it"
            raise NoAnswerError("another tool's recording has no station to ask", where=recording.name, hint=hint)
        found = self._runs.get(id(recording))
        if found is None:
            from aerodft.app.assembly import RecordedRun  # a replay that nobody asks needs no pipeline

            found = self._runs[id(recording)] = RecordedRun(recording)
        return found


class Replay:
    """Recordings that are published again: original payloads on original keys, in order of time.

    A ``with`` block opens the bus and the link, and closes them; ``play`` plays within it. Until then ``measure``,
    ``probes`` and ``history`` queries are answered as the station would have at the time that is being replayed.

    Args:
        recordings: Opened recordings, of aerodft or other tools; several are merged by time.
        start_ns: Log time (UTC) to start at; None for the first message.
        stop_ns: Log time (UTC) to stop before; None for the end.
        rate: Times real time; None for as fast as it goes.
        is_now: Whether all stamps are moved by one amount, the first of them to now.
        listen: Endpoint to listen on; None to connect only.
        connect: Endpoints to connect to.
        mavlink: Where recorded MAVLink is sent too, as it came: ``udpout:HOST:PORT``; None for nowhere.
        wait_s: How long a first subscriber is waited for.
        controls: Pause, steps, looping and the end, which may be changed from any thread while it plays.

    Raises:
        UsageError: ``rate``, ``mavlink``, or the order of ``start_ns`` and ``stop_ns`` makes no sense.
        NoAnswerError: The recordings hold nothing between the two, or no MAVLink where it is to be sent.

    Examples:
        >>> from pathlib import Path
        >>> from aerodft.app.replay import Replay
        >>> from replay.foreign import open_recording
        >>> with Replay([open_recording(Path("tests/cli/frozen-0.1"))], rate=None, listen=None) as replay:
        ...     replay.play()
        >>> replay.result.measurements, replay.result.has_listeners
        (118, False)
    """

    def __init__(  # noqa: PLR0913 - what a user may choose, by name
        self,
        recordings: Sequence[AnyRecording],
        *,
        start_ns: int | None = None,
        stop_ns: int | None = None,
        rate: float | None = 1.0,
        is_now: bool = False,
        listen: str | None = DEFAULT_LISTEN,
        connect: Sequence[str] = (),
        mavlink: str | None = None,
        wait_s: float = 0.0,
        controls: Controls | None = None,
    ) -> None:
        if rate is not None and not _SLOWEST <= rate <= _FASTEST:
            raise UsageError("`rate`", got=f"{rate:g}", expected=f"{_SLOWEST:g} to {_FASTEST:g} times real time")
        self._recordings = tuple(recordings)
        self._from_ns, self._to_ns = start_ns, stop_ns
        self._zero_ns = min(each.zero_ns for each in self._recordings)
        self._first_ns, self._last_ns = self._window()
        self._listen, self._connect, self._wait_s = listen, connect, wait_s
        self._mavlink = None if mavlink is None else parse_address(mavlink)
        if self._mavlink is not None:
            if self._mavlink.kind is LinkKind.UDP_IN:
                raise UsageError("`mavlink`", got=mavlink, expected="udpout:HOST:PORT: nobody would be sent to")
            check_mavlink(self._recordings)
        self.controls = Controls() if controls is None else controls
        self._player = Player(outlets=(), clock=WallClock(), rate=rate, is_now=is_now, controls=self.controls)
        self._publisher: Republisher | None = None
        self._sender: MavlinkOut | None = None
        self._has_listeners = False
        self._stack = ExitStack()

    def _window(self) -> tuple[int, int]:
        """The first and the last log time that are played.

        Raises:
            UsageError: The start is not before the end.
            NoAnswerError: The recordings have nothing between them.
        """
        first_ns, last_ns = (
            min(each.start_ns for each in self._recordings),
            max(each.end_ns for each in self._recordings),
        )
        from_ns, to_ns, zero_ns = self._from_ns, self._to_ns, self._zero_ns
        got = " to ".join(
            otherwise if at_ns is None else f"{(at_ns - zero_ns) / SECOND_NS:g} s ({unix_ns_to_iso(at_ns)})"
            for at_ns, otherwise in ((from_ns, "the start"), (to_ns, "the end"))
        )
        if from_ns is not None and to_ns is not None and from_ns >= to_ns:
            raise UsageError("`start_ns` is not before `stop_ns`", got=got)
        if (from_ns is not None and from_ns > last_ns) or (to_ns is not None and to_ns <= first_ns):
            first, last = (f"{(each - zero_ns) / SECOND_NS:.1f}" for each in (first_ns, last_ns))
            expected = f"times within {first} to {last} s from its first image"
            where = ", ".join(each.name for each in self._recordings)
            raise NoAnswerError("the recording has nothing there", where=where, got=got, expected=expected)
        return max(from_ns or 0, first_ns), min(to_ns or last_ns, last_ns)

    def __enter__(self) -> Self:
        """Open the bus and the link, and wait for whoever is to be there.

        Raises:
            LinkError: An endpoint or the address cannot be opened.
            NoAnswerError: No peer or no subscriber came in time.
        """
        with ExitStack() as stack:
            if self._mavlink is not None:
                transport = open_transport(self._mavlink)
                stack.callback(transport.close)
                self._sender = MavlinkOut(transport)
            session = stack.enter_context(session_on(self._listen, self._connect))
            queries = _ReplayedQueries(session, self._recordings)
            stack.callback(queries.close)
            self._publisher = Republisher(session, queries.remember)
            stack.callback(self._publisher.close)
            self._await_listeners(self._publisher)
            self._player.outlets = [queries, self._publisher, *([self._sender] if self._sender else [])]
            self._stack = stack.pop_all()
        return self

    def _await_listeners(self, publisher: Republisher) -> None:
        link_s = max(self._wait_s, _LINK_S)
        if self._connect and not publisher.wait_for_link(link_s):
            got = f"no answer within {link_s:g} s"
            where = ", ".join(self._connect)
            raise NoAnswerError("nobody to publish to", where=where, got=got, hint="nothing was published")
        if self._wait_s and not publisher.wait_for_subscriber(self._recordings, self._wait_s):
            raise NoAnswerError("nobody subscribed", where=self._listen, got=f"nothing within {self._wait_s:g} s")

    def play(self, progress: Progress = no_progress, on_pause: Callable[[int, int], None] | None = None) -> None:
        """Play to the end, or until ``controls`` or an exception of a callback ends it.

        Args:
            progress: Called after each message with nanoseconds of the recording.
            on_pause: Called with the log time (UTC ns) at which it pauses, and nanoseconds of the recording until then.

        Raises:
            AerodftError: A recording cannot be read.
            ValueError: The ``with`` block was not entered.
        """
        if self._publisher is None:
            raise ValueError("the replay has not been entered: there is nothing to publish on")
        span_ns, player = self._last_ns - self._first_ns, self._player
        player.on_time = lambda log_ns: progress(log_ns - self._first_ns, span_ns)
        if on_pause is not None:
            player.on_pause = lambda log_ns: on_pause(log_ns, log_ns - self._zero_ns)

        def is_wanted(recording: AnyRecording, channel: Channel) -> bool:
            return is_published(recording, channel) or (self._sender is not None and recording.holds_mavlink(channel))

        player.play(lambda: timeline(self._recordings, self._from_ns, self._to_ns, is_wanted))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the bus and the link."""
        self._has_listeners = self._publisher is not None and self._publisher.has_listeners
        self._stack.close()

    @property
    def result(self) -> ReplayResult:
        """Counts of what was published; complete once the ``with`` block was left.

        Raises:
            ValueError: It was not entered yet.
        """
        if self._publisher is None:
            raise ValueError("the replay has not been entered: nothing was published")
        published = self._publisher.published
        return ReplayResult(
            measurements=published.measurements,
            images=published.images,
            others=published.others,
            rounds=self._player.rounds,
            has_listeners=self._has_listeners,
            mavlink_frames=None if self._sender is None else self._sender.frames,
            is_stopped=self.controls.ended,
            left_out=LeftOut.joined(
                [
                    *(each.left_out(images=True) for each in self._recordings if isinstance(each, Recording)),
                    LeftOut(damaged_messages=published.damaged),
                ]
            ),
        )
