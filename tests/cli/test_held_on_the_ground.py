"""Fixed pixels of a watched camera in a simulated yard that is bumped: each number is of its place on the ground."""

import math
from dataclasses import replace

import numpy as np
import orjson
import pytest
import tomli_w

from aerodft.adapters.config.camera import camera_document
from aerodft.geometry import camera_pose, from_rotation_vector, inverse, matrix, multiply, pixels_from_rays
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.scenario import EPOCH_NS, default_camera
from aerodft.sim.video import write_video
from aerodft.sim.yard import YARD
from replay.recordings import Recording

HEIGHT_M, TILT_DEG, FPS, BUMPED, LENGTH = 5.0, 68.0, 2, 6, 14
STD = {"height_m": 0.02, "tilt_deg": 0.1, "pan_deg": 0.1, "roll_deg": 0.1, "heading_deg": 0.5}
NEAR, FAR, EDGE = (-3.0, 9.0, 0.0), (2.5, 11.5, 0.0), (6.35, 9.0, 0.0)
"""Surveyed places, metres east, north, up; the last one is in the image until the bump only."""

CAMERA = replace(default_camera(960, 540), distortion=(-0.12, 0.03, 0.0005, -0.0004))
BEFORE = camera_pose(height_agl_m=HEIGHT_M, tilt_rad=math.radians(TILT_DEG))


def bumped(turn_deg, shift_m):
    """The pose after a turn about the camera's own axes, the lens carried along."""
    turn = from_rotation_vector(np.radians(turn_deg))
    return replace(BEFORE, wxyz=multiply(BEFORE.wxyz, turn), position_enu_m=BEFORE.position_enu_m + np.array(shift_m))


def seen(pose, place):
    return pixels_from_rays(CAMERA, (np.array(place) - pose.position_enu_m) @ matrix(inverse(pose.wxyz)).T)


AFTER = bumped((-1.5, -3.0, 2.0), (0.004, -0.003, 0.005))
PROBES = {"crossing": ("distance", (NEAR, FAR)), "far": ("range", (FAR,)), "edge": ("range", (EDGE,))}


@pytest.fixture(scope="module")
def recording(tmp_path_factory, aerodft):
    folder = tmp_path_factory.mktemp("yard")
    renderer = Renderer(CAMERA, replace(YARD, walkers=()), SensorModel(noise_std=2.0))
    step_ns = 1_000_000_000 // FPS
    images = (
        (EPOCH_NS + k * step_ns, renderer.render(BEFORE if k < BUMPED else AFTER, k / FPS)) for k in range(LENGTH)
    )
    write_video(folder / "yard.mp4", images, fps=FPS)
    document = {
        "station": {"name": "yard"},
        "camera": camera_document(CAMERA),
        "pose": {"height_agl_m": HEIGHT_M, "tilt_deg": TILT_DEG, "heading_deg": 0.0, "std": STD},
        "camera_motion": {"every_s": 0.5},
        "zenoh": {"enabled": False},
        "images": {"video": "yard.mp4", "start": "2026-11-21T10:00:00Z"},
        "probe": [
            {"name": name, "kind": kind, "pixels": [seen(BEFORE, place).tolist() for place in places], "std_px": 0.3}
            for name, (kind, places) in PROBES.items()
        ],
    }
    (folder / "station.toml").write_text(tomli_w.dumps(document))
    run = aerodft("import", "-c", folder / "station.toml", "-o", folder / "recording")
    assert run.code == 0, run.err
    assert run.err.count("camera_motion.reference") == 1  # without one, a bump before the start would not be seen
    return folder / "recording"


def measured(recording, name):
    found = [orjson.loads(each) for each in Recording(recording).measurements()]
    return [each for each in found if each["name"] == name]


@pytest.mark.parametrize("name", ["crossing", "far"])
def test_every_number_holds_the_surveyed_truth_whatever_the_camera_does(name, recording):
    kind, places = PROBES[name]
    found = measured(recording, name)
    assert [each["status"] for each in found].count("CAMERA_MOVED") == 2
    for k, each in enumerate(found):
        if each["status"] == "CAMERA_MOVED":
            continue
        pose = BEFORE if k < BUMPED else AFTER
        truth_m = math.dist(*places) if kind == "distance" else math.dist(places[0], pose.position_enu_m)
        assert each["status"] == "ok"
        assert each["ci95"][0] < truth_m < each["ci95"][1]
        assert each["value"] == pytest.approx(truth_m, rel=0.002)
        np.testing.assert_allclose(each["pixels"], [seen(pose, place) for place in places], atol=0.8)


def test_a_place_that_leaves_the_image_has_no_number(recording):
    found = measured(recording, "edge")
    assert {each["status"] for each in found[:BUMPED]} == {"ok"}
    assert {each["status"] for each in found[BUMPED + 2 :]} == {"OUT_OF_IMAGE"}
    assert "CAMERA_MOVED: turned by" in " ".join(found[-1]["reasons"])


def test_computed_anew_it_is_the_same_to_the_byte(recording, aerodft, tmp_path):
    assert aerodft("recompute", recording, "-o", tmp_path / "again").code == 0
    assert list(Recording(tmp_path / "again").measurements()) == list(Recording(recording).measurements())
