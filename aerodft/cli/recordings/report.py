"""``aerodft report``: one page about a recording or a river."""

from pathlib import Path
from typing import Annotated

import typer

from aerodft.cli.options import OverwriteOption
from aerodft.cli.output import end_with_gaps, say


def report(
    what: Annotated[
        Path, typer.Argument(metavar="RECORDING|RIVER-FOLDER", help="A recording, or the folder that river wrote.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The page to write: HTML in one file.")],
    overwrite: OverwriteOption = False,
) -> None:
    r"""Write one page: what was measured and how surely, picture, map, plots, table, assumptions, files and hashes.

    It opens in any browser without network, and prints on A4. Exit 5 where parts of the recording are missing.

    \b
    Example:
      aerodft report recordings/flight -o flight.html
      aerodft report reach -o river.html
    """
    from aerodft.app.recordings import open_recording
    from aerodft.app.recordings import report as write_report
    from aerodft.reports.river_folder import is_river_folder

    recording = None if is_river_folder(what) else open_recording(what)
    say(f"{write_report(recording or what, output, overwrite=overwrite)}: open it in a browser")
    if recording is not None:
        end_with_gaps(recording.reader.left_out(images=True))
