"""``aerodft replay``: recordings on the bus, and their MAVLink on a link, again."""

import os
import select
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.adapters.wire.keys import DEFAULT_LISTEN
from aerodft.cli.options import JsonOption, TopicOption, grouped, parse_instant, parse_topics
from aerodft.cli.output import end_with_gaps, print_json, progress, say
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError, UsageError

if TYPE_CHECKING:
    from aerodft.app.replay import ReplayResult
    from replay.player import Controls

_NOWHERE = "none"

_HAS_TERMINALS = find_spec("termios") is not None
_POLL_S = 0.1
_LONGEST = 8  # bytes of the sequence that one key sends


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayOptions:
    """Options on the span, speed and rounds of a replay."""

    rate: Annotated[str, typer.Option(help="Times real time (0.1, 4, ...), or max: as fast as it goes.")] = "1"
    start: Annotated[str | None, typer.Option("--from", help="Seconds from the first image, UTC ns, or ISO 8601.")] = (
        None
    )
    stop: Annotated[str | None, typer.Option("--to", help="Where to stop (before it), written as --from.")] = None
    stamps: Annotated[
        Literal["original", "now"],
        typer.Option(help="now: all stamps are moved by one amount, the first of them to now."),
    ] = "original"
    loop: Annotated[bool, typer.Option("--loop", help="Again and again, until it is stopped.")] = False
    step: Annotated[bool, typer.Option("--step", help="Image by image, at the press of a key.")] = False

    def controls(self) -> "Controls":
        """Controls that keys change during the replay."""
        from replay.player import Controls

        if self.step and not has_keys():
            raise UsageError("--step", got="no terminal", expected="a terminal to press keys on")
        return Controls(paused=self.step, looping=self.loop)

    def window(self, start_ns: int) -> dict[str, Any]:
        """The arguments of ``Replay`` for recordings that start then (UTC)."""
        return {
            "start_ns": None if self.start is None else parse_instant("--from", self.start, start_ns),
            "stop_ns": None if self.stop is None else parse_instant("--to", self.stop, start_ns),
            "rate": _rate(self.rate),
            "is_now": self.stamps == "now",
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class OutletOptions:
    """Options on the destination of messages."""

    mavlink: Annotated[str | None, typer.Option(help="Send its MAVLink there too, as it came: udpout:HOST:PORT.")] = (
        None
    )
    listen: Annotated[str, typer.Option(help=f"Endpoint to listen on; {_NOWHERE} to connect only.")] = DEFAULT_LISTEN
    connect: Annotated[list[str] | None, typer.Option(help="Endpoint to connect to; may be repeated.")] = None
    wait: Annotated[float, typer.Option(help="Wait this many seconds for a first subscriber.", min=0)] = 0.0


@grouped
def replay(
    recordings: Annotated[list[Path], typer.Argument(help="Folders or MCAP files; several are merged by time.")],
    played: PlayOptions,
    outlets: OutletOptions,
    *,
    topic: TopicOption = None,
    json: JsonOption = False,
) -> None:
    r"""Publish recordings again: original payloads on original keys, in order of time.

    On a terminal space pauses and goes on, n or the right arrow goes to the next image, l loops or stops looping, q
    ends. Exit 5 where damaged or missing parts or messages of a recording are not in what was
    published.

    \b
    Examples:
      aerodft replay flights/2026-11-21 --rate 4 --from 30 --to 90
      aerodft replay flights/2026-11-21 --mavlink udpout:127.0.0.1:14550 --loop
    """
    from aerodft.app.replay import Replay
    from replay.foreign import open_recording

    controls = played.controls()
    opened = [open_recording(path, parse_topics(topic)) for path in recordings]
    with (
        Replay(
            opened,
            **played.window(min(each.zero_ns for each in opened)),
            listen=None if outlets.listen == _NOWHERE else outlets.listen,
            connect=outlets.connect or (),
            mavlink=outlets.mavlink,
            wait_s=outlets.wait,
            controls=controls,
        ) as player,
        progress("replaying") as bar,
        _keys_to(controls),
    ):
        try:
            player.play(bar, _say_pause)
        except KeyboardInterrupt:  # ends it as the key does, and what went out is said
            controls.end()
    result = player.result
    if result.is_stopped:
        say("aerodft: stopped")
    _report([str(path) for path in recordings], result, as_json=json)
    if not result.is_stopped and result.is_empty:
        where = ", ".join(map(str, recordings))
        raise NoAnswerError("nothing was published", where=where, hint="it holds nothing there, or is damaged")
    end_with_gaps(result.left_out)


def _rate(text: str) -> float | None:
    """Times real time; None for ``max``."""
    try:
        return None if text == "max" else float(text)
    except ValueError:
        raise UsageError("--rate", got=repr(text), expected="a number, or max") from None


def _keys_to(controls: "Controls") -> AbstractContextManager[None]:
    """Have keys of the terminal change what is played."""

    def toggle_loop() -> None:
        controls.looping = not controls.looping
        say("looping" if controls.looping else "not looping")

    return key_actions(
        {
            " ": controls.pause_or_go,
            "n": controls.step,
            "\x1b[C": controls.step,
            "l": toggle_loop,
            "q": controls.end,
        }
    )


def _say_pause(log_ns: int, passed_ns: int) -> None:
    at = f"{passed_ns / SECOND_NS:.3f} s ({unix_ns_to_iso(log_ns)})"
    say(f"paused at {at}: space goes on, n is the next image, q ends")


def _report(names: list[str], result: "ReplayResult", *, as_json: bool) -> None:
    if as_json:
        document = {
            "recording": names[0] if len(names) == 1 else names,
            "measurements": result.measurements,
            "images": result.images,
            "others": result.others,
            "rounds": result.rounds,
            "subscribers": result.has_listeners,
            **result.left_out.document(),
        }
        print_json(document if result.mavlink_frames is None else {**document, "mavlink_frames": result.mavlink_frames})
        return
    frames = "" if result.mavlink_frames is None else f", sent {result.mavlink_frames} MAVLink frames"
    say(
        f"{', '.join(names)}: published {result.measurements} measurements, {result.images} images"
        f" and {result.others} poses and states{frames}"
    )
    if not result.has_listeners and result.mavlink_frames is None:
        say("aerodft: nobody subscribed to them; --wait SECONDS waits for somebody")


def has_keys() -> bool:
    """Whether somebody could press a key: stdin and stderr are a terminal, and this is its foreground."""
    if not _HAS_TERMINALS or not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    return _is_foreground(sys.stdin.fileno())


@contextmanager
def key_actions(actions: Mapping[str, Callable[[], None]]) -> Iterator[None]:
    """Call an action for each of its keys, from a thread, until the end; the terminal is left as it was.

    Args:
        actions: By what the key sends, which for an arrow is several characters.
    """
    if not has_keys():
        yield
        return
    import termios
    import tty

    number = sys.stdin.fileno()
    before = termios.tcgetattr(number)
    ending = threading.Event()
    thread = threading.Thread(target=_listen, args=(number, actions, ending), name="keys", daemon=True)
    try:
        tty.setcbreak(number)
        thread.start()
        yield
    finally:
        ending.set()
        if thread.is_alive():
            thread.join(2 * _POLL_S)
        termios.tcsetattr(number, termios.TCSADRAIN, before)


def _listen(number: int, actions: Mapping[str, Callable[[], None]], ending: threading.Event) -> None:
    while not ending.is_set():
        ready, _, _ = select.select([number], [], [], _POLL_S)
        # To read from the background would stop the whole process.
        if not ready or not _is_foreground(number):
            continue
        text = os.read(number, _LONGEST)
        if not text:
            return
        found = text.decode(errors="replace")
        for key in [found] if found in actions else found:
            action = actions.get(key)
            if action is not None:
                action()


def _is_foreground(number: int) -> bool:
    try:
        return os.tcgetpgrp(number) == os.getpgrp()
    except OSError:
        return False
