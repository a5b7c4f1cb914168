"""Every error in the code reads as English: what follows "got" is a noun, and a clause of its own is a ``Reason``."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from aerodft.errors import AerodftError, InputError, NoAnswerError, Reason, counted, located

ROOT = Path(__file__).parents[1]
VERBS = re.compile(
    r"\b(is|are|was|were|has|have|had|cannot|can|does|do|did|stands?|lies|holds|shows|needs|moved|contradicts?|must)\b"
)
RELATIVE = re.compile(r"\b(which|that|who|what|where|while|with which|of which|ago)\b.*")  # a clause about the noun
PLURAL = re.compile(r"^\{len\([^}]*\}\s+\w+s\b")


def errors_in(path: Path) -> Iterator[tuple[int, str]]:
    """Line and text of what ``got`` says in each call, with what is known at run time in braces."""
    for call in (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)):
        for keyword in call.keywords:
            if keyword.arg == "got" and isinstance(keyword.value, ast.Constant | ast.JoinedStr):
                yield call.lineno, text_of(keyword.value)


def text_of(node: ast.AST) -> str:
    if isinstance(node, ast.JoinedStr):
        return "".join(map(text_of, node.values))
    return str(node.value) if isinstance(node, ast.Constant) else f"{{{ast.unparse(node.value)}}}"


@pytest.mark.parametrize("package", ["aerodft", "calibration", "replay"])
def test_got_is_followed_by_a_noun(package: str) -> None:
    paths = sorted((ROOT / package).rglob("*.py"))
    found = [(path, line, text) for path in paths for line, text in errors_in(path)]
    assert len(found) > 5, "the survey finds the errors"
    words = [(each, re.sub(r"\{[^}]*\}|'.*?'|\".*?\"", "", each[2])) for each in found]
    clauses = [each for each, text in words if VERBS.search(RELATIVE.sub("", text))]
    assert not clauses, "a clause is a Reason"
    assert not [each for each in found if PLURAL.search(each[2])], "counted() knows the singular"


@pytest.mark.parametrize(
    ("got", "sentence"),
    [
        ("3 pixels", "no width: got 3 pixels, expected 2"),
        (counted(1, "pixel"), "no width: got 1 pixel, expected 2"),
        (Reason("banks cannot be told apart"), "no width: banks cannot be told apart, expected 2"),
        (OSError(13, "Permission denied", "/x"), "no width: Permission denied, expected 2"),
        (ValueError("a row is cut short"), "no width: a row is cut short, expected 2"),
    ],
)
def test_a_reason_and_an_exception_stand_without_got(got: object, sentence: str) -> None:
    error = InputError("no width", got=got, expected="2")
    assert str(error) == sentence
    assert error.got
    again = type(error)(error.what, got=error.got, expected=error.expected)
    assert str(again) == sentence, "also of an error that is raised again with what it carries"


def test_an_error_that_gets_its_place_later_keeps_its_reason() -> None:
    def fail() -> None:
        with located("a.toml"):
            raise NoAnswerError("no heading", got=Reason("north and tilt cannot be told apart"))

    with pytest.raises(AerodftError, match=r"^a\.toml: no heading: north and tilt cannot be told apart$"):
        fail()
