"""Tables on narrow and wide terminals: no word and no number is cut."""

import pytest
from rich.table import Table

from aerodft.cli.output import tables


@pytest.mark.parametrize("columns", range(30, 121, 3))
def test_no_number_is_cut(monkeypatch, capsys, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    table = Table("probe", "mean", "median", "max std change", "in stds: median", title="b minus a")
    table.add_row("width-bridge", "-0.123456 m", "1234.5678 m", "", "987.654321")
    table.add_row("a [b]other[/b]", "0.5 m", "1e-07 m", "0.25 m", "3")
    tables().print(table)
    said = capsys.readouterr().out
    assert "…" not in said
    assert max(map(len, said.splitlines())) <= columns
    assert said.count("┏") == said.count("┓")
    for word in ("minus", "median", "-0.123456", "1234.5678", "987.654321", "1e-07", "[b]other[/b]", "width-bridge"):
        assert word in said


def test_a_heading_of_several_lines_is_one_line_beside_its_value(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "34")
    table = Table("camera", "depth at pitch\nmiddle (m)", "the text says\n(m)")
    table.add_row("Canon-1000D", "131.8", "below-0.5")
    tables().print(table)
    assert capsys.readouterr().out.splitlines() == [
        "Canon-1000D",
        "  depth at pitch middle (m): 131.8",
        "  the text says (m): below-0.5",
    ]


def test_a_comparison_says_which_minus_which(aerodft):
    recording = "tests/cli/frozen-0.1"
    assert f"{recording} minus {recording}" in aerodft("compare", recording, recording).out.decode()
