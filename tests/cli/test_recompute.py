"""``aerodft recompute``: the same bytes again, or what another configuration makes of the same input."""

import math
import shutil

import orjson
import pytest

from aerodft.adapters.recording.write import McapRecorder, RecorderSettings
from aerodft.model import Camera, Image
from replay.recordings import Recording, RecordingSource

CALIBRATION = """
[bias]
height_m = { value = -4.0, std = 0.1 }
tilt_deg = { value = 1.0, std = 0.1 }
"""


def payloads(folder):
    return list(Recording(folder).measurements())


def found(folder, name):
    return [m for m in map(orjson.loads, payloads(folder)) if m["name"] == name]


def edited(recording, folder, old, new):
    """The recording's own configuration with one thing changed."""
    text = (recording / "config.toml").read_text()
    assert old in text
    path = folder / "other.toml"
    path.write_text(text.replace(old, new))
    return path


def test_the_same_configuration_gives_the_same_bytes(aerodft, flight_recording, tmp_path):
    once, twice = tmp_path / "once", tmp_path / "twice"
    first = aerodft("recompute", flight_recording, "-o", once, "--json")
    assert first.code == 0, first.err
    assert first.json["measurements"] == {"ok": 15}
    assert aerodft("recompute", once, "-o", twice).code == 0
    assert payloads(flight_recording) == payloads(once) == payloads(twice)
    assert (flight_recording / "config.toml").read_text() == (once / "config.toml").read_text()


def test_images_are_copied_as_they_are(aerodft, flight_recording, tmp_path):
    out = tmp_path / "out"
    assert aerodft("recompute", flight_recording, "-o", out).code == 0

    def pictures(folder):
        images = [e for e in RecordingSource(Recording(folder), pixels=True).events() if isinstance(e, Image)]
        return {image.index: image.pixels().tobytes() for image in images if image.pixels}

    assert pictures(flight_recording) == pictures(out)
    assert len(pictures(out)) == 2


def test_another_configuration_gives_other_numbers(aerodft, flight_recording, tmp_path):
    config = edited(flight_recording, tmp_path, "home_above_plane_m = 0.0", "home_above_plane_m = 2.5")
    out = tmp_path / "out"
    assert aerodft("recompute", flight_recording, "-c", config, "-o", out).code == 0
    values = [m["value"] for m in found(out, "centre")]
    assert values == pytest.approx([42.5 / math.cos(math.radians(30.0))] * 10)
    assert found(out, "centre")[0]["config"] != found(flight_recording, "centre")[0]["config"]


def test_a_calibration_corrects_height_and_tilt(aerodft, flight_recording, tmp_path):
    calibration = tmp_path / "calibration.toml"
    calibration.write_text(CALIBRATION)
    out, again = tmp_path / "out", tmp_path / "again"
    run = aerodft("recompute", flight_recording, "--calibration", calibration, "-o", out)
    assert run.code == 0, run.err
    values = [m["value"] for m in found(out, "centre")]
    assert values == pytest.approx([36.0 / math.cos(math.radians(31.0))] * 10)
    assert found(out, "centre")[0]["calibration"].startswith("sha256:")
    assert aerodft("recompute", out, "-o", again).code == 0
    assert payloads(again) == payloads(out)


def test_another_time_offset_moves_images_and_what_was_seen_in_them(aerodft, flight_recording, tmp_path):
    config = edited(flight_recording, tmp_path, "time_offset_s = 0.0", "time_offset_s = 0.1")
    out = tmp_path / "out"
    assert aerodft("recompute", flight_recording, "-c", config, "-o", out).code == 0
    for name in ("centre", "width"):
        before, after = ([(int(m["stamp_ns"]), m["image"]) for m in found(f, name)] for f in (flight_recording, out))
        # The configuration has two offsets, of images and of observations, and both were changed.
        shift_ns = 100_000_000 if name == "centre" else 200_000_000
        assert [stamp for stamp, _ in after] == [stamp + shift_ns for stamp, _ in before]


def test_what_is_no_recording_is_refused(aerodft, tmp_path):
    for folder, sentence in ((tmp_path / "none", "no such file or folder"), (tmp_path, "there is no recording")):
        (tmp_path / "notes.txt").write_text("x")
        run = aerodft("recompute", folder, "-o", tmp_path / "out")
        assert (run.code, f"{folder}: {sentence}" in run.last) == (3, True)
        assert not (tmp_path / "out").exists()


def test_a_recording_that_lost_its_configuration_is_computed_with_the_one_in_its_segments(
    aerodft, flight_recording, tmp_path
):
    bare = tmp_path / "bare"
    shutil.copytree(flight_recording, bare)
    (bare / "config.toml").unlink()
    for number, recording in enumerate((bare, bare / "data_000.mcap")):
        out = tmp_path / f"out{number}"
        run = aerodft("recompute", recording, "-o", out)
        assert run.code == 0, run.err
        assert payloads(out) == payloads(flight_recording)


def test_a_recording_without_any_configuration_asks_for_one(aerodft, tmp_path):
    bare = tmp_path / "bare"
    camera = Camera.from_fov(name="small", width_px=64, height_px=48, hfov_rad=1.0, vfov_rad=0.8)
    recorder = McapRecorder(bare, RecorderSettings(station="test", camera=camera, lossless=True), started_ns=1)
    recorder.close()
    run = aerodft("recompute", bare, "-o", tmp_path / "out")
    assert (
        run.code,
        "no config.toml beside the segments; `aerodft recompute` takes one as --config" in run.last,
    ) == (3, True)


def test_it_never_writes_into_the_recording(aerodft, flight_recording):
    before = sorted((path.name, path.stat().st_size) for path in flight_recording.iterdir())
    run = aerodft("recompute", flight_recording, "-o", flight_recording)
    assert (run.code, "a recording is never written over something else" in run.last) == (3, True)
    assert sorted((path.name, path.stat().st_size) for path in flight_recording.iterdir()) == before


def test_a_time_offset_does_not_move_stamps_at_a_rate(aerodft, desk, tmp_path):
    """They are no camera's clock: import leaves them where they are, and so does recompute."""
    moved = desk.station(desk.config.read_text().replace("rate_hz = 5", "rate_hz = 5\ntime_offset_s = 0.7"), "m.toml")
    assert aerodft("import", desk.log, "-c", desk.config, "-o", tmp_path / "plain").code == 0
    assert aerodft("import", desk.log, "-c", moved, "-o", tmp_path / "moved").code == 0
    assert aerodft("recompute", tmp_path / "plain", "-c", moved, "-o", tmp_path / "again").code == 0
    assert payloads(tmp_path / "again") == payloads(tmp_path / "moved")
    stamps = [[json["stamp_ns"] for json in found(tmp_path / name, "centre")] for name in ("plain", "moved")]
    assert stamps[0] == stamps[1]
