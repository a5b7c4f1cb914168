"""Command lines that make no sense, as one sentence each: the parser's own messages take several lines."""

import difflib
import re
from collections.abc import Collection
from itertools import pairwise
from typing import Final

from typer.exceptions import TyperException

from aerodft.errors import UsageError

_CHOICES: Final = re.compile(r"'(?P<got>[^']*)' is not one of (?P<expected>.*?)\.?$", re.DOTALL)
_OUTPUT: Final = ("-o", "--output")
_BOUND: Final = re.compile(r"should be (?P<expected>[^,]+)")


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
    return UsageError(label, where=command, got=why.rstrip("."), hint=hint)


def _given(arguments: list[str], option: str) -> str:
    """What stands behind an option, or after its equals sign."""
    for argument, after in zip(arguments, [*arguments[1:], ""], strict=True):
        name, _, value = argument.partition("=")
        if name == option:
            return value or after
    return ""
