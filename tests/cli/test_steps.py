"""Slow steps say how far they are: on a terminal as a bar, elsewhere not more often than every 5 s."""

import sys

import pytest

from aerodft.cli.output import steps


@pytest.mark.parametrize(("seconds_each", "lines"), [(0.1, 0), (1.0, 3), (7.0, 19)])
def test_a_pipe_gets_a_line_every_five_seconds(capsys, seconds_each, lines):
    now = [100.0]
    with steps("looking", lambda: now[0]) as advance:
        for done in range(1, 20):
            now[0] += seconds_each
            advance(done, 20)
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == lines
    if lines == 3:
        assert said.err.splitlines() == [f"aerodft: looking: {done} of 20" for done in (5, 10, 15)]


def test_a_terminal_gets_a_bar_and_no_lines(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    now = [0.0]
    with steps("looking", lambda: now[0]) as advance:
        for done in range(1, 4):
            now[0] += 60.0
            advance(done, 3)
    assert " of 3" not in capsys.readouterr().err
