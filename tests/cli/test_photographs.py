"""A drone's photograph through every command: without camera, height and tilt; what is given by hand wins."""

import math
import shlex
from pathlib import Path

import numpy as np
import orjson
import pytest

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.config.station import load_station
from aerodft.app.measure import Distance
from aerodft.cli.scenes.image_options import PoseOptions
from aerodft.cli.scenes.view import _fixed
from replay.recordings import Recording
from tests.commands import run_aerodft
from tests.photo_writer import dji, dji_photo, exif, packet, write_photo

SAMPLE = Path(__file__).parents[2] / "samples" / "DJI_0001.JPG"
PROBE = ("--probe", "position 31.5,23.5")


@pytest.fixture
def photo(tmp_path):
    return dji_photo(tmp_path / "DJI_0001.JPG", yaw_deg=40.0, pitch_deg=-60.0, relative_m=39.9)


def measured(*arguments):
    done = run_aerodft("measure", *arguments, *PROBE, "--json")
    assert done.code == 0, done.err
    return done, done.json[0]


def test_measure_takes_camera_and_pose_from_it(photo):
    done, found = measured(photo, "--home-above-plane", "1.5")
    pose = found["pose"]
    assert pose["height_agl_m"] == pytest.approx(41.4)
    assert (pose["height_source"], pose["height_datum"]) == ("home", "home")
    assert pose["tilt_deg"] == pytest.approx(30.0)
    assert pose["heading_deg"] == pytest.approx(40.0)
    assert pose["lat_deg"] == pytest.approx(46.8428646)
    assert found["ground_m"][0][1] == pytest.approx(41.4 * math.tan(math.radians(30.0)), abs=0.01)
    assert pose["std"]["tilt_deg"] == pytest.approx(1.2)
    assert any("DJI" in each for each in found["reasons"])
    assert "DJI: height 41.40 m (home), tilt 30.0 deg" in done.err


def test_an_unstated_take_off_height_is_said_and_wide(photo):
    _, unstated = measured(photo)
    _, stated = measured(photo, "--home-above-plane", "0")
    assert unstated["pose"]["std"]["height_agl_m"] > 5.0
    assert stated["pose"]["std"]["height_agl_m"] < 2.0
    assert any("home_above_plane_m" in each for each in unstated["reasons"])


def test_what_is_given_by_hand_wins_and_is_said(photo, tmp_path):
    (tmp_path / "cam.toml").write_text('name = "mine"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 50.0\n')
    by_hand = (
        "--height",
        "50",
        "--tilt",
        "20",
        "--heading",
        "10",
        "--lat",
        "1",
        "--lon",
        "2",
        "--std",
        "height=0.1,tilt=0.2",
    )
    _, found = measured(photo, "--camera", tmp_path / "cam.toml", *by_hand)
    pose = found["pose"]
    assert (pose["height_agl_m"], pose["height_source"]) == (50.0, "manual")
    assert pose["tilt_deg"] == pytest.approx(20.0)
    assert pose["heading_deg"] == pytest.approx(10.0)
    assert (pose["lat_deg"], pose["lon_deg"]) == (pytest.approx(1.0), pytest.approx(2.0))
    assert (pose["std"]["height_agl_m"], pose["std"]["tilt_deg"]) == (0.1, pytest.approx(0.2))
    assert found["camera"] == "mine"
    for said in ("height 50 m as stated", "tilt 20 deg as stated", "heading 10 deg as stated"):
        assert any(said in each for each in found["reasons"]), found["reasons"]


def test_the_laser_rangefinders_target_gives_the_height(tmp_path):
    lrf = {"LRFStatus": "Normal", "LRFTargetDistance": "79.572", "LRFTargetAlt": "-0.735"}
    photo = dji_photo(tmp_path / "a.jpg", yaw_deg=-106.6, pitch_deg=-32.9, relative_m=42.602, **lrf)
    _, found = measured(photo)
    assert found["pose"]["height_source"] == "rangefinder"
    assert found["pose"]["height_agl_m"] == pytest.approx(79.572 * math.sin(math.radians(32.9)), abs=1e-3)
    _, by_home = measured(photo, "--home-above-plane", "0.7")
    assert by_home["pose"]["height_agl_m"] == pytest.approx(43.3)  # the tag has 0.01 m


def test_a_target_that_contradicts_the_pose_is_left_out_and_said(tmp_path):
    lrf = {"LRFTargetDistance": "79.572", "LRFTargetAlt": "-40.0"}
    photo = dji_photo(tmp_path / "a.jpg", pitch_deg=-32.9, relative_m=42.602, **lrf)
    _, found = measured(photo)
    assert found["pose"]["height_source"] == "home"
    assert any("laser's target lies" in each for each in found["reasons"])


REFUSED = {
    "no angles": (packet({"drone-dji:RelativeAltitude": "39.9"}), "no --tilt"),
    "no height": (packet({k: v for k, v in dji().items() if "Relative" not in k}), "no --height"),
    "stripped": (None, "no --tilt"),
    "angles of 0": (packet(dji(0.0, 0.0, 0.0)), "all exactly 0"),
    "below the take-off point": (packet(dji(relative_m=-3.0)), "not above the water"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_it_does_not_say_is_asked_for(tmp_path, what):
    xmp, said = REFUSED[what]
    photo = write_photo(tmp_path / "a.jpg", xmp, exif(make="DJI", model="X", focal_35mm_mm=24))
    done = run_aerodft("measure", photo, *PROBE)
    assert done.code in {2, 3}
    assert said in done.last


def test_over_an_elevation_model_the_altitudes_datum_is_asked_for(photo, tmp_path):
    done = run_aerodft("measure", photo, "--terrain", tmp_path / "dem.tif", *PROBE)
    assert done.code == 2
    assert "no --altitude" in done.last
    assert "198.41 m above a datum that is not stated" in done.last


def test_an_unused_home_above_plane_is_refused(tmp_path):
    (tmp_path / "cam.toml").write_text('name = "mine"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 50.0\n')
    done = run_aerodft(
        *("measure", "--camera", tmp_path / "cam.toml", "--height", 10, "--tilt", 10, "--home-above-plane", 1, *PROBE)
    )
    assert done.code == 2
    assert "--home-above-plane" in done.last


def test_a_file_that_is_no_image_is_refused(tmp_path):
    (tmp_path / "a.jpg").write_text("nothing of that kind")
    done = run_aerodft("measure", tmp_path / "a.jpg", *PROBE)
    assert done.code == 3
    assert "not a readable image" in done.last


def test_depth_map_and_frames_take_it(photo, tmp_path):
    done = run_aerodft("depth-map", photo, "--home-above-plane", "1.5", "-o", tmp_path / "depth")
    assert done.code == 0, done.err
    assert (tmp_path / "depth" / "footprint.geojson").is_file()
    done = run_aerodft("frames", photo, "-o", tmp_path / "stills", "--json")
    assert done.code == 0, done.err
    assert Path(done.json[0]["path"]).is_file()


def flight(folder, count=5, **tags):
    folder.mkdir()
    for k in range(count):
        place_deg = (46.8428 + 1e-4 * k, -91.9936)
        info = exif(make="DJI", model="FC0000", date=f"2026:06:01 10:00:{4 * (k // 2):02d}", focal_35mm_mm=24)
        write_photo(
            folder / f"DJI_{k:04d}.JPG",
            packet(dji(10.0 * k, -90.0 + 5 * k, relative_m=40.0 + k, place_deg=place_deg, **tags)),
            info,
        )
    return folder


def test_a_folder_is_a_flight_each_with_its_own_pose(tmp_path):
    """Two photographs a second: neither takes the other's pose, and recomputing gives the same bytes."""
    photos = flight(tmp_path / "photos")
    done = run_aerodft("init", photos, "-o", tmp_path / "mine", "--home-above-plane", "1.5", "--json")
    assert done.code == 0, done.err
    assert done.json["next_command"].startswith(f"aerodft import {photos}")
    station = tmp_path / "mine" / "station.toml"
    done = run_aerodft("import", photos, "-c", station, "-o", tmp_path / "rec", "--json")
    assert done.code == 0, done.err
    found = [orjson.loads(each) for each in Recording(tmp_path / "rec").measurements()]
    assert [each["status"] for each in found] == ["ok"] * 5
    np.testing.assert_allclose([each["pose"]["height_agl_m"] for each in found], 41.5 + np.arange(5))
    np.testing.assert_allclose([each["pose"]["tilt_deg"] for each in found], 5.0 * np.arange(5), atol=1e-6)
    np.testing.assert_allclose([each["pose"]["heading_deg"] for each in found], 10.0 * np.arange(5), atol=1e-6)
    np.testing.assert_allclose([each["pose"]["lat_deg"] for each in found], 46.8428 + 1e-4 * np.arange(5), atol=1e-7)
    np.testing.assert_allclose([each["pose"]["std"]["tilt_deg"] for each in found], 1.2)
    done = run_aerodft("recompute", tmp_path / "rec", "-o", tmp_path / "again", "--json")
    assert done.code == 0, done.err
    assert list(Recording(tmp_path / "again").measurements()) == list(Recording(tmp_path / "rec").measurements())


def test_a_take_off_height_that_is_stated_later_ends_its_assumed_std(tmp_path):
    photos = flight(tmp_path / "photos", count=2)
    run_aerodft("init", photos, "-o", tmp_path / "mine", "--json")
    run_aerodft("import", photos, "-c", tmp_path / "mine" / "station.toml", "-o", tmp_path / "rec", "--json")
    done = run_aerodft("recompute", tmp_path / "rec", "--home-above-plane", "2", "-o", tmp_path / "later", "--json")
    assert done.code == 0, done.err
    for folder, height_m, std_m in (("rec", 40.0, math.hypot(1.5, 5.0)), ("later", 42.0, 1.5)):
        pose = orjson.loads(next(iter(Recording(tmp_path / folder).measurements())))["pose"]
        assert pose["height_agl_m"] == pytest.approx(height_m)
        assert pose["std"]["height_agl_m"] == pytest.approx(std_m)


def test_a_flight_agrees_with_its_photographs_one_by_one(tmp_path):
    photos = flight(tmp_path / "photos", count=3)
    run_aerodft("init", photos, "-o", tmp_path / "mine", "--json")
    run_aerodft("import", photos, "-c", tmp_path / "mine" / "station.toml", "-o", tmp_path / "rec", "--json")
    for each, photo in zip(Recording(tmp_path / "rec").measurements(), sorted(photos.iterdir()), strict=True):
        in_flight = orjson.loads(each)
        alone = measured(photo, "--camera", tmp_path / "mine" / "camera.toml")[1]
        for key in ("height_agl_m", "tilt_deg", "heading_deg", "lat_deg", "lon_deg"):
            assert in_flight["pose"][key] == pytest.approx(alone["pose"][key], abs=1e-6)
        assert in_flight["pose"]["std"] == pytest.approx(alone["pose"]["std"])
        np.testing.assert_allclose(in_flight["ground_m"], alone["ground_m"], atol=1e-6)


def test_photographs_without_a_date_are_a_flight_as_well(tmp_path):
    photos = tmp_path / "photos"
    photos.mkdir()
    for k in range(2):
        write_photo(
            photos / f"{k}.jpg",
            packet(dji(relative_m=40.0 + k)),
            exif(make="DJI", model="X", date="", focal_35mm_mm=24),
        )
    run_aerodft("init", photos, "-o", tmp_path / "mine", "--json")
    done = run_aerodft("import", photos, "-c", tmp_path / "mine" / "station.toml", "-o", tmp_path / "rec")
    assert done.code == 0, done.err
    assert "no still has a date" in done.err
    found = [orjson.loads(each) for each in Recording(tmp_path / "rec").measurements()]
    assert [each["pose"]["height_agl_m"] for each in found] == [40.0, 41.0]


def test_stills_of_nobody_beside_them_are_left_out_and_counted(tmp_path):
    photos = flight(tmp_path / "photos", count=2)
    write_photo(photos / "holiday.jpg", None, exif(make="Canon"), size_px=(30, 20))
    done = run_aerodft("doctor", photos)
    assert done.code == 0, done.err
    assert "1 stills beside them" in done.out.decode()


def test_doctor_says_who_took_them_and_what_they_leave_open(tmp_path):
    done = run_aerodft("doctor", flight(tmp_path / "photos"), "--json")
    assert done.code == 0, done.err
    assert done.json["usable"]
    assert "5 photographs by DJI" in done.json["notes"]
    assert "5 of 5 can be measured" in done.json["notes"]
    assert any("home_above_plane_m" in each for each in done.json["problems"])
    assert not any("vehicle" in each for each in done.json["problems"]), done.json["problems"]


def test_doctor_and_init_refuse_photographs_without_angles(tmp_path):
    siyi = write_photo(
        tmp_path / "a.jpg",
        None,
        exif(make="SIYIKEJI", model="ZR10", date="1970:01:01 00:03:45", place_deg=(6.6e-06, 1.5e-04)),
    )
    for command in (("doctor", siyi), ("init", siyi, "-o", tmp_path / "mine")):
        done = run_aerodft(*command)
        assert done.code == 3
        assert "without a fix" in done.last
        assert "SIYI states no angle" in done.last


def test_init_of_one_photograph_writes_a_station_that_works(photo, tmp_path):
    done = run_aerodft("init", photo, "-o", tmp_path / "mine", "--json")
    assert done.code == 0, done.err
    assert done.json["to_do"][0].startswith("Measure how high the take-off point lies above the water")
    settings = load_station(tmp_path / "mine" / "station.toml").pipeline.telemetry
    assert settings.height.home_above_plane_std_m == 5.0
    done = run_aerodft("import", photo, "-c", tmp_path / "mine" / "station.toml", "-o", tmp_path / "rec", "--json")
    assert done.code == 0, done.err


def test_photographs_that_say_no_height_ask_for_it(tmp_path):
    values = {"Camera:Yaw": 10.0, "Camera:Pitch": 20.0, "Camera:Roll": 0.0}
    info = exif(make="senseFly", model="S.O.D.A.", focal_35mm_mm=29, place_deg=(46.8, 7.1))
    photo = write_photo(tmp_path / "a.jpg", packet(values), info)
    done = run_aerodft("init", photo, "-o", tmp_path / "mine", "--json")
    assert done.code == 0, done.err
    assert "manual_m" in done.json["to_do"][0]
    done = run_aerodft("import", photo, "-c", tmp_path / "mine" / "station.toml", "-o", tmp_path / "rec", "--json")
    assert done.code == 0, done.err


def test_a_river_in_the_sample():
    """The sample's river is 22 m wide in the mean, with a swing of 3 m."""
    done = run_aerodft("river", SAMPLE, "--home-above-plane", "1.5", "--json")
    assert done.code == 0, done.err
    low, high = done.json["width_m"]["ci95"]
    assert low < 22.0 < high
    assert done.json["width_m"]["median"] == pytest.approx(22.0, abs=1.0)


def test_the_page_shows_it_with_commands_that_give_the_same(photo):
    view = _fixed(photo, PoseOptions(), 1.5)
    shown = view.measure(0, [Distance([(10.0, 10.0), (50.0, 12.0)], name="a")])[0]
    words = shlex.split(shown["command"])
    assert words[:3] == ["aerodft", "measure", str(photo.absolute())]
    done = run_aerodft(*words[1:], "--json")
    assert done.json[0]["value"] == shown["value"]


def test_a_photo_is_a_camera_file(photo, tmp_path):
    dewarp = "2018-09-07;366.0,365.0,1.0,2.0,-0.26,0.11,0.0009,0.00009,-0.03"
    own = dji_photo(tmp_path / "b.jpg", size_px=(547, 365), DewarpData=dewarp)
    done = run_aerodft("cameras", own, "-o", tmp_path / "camera.toml")
    assert done.code == 0, done.err
    assert load_camera(tmp_path / "camera.toml") == load_camera(own)
    assert load_camera(own).distortion[0] == -0.26
    assert load_camera(photo).distortion == ()


def test_a_folder_of_two_cameras_of_one_size_is_refused_by_their_names(tmp_path):
    values = dji(0.0, -60.0, 0.0)
    for name, model in (("a", "FC6310R"), ("b", "FC6310R"), ("c", "FC300S")):
        write_photo(tmp_path / f"{name}.jpg", packet(values), exif(model=model))
    done = run_aerodft("doctor", tmp_path)
    assert done.code == 3
    assert "photographs by several cameras: got FC300S (1), FC6310R (2)" in " ".join(done.err.split())


def test_copies_of_a_photograph_are_left_out_and_named(tmp_path):
    photos = flight(tmp_path / "photos")
    first, second, *_ = sorted(photos.iterdir())
    (photos / "copy of it.jpg").write_bytes(first.read_bytes())
    edited = photos / "edited.jpg"
    edited.write_bytes(second.read_bytes() + b"\0")  # other bytes that say what the second one says
    done = run_aerodft("doctor", photos, "--json")
    assert done.code == 0, done.err
    problems = " ".join(done.json["problems"])
    assert "1 of 7 photographs are copies of others: left out (copy of it.jpg)" in problems
    assert "1 of 7 photographs state time and pose of another one" in problems
    assert "6 photographs by DJI" in done.json["notes"]
    run_aerodft("init", photos, "-o", tmp_path / "mine", "--json")
    done = run_aerodft("import", photos, "-c", tmp_path / "mine/station.toml", "-o", tmp_path / "rec")
    assert done.code == 0, done.err
    assert "copies of others" in done.err
    assert len(list(Recording(tmp_path / "rec").measurements())) == 6


def test_photographs_of_another_place_or_of_none_are_left_out_and_named(tmp_path):
    photos = flight(tmp_path / "photos")
    info = exif(make="DJI", model="FC0000", date="2026:06:01 12:00:00", focal_35mm_mm=24)
    write_photo(photos / "holiday.jpg", packet(dji(0.0, -90.0, place_deg=(46.9, -91.9939))), info)
    write_photo(photos / "nowhere.jpg", packet(dji(0.0, -90.0, place_deg=(0.0, 0.0))), info)
    run_aerodft("init", photos, "-o", tmp_path / "mine", "--json")
    done = run_aerodft("import", photos, "-c", tmp_path / "mine/station.toml", "-o", tmp_path / "rec")
    assert done.code == 0, done.err
    said = " ".join(done.err.split())
    assert "1 of 7 photographs state no position: left out (nowhere.jpg)" in said
    # 57.2 thousandths of a degree of latitude less the flight's 0.4, times 111.19 km
    assert "1 of 6 photographs are of another place, 6.3 km and more from the rest: left out (holiday.jpg)" in said
    found = [orjson.loads(each) for each in Recording(tmp_path / "rec").measurements()]
    assert [each["status"] for each in found] == ["ok"] * 5


def test_photographs_of_two_places_are_refused(tmp_path):
    photos = flight(tmp_path / "photos", count=2)
    info = exif(make="DJI", model="FC0000", date="2026:06:02 12:00:00", focal_35mm_mm=24)
    for k in range(2):
        write_photo(photos / f"other{k}.jpg", packet(dji(k, -90.0, place_deg=(47.5, -90.0 + 1e-4 * k))), info)
    done = run_aerodft("doctor", photos)
    assert done.code == 3
    said = " ".join(done.err.split())
    assert "photographs of several places: got 2 photographs at" in said
    assert "put each place's photographs into a folder" in said
