"""Names of the Python API in sentences, and the options that people type for them."""

import ast
from pathlib import Path

import pytest

import aerodft
import calibration
import replay
from aerodft.cli.options import as_typed


@pytest.mark.parametrize(
    ("said", "typed"),
    [
        ("`max_range_m` is too short", "--max-range is too short"),
        ("pass `video_start_ns`, or a larger `max_offset_s`", "pass --video-start, or a larger --max-offset"),
        ("expected `unknowns` height,tilt", "expected --unknowns height,tilt"),
        ("`start_ns` is not before `stop_ns`", "--from is not before --to"),
        ("say which: `topics` mavlink=/raw", "say which: --topic mavlink=/raw"),
        ("see `diagnose`", "see `aerodft doctor`"),
        ("`aerodft doctor --json` says more", "`aerodft doctor --json` says more"),
    ],
)
def test_a_sentence_names_what_is_typed(said, typed):
    assert as_typed(said) == typed


def test_no_sentence_below_the_command_line_names_an_option():
    roots = [Path(package.__file__).parent for package in (aerodft, calibration, replay)]
    with_own_options = {roots[0] / "cli", roots[0] / "sim"}  # the simulator is a command line of its own
    found = [
        f"{path}:{line}: {text}"
        for root in roots
        for path in sorted(root.rglob("*.py"))
        if not with_own_options & set(path.parents)
        for line, text in _sentences(path)
        if any(map(_is_option, text.split()))
    ]
    assert found == []


def _is_option(word: str) -> bool:
    word = word.strip("`(,.;:")
    return word.startswith("--") and word[2:3].isalpha()


def _sentences(path: Path) -> list[tuple[int, str]]:
    """The strings of a module that are no docstrings."""
    tree = ast.parse(path.read_text())
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and isinstance(node.body[0], ast.Expr)
    }
    strings = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str))
    return [(each.lineno, each.value) for each in strings if id(each) not in docstrings]
