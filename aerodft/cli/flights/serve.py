"""``aerodft serve``: MAVLink and images in, measurements out on zenoh and into a recording, until it is stopped."""

import gc
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from aerodft.cli.interrupts import calling_on_signal
from aerodft.cli.options import MOST_SECONDS, JsonOption, PageOptions, grouped
from aerodft.cli.output import say
from aerodft.cli.summary import report


@grouped
def serve(
    config: Annotated[Path, typer.Argument(help="Station configuration (TOML).")],
    page: PageOptions,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="New folder for the recording; else one under record.folder.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(min=0.0, max=MOST_SECONDS, help="Stop after this time.")] = None,
    json: JsonOption = False,
    web: Annotated[bool, typer.Option("--web", help="Show the images as a page, to measure in them.")] = False,
) -> None:
    r"""Measure live until SIGINT or SIGTERM: every configured probe, for every image.

    \b
    Example:
      aerodft serve configs/services/river-flight.toml
      aerodft serve configs/services/river-flight.toml --web
    """
    from aerodft.app.station import Station

    station = Station(config, output=output)
    with ExitStack() as stack:
        if web:
            from aerodft.app.viewing import LiveView

            view = LiveView(station)
            station.add_output(view)
            address = stack.enter_context(page.page_of(view))
        stack.enter_context(station)
        stack.enter_context(calling_on_signal(station.stop))
        gc.freeze()  # else each full search among 100,000 loaded objects holds everything up for 0.05 to 0.12 s
        if web:
            say(f"{station.config.pipeline.station}: open {address} in a browser")
        say(f"recording to {station.recording}; stop with Ctrl-C")
        station.wait(seconds)
    for sentence in station.output_warnings:
        say(sentence)
    report(station.result, as_json=json, live=True)
