"""``aerodft replay``: recordings on the bus, and their MAVLink on a link, again."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from aerodft.adapters.bus import DEFAULT_LISTEN, session_on
from aerodft.adapters.recording import Channel
from aerodft.adapters.telemetry.mavlink import LinkKind, open_transport, parse_address
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.cli.option_values import TopicOption, parse_instant, parse_topics
from aerodft.cli.output import print_json, progress_bar, say
from aerodft.cli.recordings.keys import has_keys, pressed
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError, UsageError
from aerodft.service.clocks import WallClock
from replay.foreign import open_recording
from replay.player import (
    AnyRecording,
    Controls,
    MavlinkOut,
    Outlet,
    Player,
    Republisher,
    check_mavlink,
    holds_mavlink,
    is_published,
    name_of,
    timeline,
)

_NOWHERE = "none"
_LINK_S = 5.0  # for whoever --connect names to answer
_SLOWEST, _FASTEST = 0.01, 1000.0


class Stamps(StrEnum):
    """Whether stamps are moved."""

    ORIGINAL = "original"
    NOW = "now"


def replay(
    recordings: Annotated[list[Path], typer.Argument(help="Folders or MCAP files; several are merged by time.")],
    *,
    rate: Annotated[str, typer.Option(help="Times real time (0.1, 4, ...), or max: as fast as it goes.")] = "1",
    start: Annotated[
        str | None, typer.Option("--from", help="Seconds from the recording's start, UTC ns, or ISO 8601.")
    ] = None,
    stop: Annotated[str | None, typer.Option("--to", help="Where to stop (before it), written as --from.")] = None,
    stamps: Annotated[
        Stamps, typer.Option(help="now: all stamps are moved by one amount, the first of them to now.")
    ] = Stamps.ORIGINAL,
    loop: Annotated[bool, typer.Option("--loop", help="Again and again, until it is stopped.")] = False,
    step: Annotated[bool, typer.Option("--step", help="Image by image, at the press of a key.")] = False,
    mavlink: Annotated[
        str | None, typer.Option(help="Send its MAVLink there too, as it came: udpout:HOST:PORT.")
    ] = None,
    listen: Annotated[str, typer.Option(help=f"Endpoint to listen on; {_NOWHERE} to connect only.")] = DEFAULT_LISTEN,
    connect: Annotated[list[str] | None, typer.Option(help="Endpoint to connect to; may be repeated.")] = None,
    wait: Annotated[float, typer.Option(help="Wait this many seconds for a first subscriber.", min=0)] = 0.0,
    topic: TopicOption = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was published as JSON.")] = False,
) -> None:
    r"""Publish recordings again: original payloads on original keys, in order of time.

    On a terminal space pauses and goes on, n or the right arrow goes to the next image, l loops or stops looping, q
    ends.

    \b
    Examples:
      aerodft replay flights/2026-11-21 --rate 4 --from 30 --to 90
      aerodft replay flights/2026-11-21 --mavlink udpout:127.0.0.1:14550 --loop
    """
    factor = _rate(rate)
    if step and not has_keys():
        raise UsageError("--step", got="no terminal", expected="a terminal to press keys on")
    opened = [open_recording(path, parse_topics(topic)) for path in recordings]
    window = _window(opened, start, stop)
    controls = Controls(paused=step, looping=loop)
    with ExitStack() as stack:
        sender = _mavlink_out(mavlink, opened, stack)
        session = stack.enter_context(session_on(None if listen == _NOWHERE else listen, connect or ()))
        publisher = Republisher(session)
        stack.callback(publisher.close)
        if connect and not publisher.wait_for_link(max(wait, _LINK_S)):
            got = f"no answer within {max(wait, _LINK_S):g} s"
            raise NoAnswerError("nobody to publish to", where=", ".join(connect), got=got, hint="nothing was published")
        if wait and not publisher.wait_for_subscriber(opened, wait):
            raise NoAnswerError("nobody subscribed", where=listen, got=f"nothing within {wait:g} s")
        outlets: list[Outlet] = [publisher] if sender is None else [publisher, sender]
        player = Player(outlets=outlets, clock=WallClock(), rate=factor, is_now=stamps is Stamps.NOW, controls=controls)
        is_stopped = _play(player, opened, window)
        has_listeners = publisher.has_listeners
    if is_stopped:
        say("aerodft: stopped")
    _report(recordings, publisher, sender, player, has_listeners=has_listeners, as_json=json)
    if not is_stopped and not publisher.published.total and (sender is None or not sender.frames):
        where = ", ".join(map(str, recordings))
        raise NoAnswerError("nothing was published", where=where, hint="it holds nothing there, or is damaged")


def _rate(text: str) -> float | None:
    """Times real time; None for ``max``."""
    if text == "max":
        return None
    try:
        rate = float(text)
    except ValueError:
        rate = -1.0
    if not _SLOWEST <= rate <= _FASTEST:
        raise UsageError("--rate", got=repr(text), expected=f"{_SLOWEST:g} to {_FASTEST:g}, or max")
    return rate


def _window(recordings: Sequence[AnyRecording], start: str | None, stop: str | None) -> tuple[int | None, int | None]:
    """What ``--from`` and ``--to`` say, in UTC ns; None for the start and the end.

    Raises:
        UsageError: One of them is no time, or they are in the wrong order.
        NoAnswerError: The recordings have nothing between them.
    """
    first_ns, last_ns = min(each.start_ns for each in recordings), max(each.end_ns for each in recordings)
    from_ns = None if start is None else parse_instant("--from", start, first_ns)
    to_ns = None if stop is None else parse_instant("--to", stop, first_ns)
    got = f"{start or 'the start'} to {stop or 'the end'}"
    if from_ns is not None and to_ns is not None and from_ns >= to_ns:
        raise UsageError("--from is not before --to", got=got)
    if (from_ns is not None and from_ns > last_ns) or (to_ns is not None and to_ns <= first_ns):
        expected = f"times within 0 to {(last_ns - first_ns) / SECOND_NS:.1f} s from its start"
        where = ", ".join(name_of(each) for each in recordings)
        raise NoAnswerError("the recording has nothing there", where=where, got=got, expected=expected)
    return from_ns, to_ns


def _mavlink_out(text: str | None, recordings: Sequence[AnyRecording], stack: ExitStack) -> MavlinkOut | None:
    if text is None:
        return None
    address = parse_address(text)
    if address.kind is LinkKind.UDP_IN:
        raise UsageError("--mavlink", got=text, expected="udpout:HOST:PORT: nobody would be sent to")
    check_mavlink(tuple(recordings))
    transport = open_transport(address)
    stack.callback(transport.close)
    return MavlinkOut(transport)


def _play(player: Player, recordings: Sequence[AnyRecording], window: tuple[int | None, int | None]) -> bool:
    """Play to the end; True where it was stopped before."""
    from_ns, to_ns = window
    with_mavlink = any(isinstance(outlet, MavlinkOut) for outlet in player.outlets)

    def wanted(recording: AnyRecording, channel: Channel) -> bool:
        return is_published(recording, channel) or (with_mavlink and holds_mavlink(recording, channel))

    first_ns = max(from_ns or 0, min(each.start_ns for each in recordings))
    last_ns = max(each.end_ns for each in recordings)
    controls = player.controls
    actions: dict[str, Callable[[], None]] = {
        " ": controls.pause_or_go,
        "n": controls.step,
        "\x1b[C": controls.step,
        "l": lambda: _toggle_loop(controls),
        "q": controls.end,
    }

    def on_pause(log_ns: int) -> None:
        at_s = (log_ns - first_ns) / SECOND_NS
        say(f"paused at {at_s:.3f} s ({unix_ns_to_iso(log_ns)}): space goes on, n is the next image, q ends")

    player.on_pause = on_pause
    with progress_bar("replaying", first_ns, min(to_ns or last_ns, last_ns)) as on_time, pressed(actions):
        player.on_time = on_time
        try:
            player.play(lambda: timeline(recordings, from_ns, to_ns, wanted))
        except KeyboardInterrupt:  # ends it as the key does, and what went out is said
            controls.end()
    return controls.ended


def _toggle_loop(controls: Controls) -> None:
    controls.looping = not controls.looping
    say("looping" if controls.looping else "not looping")


def _report(
    recordings: Sequence[Path],
    publisher: Republisher,
    sender: MavlinkOut | None,
    player: Player,
    *,
    has_listeners: bool,
    as_json: bool,
) -> None:
    published = publisher.published
    names = [str(path) for path in recordings]
    if as_json:
        document = {
            "recording": names[0] if len(names) == 1 else names,
            "measurements": published.measurements,
            "images": published.images,
            "others": published.others,
            "damaged": published.damaged,
            "rounds": player.rounds,
            "subscribers": has_listeners,
        }
        print_json(document if sender is None else {**document, "mavlink_frames": sender.frames})
        return
    damaged = f"; left out {published.damaged} damaged payloads" if published.damaged else ""
    frames = "" if sender is None else f", sent {sender.frames} MAVLink frames"
    say(
        f"{', '.join(names)}: published {published.measurements} measurements, {published.images} images"
        f" and {published.others} poses and states{frames}{damaged}"
    )
    if not has_listeners and sender is None:
        say("aerodft: nobody subscribed to them; --wait SECONDS waits for somebody")
