"""``aerodft replay``: a recording on the bus again."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from aerodft.adapters.zenoh.session import DEFAULT_LISTEN, session_on
from aerodft.cli.output import print_json, progress_bar, say
from aerodft.cli.times import parse_instant
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError, UsageError
from aerodft.service.clock import WallClock
from replay.publish import Published, Republisher
from replay.recording import Recording

_NOWHERE = "none"


class Rate(StrEnum):
    """Times real time."""

    REAL = "1"
    FOURFOLD = "4"
    MAX = "max"


def replay(
    recording: Annotated[Path, typer.Argument(help="The recording's folder.")],
    *,
    rate: Annotated[Rate, typer.Option(help="Times real time, or as fast as it goes.")] = Rate.REAL,
    start: Annotated[
        str | None, typer.Option("--from", help="Seconds from the recording's start, UTC ns, or ISO 8601.")
    ] = None,
    stop: Annotated[str | None, typer.Option("--to", help="Likewise; stops before it.")] = None,
    listen: Annotated[str, typer.Option(help=f"Endpoint to listen on; {_NOWHERE} to connect only.")] = DEFAULT_LISTEN,
    connect: Annotated[list[str] | None, typer.Option(help="Endpoint to connect to; may be repeated.")] = None,
    wait: Annotated[float, typer.Option(help="Wait this many seconds for a first subscriber.", min=0)] = 0.0,
    json: Annotated[bool, typer.Option("--json", help="Print what was published as JSON.")] = False,
) -> None:
    r"""Publish a recording again: original payloads on original keys, in order.

    \b
    Example:
      aerodft replay flights/2026-11-21 --rate 4 --from 30 --to 90
    """
    opened = Recording(recording)
    from_ns, to_ns = _window(opened, start, stop)
    factor = None if rate is Rate.MAX else float(rate)
    with session_on(None if listen == _NOWHERE else listen, connect or ()) as session:
        publisher = Republisher(session=session, clock=WallClock(), rate=factor)
        if wait and not publisher.wait_for_subscriber(opened, wait):
            raise NoAnswerError("nobody subscribed", where=listen, got=f"nothing within {wait:g} s")
        with progress_bar("replaying", max(from_ns, opened.start_ns), min(to_ns, opened.end_ns)) as on_time:
            try:
                published = publisher.publish(opened, from_ns=from_ns, to_ns=to_ns, on_time=on_time)
            except KeyboardInterrupt:
                say(f"{recording}: stopped")
                return
    _report(recording, published, as_json=json)


def _window(recording: Recording, start: str | None, stop: str | None) -> tuple[int, int]:
    """What ``--from`` and ``--to`` say, in UTC ns.

    Raises:
        UsageError: One of them is no time, or they are in the wrong order.
        NoAnswerError: The recording has nothing between them.
    """
    from_ns = recording.start_ns if start is None else parse_instant("--from", start, recording.start_ns)
    to_ns = recording.end_ns + 1 if stop is None else parse_instant("--to", stop, recording.start_ns)
    got = f"{start or 'the start'} to {stop or 'the end'}"
    length_s = (recording.end_ns - recording.start_ns) / SECOND_NS
    expected = f"times within 0 to {length_s:.1f} s from its start"
    if start and stop and from_ns >= to_ns:
        raise UsageError("--from is not before --to", got=got)
    if from_ns > recording.end_ns or to_ns <= recording.start_ns:
        raise NoAnswerError("the recording has nothing there", where=recording.folder, got=got, expected=expected)
    return from_ns, to_ns


def _report(recording: Path, published: Published, *, as_json: bool) -> None:
    if as_json:
        print_json(
            {
                "recording": str(recording),
                "measurements": published.measurements,
                "images": published.images,
                "others": published.others,
            }
        )
        return
    say(
        f"{recording}: published {published.measurements} measurements, {published.images} images"
        f" and {published.others} poses and states"
    )
