"""Options of several commands: each described once, alone or in a group that a command takes as one value."""

import inspect
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, get_type_hints

import typer

from aerodft.errors import InputError

if TYPE_CHECKING:
    from aerodft.app.viewing import View

ConfigOption: TypeAlias = Annotated[Path | None, typer.Option("--config", "-c", help="Station file (TOML).")]
OverwriteOption: TypeAlias = Annotated[bool, typer.Option("--overwrite", help="Replace what is there.")]
JsonOption: TypeAlias = Annotated[bool, typer.Option("--json", help="Print JSON on stdout, and nothing else there.")]
TopicOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option("--topic", help="Of another tool's recording: mavlink=/TOPIC, images=/TOPIC, camera=/TOPIC."),
]


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """A command in which a parameter that is a dataclass stands for the options that are the dataclass's fields."""
    hints, signature = get_type_hints(command, include_extras=True), inspect.signature(command)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}

    @wraps(command)
    def run(**options: Any) -> None:  # noqa: ANN401 - of all kinds
        values = {
            name: group(**{each.name: options.pop(each.name) for each in fields(group) if each.name in options})
            for name, group in groups.items()
        }
        command(**values, **options)

    parameters = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint)
        for each in signature.parameters.values()
        for name, default, hint in _options_of(each, hints[each.name])
    ]
    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]  # what inspect looks for
    return run


def _options_of(parameter: inspect.Parameter, hint: Any) -> list[tuple[str, Any, Any]]:  # noqa: ANN401 - any type
    """Name, default and annotated type of each option that a parameter stands for."""
    if not is_dataclass(hint):
        return [(parameter.name, parameter.default, hint)]
    hints = get_type_hints(hint, include_extras=True)
    empty = inspect.Parameter.empty
    return [(each.name, empty if each.default is MISSING else each.default, hints[each.name]) for each in fields(hint)]


@dataclass(frozen=True, slots=True, kw_only=True)
class PageOptions:
    """Where a page listens, and what it lets people do."""

    host: Annotated[
        str, typer.Option(help="Address that the page listens on; beyond this machine a token is asked for.")
    ] = "127.0.0.1"
    port: Annotated[int, typer.Option(help="Of the page; 0 takes a free one.", min=0, max=65535)] = 0
    read_only: Annotated[
        bool, typer.Option("--read-only", help="On the page look and measure only; change nothing.")
    ] = False

    tiles: Annotated[
        str | None,
        typer.Option(
            help="Tile server for the page's map, such as https://tiles.example/{z}/{x}/{y}.png; else a grid."
        ),
    ] = None

    def page_of(self, view: "View", std_px: float | None = None) -> AbstractContextManager[str]:
        """The page of a view while the ``with`` block lasts; gives its address.

        Raises:
            InputError: Tornado is not installed.
            UsageError: The host is no address, or the tiles' address names no tiles.
        """
        try:
            from aerodft.web import Access, page_beside
        except ImportError as error:
            raise InputError("the page needs Tornado", got=error, hint="install aerodft[web]") from error
        access = Access.at(self.host, self.port, is_read_only=self.read_only, tiles=self.tiles)
        return page_beside(view, access, 1.0 if std_px is None else std_px)
