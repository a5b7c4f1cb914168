"""``aerodft measure --recording``: camera and pose of a recorded flight at a time."""

import math
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    "at", ["0.47", "1795221169020000000", "2026-11-21T00:32:49.02Z", "2026-11-21T02:32:49.02+02:00"]
)
def test_a_recording_gives_camera_and_pose(aerodft, flight_recording, at):
    """The first image is of 0.55 s after power-on; the gimbal looks 30 deg from straight down, 40 m above home."""
    found = aerodft("measure", "--recording", flight_recording, "--at", at, "--json", "--probe", "range 31.5,23.5")
    assert found.code == 0, found.err
    (centre,) = found.json
    assert centre["value"] == pytest.approx(40.0 / math.cos(math.radians(30.0)), abs=1e-6)
    assert centre["pose"]["tilt_deg"] == pytest.approx(30.0, abs=1e-5)
    assert centre["pose"]["heading_deg"] == pytest.approx(math.degrees(0.5), abs=1e-5)
    assert centre["camera"] == "small"
    assert abs(int(centre["stamp_ns"]) - 1_795_221_169_020_000_000) < 1_000_000
    assert centre["config"].startswith("sha256:")


def test_a_recording_can_be_measured_with_the_papers_model(aerodft, flight_recording):
    asked = ("measure", "--recording", flight_recording, "--at", 1, "--json", "--probe", "range 31.5,10")
    pinhole, dft = aerodft(*asked).json[0], aerodft(*asked, "--model", "dft").json[0]
    assert (pinhole["model"], dft["model"]) == ("pinhole", "dft")
    assert pinhole["value"] != dft["value"]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--at", "1e4"), 4, "the time is outside the recording: got 10000.0, expected -0.5 to "),
        (("--at", "2020-01-01T00:00:00Z"), 4, "the time is outside the recording"),
        (("--at", "tomorrow"), 2, "--at: got 'tomorrow', expected ISO 8601"),
        ((), 2, "--recording and --at go together"),
        (("--at", "1", "--height", "5"), 2, "--height beside --recording"),
        (("--at", "1", "--roll", "5"), 2, "--roll beside --recording"),
    ],
)
def test_a_recording_that_cannot_answer_says_why(aerodft, flight_recording, arguments, code, said):
    found = aerodft("measure", "--recording", flight_recording, *arguments, "--probe", "range 1,1")
    assert (found.code, said in found.err) == (code, True), found.err


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda _: None, "no such file or folder"),
        (Path.mkdir, "there is no recording"),
        (Path.touch, "there is no recording"),
    ],
)
def test_what_is_no_recording_is_refused(aerodft, tmp_path, make, sentence):
    folder = tmp_path / "recording"
    make(folder)
    found = aerodft("measure", "--recording", folder, "--at", "1", "--probe", "range 1,1")
    assert (found.code, f"{folder}: {sentence}" in found.err) == (3, True)


def test_a_recording_is_measured_with_another_calibration(aerodft, flight_recording, tmp_path):
    """Biases are added: 36 m at 31 deg."""
    path = tmp_path / "biases.toml"
    path.write_text("[bias]\nheight_m = { value = -4.0, std = 0.1 }\ntilt_deg = { value = 1.0, std = 0.1 }\n")
    asked = ("measure", "--recording", flight_recording, "--at", "1.0", "--json", "--probe", "range 31.5,23.5")
    found = aerodft(*asked, "--calibration", path)
    assert found.code == 0, found.err
    (centre,) = found.json
    assert centre["value"] == pytest.approx(36.0 / math.cos(math.radians(31.0)), abs=1e-5)
    assert centre["calibration"] != aerodft(*asked).json[0]["calibration"]
    assert centre["calibration"].startswith("sha256:")


def test_it_says_when_it_was_and_from_where(aerodft, flight_recording):
    found = aerodft("measure", "--recording", flight_recording, "--at", "1", "--probe", "range 31,23")
    assert "2026-11-21T" in found.err
    assert "height 40.00 m +- 1 (home), tilt 30.00 deg" in found.err
