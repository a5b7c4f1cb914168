"""Options of several commands: described once, alone or in groups; and times, topics and names as people write them."""

import inspect
import math
import re
import tomllib
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias, get_type_hints

import typer

from aerodft.adapters.timestamps import iso_to_unix_ns
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, UsageError

if TYPE_CHECKING:
    from aerodft.adapters.config.station import Topics
    from aerodft.app.viewing import View

ConfigOption: TypeAlias = Annotated[Path | None, typer.Option("--config", "-c", help="Station file (TOML).")]
OverwriteOption: TypeAlias = Annotated[bool, typer.Option("--overwrite", help="Replace what is there.")]
JsonOption: TypeAlias = Annotated[bool, typer.Option("--json", help="Print JSON on stdout, and nothing else there.")]
TopicOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option("--topic", help="Of another tool's recording: mavlink=/TOPIC, images=/TOPIC, camera=/TOPIC."),
]

LOG_FORMATS: Final = "{log formats}"
"""In a help text: what the registry of log formats names, which is loaded where the text is shown."""

MOST_SECONDS = 1e8
"""Three years: what a wait may last at most."""

_EXPECTED_TIME = "ISO 8601 that ends with Z or an offset like +01:00, seconds, or nanoseconds since 1970"
_LEAST_UNIX_S = 1e8  # 1973; anything below is seconds from a start
_MOST_UNIX_S = 1e10  # 2286; milli- and microseconds are in between
_LEAST_UNIX_NS = 1e17
_MOST_UNIX_NS = 9.2e18

_ROLES = ("mavlink", "images", "camera")
_SINGLE = ("images", "camera")

_NAMED: Final = re.compile(r"`([a-z_]+)`")
_UNIT: Final = re.compile(r"_(?:m|px|deg|s|ns|hz)$")
_TYPED_AS: Final = {
    "align": "`aerodft sync`",
    "calibrate": "`aerodft calibrate`",
    "calibrate_lens": "`aerodft calibrate-lens`",
    "diagnose": "`aerodft doctor`",
    "export": "`aerodft export`",
    "find_cameras": "`aerodft cameras`",
    "import_flight": "`aerodft import`",
    "recompute": "`aerodft recompute`",
    "recover": "`aerodft recover`",
    "river": "`aerodft river`",
    "settings": "--set",
    "form": "--format",
    "path": "--output",
    "probes": "--probe",
    "start_ns": "--from",
    "station": "--config",
    "stop_ns": "--to",
    "sync": "--sync auto",
    "topics": "--topic",
    "with_overlay": "--overlay",
}
"""What is typed for names of the Python API, where it is not the name of a parameter without its unit."""


def help_record(parameter: Any, context: Any) -> tuple[str, str] | None:  # noqa: ANN401 - types of the library's own
    """A parameter as help shows it, and what it is; None of one that is hidden."""
    record: tuple[str, str] | None = parameter.get_help_record(context)
    if record is None or LOG_FORMATS not in record[1]:
        return record
    from aerodft.adapters import telemetry

    return record[0], record[1].replace(LOG_FORMATS, ", ".join(each.TITLE for each in telemetry.LOG_FORMATS))


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
class SettingOptions:
    """Options that change single keys of the configuration that a recording is computed with."""

    home_above_plane: Annotated[
        float | None,
        typer.Option(help="Of a recording or a drone's photograph: height of the take-off point above the water, m."),
    ] = None
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="Of a recording: KEY=VALUE of the station file, as limits.max_range_m=80; again for more."
        ),
    ] = None

    def settings(self) -> dict[str, Any]:
        """Values by dotted key of the station file.

        Raises:
            UsageError: An option is no key with a value, or states a key twice.
        """
        from aerodft.adapters.config.station import HOME_ABOVE_PLANE

        found: dict[str, Any] = {}
        if self.home_above_plane is not None:
            found[HOME_ABOVE_PLANE] = self.home_above_plane
        for text in self.set_ or ():
            key, is_stated, value = (part.strip() for part in text.partition("="))
            if not (key and is_stated and value):
                raise UsageError("--set", got=repr(text), expected="KEY=VALUE, as limits.max_range_m=80")
            if key in found:
                raise UsageError(f"--set {key}", got="it twice", expected="one value of each key")
            found[key] = _toml_value(value)
        return found

    def refuse(self, expected: str, *, but_height: bool = False) -> None:
        """Refuse these options where no recording is computed; ``but_height`` leaves that of the take-off point."""
        for option, given in (
            ("--home-above-plane", None if but_height else self.home_above_plane),
            ("--set", self.set_),
        ):
            if given is not None:
                raise UsageError(option, expected=expected)


def _toml_value(text: str) -> Any:  # noqa: ANN401 - TOML's types
    """A value as TOML has it; what is no TOML is text, so that names need no quotes."""
    try:
        document = tomllib.loads(f"value = {text}")
    except ValueError:
        return text
    return document["value"] if document.keys() == {"value"} else text


@dataclass(frozen=True, slots=True, kw_only=True)
class PageOptions:
    """Options on the address of a page, and on what it lets people do."""

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

    def page_of(self, view: "View") -> AbstractContextManager[str]:
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
        return page_beside(view, access)


def as_typed(sentence: str) -> str:
    """A sentence with the options and commands that people type, for the Python API's names, which are in backticks.

    Errors, warnings and remarks name what a caller of a function knows: ``max_range_m`` is typed ``--max-range``.
    """
    return _NAMED.sub(lambda name: _TYPED_AS.get(name[1]) or f"--{_UNIT.sub('', name[1]).replace('_', '-')}", sentence)


def parse_utc(option: str, text: str) -> int:
    """A UTC instant in ns.

    Raises:
        UsageError: The text is no such time.
    """
    number = _number(text)
    stamp_ns = -1
    if number is None:
        with suppress(ValueError):
            stamp_ns = iso_to_unix_ns(text)
    elif _LEAST_UNIX_S <= number < _MOST_UNIX_S or number >= _LEAST_UNIX_NS:
        stamp_ns = _unix_ns(text, number)
    if not _LEAST_UNIX_NS <= stamp_ns < _MOST_UNIX_NS:
        raise UsageError(option, got=repr(text), expected=_EXPECTED_TIME)
    return stamp_ns


def parse_instant(option: str, text: str, start_ns: int) -> int:
    """A UTC instant in ns, given as such or in seconds from ``start_ns``.

    Raises:
        UsageError: The text is no such time.
    """
    number = _number(text)
    if number is not None and abs(number) < _LEAST_UNIX_S:
        return start_ns + round(number * SECOND_NS)
    return parse_utc(option, text)


def _unix_ns(text: str, number: float) -> int:
    if number >= _LEAST_UNIX_NS:
        return int(text) if text.isdigit() else round(number)
    whole, _, fraction = text.partition(".")
    if whole.isdigit() and fraction.isdigit():  # exact: a double holds unix seconds to 0.2 us only
        return int(whole) * SECOND_NS + int(fraction.ljust(9, "0")[:9])
    return round(number) * SECOND_NS if number.is_integer() else round(number * SECOND_NS)


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def parse_topics(given: list[str] | None, configured: "Topics | None" = None) -> "Topics":
    """Topics by the options, else by the configuration.

    Raises:
        UsageError: An option makes no sense.
    """
    from aerodft.adapters.config.station import Topics

    topics, stated = configured or Topics(), dict[str, tuple[str, ...]]()
    for text in given or ():
        role, _, topic = text.partition("=")
        if role not in _ROLES or not topic:
            expected = f"ROLE=TOPIC with one of {', '.join(_ROLES)}"
            raise UsageError("--topic", got=repr(text), expected=expected)
        if role in _SINGLE and role in stated:
            raise UsageError(f"--topic {role} twice", got=topic, expected=f"one topic of {role}")
        stated[role] = (*stated.get(role, ()), topic)
    return replace(topics, **stated)
