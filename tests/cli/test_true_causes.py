"""Situations in which a hint once named the wrong cause, or something that does not exist."""

import numpy as np
import pytest
from PIL import Image

import aerodft as ad
from tests.commands import run_aerodft

from .conftest import write_tlog, write_video


def photos(folder, *, dates=(), zone=None, count=3):
    """Photos of the desk's camera whose EXIF data have the first dates."""
    folder.mkdir()
    for index in range(count):
        exif = Image.Exif()
        if index < len(dates):
            exif.get_ifd(0x8769)[0x9003] = dates[index]
            if zone is not None:
                exif.get_ifd(0x8769)[0x9011] = zone
        Image.fromarray(np.full((48, 64, 3), 90, np.uint8)).save(folder / f"IMG_{index}.jpg", exif=exif)
    return folder


LOCAL = [f"2026:11:21 09:32:{second}" for second in (49, 50, 51)]  # the log begins at 00:32:48 UTC


def test_local_time_of_photos_is_named_with_the_option_that_states_it(desk):
    stills = photos(desk.folder / "stills", dates=LOCAL)
    asked = ("import", desk.log, "-c", desk.config, "--images", stills, "-o", desk.folder / "rec")
    refused = run_aerodft(*asked)
    assert (refused.code, "--utc-offset +09:00 would fit" in refused.last) == (3, True), refused.err
    done = run_aerodft(*asked, "--utc-offset", "+09:00")
    assert done.code == 0, done.err
    assert "poses: 3 ok" in done.err


def test_a_wrong_zone_in_exif_is_corrected_by_an_offset(desk):
    """EXIF states a zone, which `--utc-offset` does not replace."""
    stills = photos(desk.folder / "stills", dates=LOCAL, zone="+00:00")
    asked = ("import", desk.log, "--images", stills, "-o", desk.folder / "rec")
    refused = run_aerodft(*asked, "-c", desk.config)
    assert (refused.code, "images.time_offset_s = -32400 would fit" in refused.last) == (3, True), refused.err
    desk.station(desk.config.read_text().replace("rate_hz = 5", "time_offset_s = -32400"))
    done = run_aerodft(*asked, "-c", desk.config)
    assert done.code == 0, done.err


def test_photos_of_another_day_are_not_told_to_sync(desk):
    stills = photos(desk.folder / "stills", dates=[each.replace("11:21 09", "03:02 10") for each in LOCAL])
    refused = run_aerodft("import", desk.log, "-c", desk.config, "--images", stills, "-o", desk.folder / "rec")
    assert (refused.code, "is this the flight's log?" in refused.last) == (3, True), refused.err
    assert "sync" not in refused.last


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--utc-offset", "9"), "--utc-offset without stills: expected --images"),
        (("--images", "stills", "--utc-offset", "9"), "--utc-offset: got 9, expected an offset from UTC like +02:00"),
        (("--max-offset", "60"), "--max-offset without --sync auto"),
        (("--video", "flight.mp4", "--sync", "auto", "--max-offset", "0"), "--max-offset: got 0, expected above 0"),
    ],
)
def test_options_without_their_place_are_refused(desk, options, says):
    photos(desk.folder / "stills", dates=LOCAL)
    desk.video()
    places = {name: desk.folder / name for name in ("stills", "flight.mp4")}
    given = (places.get(each, each) for each in options)
    done = run_aerodft("import", desk.log, "-c", desk.config, "-o", desk.folder / "rec", *given)
    assert (done.code, says in done.last) == (2, True), done.err


def test_a_cut_video_is_called_cut_and_no_second_log(tmp_path):
    whole = write_video(tmp_path / "whole.mp4").read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: len(whole) // 2])
    done = run_aerodft("init", write_tlog(tmp_path / "a.tlog"), tmp_path / "cut.mp4", "-o", tmp_path / "mine")
    assert (done.code, "not a readable video" in done.last, "two sources" in done.last) == (3, True, False), done.err


def test_photos_without_dates_are_not_said_to_have_them(tmp_path):
    log, undated = write_tlog(tmp_path / "a.tlog"), photos(tmp_path / "undated")
    draft = ad.draft_station([log, undated], tmp_path / "mine")
    assert any("have no dates" in each for each in draft.taken)
    assert any("images.pattern" in each for each in draft.to_do)
    assert not any("stamped by their EXIF data" in each for each in draft.taken)


def test_photos_of_local_time_are_known_by_their_hours(tmp_path):
    log, local = write_tlog(tmp_path / "a.tlog"), photos(tmp_path / "local", dates=LOCAL, count=4)
    draft = ad.draft_station([log, local], tmp_path / "mine")
    assert any("3 of 4 stamped by their EXIF data" in each for each in draft.taken)
    (said,) = [each for each in draft.to_do if "images.utc_offset" in each]
    assert 'utc_offset = "+09:00" would fit' in said


def test_a_fixed_camera_is_not_told_to_wait_for_its_gimbal():
    """Its attitude is stated to 5 degrees, which nothing settles."""
    asked = ("--camera", "configs/cameras/demo-1080p.toml", "--height", 8, "--tilt", 60, "--probe", "range 960,700")
    done = run_aerodft("explain", *asked, "--std", "height=0.1,attitude=5", "--json")
    assert done.code == 0, done.err
    assert b"calibrate the camera" in done.out
    assert b"gimbal" not in done.out
