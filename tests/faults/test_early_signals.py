"""Signals at random moments of the first two seconds: each ends a serving command, in bounded time and by its code."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from tests.nights import at_night

FROZEN = Path(__file__).parents[1] / "cli" / "frozen-0.1"
STATION = """
[station]
name = "early"
[camera]
name = "small"
width_px = 64
height_px = 48
hfov_deg = 60.0
[telemetry]
connection = "udpin:127.0.0.1:0"
[zenoh]
listen = "tcp/127.0.0.1:0"
"""
COMMANDS = {
    "view": ["view", FROZEN, "--port", 0],
    "serve": ["serve", "station.toml", "-o", "recording"],
    "serve --web": ["serve", "station.toml", "--web", "--port", 0, "-o", "recording"],
    "replay": ["replay", FROZEN, "--rate", 0.05, "--listen", "tcp/127.0.0.1:0"],
    "demo": ["demo", "--output", "demo"],
}
STEP_S, STEPS, MOMENTS = 0.02, 100, 30
PATIENCE_S = 60.0  # the machine may be busy with other tests; a command that stands still takes for ever
# A shell says 130 or 143 of a process that the signal itself has ended, before Python handles signals. Signals are how
# people end a page (0), a replay (0) and a service (0, or 4 where nothing was measured).
CODES = {"view": {0}, "serve": {0, 4}, "serve --web": {0, 4}, "replay": {0}, "demo": set()}


def codes_of(name: str, number: signal.Signals, complaint: str) -> set[int]:
    """Exit codes of a command that a signal has ended."""
    in_interpreter = {1} if "Fatal Python error" in complaint or "frozen site" in complaint else set()
    return {128 + number, -number} | CODES[name] | in_interpreter


@contextmanager
def load(processes: int) -> Iterator[None]:
    """Other processes that take all the time they get."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for each in busy:
            each.kill()
            each.wait()


def started(name: str, folder: Path) -> subprocess.Popen[str]:
    (folder / "station.toml").write_text(STATION)
    line = [sys.executable, "-m", "aerodft", *map(str, COMMANDS[name])]
    return subprocess.Popen(
        line, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.parametrize(("moments", "busy"), [(3, 0), *at_night((MOMENTS, 0), (MOMENTS, 6))])
@pytest.mark.parametrize("name", COMMANDS)
def test_a_signal_ends_a_command_that_is_starting(tmp_path: Path, name: str, moments: int, busy: int) -> None:
    draws = np.random.default_rng(sum(map(ord, name)) + busy)
    with load(busy):
        for moment in range(moments):
            folder = tmp_path / str(moment)
            folder.mkdir()
            number = (signal.SIGINT, signal.SIGTERM)[moment % 2]
            after_s = STEP_S * int(draws.integers(1, STEPS + 1))
            with started(name, folder) as process:
                time.sleep(after_s)
                process.send_signal(number)
                try:
                    _, complaint = process.communicate(timeout=PATIENCE_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    pytest.fail(f"{name}: {number.name} after {after_s:.2f} s has not ended it")
            assert process.returncode in codes_of(name, number, complaint), (after_s, number, complaint)


STUCK = """
import os, sys, threading, time
from aerodft.cli.interrupts import ending_on_signals, exit_process
with ending_on_signals():
    try:
        print("up", flush=True)
        time.sleep(600)
    except BaseException:
        print("closing", flush=True)
        {closing}
        exit_process(130)
"""


@pytest.mark.parametrize(
    ("closing", "signals", "code"),
    [
        ("threading.Event().wait(600)", 2, -signal.SIGINT),
        ("os.read(os.pipe()[0], 1)", 2, -signal.SIGINT),
        ("threading.Thread(target=time.sleep, args=(600,)).start()", 1, 130),
    ],
    ids=["a lock", "a read", "a thread that goes on"],
)
def test_a_second_signal_always_ends_it_and_threads_are_not_waited_for(closing: str, signals: int, code: int) -> None:
    line = [sys.executable, "-c", STUCK.format(closing=closing)]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "closing\n"
        process.send_signal(signal.SIGINT)  # as `timeout` does: one signal twice within milliseconds
        if signals > 1:
            time.sleep(0.5)
            assert process.poll() is None
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
    assert process.returncode == code


SLOW_IMPORT = """
import sys, time
from aerodft.cli.interrupts import ending_on_signals
with ending_on_signals():
    try:
        import slow
        time.sleep(5.0)
    except KeyboardInterrupt:
        print("slow" in sys.modules and hasattr(sys.modules["slow"], "end"))
"""


@pytest.mark.parametrize(("seconds", "is_loaded"), [(0.3, True), (5.0, False)])
def test_an_import_is_finished_unless_it_takes_longer_than_a_second(
    tmp_path: Path, seconds: float, *, is_loaded: bool
) -> None:
    module = f"import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\nt = time.monotonic() + {seconds}\n"
    (tmp_path / "slow.py").write_text(f"{module}while time.monotonic() < t:\n    pass\nend = True\n")
    variables = {**os.environ, "PYTHONPATH": str(tmp_path)}
    line = [sys.executable, "-c", SLOW_IMPORT]
    done = subprocess.run(line, env=variables, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.stdout == f"{is_loaded}\n", done.stderr
