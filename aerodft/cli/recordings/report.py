"""``aerodft report``: one page about a recording or a river."""

from pathlib import Path
from typing import Annotated

import typer

from aerodft.cli.output import say


def report(
    what: Annotated[
        Path, typer.Argument(metavar="RECORDING|RIVER-FOLDER", help="A recording, or the folder that river wrote.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The page to write: HTML in one file.")],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file where there is one.")] = False,
) -> None:
    r"""Write one page: what was measured and how surely, picture, map, plots, table, assumptions, files and hashes.

    It opens in any browser without network, and prints on A4.

    \b
    Example:
      aerodft report recordings/flight -o flight.html
      aerodft report reach -o river.html
    """
    from aerodft.app.recordings import report as write_report

    say(f"{write_report(what, output, overwrite=overwrite)}: open it in a browser")
