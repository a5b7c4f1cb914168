"""``aerodft calibrate`` with many images: simulated flights whose telemetry is off by known biases."""

import math
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from numpy.testing import assert_allclose

from aerodft.adapters.config.camera import load_calibration
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.model import BIASES, BiasValues, Image, PoseStd
from aerodft.sim import Autopilot, default_camera
from aerodft.sim.observations import pixels_of
from aerodft.sim.scenario import Scenario, survey_scenario, write_files
from aerodft.sim.world import DEFAULT_ORIGIN
from replay.recordings import Recording, RecordingSource

REPOSITORY = Path(__file__).parents[2]
SAMPLE = REPOSITORY / "configs/calibration/flight-images.toml"
DEMO = REPOSITORY / "configs/cameras/demo-1080p.toml"
DEG = math.pi / 180
OFFSET_S, STD_PX = 0.3, 0.5
ASKED = "height,tilt,roll,heading,time"
TRUTH = {"height_bias_m": 1.5, "tilt_bias_deg": 1.2, "roll_bias_deg": -0.4, "heading_bias_deg": -1.5}
STATION = """
[station]
name = "s"
[station.origin]
lat_deg = -35.363262
lon_deg = 149.165237
[camera]
file = "camera.toml"
[telemetry]
[images]
rate_hz = 5
[[probe]]
name = "d"
kind = "distance"
pixels = [[300.0, 300.0], [900.0, 320.0]]
"""


@dataclass(frozen=True)
class Flown:
    """A flight, and the folder with its log, its camera, and evidence: images that were stamped too early."""

    folder: Path
    scenario: Scenario

    def document(self, stamps, log="flight.tlog"):
        """Evidence from images at these true stamps, each with what is said of its time."""
        rng, images, landmarks = np.random.default_rng(1), [], []
        for index, (stamp_ns, said) in enumerate(stamps):
            seen = _seen(self.scenario, stamp_ns, rng)
            if seen:
                images.append({"name": f"IMG_{index}", **said})
                landmarks += [{"image": f"IMG_{index}", "std_px": STD_PX, **each} for each in seen]
        origin = {"lat_deg": math.degrees(DEFAULT_ORIGIN.lat_rad), "lon_deg": math.degrees(DEFAULT_ORIGIN.lon_rad)}
        return {"telemetry": {"log": str(log), "origin": origin}, "image": images, "landmark": landmarks}


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flight")
    biases = BiasValues(height_m=-1.5, tilt_rad=-1.2 * DEG, roll_rad=0.4 * DEG, heading_rad=1.5 * DEG)
    noise = PoseStd(height_agl_m=0.05, tilt_rad=0.05 * DEG, horizontal_m=0.1)
    scenario = survey_scenario(default_camera(1280, 720), duration_s=14.0, fps=5.0)
    scenario = replace(scenario, autopilot=Autopilot(biases=biases, noise=noise))
    write_files(scenario, folder, video=False)
    (folder / "station.toml").write_text(STATION)
    made, late_ns = Flown(folder, scenario), round(OFFSET_S * 1e9)
    stamps = [(ns, {"utc": unix_ns_to_iso(ns - late_ns)}) for ns in scenario.image_stamps_ns[20::4].tolist()]
    (folder / "evidence.toml").write_text(tomli_w.dumps(made.document(stamps)))
    return made


@pytest.fixture
def flight(flown):
    return flown.folder


def _seen(scenario, stamp_ns, rng):
    """Points of the ground all over the image, from the true pose."""
    pose, camera = scenario.trajectory.pose(stamp_ns), scenario.camera
    east, north, _ = pose.position_enu_m.tolist()
    found = []
    for index in range(40):
        point = [round(east + 40 * rng.normal(), 2), round(north + 40 * rng.normal(), 2), round(rng.uniform(0, 2), 2)]
        pixel = pixels_of(camera, pose, np.array(point)) + STD_PX * rng.normal(size=2)
        inside = (5 < pixel[0] < camera.width_px - 5) and (5 < pixel[1] < camera.height_px - 5)
        if inside:
            found.append({"name": f"p{index}", "pixel": pixel.tolist(), "position_m": point})
    return found[:5]


def calibrate(aerodft, folder, *more, document=None, names=ASKED):
    path = folder / "evidence.toml"
    if document is not None:
        path = folder / "changed.toml"
        path.write_text(tomli_w.dumps(document))
    return aerodft("calibrate", path, "--camera", folder / "camera.toml", "--unknowns", names, "--json", *more)


def evidence(folder):
    return tomllib.loads((folder / "evidence.toml").read_text())


def check_truth(parameters, offset_s=OFFSET_S):
    for key, value in {**TRUTH, "time_offset_s": offset_s}.items():
        assert_allclose(parameters[key]["value"], value, atol=4 * parameters[key]["std"], err_msg=key)
    assert parameters["time_offset_s"]["std"] < 0.02
    assert parameters["height_bias_m"]["std"] < 0.2
    assert parameters["tilt_bias_deg"]["std"] < 0.2


def test_biases_and_the_time_offset_of_a_log_are_found(aerodft, flight, tmp_path):
    out, report = tmp_path / "biases.toml", tmp_path / "report"
    found = calibrate(aerodft, flight, "-o", out, "--report", report)
    assert found.code == 0, found.err
    check_truth(found.json["parameters"])
    assert found.json["residuals"][0]["name"].startswith("IMG_0/p")
    assert len(found.json["images"]) == len(evidence(flight)["image"])
    written = load_calibration(out).biases
    assert_allclose(written.bias.time_s, found.json["parameters"]["time_offset_s"]["value"])
    order, named = found.json["order"], np.array(found.json["covariance"])
    height, time = order.index("height_bias_m"), order.index("time_offset_s")
    assert_allclose(written.bias_cov[0, -1], named[height, time], rtol=1e-6)
    assert written.bias_cov.shape == (len(BIASES), len(BIASES))
    assert {path.name for path in report.iterdir()} == {"report.md", "residuals.png", "residuals.csv"}
    assert "time\\_offset\\_s" in (report / "report.md").read_text()


def test_the_calibration_goes_into_every_command(aerodft, flight, tmp_path):
    """What is measured with it is as far off as without images: not at all, to a percent."""
    out = tmp_path / "biases.toml"
    assert calibrate(aerodft, flight, "-o", out).code == 0
    log, station = flight / "flight.tlog", flight / "station.toml"
    options = ("--calibration", out)
    assert aerodft("import", log, "-c", station, "-o", tmp_path / "one", *options).code == 0
    assert aerodft("recompute", tmp_path / "one", "-o", tmp_path / "two").code == 0
    assert aerodft("compare", tmp_path / "one", tmp_path / "two").code == 0
    again = aerodft("recompute", tmp_path / "one", "-o", tmp_path / "three", *options)
    assert again.code == 0, again.err
    probe = ("--camera", flight / "camera.toml", "--probe", "distance 300,400 900,420", "--json")
    pose = ("--height", "40", "--tilt", "45")
    with_biases = aerodft("measure", *probe, *pose, *options).json[0]
    by_hand = aerodft("measure", *probe, "--height", str(40 + written_height(out)), "--tilt", "45").json[0]
    assert with_biases["calibration"].startswith("sha256:")
    assert with_biases["pose"]["tilt_deg"] == pytest.approx(
        45 + load_calibration(out).biases.bias.tilt_rad / DEG, abs=0.1
    )
    assert with_biases["pose"]["height_agl_m"] == pytest.approx(by_hand["pose"]["height_agl_m"])
    assert with_biases["std"] < by_hand["std"]


def written_height(path):
    return load_calibration(path).biases.bias.height_m


def test_images_of_a_recording_are_named_by_index(aerodft, flown, tmp_path):
    """Its stamps are right, and its biases are the telemetry's own, whatever it was recorded with."""
    old, recording = tmp_path / "old.toml", tmp_path / "recording"
    old.write_text("[bias]\nheight_m = 5.0\n")
    log, station = flown.folder / "flight.tlog", flown.folder / "station.toml"
    assert aerodft("import", log, "-c", station, "-o", recording, "--calibration", old).code == 0
    events = RecordingSource(Recording(recording)).events()
    stamps = {event.index: event.stamp_ns for event in events if isinstance(event, Image)}
    chosen = [(stamps[index], {"index": index}) for index in sorted(stamps)[25:-3:5]]
    document = flown.document(chosen, log=recording)
    found = calibrate(aerodft, flown.folder, document=document)
    assert found.code == 0, found.err
    check_truth(found.json["parameters"], offset_s=0.0)
    document["image"][0]["index"] = 10_000
    missing = calibrate(aerodft, flown.folder, document=document)
    assert missing.code == 3
    assert 'image "IMG_0": index: got 10000, expected 0 to ' in missing.err


def test_the_sample_finds_what_it_says(aerodft, tmp_path):
    found = aerodft("calibrate", SAMPLE, "--camera", DEMO, "--unknowns", ASKED, "-o", tmp_path / "b.toml", "--json")
    assert found.code == 0, found.err
    truth = {"height_bias_m": -0.9, "tilt_bias_deg": 1.1, "roll_bias_deg": -0.4, "heading_bias_deg": 2.2,
             "east_bias_m": 1.3, "north_bias_m": -0.8, "time_offset_s": 0.24}  # fmt: skip
    for key, value in truth.items():
        said = found.json["parameters"][key]
        assert abs(said["value"] - value) < 3 * said["std"], key


def test_a_hovering_drone_is_told_that_time_cannot_be_known(aerodft, tmp_path):
    document = tomllib.loads(SAMPLE.read_text())
    for image in document["image"]:
        del image["velocity_mps"], image["rates_dps"]
    path = tmp_path / "hover.toml"
    path.write_text(tomli_w.dumps(document))
    out = tmp_path / "b.toml"
    found = aerodft("calibrate", path, "--camera", DEMO, "--unknowns", "height,tilt,time", "-o", out, "--json")
    assert found.code == 4
    assert "time cannot be told: take images while the camera moves or turns" in found.err
    assert found.json["status"] == "ILL_CONDITIONED"
    assert not out.exists()


def without_pose(document):
    document["image"][1] = {"name": document["image"][1]["name"]}


def without_place(document):
    del document["image"][0]["position_m"]


def same_name(document):
    document["image"][1]["name"] = document["image"][0]["name"]


def unknown_image(document):
    document["landmark"][0]["image"] = "IMG_9"


def no_image(document):
    del document["landmark"][0]["image"]


def stamp_and_pose(document):
    document["image"][0]["utc"] = "2026-11-21T01:57:26Z"


def stamp_without_log(document):
    document["image"][0] = {"name": document["image"][0]["name"], "utc": "2026-11-21T01:57:26Z"}


def nothing_seen(document):
    document["image"].append({"name": "IMG_5", "height_agl_m": 40.0, "tilt_deg": 30.0})


def camera_height(document):
    document["camera"] = {"height_agl_m": 40.0}


def wrong_size(document):
    document["image"][0] |= {"width_px": 4000, "height_px": 3000}


def two_sizes(document):
    wrong_size(document)
    document["image"][1] |= {"width_px": 1920, "height_px": 1080}


def live_link(document):
    document["telemetry"]["connection"] = "udpin:127.0.0.1:14550"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (without_pose, "image[1].height_agl_m: got nothing"),
        (without_place, "no position_m, or lat_deg and lon_deg"),
        (same_name, 'image[1].name: got "DJI_0041.jpg", which image[0] has'),
        (unknown_image, 'landmark[0].image: got "IMG_9", expected one of DJI_0041.jpg'),
        (no_image, "landmark[0].image: got nothing, expected one of DJI_0041.jpg"),
        (stamp_and_pose, "beside utc, expected a pose, or one stamp"),
        (stamp_without_log, 'no pose, expected telemetry = "flight.tlog"'),
        (nothing_seen, 'image[4]: got no observation in it, expected an observation with image = "IMG_5"'),
        (camera_height, "camera.height_agl_m: it stands beside [[image]]"),
        (wrong_size, "image: got 4000 x 3000 pixels, expected 1920 x 1080"),
        (two_sizes, "got 4000 x 3000 and 1920 x 1080 pixels, expected images of one size"),
        (live_link, "telemetry.connection: it stands beside [[image]]"),
    ],
)
def test_bad_files_are_named(aerodft, tmp_path, change, words):
    document = tomllib.loads(SAMPLE.read_text())
    change(document)
    path = tmp_path / "images.toml"
    path.write_text(tomli_w.dumps(document))
    found = aerodft("calibrate", path, "--camera", DEMO, "--unknowns", "height", "-o", tmp_path / "b.toml")
    assert found.code == 3, found.err
    assert words in found.err
    assert not (tmp_path / "b.toml").exists()


def late(document):
    document["image"][0]["utc"] = "2026-11-22T00:00:00Z"


def nowhere(document):
    del document["telemetry"]["origin"]


def index_in_log(document):
    document["image"][0] = {"name": "IMG_0", "index": 3}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (late, 'image "IMG_0" is outside the telemetry: got 2026-11-22T00:00:00Z, expected 2026-'),
        (nowhere, 'telemetry.origin: got nothing, expected { lat_deg, lon_deg } of the zero of crs = "local"'),
        (index_in_log, 'image "IMG_0": index: got a log'),
    ],
)
def test_stamps_that_no_log_has_are_named(aerodft, flight, change, words):
    document = evidence(flight)
    change(document)
    found = calibrate(aerodft, flight, document=document, names="height")
    assert found.code == 3, found.err
    assert words in found.err


def test_telemetry_without_images_is_refused(aerodft, flight):
    bridge = REPOSITORY / "configs/calibration/bridge-landmarks.toml"
    found = aerodft("calibrate", bridge, "--camera", DEMO, "--telemetry", flight / "flight.tlog")
    assert found.code == 2
    assert "--telemetry: got a file without [[image]]" in found.err


def test_unknowns_that_images_do_not_have_are_named(aerodft):
    found = aerodft("calibrate", SAMPLE, "--camera", DEMO, "--unknowns", "height,k9")
    assert found.code == 2
    assert "--unknowns: got k9" in found.err
