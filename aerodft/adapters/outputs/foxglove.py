"""``[foxglove]``: images with what is measured in them, numbers, poses and places in Foxglove's viewer, live."""

from typing import Annotated, Final

from pydantic import Field

from aerodft.adapters.config import Table
from aerodft.adapters.outputs.output import Output, Run


class FoxgloveTable(Table):
    """A WebSocket server for Foxglove's viewer, on this machine only; there is none without this table."""

    port: Annotated[int, Field(ge=1, le=65535)] = 8765
    image_hz: Annotated[float, Field(ge=0)] = 5.0


TABLE: Final = "foxglove"
MODEL: Final = FoxgloveTable
DEFAULT: Final = None


def open_output(settings: FoxgloveTable, run: Run) -> Output | None:
    """The server of a live run; None of any other."""
    if not run.is_live:
        return None
    from aerodft.adapters.outputs.foxglove_server import FoxgloveServer  # noqa: PLC0415 - else every file read loads it

    return FoxgloveServer(run, port=settings.port, image_hz=settings.image_hz)
