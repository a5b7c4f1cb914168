"""A fixed camera that is bumped, as its owner meets it: a video in, widths with the right numbers before and after."""

import math
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import orjson
import pytest
import tomli_w

from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.wire.status import CAMERA_MOTION_SCHEMA
from aerodft.dft import Request, Setup
from aerodft.geometry import camera_pose
from aerodft.model import Camera, PoseSample, Probe, ProbeKind, Status
from replay.recordings import Recording
from tests.one_image import measure
from tests.payloads import decode_camera_motion

BRIDGE = Path(__file__).parents[2] / "configs/calibration/bridge.jpg"
CAMERA = Camera(name="small", width_px=960, height_px=540, fx_px=790.0, fy_px=802.0, cx_px=484.0, cy_px=262.0)
PIXELS = [[205.0, 360.0], [815.0, 352.5]]
TURN = math.radians(2.0) * np.array([0.6, -0.48, 0.64])
BUMPED, DARK, LENGTH = 8, 18, 24


def after_turn(picture, rotvec):
    """What a pinhole camera sees after ``later_SO3_earlier``: the homography of its rotation."""
    intrinsics = np.array([[CAMERA.fx_px, 0, CAMERA.cx_px], [0, CAMERA.fy_px, CAMERA.cy_px], [0, 0, 1.0]])
    homography = intrinsics @ cv2.Rodrigues(rotvec)[0] @ np.linalg.inv(intrinsics)
    size = (CAMERA.width_px, CAMERA.height_px)
    return cv2.warpPerspective(picture, homography, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    """A video of two images a second: bumped by 2 degrees after 4 s, and dark after 9 s."""
    folder, rng, picture = tmp_path_factory.mktemp("watched"), np.random.default_rng(1), cv2.imread(str(BRIDGE))
    picture = cv2.resize(picture, (CAMERA.width_px, CAMERA.height_px), interpolation=cv2.INTER_AREA)
    turned = after_turn(picture, TURN)
    with av.open(str(folder / "bridge.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=2)
        stream.width, stream.height, stream.pix_fmt = CAMERA.width_px, CAMERA.height_px, "yuv420p"
        stream.time_base, stream.options = Fraction(1, 2), {"crf": "20", "preset": "ultrafast"}
        for index in range(LENGTH):
            shown = np.zeros_like(picture) if index >= DARK else picture if index < BUMPED else turned
            lit = shown * (1 - 0.01 * index) + rng.normal(scale=2.0, size=shown.shape)
            taken = np.clip(lit, 0, 255).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(taken, format="bgr24")))
        container.mux(stream.encode())
    cv2.imwrite(str(folder / "reference.png"), picture)
    return folder


def station_file(folder, **tables):
    document = {
        "station": {"name": "bridge"},
        "camera": camera_document(CAMERA),
        "pose": {
            "height_agl_m": 7.85,
            "tilt_deg": 62.0,
            "heading_deg": 128.0,
            "std": {"height_m": 0.02, "tilt_deg": 0.05, "pan_deg": 0.05, "roll_deg": 0.05, "heading_deg": 0.0},
        },
        "zenoh": {"enabled": False},
        "camera_motion": {"every_s": 0.5, "reference": "reference.png"},
        "probe": [{"name": "crossing", "kind": "distance", "pixels": PIXELS}],
    } | tables
    path = folder / "station.toml"
    path.write_text(tomli_w.dumps({key: value for key, value in document.items() if value is not None}))
    return path


@pytest.fixture(scope="module")
def imported(watched, aerodft):
    run = aerodft(
        "import", "--video", watched / "bridge.mp4", "--video-start", "2026-11-21T10:00:00Z",
        "-c", station_file(watched), "-o", watched / "recording", "--json",
    )  # fmt: skip
    assert run.code == 0, run.err
    return run, watched / "recording"


def payloads(folder):
    return list(Recording(folder).measurements())


def truth_m():
    """Between the two places on the ground that the probe was put on, by the pose that was stated."""
    pose = camera_pose(height_agl_m=7.85, tilt_rad=math.radians(62.0), heading_rad=math.radians(128.0))
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=pose)
    probe = Probe(name="crossing", kind=ProbeKind.DISTANCE, pixels=tuple(map(tuple, PIXELS)))
    return measure(Setup(camera=CAMERA), sample, (Request(probe=probe, pixels=probe.pixels, std_px=1.0),))[0].value


def pixels_after_the_bump():
    """``(2, 2)``: where the places on the ground are seen, by the homography that the images were warped by."""
    intrinsics = np.array([[CAMERA.fx_px, 0, CAMERA.cx_px], [0, CAMERA.fy_px, CAMERA.cy_px], [0, 0, 1.0]])
    homography = intrinsics @ cv2.Rodrigues(TURN)[0] @ np.linalg.inv(intrinsics)
    return cv2.perspectiveTransform(np.array([PIXELS]), homography)[0]


def test_a_width_is_that_of_the_same_places_before_and_after_the_bump(imported):
    found = [orjson.loads(payload) for payload in payloads(imported[1])]
    for measured in found[:BUMPED]:
        assert measured["reasons"] == []
        assert measured["pixels"] == pytest.approx(np.array(PIXELS), abs=0.05)
    unknown = [index for index, measured in enumerate(found) if measured["status"] == "CAMERA_MOVED"]
    assert unknown == [BUMPED, BUMPED + 1]
    for measured in found[BUMPED + 2 :]:
        assert measured["reasons"][0].startswith("CAMERA_MOVED: turned by 2.00 deg since 2026-11-21T10:00:04Z")
        np.testing.assert_allclose(measured["pixels"], pixels_after_the_bump(), atol=0.1)
    for measured in found:
        assert measured["status"] == "CAMERA_MOVED" or measured["value"] == pytest.approx(truth_m(), abs=0.002)
    assert "no steady points were recognised" in found[-1]["reasons"][1]


def test_the_summary_says_what_happened(imported):
    run, _ = imported
    assert run.json["steadiness"]["state"] == "unchecked"
    assert run.json["steadiness"]["moved_since"] == "2026-11-21T10:00:04Z"
    assert run.json["steadiness"]["turned_deg"] == pytest.approx(2.0, abs=0.005)
    assert run.json["watch"] == {"images": LENGTH, "skipped": 0, "unreadable": 0}
    assert "turned by 2.00 deg at 2026-11-21T10:00:04Z" in run.err


def test_what_was_estimated_is_recorded(imported):
    messages = [each for each in Recording(imported[1]).messages() if each.channel.schema == CAMERA_MOTION_SCHEMA]
    estimates = [decode_camera_motion(each.data) for each in messages]
    assert len(estimates) == LENGTH
    off = [np.array(each.turn_rad) + TURN for each in estimates[BUMPED + 2 :]]
    stds = [np.array(each.std_rad) for each in estimates[BUMPED + 2 :]]
    assert np.all(np.abs(off) < 3 * np.array(stds))


def test_computed_anew_without_images_it_is_the_same_to_the_byte(imported, aerodft, tmp_path):
    again = tmp_path / "again"
    assert aerodft("recompute", imported[1], "-o", again).code == 0
    assert payloads(again) == payloads(imported[1])


PAPER = {**camera_document(CAMERA), "model": "dft"}
REFUSALS = {
    "with telemetry": ({"pose": None, "telemetry": {"height": {"order": ["home"]}}}, "camera_motion: it stands beside"),
    "in the paper's model": ({"camera": PAPER}, "camera_motion: it stands beside camera.model"),
    "under its own name": ({"probe": [{"name": "steady", "kind": "range", "observed": True}]}, "another name"),
    "without a limit": ({"camera_motion": {"limit_deg": 0.0}}, "camera_motion.limit_deg"),
    "with a line for a polygon": ({"camera_motion": {"ignore": [[[0, 0], [1, 1]]]}}, "camera_motion.ignore[0]"),
    "without its reference": ({"camera_motion": {"reference": "nowhere.png"}}, "nowhere.png: the image cannot be read"),
    "with what is no image": ({"camera_motion": {"reference": "station.toml"}}, "image cannot be decoded"),
    "with another camera's reference": ({"camera_motion": {"reference": "small.png"}}, "small.png: the image is not"),
    "with nothing to see": ({"camera_motion": {"reference": "flat.png"}}, "shows too little"),
}  # fmt: skip


@pytest.mark.parametrize(("tables", "said"), REFUSALS.values(), ids=REFUSALS)
def test_what_cannot_be_watched_is_refused_in_a_sentence(tables, said, watched, aerodft, tmp_path):
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((48, 64, 3), dtype=np.uint8))
    cv2.imwrite(str(tmp_path / "flat.png"), np.full((CAMERA.height_px, CAMERA.width_px, 3), 90, dtype=np.uint8))
    run = aerodft(
        "import", "--video", watched / "bridge.mp4", "--video-start", "2026-11-21T10:00:00Z",
        "-c", station_file(tmp_path, **tables), "-o", tmp_path / "recording",
    )  # fmt: skip
    assert run.code == 3
    assert said in run.last
    assert not (tmp_path / "recording").exists()


def test_steady_points_are_found_again_in_the_recorded_images_and_hardly_moved(aerodft, imported, tmp_path):
    """Every other image was recorded; the encoder's noise is all that moves a point."""
    run = aerodft("recompute", imported[1], "--redetect", "-o", tmp_path / "again", "--json")
    assert run.code == 0, run.err
    vision = run.json["vision"]
    assert run.json["watch"]["images"] == vision["kept"] == LENGTH // 2
    assert vision["found"] > 1000 > 5 * vision["lost"]  # fewer looks have seen fewer points restless: some are new
    assert 0 < vision["median_px"] < 0.1
    assert f"{vision['found']} points found again, {vision['lost']} lost" in run.err
    first, again = (list(map(orjson.loads, payloads(folder))) for folder in (imported[1], tmp_path / "again"))
    assert [each["stamp_ns"] for each in again] == [each["stamp_ns"] for each in first]
    for old, new in zip(first, again, strict=True):
        assert (old["value"] is None) == (new["value"] is None)
        assert old["value"] is None or abs(new["value"] - old["value"]) < 0.2 * old["std"]
