"""``aerodft sync`` and ``import --sync auto`` over rendered flights whose clocks are known."""

import math
import re
import tomllib
from dataclasses import replace

import numpy as np
import orjson
import pytest
import tomli_w

from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.images import video_info
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.cli.flights.sync import next_best
from aerodft.geometry import camera_angles
from replay.recordings import Recording

from ..calibration.sync_flights import (  # noqa: TID252 - test folders are no packages that could be named
    Clocks,
    hovering,
    scenario,
    wandering,
    write_clip,
    write_log,
)

CLOCKS = Clocks(offset_s=-13.2, drift=0.013, lag_s=0.17)
CLIP_S, MARGIN_S, SIZE = 45.0, 10.0, (320, 180)
STATION = """
[station]
name = "aligned"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["home"]
[images]
video = "video.mp4"
time_offset_s = "auto"
[record]
image_hz = 0
[[probe]]
name = "centre"
kind = "position"
pixels = [[159.5, 89.5]]
"""


def write_desk(folder, trajectory, clocks, seed):
    """A flight's files; returns where the offset holds, by the video's clock."""
    told = scenario(trajectory, seed, clocks, margin_s=MARGIN_S, size=SIZE, fps=8.0)
    write_log(told, folder / "flight.tlog")
    (folder / "camera.toml").write_text(tomli_w.dumps(camera_document(told.camera)))
    (folder / "station.toml").write_text(STATION)
    return write_clip(told, clocks, folder / "video.mp4")


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("misaligned")
    trajectory = wandering(1, CLIP_S + 2 * MARGIN_S)
    return folder, trajectory, write_desk(folder, trajectory, CLOCKS, 1)


@pytest.fixture(scope="module")
def imported(desk, aerodft, tmp_path_factory):
    """The flight imported with ``auto``; the station states a start 0.25 s too early, known to 0.6 s."""
    folder, _, _ = desk
    start_ns = video_info(folder / "video.mp4").start_ns - 250_000_000
    stated = f'[images]\nstart = "{unix_ns_to_iso(start_ns)}"\ntime_std_s = 0.6'
    (folder / "stated.toml").write_text(STATION.replace("[images]", stated))
    out = tmp_path_factory.mktemp("auto") / "rec"
    done = aerodft("import", folder / "flight.tlog", "-c", folder / "stated.toml", "-o", out, "--json")
    assert done.code == 0, done.err
    return done, out, start_ns


@pytest.mark.nightly
def test_the_truth_lies_in_the_stated_intervals(desk, aerodft, tmp_path):
    folder, _, reference_ns = desk
    found = aerodft(
        "sync",
        folder / "video.mp4",
        folder / "flight.tlog",
        "--camera",
        folder / "camera.toml",
        "-o",
        tmp_path,
        "--json",
    )
    assert found.code == 0, found.err
    said = found.json
    after_s = (int(said["reference_ns"]) - reference_ns) / 1e9
    truth = {
        "offset_s": CLOCKS.offset_s + CLOCKS.drift * after_s,
        "drift": CLOCKS.drift,
        "lag_s": CLOCKS.lag_s,
    }
    for name, most in (("offset_s", 0.02), ("drift", 5e-4), ("lag_s", 0.03)):
        assert abs(said[name] - truth[name]) < most, name
        std = said[name.replace("_s", "_std_s") if name.endswith("_s") else f"{name}_std"]
        assert abs(said[name] - truth[name]) < 3 * std, name
    attitude_s = truth["offset_s"] - truth["lag_s"]
    assert abs(said["attitude_offset_s"] - attitude_s) < min(0.02, 3 * said["attitude_offset_std_s"])
    assert said["lag_told"]
    assert said["reasons"] == []
    assert (tmp_path / "sync.png").stat().st_size > 20_000
    config = tomllib.loads(said["config"])
    assert config["images"]["time_offset_s"] == pytest.approx(said["offset_s"], abs=1e-6)
    assert config["telemetry"]["attitude"]["delay_s"] == pytest.approx(said["lag_s"], abs=1e-4)


def test_import_with_auto_looks_where_the_camera_looked(desk, imported, aerodft, tmp_path):
    _, trajectory, _ = desk
    done, recording, _ = imported
    assert re.search(
        r"-12\.9\d\d s \(std 0\.0\d+ s\) and \+1\.3\d+ % .* off the log, the gimbal 0\.1\d+ s late", done.err
    )
    again = aerodft("recompute", recording, "-o", tmp_path / "again")
    assert again.code == 0, again.err
    assert aerodft("compare", recording, tmp_path / "again").code == 0
    config = tomllib.loads((recording / "config.toml").read_text())
    assert config["images"]["time_drift"] == pytest.approx(CLOCKS.drift, abs=5e-4)
    assert config["telemetry"]["attitude"]["delay_s"] == pytest.approx(CLOCKS.lag_s, abs=0.03)
    assert config["images"]["time_std_s"] < 0.03  # what was found, in place of the 0.6 s that the station states
    poses = {}
    for line in Recording(recording).measurements():
        said = orjson.loads(line)
        if said["pose"] is not None:
            poses[int(said["stamp_ns"])] = math.radians(said["pose"]["tilt_deg"])
    tilt_rad, _, _ = camera_angles(trajectory.at(list(poses)).enu_wxyz_cam)
    off_rad = np.array(list(poses.values())) - tilt_rad
    assert len(poses) > 200
    # The simulated gimbal has a bias of its own; what varies would be a wrong time. It turns at up to 35 deg/s: 10 ms,
    # a standard deviation and a half of so small images, are 0.35 deg; a lag that was not found would be 5.
    assert np.percentile(np.abs(off_rad - np.median(off_rad)), 95) < math.radians(0.35)


@pytest.mark.nightly
def test_the_printed_lines_give_what_auto_gives(desk, imported, aerodft, tmp_path):
    folder, _, _ = desk
    _, recording, start_ns = imported
    station, log = folder / "stated.toml", folder / "flight.tlog"
    said = aerodft("sync", folder / "video.mp4", log, "--config", station, "--json").json
    assert int(said["video_start_ns"]) == start_ns
    pasted = folder / "pasted.toml"
    document = tomllib.loads(station.read_text()) | {"images": {}}
    printed = tomllib.loads(said["config"])
    document["telemetry"] |= printed["telemetry"]
    pasted.write_text(tomli_w.dumps(document | {"images": printed["images"]}))
    done = aerodft("import", log, "-c", pasted, "-o", tmp_path / "pasted")
    assert done.code == 0, done.err
    first, second = (list(Recording(each).measurements()) for each in (recording, tmp_path / "pasted"))
    assert len(first) > 200
    assert first == second
    # A start on the command line moves the offset by as much, and the images stay where they were.
    later = unix_ns_to_iso(start_ns + 3_000_000_000)
    moved = aerodft("sync", folder / "video.mp4", log, "--config", station, "--video-start", later, "--json").json
    assert moved["offset_s"] == pytest.approx(said["offset_s"] - 3, abs=2e-3)
    assert tomllib.loads(moved["config"])["images"]["start"] == moved["video_start"]


@pytest.mark.parametrize(
    ("peak_ratio", "said"),
    [(0.0, "No other offset fits."), (0.37, "the next best one explains 37% of what this one does.")],
)
def test_the_next_best_offset_is_put_in_words(peak_ratio, said):
    assert next_best(peak_ratio).endswith(said)


def test_a_log_that_goes_on_after_a_reboot_is_aligned_before_it(desk, aerodft, tmp_path):
    """The video lies before the reboot, on whose clock no attitude of the video is."""
    folder, _, _ = desk
    later = hovering(20.0)
    later = replace(later, stamp_ns=later.stamp_ns + 300_000_000_000)
    write_log(scenario(later, 2, CLOCKS, margin_s=1.0, size=SIZE, fps=8.0), tmp_path / "later.tlog")
    log = tmp_path / "rebooted.tlog"
    log.write_bytes((folder / "flight.tlog").read_bytes() + (tmp_path / "later.tlog").read_bytes())
    camera = ("--camera", folder / "camera.toml", "--json")
    whole = aerodft("sync", folder / "video.mp4", folder / "flight.tlog", *camera)
    found = aerodft("sync", folder / "video.mp4", log, *camera)
    assert found.code == 0, found.err
    assert found.json["offset_s"] == pytest.approx(whole.json["offset_s"], abs=1e-3)
    assert found.json["lag_s"] == pytest.approx(whole.json["lag_s"], abs=1e-3)


@pytest.mark.nightly
def test_a_hover_with_a_locked_gimbal_is_refused(aerodft, tmp_path):
    write_desk(tmp_path, hovering(20 + 2 * MARGIN_S), Clocks(2.0, 0.0, 0.1), 3)
    found = aerodft("sync", tmp_path / "video.mp4", tmp_path / "flight.tlog", "--camera", tmp_path / "camera.toml")
    assert found.code == 4
    assert re.search(r"too little motion to tell.*got at best \d+% of what tells an offset, at [-+]", found.err)
    assert found.err.count("\n") <= 2
    done = aerodft("import", tmp_path / "flight.tlog", "-c", tmp_path / "station.toml", "-o", tmp_path / "rec")
    assert done.code == 4
    assert not (tmp_path / "rec").exists()


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        ((), 2, "no camera: expected --camera FILE or --config FILE"),
        (("--camera", "camera.toml", "--max-offset", "0"), 2, "--max-offset: got 0, expected above 0"),
        (("--camera", "camera.toml", "--video-start", "2020-01-01T00:00:00Z"), 4, "do not overlap in time"),
        (("--camera", "other.toml"), 3, "the image is not of this camera's mode"),
    ],
)
def test_what_cannot_be_aligned_is_refused_in_a_sentence(desk, aerodft, options, code, says):
    folder, _, _ = desk
    document = tomllib.loads((folder / "camera.toml").read_text())
    (folder / "other.toml").write_text(tomli_w.dumps(document | {"width_px": 640, "height_px": 360}))
    given = [folder / option if option.endswith(".toml") else option for option in options]
    found = aerodft("sync", folder / "video.mp4", folder / "flight.tlog", *given)
    assert (found.code, says in found.err) == (code, True), found.err


@pytest.mark.parametrize("command", ["serve", "recompute"])
def test_auto_is_for_import(desk, aerodft, tmp_path, command):
    folder, _, _ = desk
    text = STATION.replace('video = "video.mp4"\n', "rate_hz = 5\n")
    config = folder / "auto.toml"
    config.write_text(text)
    if command == "serve":
        link = '[telemetry]\nconnection = "udpin:127.0.0.1:0"\n[telemetry.height]'
        config.write_text(text.replace("[telemetry.height]", link))
        done = aerodft("serve", config, "--seconds", "1")
    else:
        plain = folder / "plain.toml"
        plain.write_text(text.replace('time_offset_s = "auto"\n', ""))
        recording = tmp_path / "rec"
        assert aerodft("import", folder / "flight.tlog", "-c", plain, "-o", recording).code == 0
        done = aerodft("recompute", recording, "-c", config, "-o", tmp_path / "again")
    assert done.code == 3
    assert 'images.time_offset_s: got "auto", expected a number' in done.err
