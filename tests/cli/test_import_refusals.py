"""Bad input to ``aerodft import``: one clear sentence each, the right exit code, and nothing half-written unsaid."""

import shutil

import cv2
import numpy as np
import orjson
import pytest

from aerodft.errors import InputError
from aerodft.service import StepOutputs
from replay.recordings import Recording

UTC0_NS = 1_795_221_168_000_000_000
START = "2026-11-21T00:32:48.55Z"
MS = 1_000_000
STILLS = '[images]\nstills = "stills"\npattern = "{unix_ms}.png"'
FIXED = """
[station]
name = "bridge"
[camera]
file = "camera.toml"
[pose]
height_agl_m = 12.0
tilt_deg = 60.0
[[probe]]
name = "centre"
kind = "range"
pixels = [[31.5, 23.5]]
"""


def measurements(folder, name):
    found = (orjson.loads(data) for data in Recording(folder).measurements())
    return [m for m in found if m["name"] == name]


def write_stills(folder, stamps_ms, *, size=(48, 64)):
    folder.mkdir()
    for ms in stamps_ms:
        cv2.imwrite(str(folder / f"{UTC0_NS // MS + ms}.png"), np.full((*size, 3), 90, dtype=np.uint8))
    return folder


def refused(found, code, *said):
    """The command ended with this exit code and one sentence that says all of this."""
    assert found.code == code, found.err
    assert found.last.startswith("aerodft: ")
    for words in said:
        assert words in found.last
    assert "Traceback" not in found.err


def untouched(folder):
    assert not folder.exists(), sorted(folder.iterdir())


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "no such file"),
        (b"", "the file is empty: got 0 bytes"),
        (b"just some words, not a log\n" * 40, "wrong type of file: got text"),
        (b"\x89PNG\r\n\x1a\n" + bytes(500), "wrong type of file: got a PNG image"),
        (b"\x00\x00\x00\x18ftypisom" + bytes(500), "wrong type of file: got an MP4 or MOV video"),
        (bytes(range(256)) * 8, "wrong type of file"),
    ],
)
def test_a_bad_log(aerodft, desk, content, said):
    log = desk.folder / "bad.tlog"
    if content is not None:
        log.write_bytes(content)
    found = aerodft("import", log, "-c", desk.config, "-o", desk.folder / "out")
    refused(found, 3, str(log), said, "expected a")
    untouched(desk.folder / "out")


def test_a_folder_is_no_log(aerodft, desk):
    refused(aerodft("import", desk.folder, "-c", desk.config, "-o", desk.folder / "out"), 3, "is a folder")


def test_a_log_without_height(aerodft, desk):
    log = desk.tlog("blind.tlog", height=False)
    found = aerodft("import", log, "-c", desk.config, "-o", desk.folder / "out")
    refused(found, 4, f"{log}: no height in the log: got none, expected one of home", "aerodft doctor")
    untouched(desk.folder / "out")


def test_a_log_without_gimbal(aerodft, desk):
    log = desk.tlog("stiff.tlog", gimbal=False)
    found = aerodft("import", log, "-c", desk.config, "-o", desk.folder / "out")
    refused(found, 4, f"{log}: no camera attitude in the log", "expected one of GIMBAL_DEVICE_ATTITUDE_STATUS")
    untouched(desk.folder / "out")


def test_a_height_that_the_configuration_does_not_want(aerodft, desk):
    text = desk.config.read_text().replace('["home"]', '["rangefinder", "terrain"]')
    found = aerodft("import", desk.log, "-c", desk.station(text), "-o", desk.folder / "out")
    refused(found, 4, "no height in the log: got home, expected one of rangefinder, terrain")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "no video file: got nothing there"),
        (b"", "not a readable video: got an empty file"),
        (b"just some words\n" * 40, "got text, expected a video file"),
        ("log", "got a MAVLink .tlog, expected a video file"),
        ("cut", "got an MP4 or MOV video, expected a video file; it is cut off before its index"),
    ],
)
def test_a_bad_video(aerodft, desk, content, said):
    video = desk.folder / "bad.mp4"
    if content == "log":
        shutil.copy(desk.log, video)
    elif content == "cut":
        whole = desk.video("whole.mp4").read_bytes()
        video.write_bytes(whole[: len(whole) // 2])
    elif content is not None:
        video.write_bytes(content)
    found = aerodft(
        "import", desk.log, "-c", desk.config, "-o", desk.folder / "out", "--video", video, "--video-start", START
    )
    refused(found, 3, str(video), said)
    untouched(desk.folder / "out")


def test_a_video_that_does_not_overlap_the_log(aerodft, desk):
    video = desk.video()
    found = aerodft(
        "import", desk.log, "-c", desk.config, "-o", desk.folder / "out", "--video", video, "--video-start",
        "2026-11-21T01:32:48Z",
    )  # fmt: skip
    refused(
        found,
        3,
        f"{video}: images and log {desk.log} do not overlap in time",
        "got images 2026-11-21T01:32:48Z to 2026-11-21T01:32:49.8Z",
        "expected within 2026-11-21T00:32:48",
    )
    untouched(desk.folder / "out")


def test_a_video_without_a_start(aerodft, desk):
    found = aerodft("import", desk.log, "-c", desk.config, "-o", desk.folder / "out", "--video", desk.video())
    refused(found, 3, "does not say when it was recorded", "--video-start")
    untouched(desk.folder / "out")


def test_a_video_of_another_size_than_the_camera(aerodft, desk):
    video = desk.video("large.mp4", size=(128, 96))
    found = aerodft(
        "import", desk.log, "-c", desk.config, "-o", desk.folder / "out", "--video", video, "--video-start", START
    )
    refused(found, 3, f"{video}: the image is not of this camera's mode", "got 128 x 96 px, expected 64 x 48 px")
    untouched(desk.folder / "out")


@pytest.mark.parametrize("make", [lambda _: None, lambda p: p.mkdir(), lambda p: p.write_text("x")])
def test_no_stills(aerodft, desk, make):
    folder = desk.folder / "stills"
    make(folder)
    found = aerodft("import", desk.log, "-c", desk.config, "-o", desk.folder / "out", "--images", folder)
    refused(found, 3, str(folder), "stills")
    untouched(desk.folder / "out")


def test_a_still_of_another_size_is_found_before_anything_is_written(aerodft, desk):
    folder = write_stills(desk.folder / "stills", [500, 900])
    cv2.imwrite(str(folder / f"{UTC0_NS // MS + 1300}.png"), np.zeros((10, 20, 3), dtype=np.uint8))
    config = desk.station(desk.config.read_text().replace("[images]\nrate_hz = 5", STILLS))
    found = aerodft("import", desk.log, "-c", config, "-o", desk.folder / "out")
    refused(found, 3, "got 20 x 10 px, expected 64 x 48 px, the size of camera")
    untouched(desk.folder / "out")


def test_an_observation_outside_the_image_has_a_status_not_a_number(aerodft, desk):
    seen = desk.observations({"name": "width", "stamp_ns": str(UTC0_NS + 10**9), "pixels": [[1, 30], [64, 30]]})
    out = desk.folder / "out"
    assert aerodft("import", desk.log, "-c", desk.config, "-o", out, "--observations", seen).code == 0
    (width,) = measurements(out, "width")
    assert (width["status"], width["value"]) == ("OUT_OF_IMAGE", None)
    assert width["reasons"] == ["pixel 1 (64, 30) is outside the image of 64 x 48 px"]


def test_an_existing_recording_is_not_touched(aerodft, desk):
    out = desk.folder / "out"
    assert aerodft("import", desk.log, "-c", desk.config, "-o", out).code == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    refused(aerodft("import", desk.log, "-c", desk.config, "-o", out), 3, f"{out}: a recording is never written over")
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_a_folder_that_cannot_be_written(aerodft, desk):
    found = aerodft("import", desk.log, "-c", desk.config, "-o", desk.log / "out")
    refused(found, 3, f"{desk.log}/out: the recording cannot be written: Not a directory")
    found = aerodft("import", desk.log, "-c", desk.config, "-o", desk.log)
    refused(found, 3, f"{desk.log}: the recording cannot be written: File exists")
    found = aerodft("import", desk.log, "-c", desk.config, "-o", "/proc/aerodft/out")
    refused(found, 3, "/proc/aerodft/out: the recording cannot be written: No such file or directory")


@pytest.mark.parametrize("ending", [InputError("the disk went away"), KeyboardInterrupt()])
def test_what_ends_halfway_says_that_it_did(aerodft, desk, monkeypatch, ending):
    def interrupted(feed, _, sinks, *__, **___):
        step = next(iter(feed.batches()))
        for sink in sinks:
            sink.take(step[:20], StepOutputs())
        raise ending

    monkeypatch.setattr("aerodft.app.assembly.run", interrupted)
    out = desk.folder / "out"
    found = aerodft("import", desk.log, "-c", desk.config, "-o", out)
    assert found.code == (3 if isinstance(ending, InputError) else 130)
    kept = "stopped; OUT holds what was done so far", "not finished; OUT holds what was read so far"
    assert f"aerodft: {kept[isinstance(ending, InputError)].replace('OUT', str(out))}" in found.err
    assert Recording(out).is_whole


def test_not_one_usable_pose_is_exit_4_and_the_recording_is_kept(aerodft, desk):
    text = desk.config.read_text().replace('order = ["home"]', 'order = ["home"]\nmin_m = 100.0')
    out = desk.folder / "out"
    found = aerodft("import", desk.log, "-c", desk.station(text), "-o", out, "--json")
    refused(
        found,
        4,
        f"{out}: no image has a usable pose: BELOW_MIN_HEIGHT (home says 40.00 m, the minimum is 100 m)",
        "the recording is kept",
    )
    assert found.json["measurements"] == {"BELOW_MIN_HEIGHT": 15}
    assert {m["value"] for m in measurements(out, "centre")} == {None}


def test_log_and_configuration_must_agree_on_telemetry(aerodft, desk):
    out = desk.folder / "out"
    found = aerodft("import", "-c", desk.config, "-o", out)
    refused(found, 3, f"{desk.config}: the configuration has [telemetry]: expected a LOG")
    found = aerodft("import", desk.log, "-c", desk.station(FIXED), "-o", out)
    refused(found, 3, "the configuration has [pose]: expected no LOG")
    found = aerodft("import", "-c", desk.station(FIXED), "-o", out)
    refused(found, 3, "a fixed camera's import needs images: expected --video or --images")
    untouched(out)
