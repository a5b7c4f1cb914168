"""Recordings of other tools: measured as a log and images of their own would be, or refused with what is there."""

import math
from io import BytesIO

import av
import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from mcap.writer import Writer

from replay.recordings import Recording
from tests.cli.conftest import HEIGHT_PX, UTC0_NS, WIDTH_PX
from tests.replay.foreign_files import LINK, PICTURES, frames_of, jpegs, write_foreign

STAMPS_NS = [UTC0_NS + 570_000_000 + k * 200_000_000 for k in range(10)]  # 20 ms late, as this host's clock is
RANGE_M = 40.0 / math.cos(math.radians(30.0))


@pytest.fixture
def frames(desk):
    return frames_of(desk.log)


def unrated(desk):
    """The station without a rate: images are the recording's."""
    return desk.station(desk.config.read_text().replace("rate_hz = 5\n", ""), "images.toml")


def h264(count):
    """Packets of a video with P-frames and one key frame, as an encoder without delay makes them."""
    with av.open(BytesIO(), "w", format="h264") as container:
        stream = container.add_stream("libx264", rate=5, options={"tune": "zerolatency", "g": "100"})
        stream.width, stream.height, stream.pix_fmt = WIDTH_PX, HEIGHT_PX, "yuv420p"
        pictures = [np.full((HEIGHT_PX, WIDTH_PX, 3), 20 + 20 * k, np.uint8) for k in range(count)]
        return [
            b"".join(map(bytes, stream.encode(av.VideoFrame.from_ndarray(each, format="bgr24")))) for each in pictures
        ]


def test_its_telemetry_gives_the_same_bytes_as_the_log_that_it_was_made_from(aerodft, desk, frames, tmp_path):
    foreign = write_foreign(desk.folder / "a.mcap", frames)
    assert aerodft("import", desk.log, "-c", desk.config, "-o", tmp_path / "log").code == 0
    for number, command in enumerate(("import", "recompute")):
        out = tmp_path / f"out{number}"
        found = aerodft(command, foreign, "-c", desk.config, "-o", out)
        assert found.code == 0, found.err
        assert list(Recording(out).measurements()) == list(Recording(tmp_path / "log").measurements())


@pytest.mark.parametrize("form", ["jpeg", "h264", "apart"])
def test_its_images_are_measured_and_recorded(aerodft, desk, frames, tmp_path, form):
    pictures = jpegs(STAMPS_NS, WIDTH_PX, HEIGHT_PX)
    if form == "h264":
        pictures = list(zip(STAMPS_NS, h264(len(STAMPS_NS)), strict=True))
    foreign = write_foreign(
        desk.folder / "a.mcap", frames, pictures, form="h264" if form == "h264" else "jpeg", apart=form == "apart"
    )
    out = tmp_path / "out"
    found = aerodft("recompute", foreign, "-c", unrated(desk), "-o", out, "--json")
    assert found.code == 0, found.err
    assert found.json["images"] == found.json["measurements"]["ok"] == 10
    assert aerodft("export", out, "--format", "csv").out.count(b"centre") == 10
    again = aerodft("recompute", out, "-o", tmp_path / "again")
    assert again.code == 0, again.err
    assert list(Recording(tmp_path / "again").measurements()) == list(Recording(out).measurements())
    assert len(list(Recording(out).image_messages())) == 2  # one a second


def test_its_camera_and_telemetry_are_measured_with_at_a_time(aerodft, desk, frames):
    focal_px = WIDTH_PX / 2 / math.tan(math.radians(30.0))
    matrix = (focal_px, 0, 31.5, 0, focal_px, 23.5, 0, 0, 1)
    camera = CameraCalibration(width=WIDTH_PX, height=HEIGHT_PX, distortion_model="plumb_bob", D=[0.0] * 5, K=matrix)
    foreign = write_foreign(desk.folder / "a.mcap", frames, calibration=camera)
    asked = ("measure", "--recording", foreign, "--at", 1, "--json", "--probe", "range 31.5,23.5")
    for more in ((), ("--camera", desk.folder / "camera.toml"), ("--config", desk.config)):
        found = aerodft(*asked, *more)
        assert found.code == 0, found.err
        assert found.json[0]["value"] == pytest.approx(RANGE_M, abs=1e-6)
    without = write_foreign(desk.folder / "b.mcap", frames)
    found = aerodft("measure", "--recording", without, "--at", 1, "--probe", "range 31.5,23.5")
    assert (found.code, "no camera in the recording" in found.last) == (3, True)


def test_doctor_says_of_it_what_it_says_of_the_log(aerodft, desk, frames):
    foreign = write_foreign(desk.folder / "a.mcap", frames)
    log, found = aerodft("doctor", desk.log, "--json").json, aerodft("doctor", foreign, "--json").json
    assert {key for key in log if log[key] != found[key]} <= {"target", "frames", "counts"}


def test_of_several_topics_one_is_named_on_the_command_line_or_in_the_configuration(aerodft, desk, frames, tmp_path):
    first = write_foreign(desk.folder / "a.mcap", frames, topic="/link/a")
    folder = tmp_path / "several"
    folder.mkdir()
    first.rename(folder / "a.mcap")
    write_foreign(folder / "b.mcap", frames, topic="/link/b")
    asked = ("recompute", folder, "-c", desk.config, "-o")
    found = aerodft(*asked, tmp_path / "none")
    assert (found.code, "several topics hold MAVLink: got /link/a, /link/b; say which" in found.last) == (3, True)
    assert aerodft(*asked, tmp_path / "one", "--topic", "mavlink=/link/a").code == 0
    stated = desk.station(desk.config.read_text() + '[topics]\nmavlink = "/link/b"\n', "stated.toml")
    assert aerodft("recompute", folder, "-c", stated, "-o", tmp_path / "other").code == 0
    assert list(Recording(tmp_path / "one").measurements()) == list(Recording(tmp_path / "other").measurements())


def write_json(path):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/chatter", "json", writer.register_schema("std_msgs/String", "", b""))
        writer.add_message(channel, UTC0_NS, b'{"data": "hello"}', UTC0_NS)
        writer.finish()


def write_empty(path):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()


REFUSED = {
    "no MAVLink": (write_json, (), 3, "no MAVLink in the recording: got /chatter (std_msgs/String, json), expected"),
    "no message": (write_empty, (), 4, "the recording holds no message"),
    "no MCAP": (lambda path: path.write_bytes(b"\x89MCAP1\r\n"), (), 3, "there is no recording: got unknown"),
    "no such topic": (write_json, ("--topic", "mavlink=/x"), 3, "no topic /x (mavlink): got /chatter"),
    "no such role": (write_json, ("--topic", "radar=/x"), 2, "--topic: got 'radar=/x', expected ROLE=TOPIC"),
    "no frame in it": (write_json, ("--topic", "mavlink=/chatter"), 4, "no height in the log: got none"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_used_is_refused_in_one_sentence(aerodft, desk, tmp_path, case):
    make, options, code, said = REFUSED[case]
    make(desk.folder / "a.mcap")
    config = unrated(desk)
    found = aerodft("recompute", desk.folder / "a.mcap", "-c", config, "-o", tmp_path / "out", *options)
    assert (found.code, said in found.last, "Traceback" in found.err) == (code, True, False), found.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["sync", "import"])
def test_a_video_is_aligned_with_the_topic_that_is_named(aerodft, desk, frames, tmp_path, command):
    folder = tmp_path / "two"
    folder.mkdir()
    write_foreign(folder / "a.mcap", frames, topic="/link/a")
    write_foreign(folder / "b.mcap", frames, topic="/link/b")
    video, began = desk.video(), ("--video-start", "2026-11-21T00:32:48.55Z")
    lines = {
        "sync": ("sync", video, folder, "-c", desk.config, *began),
        "import": (
            "import",
            folder,
            "--sync",
            "auto",
            "-c",
            desk.config,
            "--video",
            video,
            *began,
            "-o",
            tmp_path / "n",
        ),
    }
    open_which = aerodft(*lines[command])
    assert (open_which.code, "several topics hold MAVLink" in open_which.last) == (3, True), open_which.err
    named = aerodft(*lines[command], "--topic", "mavlink=/link/a")
    assert named.code == 4, named.err  # a hover: it does not turn
    assert "several topics" not in named.err
    desk.station(desk.config.read_text() + '[topics]\nmavlink = "/link/b"\n')
    assert aerodft(*lines[command]).code == 4


def test_without_a_configuration_it_is_not_computed(aerodft, desk, frames, tmp_path):
    found = aerodft("recompute", write_foreign(desk.folder / "a.mcap", frames), "-o", tmp_path / "out")
    assert (found.code, "no --config for another tool's recording" in found.last) == (2, True)


def test_a_clock_that_steps_back_is_named_and_ends(aerodft, desk, frames, tmp_path):
    half = len(frames) // 2
    stepped = [(at_ns - (500_000_000 if k > half else 0), data) for k, (at_ns, data) in enumerate(frames)]
    path = desk.folder / "a.mcap"
    write_foreign(path, stepped, apart=True)
    found = aerodft("recompute", path, "-c", desk.config, "-o", tmp_path / "out", "--json")
    assert any(f"{LINK}: the recording machine's clock stepped back" in each for each in found.json["warnings"])


def test_another_lens_in_the_recording_is_said(aerodft, desk, frames, tmp_path):
    matrix = (99.0, 0, 31.5, 0, 99.0, 23.5, 0, 0, 1)
    camera = CameraCalibration(width=WIDTH_PX, height=HEIGHT_PX, K=matrix)
    path = write_foreign(desk.folder / "a.mcap", frames, jpegs(STAMPS_NS, WIDTH_PX, HEIGHT_PX), calibration=camera)
    found = aerodft("recompute", path, "-c", unrated(desk), "-o", tmp_path / "out")
    assert "has a focal length of 99.0 px, 'small' of 55.4 px, which is measured with" in found.err
    assert PICTURES not in found.err
