"""The ``aerodft`` command: loads only the command that is asked for, and turns errors into exit codes.

Exit codes: 0 done, 1 a bug, 2 usage, 3 bad input or configuration, 4 no answer in the data, 5 done with a difference or
a loss to report.
"""

import difflib
import errno
import inspect
import io
import logging
import os
import re
import sys
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from importlib import import_module
from itertools import chain, pairwise
from keyword import iskeyword
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple, NoReturn, cast

import typer
from typer.core import TyperCommand
from typer.exceptions import TyperException

from aerodft.cli.interrupts import INTERRUPTED, TERMINATED, ending_on_signals
from aerodft.cli.options import as_typed, help_record
from aerodft.errors import AerodftError, InputError, Reason, UsageError, printable
from aerodft.version import SOFTWARE

_PIPE_CLOSED = 141


class _Command(NamedTuple):
    """Where a command is, a function that bears its name, and its line of help."""

    module: str
    help: str


COMMANDS: Final = {
    "measure": _Command("scenes.measure", "Measure pixels of one image with a known pose."),
    "explain": _Command(
        "scenes.measure", "Say where a measurement's uncertainty comes from, and what would make it smaller."
    ),
    "depth-map": _Command(
        "scenes.measure", "Write range and ground point of every pixel, and the image as seen from above."
    ),
    "serve": _Command("flights.serve", "Measure live: MAVLink and images in, zenoh and a recording out."),
    "init": _Command("setup", "Write first station and camera files for what you have."),
    "import": _Command("flights.import_", "Turn a flight's log (and video) into a recording with measurements."),
    "replay": _Command("recordings.replay", "Publish a recording again."),
    "recompute": _Command("recordings.recompute", "Compute one recording's measurements anew, or those of many."),
    "recover": _Command(
        "recordings.recover", "Make a recording whole whose recorder was killed or whose files were damaged."
    ),
    "compare": _Command("recordings.compare", "Compare two recordings measurement by measurement."),
    "export": _Command(
        "recordings.export",
        "Write a recording as a table, a map, one MCAP file or an annotated video; a river as a map.",
    ),
    "plot": _Command(
        "recordings.export", "Draw a recording: values with intervals, heights, tilt, statuses and events over time."
    ),
    "report": _Command("recordings.export", "Write one page about a recording or a river, for whoever was not there."),
    "view": _Command("scenes.view", "Show an image or a recording in the browser, to look, click and measure."),
    "frames": _Command("recordings.export", "Write stills of a recording or a video, to read pixels in."),
    "sync": _Command("flights.sync", "Align a video with a log: offset and drift of the clocks, lag of the gimbal."),
    "calibrate-lens": _Command(
        "scenes.calibrate", "Find a lens's focal length, centre and distortion from images of a board."
    ),
    "cameras": _Command("setup", "List cameras that many people have, and write their camera files."),
    "river": _Command("scenes.river", "Measure a river's width along it, in an image, a video or a recording."),
    "doctor": _Command("flights.doctor", "Say what a log or a live link holds, and what is wrong with it."),
    "calibrate": _Command(
        "scenes.calibrate", "Find a camera's height and angles from landmarks and what else is known of a scene."
    ),
    "paper": _Command("paper", "Compute the paper's tables and figures, beside what it prints."),
    "demo": _Command("demo", "Fly a simulated flight through everything and show the result."),
}
"""Every command."""

_EXAMPLE = 'Example: aerodft measure --camera cam.toml --height 50 --tilt 60 --probe "distance 812,604.5 1377,611"'

_CHOICES: Final = re.compile(r"'(?P<got>[^']*)' is not one of (?P<expected>.*?)\.?$", re.DOTALL)
_OUTPUT: Final = ("-o", "--output")
_FILE_TICK_S: Final = 0.02  # file systems stamp by a clock that lags by up to its last tick
_BOUND: Final = re.compile(r"should be (?P<expected>[^,]+)")


class _ReaderGone(Exception):  # noqa: N818 - no error: whoever read stdout has seen enough
    """The pipe behind stdout was closed at its other end."""


class _Stream(io.FileIO):
    """A standard stream whose first failure is its last: what is still to be written then goes nowhere.

    stdout raises ``_ReaderGone``, or ``InputError`` where it cannot be written; of stderr nobody is left to tell.
    """

    def write(self, data: bytes | memoryview, /) -> int:  # type: ignore[override]  # of the buffer, never None
        try:
            return super().write(data) or 0
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            if self.fileno() == 1 and isinstance(error, BrokenPipeError):
                raise _ReaderGone from error
            if self.fileno() == 1:
                raise InputError("the output cannot be written", where="stdout", got=error) from error
        return len(data)


def _guard_streams() -> None:
    """Have the process's own stdout and stderr fail in a sentence, and open closed ones on nothing.

    Else the next file opened would take the place of a closed one, and what C libraries print.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) in {None, getattr(sys, f"__{name}__")}:
            stream = _Stream(number, "w", closefd=False)
            buffer = io.BufferedWriter(cast("io.RawIOBase", stream))
            is_live = number == 2 or stream.isatty()  # noqa: PLR2004 - stderr
            text = io.TextIOWrapper(buffer, "utf-8", "backslashreplace", line_buffering=is_live, write_through=is_live)
            setattr(sys, name, text)


class _Sentences(logging.Formatter):
    """Formatter of log records, in the options' names as errors are."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - the library's own
        return as_typed(printable(super().formatMessage(record)))


_HANDLER: Final = logging.StreamHandler()
_HANDLER.setFormatter(_Sentences("aerodft: %(message)s"))


def _options(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Say more on stderr.")] = False,
) -> None:
    """Measurements from aerial images: telemetry and pixels in, metres with an honest uncertainty out."""
    if version:
        typer.echo(SOFTWARE)
        raise typer.Exit
    if context.invoked_subcommand is None:
        raise UsageError("no command", expected=f"one of {', '.join(COMMANDS)}", hint="see aerodft --help")
    _HANDLER.stream = sys.stderr
    logging.getLogger().addHandler(_HANDLER)
    logging.getLogger("aerodft").setLevel(logging.DEBUG if verbose else logging.INFO)


class _GroupedCommand(TyperCommand):
    """A command whose help shows options under the headings that they name, those without one last."""

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - types that the library keeps to itself
        """Write arguments and options, a section for each heading."""
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": []}
        others: list[tuple[str, str]] = []
        for each in self.get_params(ctx):
            heading = "Arguments" if each.param_type_name == "argument" else getattr(each, "rich_help_panel", None)
            if record := help_record(each, ctx):
                (others if heading is None else sections.setdefault(heading, [])).append(record)
        for heading, records in {**sections, "Options": others}.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)


def _command(name: str, wanted: str | None) -> Callable[..., None]:
    """The command's function; for the commands that are only listed, something with its line of help."""
    if name == wanted:
        word = name.replace("-", "_") + "_" * iskeyword(name)
        function: Callable[..., None] = getattr(import_module(f"aerodft.cli.{COMMANDS[name].module}"), word)
        return function
    return lambda: None


def build_app(arguments: list[str]) -> typer.Typer:
    """The application for these arguments, with only their command loaded: ``measure`` needs no video library."""
    typed = os.environ.get("COMP_WORDS", os.environ.get("_TYPER_COMPLETE_ARGS", "")).split()  # a shell completes it
    wanted = next((argument for argument in arguments or typed if argument in COMMANDS), None)
    app = typer.Typer(
        pretty_exceptions_enable=False,
        no_args_is_help=True,
        invoke_without_command=True,
        rich_markup_mode=None,
        epilog=_EXAMPLE,
    )
    app.callback()(_options)
    for name, command in COMMANDS.items():
        function = _command(name, wanted)
        text = inspect.getdoc(function) or command.help
        help_text = text.replace(r"\b", "\b")  # keeps an example's lines
        app.command(name=name, cls=_GroupedCommand, short_help=command.help, help=help_text)(function)
    return app


def _run(arguments: list[str]) -> NoReturn:
    """Run a command line and exit, with its misuse as one sentence."""
    refuse_empty(arguments)
    try:
        code = build_app(arguments)(arguments, standalone_mode=False)
    except TyperException as error:
        misuse = usage_error(error, arguments, COMMANDS)
        if misuse is None:
            typer.echo(str(error), err=True)
            raise SystemExit(UsageError.exit_code) from None
        raise misuse from None
    except typer.Abort:
        raise SystemExit(INTERRUPTED) from None
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        raise InputError("no file has such a name", where=error.filename, got=error) from None
    raise SystemExit(code or 0)


def main() -> None:
    """Entry point of the ``aerodft`` script."""
    _guard_streams()
    began_s = time.time()
    try:
        with ending_on_signals():
            try:
                _run(sys.argv[1:])
            finally:
                with suppress(ValueError):  # closed already
                    sys.stdout.flush()
    except SystemExit as ending:
        if ending.code in {INTERRUPTED, TERMINATED}:
            typer.echo(f"aerodft: {_left_by(sys.argv[1:], began_s)}", err=True)
        raise
    except AerodftError as error:
        typer.echo(f"aerodft: {as_typed(str(error))}", err=True)
        sys.exit(error.exit_code)
    except _ReaderGone:
        sys.exit(_PIPE_CLOSED)
    except KeyboardInterrupt:  # while the command was loaded; once it runs, typer exits likewise
        typer.echo("aerodft: stopped", err=True)
        sys.exit(INTERRUPTED)


def _left_by(arguments: list[str], began_s: float) -> str:
    """What a command that was stopped leaves of its output."""
    named = (after for option, after in pairwise(arguments) if option in _OUTPUT)
    joined = (argument.partition("=")[2] for argument in arguments if argument.startswith("--output="))
    output = next(map(Path, chain(named, joined)), None)
    if output is None:
        return "stopped"
    with suppress(OSError):
        if any(each.stat().st_mtime >= began_s - _FILE_TICK_S for each in (output, *output.rglob("*"))):
            return f"stopped; {output} holds what was done so far"
    return "stopped; nothing was written"


def usage_error(error: TyperException, arguments: list[str], commands: Collection[str]) -> UsageError | None:
    """The sentence for what the parser of the command line refused.

    Args:
        error: What it raised.
        arguments: The command line without the program's name.
        commands: Every command.

    Returns:
        None where its message is help that was asked for, and should stand as it is.
    """
    if not arguments:
        return None
    command = next((each for each in arguments if each in commands), "")
    hint = f"see aerodft {command} --help" if command else "see aerodft --help"
    option = getattr(error, "option_name", None)
    if possibilities := getattr(error, "possibilities", None) or ():
        close = difflib.get_close_matches(str(option), possibilities, n=1, cutoff=0.0)
        hint = f"did you mean {close[0]}?" if close else hint
    message = str(getattr(error, "format_message", lambda: error)())
    if message.startswith("No such command"):
        wanted = next((each for each in arguments if not each.startswith("-")), arguments[-1])
        close = difflib.get_close_matches(wanted, commands, n=1)
        expected = f"one of {', '.join(commands)}"
        return UsageError(
            "no such command", got=wanted, expected=expected, hint=f"did you mean {close[0]}?" if close else hint
        )
    if message.startswith("No such option"):
        return UsageError("no such option", where=command, got=option, hint=hint)
    if message.startswith("Invalid value"):
        return _invalid(message, arguments, command, hint)
    first, *_ = message.splitlines()
    return UsageError(f"{first[:1].lower()}{first[1:].rstrip('.')}", where=command, hint=hint)


def refuse_empty(arguments: list[str]) -> None:
    """Refuse an output without a name, as ``-o "$UNSET"`` gives it: the parser takes it for the current folder.

    Raises:
        UsageError: There is one.
    """
    for before, argument in pairwise(["", *arguments]):
        if (before in _OUTPUT and not argument) or argument in {f"{name}=" for name in _OUTPUT}:
            raise UsageError("--output", got="nothing", expected="a file or a folder to write to")


def _invalid(message: str, arguments: list[str], command: str, hint: str) -> UsageError:
    """A value of another kind than its option takes."""
    label, _, why = message.removeprefix("Invalid value").removeprefix(" for ").partition(": ")
    label, why = label.strip("'"), " ".join(why.removeprefix("Value error, ").split())
    choice = _CHOICES.search(why)
    if choice:
        return UsageError(label, where=command, got=choice["got"], expected=f"one of {choice['expected']}", hint=hint)
    bound = _BOUND.search(why)
    if bound:
        expected = bound["expected"].replace("valid number", "number").replace("valid integer", "whole number")
        return UsageError(label, where=command, got=_given(arguments, label), expected=expected, hint=hint)
    return UsageError(label, where=command, got=Reason(why.rstrip(".")), hint=hint)


def _given(arguments: list[str], option: str) -> str:
    """Value of an option on the command line, behind it or after its equals sign."""
    for argument, after in zip(arguments, [*arguments[1:], ""], strict=True):
        name, _, value = argument.partition("=")
        if name == option:
            return value or after
    return ""
