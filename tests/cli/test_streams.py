"""Standard streams that are closed, full, or read by nobody."""

import os
import subprocess
import sys

import pytest

AERODFT = f"{sys.executable} -m aerodft"


def shell(line):
    return subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False, timeout=60)


def test_a_reader_that_has_seen_enough_is_no_error():
    done = shell(f"{AERODFT} --version | true; echo ${{PIPESTATUS[0]}}")
    assert done.stdout in {"141\n", "0\n"}  # 0 where it was faster than its reader
    assert done.stderr == ""


def test_a_pipe_that_nobody_reads_ends_the_command_quietly():
    reading, writing = os.pipe()
    os.close(reading)
    line = [sys.executable, "-m", "aerodft", "--version"]
    with os.fdopen(writing, "wb") as pipe:
        done = subprocess.run(line, stdout=pipe, stderr=subprocess.PIPE, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full on this system")  # noqa: PTH110 - a device
def test_a_full_disk_behind_stdout_is_one_sentence():
    done = shell(f"{AERODFT} --version > /dev/full")
    assert done.returncode == 3
    assert done.stderr == "aerodft: stdout: the output cannot be written: No space left on device\n"


def test_closed_streams_are_as_good_as_unread_ones():
    assert shell(f"{AERODFT} --version <&- >&- 2>&-").returncode == 0
    assert shell(f"{AERODFT} --version 2>&-").stdout.startswith("aerodft ")


def test_words_for_a_closed_stderr_do_not_go_to_stdout():
    done = shell(f"{AERODFT} compare /nowhere /nowhere --json 2>&-")
    assert (done.returncode, done.stdout) == (3, "")
