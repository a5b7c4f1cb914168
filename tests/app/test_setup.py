"""First station files work as they are, and say where all that is in them comes from."""

import subprocess
import sys

import pytest
from PIL import Image

import aerodft as ad
from aerodft.adapters.config.station import VideoFile, load_station
from tests.commands import run_aerodft

LOG = "samples/copter.tlog"


def test_a_log_alone_becomes_measurements(tmp_path):
    done = run_aerodft("init", LOG, "-o", tmp_path / "mine", "--home-above-plane", "2.5", "--json")
    assert done.code == 0, done.err
    assert not any("take-off point" in sentence for sentence in done.json["to_do"])
    station = load_station(tmp_path / "mine" / "station.toml")
    assert station.pipeline.telemetry.height.home_above_plane_m == 2.5
    assert [str(each) for each in station.pipeline.telemetry.height.order] == ["rangefinder", "terrain", "home"]
    result = ad.import_flight(LOG, station=tmp_path / "mine" / "station.toml", output=tmp_path / "recording")
    assert result.statistics.poses["ok"] > 500


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sim") / "flight"
    command = [sys.executable, "-m", "aerodft.sim", "--out", str(folder), "--duration", "2", "--size", "320x180"]
    subprocess.run(command, check=True, capture_output=True)
    return folder


def test_a_video_and_its_log_become_measurements(flight, tmp_path):
    draft = ad.draft_station([flight / "flight.tlog", flight / "video.mp4"], tmp_path, camera=flight / "camera.toml")
    station = load_station(draft.station)
    assert station.pipeline.camera == ad.load_camera(flight / "camera.toml")
    assert isinstance(station.images.source, VideoFile)
    assert station.images.source.path.samefile(flight / "video.mp4")
    assert any("home_above_plane_m" in sentence for sentence in draft.to_do)
    result = ad.import_flight(flight / "flight.tlog", station=draft.station, output=tmp_path / "recording")
    assert result.statistics.poses["ok"] > 0


def test_a_photo_tells_its_camera(tmp_path):
    exif = Image.Exif()
    exif[0x0110] = "FC7303"
    Image.new("RGB", (4000, 3000)).save(tmp_path / "photo.jpg", exif=exif)
    draft = ad.draft_station([tmp_path / "photo.jpg"], tmp_path / "yard")
    assert ad.load_camera(draft.camera) == ad.find_cameras("FC7303 photo")[0].camera
    assert load_station(draft.station).fixed_pose.height_agl_m == 5.0
    assert "calibrate" in draft.to_do[0]


@pytest.mark.parametrize(("size", "focal_px"), [((400, 300), 300.4), ((4000, 2250), 3004.4)])
def test_the_focal_length_for_film_is_taken_where_the_camera_is_not_known(tmp_path, size, focal_px):
    """By the sensor's diagonal: 16:9 is as wide as the 4:3 sensor that it is cropped from."""
    exif, photo = Image.Exif(), tmp_path / "photo.jpg"
    exif[0x0110] = "Somebody's"
    exif.get_ifd(0x8769)[0xA405] = 26
    Image.new("RGB", size).save(photo, exif=exif)
    camera = ad.load_camera(ad.draft_station([photo], tmp_path).camera)
    assert camera.fx_px == pytest.approx(focal_px, abs=0.1)
    assert camera == ad.load_camera(photo)


def test_what_makes_no_sense_is_refused_and_nothing_is_replaced(tmp_path):
    assert run_aerodft("init", "-o", tmp_path).code == 2
    assert run_aerodft("init", LOG, LOG, "-o", tmp_path).code == 2
    assert run_aerodft("init", "nowhere.tlog", "-o", tmp_path).code == 3
    assert run_aerodft("init", LOG, "--camera", "Brownie", "-o", tmp_path).code == 4
    assert "no such file" in run_aerodft("init", LOG, "--camera", "mine/camera.toml", "-o", tmp_path).last
    assert run_aerodft("init", LOG, "-o", tmp_path).code == 0
    before = (tmp_path / "station.toml").read_bytes()
    assert run_aerodft("init", LOG, "-o", tmp_path).code == 3
    assert (tmp_path / "station.toml").read_bytes() == before
    assert run_aerodft("init", LOG, "-o", tmp_path, "--overwrite").code == 0


def test_a_stream_is_written_as_it_is_named(tmp_path):
    draft = ad.draft_station(["rtsp://127.0.0.1:8554/yard"], tmp_path)
    assert load_station(draft.station).images.source.url == "rtsp://127.0.0.1:8554/yard"
    assert draft.is_live


def test_a_video_of_another_size_is_of_its_cameras_mode(flight, tmp_path):
    draft = ad.draft_station([LOG, flight / "video.mp4"], tmp_path, camera="Mini 4 Pro")
    (listed,) = ad.find_cameras("Mini 4 Pro video")
    camera, of_4k = ad.load_camera(draft.camera), listed.camera
    assert (camera.width_px, of_4k.width_px) == (320, 3840)
    assert camera.fx_px / 320 == pytest.approx(of_4k.fx_px / 3840, rel=1e-3)
    assert camera.std.focal_px / camera.fx_px == pytest.approx(of_4k.std.focal_px / of_4k.fx_px, rel=0.01)


def test_the_page_is_next_for_a_fixed_camera_and_what_fails_leaves_no_folder(tmp_path):
    photo = tmp_path / "photo.jpg"
    Image.new("RGB", (500, 400)).save(photo)
    done = run_aerodft("init", photo, "--json", "-o", tmp_path / "mine")
    assert done.json["next_command"] == f"aerodft view {photo} --camera {tmp_path}/mine/camera.toml --open"
    assert run_aerodft("init", photo, "--camera", "Mini 4 Pro", "-o", tmp_path / "other").code == 4
    assert not (tmp_path / "other").exists()
