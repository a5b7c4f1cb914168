"""Where a page listens, as options of the commands that open one."""

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from aerodft.errors import InputError

if TYPE_CHECKING:
    from aerodft.app.viewing import View

HostOption: TypeAlias = Annotated[
    str, typer.Option(help="Address that the page listens on; beyond this machine a token is asked for.")
]
PortOption: TypeAlias = Annotated[int, typer.Option(help="Of the page; 0 takes a free one.", min=0, max=65535)]
ReadOnlyOption: TypeAlias = Annotated[
    bool, typer.Option("--read-only", help="On the page look and measure only; change nothing.")
]
TilesOption: TypeAlias = Annotated[
    str | None,
    typer.Option(help="Tile server for the page's map, such as https://tiles.example/{z}/{x}/{y}.png; else a grid."),
]


def page_of(
    view: "View", host: str, port: int, *, read_only: bool, tiles: str | None, std_px: float | None = None
) -> AbstractContextManager[str]:
    """The page of a view while the ``with`` block lasts; gives its address.

    Raises:
        InputError: Tornado is not installed.
        UsageError: The host is no address, or the tiles' address names no tiles.
    """
    try:
        from aerodft.web import Access, page_beside
    except ImportError as error:
        raise InputError("the page needs Tornado", got=error, hint="install aerodft[web]") from error
    access = Access.at(host, port, is_read_only=read_only, tiles=tiles)
    return page_beside(view, access, 1.0 if std_px is None else std_px)
