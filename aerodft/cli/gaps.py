"""What is not in a result because the recording that it was made of is damaged, or not all there."""

from collections.abc import Mapping
from typing import Final

import typer

from aerodft.cli.output import say

LOSS: Final = 5
"""Exit code of what is done, and not whole."""


def end_with_gaps(left_out: Mapping[str, int]) -> None:
    """Say what of the input could not be read.

    Raises:
        Exit: With 5, where there is such.
    """
    if any(left_out.values()):
        say(f"aerodft: {gaps(left_out)}")
        raise typer.Exit(LOSS)


def gaps(left_out: Mapping[str, int]) -> str:
    """What could not be read, as a sentence; empty where that is nothing."""
    found = [
        f"{count} {what.replace('_', ' ').removesuffix('s' if count == 1 else '')}"
        for what, count in left_out.items()
        if count
    ]
    return f"the recording is not whole, and so is what came of it: without {' and '.join(found)}" if found else ""
