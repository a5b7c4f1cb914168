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


def test_a_comparison_says_which_minus_which(aerodft):
    recording = "tests/cli/frozen-0.1"
    assert f"{recording} minus {recording}" in aerodft("compare", recording, recording).out.decode()
