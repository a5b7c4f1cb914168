"""``aerodft plot``: the figure of a recording."""

from pathlib import Path
from typing import Annotated

import typer

from aerodft.cli.options import OverwriteOption
from aerodft.cli.output import end_with_gaps, say


def plot(
    recording: Annotated[Path, typer.Argument(help="The recording.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Figure to write: .png, .svg or .pdf.")],
    probe: Annotated[
        list[str] | None, typer.Option("--probe", help="Name of a probe to draw; may be repeated. By default all.")
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    r"""Draw values with 95 % intervals over time and along the river, heights by source, tilt, statuses and events.

    \b
    Example:
      aerodft plot recordings/flight -o flight.png
      aerodft plot recordings/flight --probe bridge -o bridge.pdf
    """
    from aerodft.app.recordings import open_recording

    opened = open_recording(recording)
    drawn = opened.plot(output, probe or (), overwrite=overwrite)
    say(f"{output}: {', '.join(drawn) or 'no probes'}, height, tilt and events")
    end_with_gaps(opened.reader.left_out())
