"""``aerodft river`` on rendered rivers whose banks are known in closed form."""

import csv
import json
from functools import partial
from itertools import combinations

import cv2
import numpy as np
import pytest
import tomli_w

from aerodft.adapters.config.camera import camera_document
from aerodft.reports.river import COLUMNS, plate
from tests.vision.river_scenes import picture, river_scene, true_crossing


@pytest.fixture(scope="module")
def river(aerodft):
    """``aerodft river`` with some arguments."""
    return partial(aerodft, "river")


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    """A curved river at 40 degrees of tilt, its camera file and the options that say where it was taken."""
    folder = tmp_path_factory.mktemp("river")
    scene = river_scene("curved", 40, 1)
    camera, image = picture(scene)
    (folder / "cam.toml").write_text(tomli_w.dumps(camera_document(camera)))
    cv2.imwrite(str(folder / "river.png"), image)
    options = ["--camera", folder / "cam.toml", "--height", scene.height_m, "--tilt", scene.tilt_deg]
    options += ["--roll", scene.roll_deg, "--heading", scene.heading_deg]
    return scene, folder / "river.png", options


def test_values_on_the_plate_stay_in_the_image_and_off_each_other(river, tmp_path, monkeypatch):
    """Transects lie close together at the bridge's right edge, where values stand at the left of their bank."""
    figures, close = [], plate.plt.close
    monkeypatch.setattr(plate.plt, "close", figures.append)
    options = "--camera configs/cameras/demo-1080p.toml --height 7.93 --tilt 62.3 --std height=0.1,tilt=0.2 --spacing 2"
    assert river("configs/calibration/bridge.jpg", "--roll=-0.6", *options.split(), "-o", tmp_path).code == 0
    axes = figures[0].axes[0]
    boxes = [text.get_window_extent() for text in axes.texts]
    assert len(boxes) >= 3
    assert all(axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 for box in boxes)
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    close(figures[0])


def test_widths_are_those_of_the_river(river, shot, tmp_path):
    scene, image, options = shot
    std = "height=0.2,attitude=0.2"
    done = river(image, *options, "--std", std, "--lat", -35.0, "--lon", 149.0, "-o", tmp_path / "out", "--json")
    assert done.code == 0, done.err
    document = done.json
    assert document["status"] == "ok"
    used = [each for each in document["transects"] if each["status"] == "ok"]
    assert len(used) >= 20
    for each in used:
        left, right = (np.array(point[:2]) + scene.pose.position_enu_m[:2] for point in each["points_enu_m"])
        middle, unit = (left + right) / 2, (left - right) / np.linalg.norm(left - right)
        ((to_left, to_right),) = true_crossing(scene.world.river, middle[None], unit[None])
        assert each["width_m"] == pytest.approx(to_left - to_right, rel=0.01)
        assert each["ci95"][0] < each["width_m"] < each["ci95"][1]
    widths = [each["width_m"] for each in used]
    assert document["width_m"]["median"] == pytest.approx(float(np.median(widths)), abs=1e-9)
    assert 0 < document["confidence"] <= 1
    rows = list(csv.DictReader((tmp_path / "out/transects.csv").read_text().splitlines()))
    assert [float(row["width_m"]) for row in rows if row["width_m"]] == pytest.approx(widths)
    names = {
        each["properties"]["name"] for each in json.loads((tmp_path / "out/river.geojson").read_text())["features"]
    }
    assert names == {"centreline", "bank-left", "bank-right", "transect", "water"}
    assert json.loads((tmp_path / "out/result.json").read_text())["width_m"] == document["width_m"]
    assert cv2.imread(str(tmp_path / "out/plate.png")) is not None
    mask = cv2.imread(str(tmp_path / "out/water.png"), cv2.IMREAD_GRAYSCALE)
    assert (mask.shape, set(np.unique(mask))) == (cv2.imread(str(image)).shape[:2], {0, 255})
    for each in used:
        left, right = np.array([each["left"], each["right"]])
        across = np.rint([left + share * (right - left) for share in (0.2, 0.5, 0.8, -0.2, 1.2)]).astype(int)
        assert [mask[v, u] for u, v in across if 0 <= u < mask.shape[1]][:3] == [255, 255, 255]
        assert all(mask[v, u] == 0 for u, v in across[3:] if 0 <= u < mask.shape[1] and 0 <= v < mask.shape[0])
    assert set(rows[0]) == set(COLUMNS)
    row, each = next((row, each) for row, each in zip(rows, document["transects"], strict=True) if row["width_m"])
    assert [float(row[name]) for name in ("std_m", "ci95_low_m", "ci95_high_m", "wetted_m", "left_u", "right_lat")] == [
        each["std"], *each["ci95"], each["wetted_m"], each["left"][0], each["geo"][1]["lat_deg"],
    ]  # fmt: skip
    assert (row["images"], row["scatter_m"]) == ("1", "")


def test_without_a_place_there_is_no_geojson(river, shot, tmp_path):
    """GeoJSON is WGS84: metres under its name would lie in the Gulf of Guinea."""
    _, image, options = shot
    done = river(image, *options, "-o", tmp_path / "out", "--json")
    assert done.code == 0, done.err
    document = done.json
    assert not (tmp_path / "out/river.geojson").exists()
    assert str(tmp_path / "out/river_local.json") in document["files"]
    assert "river_local.json, in metres" in done.err
    local = json.loads((tmp_path / "out/river_local.json").read_text())
    assert (local["schema"], local["unit"], "type" in local) == ("aerodft.river_local/1", "m", False)
    drawn = [each["geometry"]["coordinates"] for each in local["features"] if each["properties"]["name"] == "transect"]
    measured = [each["points_enu_m"] for each in document["transects"] if each["points_enu_m"]]
    np.testing.assert_allclose(drawn, np.array(measured)[..., :2])


def test_height_is_shared_by_all_widths(river, shot):
    """1 % of height is 1 % of every width, and of their median: it does not average out."""
    scene, image, options = shot
    done = river(image, *options, "--std", f"height={0.01 * scene.height_m},attitude=0", "--json")
    width = done.json["width_m"]
    assert width["std"] == pytest.approx(0.01 * width["median"], rel=0.08)


def test_a_water_model_that_is_none_is_one_sentence(river, shot, tmp_path):
    _, image, options = shot
    (tmp_path / "model.onnx").write_text("weights")
    done = river(image, *options, "--water-model", tmp_path / "model.onnx", "--json")
    assert done.code == 3
    assert done.out == b""
    assert "model.onnx: no network that OpenCV can run" in done.err
    assert done.err.count("\n") == 1


def test_the_camera_above_the_horizon_sees_no_river(river, shot):
    _, image, options = shot
    options = [*options]
    options[options.index("--tilt") + 1] = 130
    done = river(image, *options, "--json")
    assert done.code == 4
    assert done.json["status"] == "ABOVE_HORIZON"
    assert "Traceback" not in done.err
    assert done.err.count("\n") == 1


def test_what_is_neither_image_nor_video_nor_recording_is_one_sentence(river, tmp_path):
    missing = river(tmp_path / "gone.jpg", "--json")
    assert (missing.code, "no such file" in missing.err) == (3, True)
    (tmp_path / "frames").mkdir()
    cv2.imwrite(str(tmp_path / "frames/1.png"), np.zeros((8, 8, 3), np.uint8))
    folder = river(tmp_path / "frames", "--height", 40, "--tilt", 30)
    assert (folder.code, "a folder without a recording" in folder.err) == (3, True)
    assert "import" in folder.err
    (tmp_path / "flight.tlog").write_bytes(bytes(8) + b"\xfd\x09" + bytes(40))
    (tmp_path / "log.jpg").write_bytes(b"\xa3\x95\x80\x80" + bytes(40))
    for name, kind in (("flight.tlog", "a MAVLink .tlog"), ("log.jpg", "an ArduPilot .bin log")):
        log = river(tmp_path / name, "--camera", "cam.toml", "--height", 40, "--tilt", 30)
        assert log.code == 3
        assert f"{name}: a flight's log has no images: got {kind}" in log.err
        assert "`aerodft import` makes a recording of a log and its --images or --video" in log.err
    (tmp_path / "notes.txt").write_text("banks")
    text = river(tmp_path / "notes.txt", "--camera", "cam.toml", "--height", 40, "--tilt", 30)
    assert (text.code, "no image: got text" in text.err) == (3, True)


def test_a_folder_that_cannot_be_written_is_said_before_anything_is_read(river, tmp_path):
    (tmp_path / "taken").write_text("mine")
    for output in (tmp_path / "taken", tmp_path / "taken" / "inside"):
        done = river(tmp_path / "gone.jpg", "--camera", "cam.toml", "--height", 40, "--tilt", 30, "-o", output)
        assert (done.code, done.err.count("\n")) == (3, 1)
        assert f"{output}: the river cannot be written" in done.err
    assert (tmp_path / "taken").read_text() == "mine"
    missing = river(tmp_path / "gone.jpg", "--camera", "cam.toml", "--height", 40, "--tilt", 30, "-o", tmp_path / "a/b")
    assert (missing.code, "no such file" in missing.err, (tmp_path / "a").exists()) == (3, True, False)


def test_how_many_images_is_not_asked_of_one(river, shot):
    _, image, options = shot
    done = river(image, *options, "--images", 5)
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "--images beside one image" in done.err
