"""``aerodft river`` over a recorded flight and over a fixed camera's video, against rivers known in closed form."""

import csv
import json
import math
from dataclasses import replace
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
import tomli_w

from aerodft.adapters.config.camera import camera_document
from aerodft.geometry import east_north
from aerodft.model import BiasValues
from aerodft.reports.river import COLUMNS
from aerodft.reports.river.document import scatter_remarks
from aerodft.sim import default_camera
from aerodft.sim.scenario import survey_scenario, write_files
from tests.vision.river_scenes import picture, river_scene, true_crossing

pytestmark = pytest.mark.nightly

START = "2026-11-21T00:34:38Z"
HEIGHT_BIAS_M, TILT_BIAS_DEG = 0.5, 0.3
STATION = {
    "station": {"name": "reach"},
    "camera": {"file": "camera.toml"},
    "telemetry": {
        "height": {"order": ["home"], "std_m": {"home": 0.5}},
        "attitude": {"feedback": "measured", "frame": "earth", "tilt_std_deg": 0.3, "roll_std_deg": 0.3},
    },
    "record": {"image_hz": 2.0},
    "probe": [{"name": "centre", "kind": "range", "pixels": [[320, 180]]}],
}


@pytest.fixture(scope="module")
def flight(tmp_path_factory, aerodft):
    """A flight along a river whose telemetry is off, and its recording with images."""
    folder = tmp_path_factory.mktemp("reach")
    scenario = survey_scenario(default_camera(640, 360), duration_s=14.0, fps=3.0)
    biases = BiasValues(height_m=HEIGHT_BIAS_M, tilt_rad=math.radians(TILT_BIAS_DEG))
    scenario = replace(scenario, autopilot=replace(scenario.autopilot, biases=biases))
    write_files(scenario, folder)
    (folder / "station.toml").write_text(tomli_w.dumps(STATION))
    done = aerodft(
        *("import", folder / "flight.tlog", "--video", folder / "video.mp4", "--video-start", START),
        *("-c", folder / "station.toml", "-o", folder / "recording"),
    )
    assert done.code == 0, done.err
    return scenario, folder / "recording"


@pytest.fixture(scope="module")
def measured(flight, aerodft, tmp_path_factory):
    folder = tmp_path_factory.mktemp("river")
    done = aerodft("river", flight[1], "--images", 8, "--spacing", 2, "--flow", 90, "-o", folder, "--json")
    assert done.code == 0, done.err
    return done.json, folder


def true_width(scenario, transect):
    """The river's width along a transect's own line."""
    ends = [
        east_north(scenario.world.origin, math.radians(p["lat_deg"]), math.radians(p["lon_deg"]))
        for p in transect["geo"]
    ]
    left, right = map(np.asarray, ends)
    middle, unit = (left + right) / 2, (left - right) / np.linalg.norm(left - right)
    ((to_left, to_right),) = true_crossing(scenario.world.river, middle[None], unit[None])
    return to_left - to_right


def test_widths_of_a_flight_hold_the_truth_and_what_its_telemetry_is_off_by(flight, measured):
    document, _ = measured
    used = [each for each in document["transects"] if each["status"] == "ok"]
    assert len(used) >= 15
    assert max(each["images"] for each in used) >= 3
    width = np.array([each["width_m"] for each in used])
    truth = np.array([true_width(flight[0], each) for each in used])
    std = np.array([each["std"] for each in used])
    assert np.median(np.abs(width / truth - 1)) < 0.03
    assert np.all(np.abs(width - truth) < 3 * std)
    # A height that is off by so much of 40 m makes every width wrong by as much: it may not average out.
    assert np.median(std / width) > HEIGHT_BIAS_M / 45
    low, high = document["width_m"]["ci95"]
    assert low <= np.median(truth) <= high


def test_a_corrected_home_height_scales_the_widths(flight, measured, aerodft):
    """Every width is the height times a function of the angles; the median is of other transects, to 2 %."""
    asked = ("river", flight[1], "--images", 8, "--spacing", 2, "--flow", 90, "--json")
    done = aerodft(*asked, "--home-above-plane", 2)
    assert done.code == 0, done.err
    assert done.json["computed_from"]["settings"] == {"telemetry.height.home_above_plane_m": 2.0}
    assert measured[0]["computed_from"]["settings"] == {}
    ratio = done.json["width_m"]["median"] / measured[0]["width_m"]["median"]
    assert ratio == pytest.approx((40 + HEIGHT_BIAS_M + 2) / (40 + HEIGHT_BIAS_M), abs=0.02)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ("images.time_offset_s=1.0", "`aerodft sync` finds the video's clock"),
        ("camera.file={short}", "a focal length that is too short, or a wrong height"),
    ],
)
def test_a_reach_whose_images_contradict_each_other_is_refused(flight, aerodft, tmp_path, change, cause):
    """A wrong clock and a wrong lens: no headline, exit 4; numbers on request, exit 5."""
    camera = camera_document(flight[0].camera)
    (tmp_path / "short.toml").write_text(tomli_w.dumps(camera | {key: 0.8 * camera[key] for key in ("fx_px", "fy_px")}))
    setting = change.format(short=tmp_path / "short.toml")
    asked = ("river", flight[1], "--images", 14, "--spacing", 2, "--set", setting)
    refused = aerodft(*asked, "-o", tmp_path / "reach")
    assert (refused.code, "CONTRADICTORY" in refused.last, cause in refused.last) == (4, True, True), refused.err
    assert b"95 %" not in refused.out
    assert not (tmp_path / "reach").exists()
    wanted = aerodft(*asked, "--despite-contradiction", "--json")
    assert wanted.code == 5, wanted.err
    assert (wanted.json["status"], wanted.json["width_m"] is None) == ("CONTRADICTORY", False)
    assert wanted.json["images"]["contradiction_stds"] > 3


def test_images_that_agree_do_not_contradict_each_other(measured):
    assert measured[0]["images"]["contradiction_stds"] < 1.5


@pytest.mark.parametrize(("ratio", "remarks", "is_suspected"), [(1.2, 0, False), (4.2, 1, False), (85.0, 1, True)])
def test_stamps_that_are_not_the_telemetry_s_are_suspected(ratio, remarks, is_suspected):
    """Of a flight at 90 m images whose stamps were 2 s off scattered 85 times as much as they state, others up to 4."""
    said = scatter_remarks(ratio)
    assert len(said) == remarks
    assert any("aerodft sync" in each for each in said) is is_suspected


def test_left_is_left_looking_downstream_and_files_say_what_the_document_says(measured):
    document, folder = measured
    used = [each for each in document["transects"] if each["status"] == "ok"]
    assert all(each["geo"][0]["lat_deg"] > each["geo"][1]["lat_deg"] for each in used)  # it flows east
    assert json.loads((folder / "result.json").read_text())["width_m"] == document["width_m"]
    rows = list(csv.DictReader((folder / "transects.csv").read_text().splitlines()))
    assert [float(row["width_m"]) for row in rows if row["status"] == "ok"] == [each["width_m"] for each in used]
    features = json.loads((folder / "river.geojson").read_text())["features"]
    assert {each["properties"]["name"] for each in features} == {
        "centreline", "bank-left", "bank-right", "transect", "water",
    }  # fmt: skip
    assert set(rows[0]) == set(COLUMNS)  # those of one image
    looked = document["images"]
    assert looked["looked_at"] == len(looked["each"]) == 8
    assert looked["without_pose"]
    assert sum(each["drift"] is not None for each in looked["each"]) >= 4
    told = [each for each in looked["each"] if each["status"] == "ok"]
    assert (looked["used"], looked["used_share"]) == (len(told), len(told) / 8)
    assert document["confidence"] == pytest.approx(np.median([each["confidence"] for each in told]))
    assert looked["each"][0]["since_s"] == 0.0
    assert all(each["wetted_m"] == each["width_m"] and each["channels"] == 1 for each in used), "it has no island"
    assert all(each["bound"] is None and max(each["hidden_m_per_m"]) < 0.5 for each in used)


def test_the_plate_shows_an_image_of_the_flight(aerodft, flight, measured, tmp_path):
    """Pixel by pixel but for lines and labels: the image with the most transects, and no other one."""
    document, folder = measured
    plate = cv2.imread(str(folder / "plate.png")).astype(int)
    top = plate[: plate.shape[0] * 2 // 5]
    is_coloured = top.max(axis=-1) - top.min(axis=-1) > 20
    (above, *_, below), (left, *_, right) = (np.flatnonzero(is_coloured.mean(axis=axis) > 0.5) for axis in (1, 0))
    shown = top[above : below + 1, left : right + 1]
    each = document["images"]["each"]
    stamps = [part for image in each for part in ("--at", image["stamp_ns"])]
    written = aerodft("frames", flight[1], *stamps, "-o", tmp_path, "--json").json
    images = [cv2.resize(cv2.imread(still["path"]), shown.shape[1::-1]) for still in written]
    same = [np.mean(np.abs(shown - image) <= 10) for image in images]  # of 256 levels
    (best,) = (image for image, share in zip(each, same, strict=True) if share > 0.8)
    assert best["status"] == "ok"
    assert sorted(same)[-2] < 0.5


def test_a_fixed_cameras_video_gives_what_its_image_gives(aerodft, tmp_path):
    scene = river_scene("curved", 40, 2)
    camera, image = picture(scene, width_px=640, height_px=360)
    (tmp_path / "cam.toml").write_text(tomli_w.dumps(camera_document(camera)))
    cv2.imwrite(str(tmp_path / "still.png"), image)
    with av.open(str(tmp_path / "video.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(5), options={"crf": "12"})
        stream.width, stream.height, stream.pix_fmt = 640, 360, "yuv420p"
        for seed in range(6):
            _, shot = picture(scene, width_px=640, height_px=360, seed=seed)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(shot, format="bgr24")))
        container.mux(stream.encode())
    pose = ["--camera", tmp_path / "cam.toml", "--height", scene.height_m, "--tilt", scene.tilt_deg]
    pose += ["--roll", scene.roll_deg, "--heading", scene.heading_deg, "--std", "height=0.2,attitude=0.2", "--json"]
    film = aerodft("river", tmp_path / "video.mp4", *pose)
    still = aerodft("river", tmp_path / "still.png", *pose)
    assert film.code == still.code == 0, film.err
    one, many = still.json["width_m"], film.json["width_m"]
    assert many["median"] == pytest.approx(one["median"], rel=0.01)
    assert many["std"] == pytest.approx(one["std"], rel=0.2)  # the pose is the same in every image
    assert film.json["images"]["looked_at"] == 6
    assert film.json["confidence"] == pytest.approx(still.json["confidence"], abs=0.1)  # the same share of the outline
    each = film.json["images"]["each"]
    assert [one["since_s"] for one in each] == pytest.approx(np.arange(6) / 5)
    assert all(one["stamp_ns"] is None for one in each), "nobody said when it was filmed"
    assert set(film.json["transects"][0]) == set(still.json["transects"][0])


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        (["--height", 40], 2, "--height beside"),
        (["--camera", "cam.toml"], 2, "--camera beside a recording"),
        (["--elevation", 100], 4, "no river width"),
    ],
)
def test_what_a_recording_says_itself_is_refused(flight, aerodft, options, code, says):
    done = aerodft("river", flight[1], "--images", 3, *options)
    assert (done.code, says in done.last) == (code, True), done.err


def test_a_recording_without_images_says_so(flight, aerodft, tmp_path):
    done = aerodft("import", flight[1].parent / "flight.tlog", "--rate", 2, "-c", flight[1].parent / "station.toml",
                   "-o", tmp_path / "bare")  # fmt: skip
    assert done.code == 0, done.err
    bare = aerodft("river", tmp_path / "bare")
    assert (bare.code, "record.image_hz" in bare.last) == (4, True), bare.err


@pytest.fixture(scope="module")
def looked(flight, aerodft, tmp_path_factory):
    """The same flight imported by a station that looks for the banks itself."""
    folder = tmp_path_factory.mktemp("looked")
    probe = {"name": "river", "kind": "river", "observed": True}
    station = {**STATION, "probe": [probe], "river": {"every_s": 1.0}}
    source = flight[1].parent
    station["camera"] = {"file": str(source / "camera.toml")}
    (folder / "station.toml").write_text(tomli_w.dumps(station))
    done = aerodft(
        *("import", source / "flight.tlog", "--video", source / "video.mp4", "--video-start", START),
        *("-c", folder / "station.toml", "-o", folder / "recording", "--json"),
    )
    assert done.code == 0, done.err
    return folder, done.json


def test_a_station_that_looks_for_banks_measures_the_river(flight, looked, aerodft, tmp_path):
    folder, summary = looked
    assert sum(summary["river"]["without_river"].values()) < summary["river"]["images"]
    done = aerodft("export", folder / "recording", "--format", "jsonl", "-o", tmp_path / "out.jsonl")
    assert done.code == 0, done.err
    found = [json.loads(line) for line in (tmp_path / "out.jsonl").read_text().splitlines()]
    assert len(found) == summary["river"]["images"], "one for each look, whether there is a river or not"
    unseen = [each for each in found if each["status"] == "NOT_SEEN"]
    assert sum(summary["river"]["without_river"].values()) == len(
        [each for each in found if each["value"] is None and not each["pixels"]]
    )
    assert unseen
    assert all(each["value"] is None and ": " in each["reasons"][0] for each in unseen)
    found = [each for each in found if each["status"] == "ok"]
    assert len(found) >= 4
    for each in found:
        assert each["kind"] == "river"
        pairs = [each["geo"][row : row + 2] for row in range(0, len(each["geo"]), 2)]
        truth = np.median([true_width(flight[0], {"geo": pair}) for pair in pairs])
        assert abs(each["value"] - truth) < 3 * each["std"]
        assert each["std"] / each["value"] > HEIGHT_BIAS_M / 45


def test_its_recording_computed_again_needs_no_image(looked, aerodft, tmp_path):
    folder, _ = looked
    assert aerodft("recompute", folder / "recording", "-o", tmp_path / "same").code == 0
    assert aerodft("compare", folder / "recording", tmp_path / "same").code == 0
    again = aerodft("recompute", folder / "recording", "--redetect", "-o", tmp_path / "seen", "--json")
    assert again.code == 0, again.err
    assert again.json["vision"]["median_px"] < 5.0  # transects begin elsewhere where a bank is seen otherwise


def test_a_flight_over_what_is_no_river_says_in_every_look_why_there_is_no_width(flight, aerodft, tmp_path):
    source = flight[1].parent
    with av.open(str(source / "video.mp4")) as old, av.open(str(tmp_path / "grass.mp4"), "w") as new:
        stream = new.add_stream("libx264", rate=Fraction(3), options={"crf": "12"})
        stream.width, stream.height, stream.pix_fmt = 640, 360, "yuv420p"
        for k, _ in enumerate(old.decode(video=0)):
            grass = np.random.default_rng(k).normal((40, 110, 60), 12, (360, 640, 3)).clip(0, 255).astype(np.uint8)
            new.mux(stream.encode(av.VideoFrame.from_ndarray(cv2.blur(grass, (3, 3)), format="bgr24")))
        new.mux(stream.encode())
    probe = {"name": "river", "kind": "river", "observed": True}
    station = {**STATION, "probe": [probe], "river": {}, "camera": {"file": str(source / "camera.toml")}}
    (tmp_path / "station.toml").write_text(tomli_w.dumps(station))
    done = aerodft(
        *("import", source / "flight.tlog", "--video", tmp_path / "grass.mp4", "--video-start", START),
        *("-c", tmp_path / "station.toml", "-o", tmp_path / "rec", "--json"),
    )
    assert done.code in (0, 4), done.err
    assert aerodft("export", tmp_path / "rec", "--format", "jsonl", "-o", tmp_path / "out.jsonl").code == 0
    found = [json.loads(line) for line in (tmp_path / "out.jsonl").read_text().splitlines()]
    assert len(found) == done.json["river"]["images"] >= 10
    assert all(each["value"] is None and each["reasons"] for each in found)
    assert {each["status"] for each in found} >= {"NOT_SEEN"}
    assert aerodft("recompute", tmp_path / "rec", "-o", tmp_path / "same").code == done.code
    assert aerodft("compare", tmp_path / "rec", tmp_path / "same", "--tolerance", "0m").code == 0


def test_looking_for_banks_that_nobody_measures_is_refused(looked, aerodft, tmp_path):
    folder, _ = looked
    text = (folder / "station.toml").read_text().replace('kind = "river"', 'kind = "width"')
    (folder / "other.toml").write_text(text)
    done = aerodft("recompute", folder / "recording", "-c", folder / "other.toml", "-o", tmp_path / "no")
    assert (done.code, "river: got no probe that is measured from banks" in done.last) == (3, True), done.err
