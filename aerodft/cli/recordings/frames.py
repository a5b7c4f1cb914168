"""``aerodft frames``: stills of a recording or a video, to read pixels in."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from aerodft.cli.options import JsonOption, OverwriteOption, parse_instant
from aerodft.cli.output import print_json, say


def frames(
    source: Annotated[Path, typer.Argument(metavar="RECORDING|VIDEO", help="Where the images are.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the PNG files.")],
    at: Annotated[
        list[str] | None, typer.Option(help="Seconds from the first image, UTC ns, or ISO 8601; may be repeated.")
    ] = None,
    every: Annotated[float | None, typer.Option(help="Instead: an image every so many seconds.")] = None,
    overlay: Annotated[bool, typer.Option("--overlay", help="Draw values, intervals and statuses in.")] = False,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    r"""Write the images nearest to some instants as PNG, pixel for pixel, or with what was measured drawn in.

    \b
    Example:
      aerodft frames flight.mp4 --at 12.5 --at 30 -o stills
      aerodft frames recordings/flight --every 10 --overlay -o stills
    """
    from aerodft.app.frames import open_reel, write_stills

    reel = open_reel(source)
    stills = write_stills(
        reel,
        output,
        at_ns=[parse_instant("--at", text, reel.zero_ns) for text in at or ()],
        every_s=every,
        with_overlay=overlay,
        overwrite=overwrite,
    )
    if json:
        print_json([asdict(each) | {"path": str(each.path), "stamp_ns": str(each.stamp_ns)} for each in stills])
        return
    for each in stills:
        say(f"{each.path}: image {each.image}, at {each.seconds:.3f} s")
