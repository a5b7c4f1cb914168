"""What can go wrong in the world around aerodft, as exceptions that carry data.

A broken contract between functions is a ``ValueError``; a point without an answer is a status, no exception.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar, Final

_MOST_LETTERS: Final = 2000  # of a sentence: names that files claim may be of megabytes


def printable(sentence: str) -> str:
    """A sentence as people can read it, whatever is quoted in it: in one line, and not endless."""
    if len(sentence) > _MOST_LETTERS:
        sentence = f"{sentence[: _MOST_LETTERS // 2]} ... {sentence[-_MOST_LETTERS // 2 :]}"
    return "".join(each if each.isprintable() else repr(each)[1:-1] for each in sentence)


class Reason(str):
    """A clause that says why: an error's sentence has it without the word "got", which a noun would need.

    Examples:
        >>> from aerodft.errors import InputError, Reason, counted
        >>> str(InputError("no heading", got=Reason("north and tilt cannot be told apart")))
        'no heading: north and tilt cannot be told apart'
        >>> str(InputError("no heading", got=counted(1, "landmark"), expected="two"))
        'no heading: got 1 landmark, expected two'
    """

    __slots__ = ()


def counted(number: int, noun: str) -> str:
    """A number with its noun, which is in the plural unless there is one: ``1 pixel``, ``2 pixels``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _found(got: object) -> str:
    """What was found, as text; the message of an exception is a reason, of the operating system's without number."""
    if isinstance(got, OSError):
        return Reason(got.strerror or got)
    return Reason(got) if isinstance(got, BaseException) else got if isinstance(got, Reason) else str(got)


class AerodftError(Exception):
    """The world failed: one sentence that says where, what, got, expected, and what to do.

    ``got`` is a noun (``got 3 pixels, expected 2``), or why it is so: a ``Reason``, or the exception that was caught.

    Attributes:
        what: What is wrong.
        where: File, key, time or address it is wrong at.
        got: What was found; a ``Reason`` where it is a clause of its own.
        expected: What would have been right.
        hint: What to do next.
    """

    exit_code: ClassVar[int] = 3

    def __init__(self, what: str, *, where: object = "", got: object = "", expected: str = "", hint: str = "") -> None:
        self.what = what
        self.where = str(where)
        self.got = _found(got)
        self.expected = expected
        self.hint = hint
        super().__init__(self._sentence())

    def _sentence(self) -> str:
        head = f"{self.where}: {self.what}" if self.where else self.what
        found = self.got if isinstance(self.got, Reason) or not self.got else f"got {self.got}"
        parts = [found, f"expected {self.expected}" if self.expected else ""]
        facts = ", ".join(part for part in parts if part)
        sentence = f"{head}: {facts}" if facts else head
        sentence = f"{sentence}; {self.hint}" if self.hint else sentence
        return printable(sentence)


class UsageError(AerodftError):
    """Arguments that make no sense, or not together, named in backticks as the Python API has them (exit 2)."""

    exit_code = 2


class InputError(AerodftError):
    """A file, stream or folder is missing, unreadable, damaged or of the wrong type (exit 3)."""


class ConfigError(InputError):
    """A configuration, camera or calibration file has an unknown key or an impossible value (exit 3)."""


class LinkError(InputError):
    """A port, address or device cannot be opened (exit 3)."""


class NoAnswerError(AerodftError):
    """The input is sound but holds no answer to what was asked (exit 4)."""

    exit_code = 4


class NotDetermined(NoAnswerError):  # noqa: N818 - what users catch, by what it says
    """The evidence of a calibration does not determine what is asked for, or contradicts itself (exit 4)."""


@contextmanager
def os_errors_as(what: str, *, where: object, expected: str = "", hint: str = "") -> Iterator[None]:
    """Errors of the operating system within the block become an ``InputError`` with the system's reason.

    Args:
        what: What cannot be done, as the sentence begins.
        where: The file or folder.
        expected: What would have been right.
        hint: What to do next.
    """
    try:
        yield
    except OSError as error:
        raise InputError(what, where=where, got=error, expected=expected, hint=hint) from error


@contextmanager
def named_in(file: Path) -> Iterator[None]:
    """Errors about a file that is not there say that this one names it, and what a relative name starts from."""
    try:
        yield
    except InputError as error:
        missing = Path(error.where)
        if not error.where or ":" in error.where or missing == file or missing.exists() or not file.is_file():
            raise
        text = file.read_text(encoding="utf-8", errors="replace")
        if missing.name not in text:
            raise
        start = "" if str(missing) in text and missing.is_absolute() else f", from the folder {file.parent.resolve()}"
        hint = f"{file} names it{start}"
        raise type(error)(error.what, where=error.where, got=error.got, expected=error.expected, hint=hint) from error


@contextmanager
def located(where: object) -> Iterator[None]:
    """Errors that do not say where they are say that it is there."""
    try:
        yield
    except AerodftError as error:
        if error.where:
            raise
        raise type(error)(error.what, where=where, got=error.got, expected=error.expected, hint=error.hint) from error
