"""Where output goes: devices stay devices, links stay links, and times outside a recording hold nothing."""

import os
import threading

import pytest


def test_a_pipe_stays_a_pipe(aerodft, flight_recording, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    done = aerodft("export", flight_recording, "-o", pipe)
    reader.join(10)
    assert done.code == 0, done.err
    assert pipe.is_fifo()
    assert len(read[0].splitlines()) == 16
    assert list(tmp_path.iterdir()) == [pipe]


def test_a_link_leads_to_the_file(aerodft, flight_recording, tmp_path):
    (tmp_path / "link.csv").symlink_to(tmp_path / "real.csv")
    assert aerodft("export", flight_recording, "-o", tmp_path / "link.csv").code == 0
    assert (tmp_path / "link.csv").is_symlink()
    assert len((tmp_path / "real.csv").read_text().splitlines()) == 16


def test_a_folder_is_no_file(aerodft, flight_recording):
    done = aerodft("export", flight_recording, "-o", "/")
    assert (done.code, done.out) == (3, b"")
    assert done.last == "aerodft: /: the file cannot be written: Is a directory"


@pytest.mark.parametrize("output", [("-o", ""), ("--output", ""), ("--output=",)])
@pytest.mark.parametrize("command", ["export", "import", "recompute", "river"])
def test_an_output_without_a_name_is_not_the_current_folder(aerodft, flight_recording, command, output):
    done = aerodft(command, flight_recording, *output)
    assert (done.code, done.out) == (2, b"")
    assert done.err == "aerodft: --output: got nothing, expected a file or a folder to write to\n"


@pytest.mark.parametrize("window", [("--from", "1000"), ("--to", "-5")])
def test_there_is_nothing_to_replay_outside_the_recording(aerodft, flight_recording, window):
    done = aerodft("replay", flight_recording, "--rate", "max", "--listen", "none", *window, "--json")
    assert (done.code, done.out) == (4, b"")
    assert "the recording has nothing there: got " in done.last
