"""Long work says how far it is: on a terminal as a bar, elsewhere not more often than every 10 s."""

import pytest

from aerodft.cli.output import progress


@pytest.mark.parametrize(("seconds_each", "lines"), [(0.1, 0), (2.0, 3), (17.0, 19)])
def test_a_pipe_gets_a_line_every_ten_seconds(capsys, seconds_each, lines):
    now = [100.0]
    with progress("looking", lambda: now[0]) as advance:
        for done in range(1, 20):
            now[0] += seconds_each
            advance(done, 20)
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == lines
    if lines == 3:
        assert said.err.splitlines() == [f"aerodft: looking: {percent} %" for percent in (25, 50, 75)]


def test_a_terminal_gets_a_bar_and_no_lines(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")  # what makes a console of rich's a terminal
    now = [0.0]
    with progress("looking", lambda: now[0]) as advance:
        for done in range(1, 4):
            now[0] += 60.0
            advance(done, 3)
    assert "aerodft: looking" not in capsys.readouterr().err
