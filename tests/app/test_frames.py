"""Stills are the images that a decoder of its own finds at these instants, pixel for pixel."""

import subprocess
import sys

import av
import cv2
import numpy as np
import pytest

import aerodft as ad
from aerodft.app.viewing import RecordingView
from tests.commands import run_aerodft


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sim") / "flight"
    command = [sys.executable, "-m", "aerodft.sim", "--out", str(folder), "--duration", "2", "--size", "320x240"]
    subprocess.run(command, check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def decoded(flight):
    """Seconds from the first image, and pixels, of each image of the video."""
    with av.open(str(flight / "video.mp4")) as container:
        found = [(frame.time, frame.to_ndarray(format="bgr24")) for frame in container.decode(video=0)]
    return [(time_s - found[0][0], pixels) for time_s, pixels in found]


@pytest.fixture(scope="module")
def recording(flight, tmp_path_factory):
    """Its messages begin with the log, its images half a second later."""
    folder, log, video = tmp_path_factory.mktemp("mine"), flight / "flight.tlog", flight / "video.mp4"
    draft = ad.draft_station([log, video], folder, camera=flight / "camera.toml", home_above_plane_m=0.0)
    begins_ns = ad.open_recording(
        ad.import_flight(log, station=draft.station, output=folder / "log").recording
    ).start_ns
    later_ns = begins_ns + 500_000_000
    ad.import_flight(log, station=draft.station, video=video, video_start_ns=later_ns, output=folder / "recording")
    return folder / "recording"


def test_a_video_gives_its_nearest_images(flight, decoded, tmp_path):
    done = run_aerodft("frames", flight / "video.mp4", "--at", 0, "--at", 0.71, "-o", tmp_path, "--json")
    assert done.code == 0, done.err
    assert len(done.json) == 2
    for still, wanted_s in zip(done.json, (0.0, 0.71), strict=True):
        nearest = int(np.argmin([abs(time_s - wanted_s) for time_s, _ in decoded]))
        assert still["image"] == nearest
        assert still["seconds"] == pytest.approx(decoded[nearest][0], abs=1e-6)
        np.testing.assert_array_equal(cv2.imread(still["path"]), decoded[nearest][1])


def test_a_step_gives_images_that_far_apart(flight, tmp_path):
    stills = run_aerodft("frames", flight / "video.mp4", "--every", 0.5, "-o", tmp_path, "--json").json
    assert [each["seconds"] for each in stills] == pytest.approx([0.0, 0.5, 1.0, 1.5], abs=0.05)


def test_a_recording_gives_its_images_with_what_was_measured(recording, tmp_path):
    plain = run_aerodft("frames", recording, "--every", 1, "-o", tmp_path / "plain", "--json").json
    drawn = run_aerodft("frames", recording, "--every", 1, "--overlay", "-o", tmp_path / "drawn", "--json")
    assert [each["image"] for each in drawn.json] == [each["image"] for each in plain]
    image = cv2.imread(plain[0]["path"])
    assert image.shape == (240, 320, 3)
    over = cv2.resize(cv2.imread(drawn.json[0]["path"]), (320, 240), interpolation=cv2.INTER_AREA)
    assert 0.01 < np.mean(np.abs(over.astype(float) - image).max(axis=-1) > 30) < 0.7


def test_what_makes_no_sense_is_refused(flight, tmp_path):
    video = flight / "video.mp4"
    assert run_aerodft("frames", video, "-o", tmp_path).code == 2
    assert run_aerodft("frames", video, "--at", 1, "--every", 1, "-o", tmp_path).code == 2
    assert run_aerodft("frames", video, "--at", 1, "--overlay", "-o", tmp_path).code == 2
    late = run_aerodft("frames", video, "--at", 30, "-o", tmp_path)
    assert late.code == 4
    assert "30 s" in late.last
    assert run_aerodft("frames", flight / "flight.tlog", "--at", 1, "-o", tmp_path).code == 3
    assert run_aerodft("frames", video, "--at", 1, "-o", tmp_path).code == 0
    assert run_aerodft("frames", video, "--at", 1, "-o", tmp_path).code == 3


def test_seconds_count_from_the_first_image_in_every_command(recording, tmp_path):
    opened = ad.open_recording(recording)
    first, last = run_aerodft("frames", recording, "--at", 0, "--at", 1, "-o", tmp_path, "--json").json
    first_ns = int(first["stamp_ns"])
    assert first_ns - opened.start_ns == pytest.approx(0.5e9, abs=0.05e9)
    assert (first["image"], first["seconds"]) == (0, 0.0)
    assert last["seconds"] == pytest.approx((int(last["stamp_ns"]) - first_ns) / 1e9)
    assert last["seconds"] == pytest.approx(1.0, abs=0.2)
    (centre,) = run_aerodft("measure", "--recording", recording, "--at", 1, "--probe", "range 159,119", "--json").json
    assert int(centre["stamp_ns"]) - first_ns == 10**9
    assert RecordingView(opened).images[0].seconds == 0.0
