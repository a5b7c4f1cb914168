"""``aerodft import``: numbers out of logs, video and stills; and one clear sentence for every bad input."""

import math
import tomllib

import cv2
import numpy as np
import orjson
import pytest

from aerodft.adapters.wire.events import IMAGE_SCHEMA, OBSERVATION_SCHEMA, decode_image
from replay.recordings import Recording
from tests.payloads import decode_observation

UTC0_NS = 1_795_221_168_000_000_000
START = "2026-11-21T00:32:48.55Z"
RANGE_M = 40.0 / math.cos(math.radians(30.0))
MS = 1_000_000


def measurements(folder, name):
    found = (orjson.loads(data) for data in Recording(folder).measurements())
    return [m for m in found if m["name"] == name]


def inputs(folder, schema, decode):
    return [decode(m.data) for m in Recording(folder).messages() if m.channel.schema == schema]


def write_stills(folder, stamps_ms, *, size=(48, 64)):
    folder.mkdir()
    for ms in stamps_ms:
        cv2.imwrite(str(folder / f"{UTC0_NS // MS + ms}.png"), np.full((*size, 3), 90, dtype=np.uint8))
    return folder


STILLS = '[images]\nstills = "stills"\npattern = "{unix_ms}.png"'


def test_telemetry_alone_at_a_rate(aerodft, desk):
    out = desk.folder / "out"
    found = aerodft("import", desk.log, "-c", desk.config, "-o", out, "--rate", 10, "--json")
    assert found.code == 0, found.err
    summary = found.json
    assert summary["recording"] == str(out)
    assert summary["images"] == 30
    assert summary["poses"] == summary["measurements"]
    assert (summary["poses"]["ok"], summary["warnings"]) == (30, [])
    assert [m["value"] for m in measurements(out, "centre")] == pytest.approx([RANGE_M] * 30)
    assert f"recording: {out}; 30 images" in found.err


def test_a_video_and_its_observations(flight_recording):
    centre, width = (measurements(flight_recording, name) for name in ("centre", "width"))
    stamps_ms = [550 + 200 * k for k in range(10)]
    assert [int(m["stamp_ns"]) for m in centre] == [UTC0_NS + ms * MS for ms in stamps_ms]
    assert [m["image"] for m in centre] == list(range(10))
    assert [m["image"] for m in width] == [0, 2, 4, 6, 8]
    assert {m["status"] for m in centre + width} == {"ok"}
    focal_px = 32 / math.tan(math.radians(30.0))
    below = 0.5 / focal_px  # row 24 is half a pixel below the centre
    depth_m = 40.0 / (math.cos(math.radians(30.0)) + below * math.sin(math.radians(30.0)))
    assert [m["value"] for m in width] == pytest.approx([40 * depth_m / focal_px] * 5, rel=1e-6)
    assert len(list(flight_recording.glob("images_*.mcap"))) == 1


def test_stills_and_observations_by_their_index(aerodft, desk):
    write_stills(desk.folder / "stills", range(500, 2500, 400))
    config = desk.station(desk.config.read_text().replace("[images]\nrate_hz = 5", STILLS))
    seen = desk.observations(*({"name": "width", "image": k, "pixels": [[10, 24], [50, 24]]} for k in range(5)))
    out = desk.folder / "out"
    found = aerodft("import", desk.log, "-c", config, "-o", out, "--observations", seen, "--json")
    assert found.code == 0, found.err
    assert found.json["measurements"] == {"ok": 10}
    images = inputs(out, IMAGE_SCHEMA, decode_image)
    observed = inputs(out, OBSERVATION_SCHEMA, decode_observation)
    assert [seen.stamp_ns for seen in observed] == [image.stamp_ns for image in images]
    assert [image.stamp_ns for image in images] == [UTC0_NS + ms * MS for ms in range(500, 2500, 400)]


def test_another_folder_of_stills_keeps_the_configured_pattern(aerodft, desk):
    write_stills(desk.folder / "others", [500, 900])
    config = desk.station(desk.config.read_text().replace("[images]\nrate_hz = 5", STILLS))
    out = desk.folder / "out"
    found = aerodft("import", desk.log, "-c", config, "-o", out, "--images", desk.folder / "others", "--json")
    assert (found.code, found.json["images"]) == (0, 2), found.err


def test_the_start_of_a_configured_video_can_be_given(aerodft, desk):
    desk.video("film.mp4")
    config = desk.station(desk.config.read_text().replace("rate_hz = 5", 'video = "film.mp4"'))
    out = desk.folder / "out"
    found = aerodft("import", desk.log, "-c", config, "-o", out, "--video-start", START, "--json")
    assert (found.code, found.json["poses"]) == (0, {"ok": 10}), found.err


@pytest.mark.parametrize(("stated_s", "used_s"), [(0.0, 3**-0.5), (0.1, 3**-0.5), (0.6, 0.6), (2.0, 2.0)])
def test_the_doubt_of_whole_seconds_is_counted_once(aerodft, desk, stated_s, used_s):
    """The part cut off is uniform over a second: its root mean square is 1 / sqrt(3) s."""
    desk.video(start="2026-11-21T00:32:48.000000Z")
    station = desk.config.read_text().replace("rate_hz = 5", f'video = "flight.mp4"\ntime_std_s = {stated_s}')
    done = aerodft("import", desk.log, "-c", desk.station(station), "-o", desk.folder / "rec")
    assert done.code == 0, done.err
    config = tomllib.loads((desk.folder / "rec" / "config.toml").read_text())
    assert config["images"]["time_std_s"] == pytest.approx(used_s)


def test_a_time_offset_moves_images_and_what_was_seen_in_them(aerodft, desk):
    text = desk.config.read_text().replace("rate_hz = 5", "time_offset_s = 0.25")
    seen = desk.observations({"name": "width", "image": 1, "pixels": [[10, 24], [50, 24]]})
    out = desk.folder / "out"
    found = aerodft(
        "import", desk.log, "-c", desk.station(text), "-o", out, "--video", desk.video(), "--video-start", START,
        "--observations", seen,
    )  # fmt: skip
    assert found.code == 0, found.err
    assert int(measurements(out, "centre")[0]["stamp_ns"]) == UTC0_NS + 800 * MS
    (width,) = measurements(out, "width")
    assert (int(width["stamp_ns"]), width["image"]) == (UTC0_NS + 1000 * MS, 1)


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


def test_a_fixed_camera_needs_no_log(aerodft, desk):
    out = desk.folder / "out"
    found = aerodft(
        "import", "-c", desk.station(FIXED), "-o", out, "--video", desk.video(), "--video-start", START, "--json"
    )
    assert (found.code, found.json["measurements"]) == (0, {"ok": 10}), found.err
    assert [m["value"] for m in measurements(out, "centre")] == pytest.approx([24.0] * 10)


def test_observations_of_an_unknown_probe_are_kept_and_said(aerodft, desk):
    seen = desk.observations({"name": "who", "stamp_ns": str(UTC0_NS + 10**9), "pixels": [[1, 1]]})
    out = desk.folder / "out"
    found = aerodft("import", desk.log, "-c", desk.config, "-o", out, "--observations", seen)
    assert found.code == 0
    assert "1 observations name a probe that the configuration does not observe; they are recorded" in found.err
    assert len(inputs(out, OBSERVATION_SCHEMA, decode_observation)) == 1


def test_a_cut_log_is_imported_up_to_the_cut_with_a_warning(aerodft, desk):
    data = desk.log.read_bytes()
    desk.log.write_bytes(data[: len(data) * 2 // 3 - 7])
    found = aerodft("import", desk.log, "-c", desk.config, "-o", desk.folder / "out", "--json")
    assert found.code == 0, found.err
    (warning,) = found.json["warnings"]
    assert warning == f"{desk.log}: the last frame is cut off; everything before it was read"
    assert f"aerodft: {warning}" in found.err
    assert 8 <= found.json["poses"]["ok"] <= 11
