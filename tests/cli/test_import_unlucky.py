"""Flights that went wrong while they were recorded: clocks that are set, videos that hold nothing, garbled names."""

import av
import numpy as np
import pytest

from aerodft.conventions import SECOND_NS
from aerodft.sim.video import write_video

FIXED = """
[station]
name = "mast"
[camera]
file = "camera.toml"
[pose]
height_agl_m = 5
tilt_deg = 40
"""


def stamped(log, stamp_us):
    """A log's bytes with the host stamp of its n-th frame made anew from the old one."""
    data, at, count = bytearray(log.read_bytes()), 0, 0
    while at < len(data):
        old = int.from_bytes(data[at : at + 8], "big")
        data[at : at + 8] = stamp_us(old, count).to_bytes(8, "big")
        at, count = at + 8 + 12 + data[at + 9], count + 1
    log.write_bytes(data)
    return log


def imported(aerodft, desk, *more):
    done = aerodft("import", *more, "-c", desk.config, "-o", desk.folder / "rec", "--json")
    assert "Traceback" not in done.err
    return done


def test_a_clock_that_is_set_from_1970_to_today_is_no_flight_of_fifty_years(aerodft, desk):
    log = stamped(desk.tlog(), lambda us, n: n if n < 40 else us)
    done = imported(aerodft, desk, log)
    assert done.code == 0, done.err
    assert 10 <= done.json["measurements"]["ok"] <= 15


@pytest.mark.parametrize("stamp_us", [0, 2**64 - 1])
def test_a_log_of_one_instant_holds_no_image(aerodft, desk, stamp_us):
    done = imported(aerodft, desk, stamped(desk.tlog(), lambda _us, _n: stamp_us))
    assert done.code == 4
    assert done.last.endswith("rec: no image has a usable pose: no image came; the recording is kept")
    assert done.json["images"] == 0


def test_a_video_that_ends_with_its_header_is_refused_before_anything_is_written(aerodft, desk):
    cut = desk.folder / "cut.mkv"
    cut.write_bytes(desk.video("whole.mkv").read_bytes()[:700])
    desk.station(FIXED)
    done = imported(aerodft, desk, "--video", cut, "--video-start", "2026-11-21T00:32:48Z")
    assert (done.code, done.out) == (3, b"")
    assert done.last.endswith("cut.mkv: holds no image: expected at least one; it is cut or damaged")
    assert not (desk.folder / "rec").exists()


def test_damaged_images_of_a_video_are_counted_as_never_measured(aerodft, desk):
    noise, video = np.random.default_rng(1), desk.folder / "noisy.mp4"
    images = ((k * SECOND_NS // 20, noise.integers(0, 255, (48, 64, 3), dtype=np.uint8)) for k in range(60))
    write_video(video, images, fps=20.0)
    data = bytearray(video.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 6000] = noise.bytes(6000)
    video.write_bytes(data)
    done = imported(aerodft, desk, desk.log, "--video", video, "--video-start", "2026-11-21T00:32:48.5Z")
    damaged = done.json["unmeasured"]["damaged"]
    assert damaged > 0
    assert done.json["images"] + damaged == 60
    assert f"images that were never measured: {damaged} damaged" in done.err
    again = aerodft("recompute", desk.folder / "rec", "-o", desk.folder / "again", "--json")
    assert again.json["unmeasured"] == {"damaged": damaged}, "the recording knows it"
    assert aerodft("report", desk.folder / "again", "-o", desk.folder / "report.html").code == 0
    assert f"images that were never measured: {damaged} damaged" in (desk.folder / "report.html").read_text()


def test_a_video_with_a_garbled_title_is_a_video(aerodft, desk):
    video = desk.folder / "titled.mkv"
    with av.open(str(video), "w") as container:
        container.metadata["title"] = "TITLETITLE"
        stream = container.add_stream("libx264", rate=5)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(10):
            container.mux(stream.encode(av.VideoFrame(64, 48, "yuv420p")))
        container.mux(stream.encode())
    video.write_bytes(video.read_bytes().replace(b"TITLETITLE", b"\xd1\xff\xfeTITLE\xc3("))
    done = imported(aerodft, desk, desk.log, "--video", video, "--video-start", "2026-11-21T00:32:48.5Z")
    assert done.code == 0, done.err
    assert done.json["images"] == 10


def test_observations_with_too_few_pixels_are_said(aerodft, desk):
    seen = desk.observations({"name": "width", "stamp_ns": "1795221169000000000", "pixels": [[1, 2]]})
    done = imported(aerodft, desk, desk.log, "--observations", seen)
    assert done.code == 0
    assert done.last == (
        "1 observations do not have the pixels that their probe takes, or an outline that it can be measured by; "
        "they are recorded"
    )
