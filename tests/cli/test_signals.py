"""Signals in the middle of something: what there is is kept and said, and nothing is left running."""

import signal
import subprocess
import sys
import threading
import time

import pytest

from aerodft.cli.interrupts import wait_in_main_thread
from replay.recordings import Recording
from tests.nights import at_night


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), *at_night((signal.SIGINT, 130))])
def test_an_import_that_is_ended_keeps_what_it_has_and_says_so(desk, number, code):
    out = desk.folder / "rec"
    line = ["import", desk.tlog(seconds=120.0), "-c", desk.config, "-o", out, "--rate", 1000, "--json"]
    with subprocess.Popen(
        [sys.executable, "-m", "aerodft", *map(str, line)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        deadline_s = time.monotonic() + 60
        begun = out / "data_000.mcap"
        while not (begun.exists() and begun.stat().st_size > 20_000) and time.monotonic() < deadline_s:
            time.sleep(0.05)
        process.send_signal(number)
        said, complained = process.communicate(timeout=60)
    assert (process.returncode, said) == (code, "")
    assert complained.splitlines()[-1] == f"aerodft: stopped; {out} holds what was done so far"
    assert "Traceback" not in complained
    assert Recording(out).is_whole


@pytest.mark.parametrize("kept", ["frames", ""])
def test_any_command_that_is_stopped_says_what_is_left(aerodft, monkeypatch, tmp_path, kept):
    out = tmp_path / "out"

    def stopped(*_, **__):
        if kept:
            out.mkdir()
            (out / kept).touch()
        raise KeyboardInterrupt

    monkeypatch.setattr("aerodft.app.frames.open_reel", stopped)
    found = aerodft("frames", "video.mp4", "-o", out)
    assert found.code == 130
    left = f"{out} holds what was done so far" if kept else "nothing was written"
    assert found.last == f"aerodft: stopped; {left}"


def test_a_wait_ends_by_a_signal_that_another_thread_received():
    done = threading.Event()
    before = signal.signal(signal.SIGUSR1, lambda *_: done.set())
    thread = threading.Timer(0.1, signal.raise_signal, [signal.SIGUSR1])
    thread.start()
    try:
        wait_in_main_thread(done)
    finally:
        signal.signal(signal.SIGUSR1, before)
        thread.join()
    assert done.is_set()
