"""``aerodft calibrate --detect``: pictures and a file of markers in, a calibration file out."""

import cv2
import numpy as np
import pytest

from tests.app.test_calibrate_markers import CAMERA, MARKERS, VIEW, file_of

from ..calibration.marker_pictures import picture  # noqa: TID252 - test folders are no packages that could be named
from .conftest import run_aerodft

POSE = "position,height,tilt,roll,heading"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    (folder / "camera.toml").write_text(CAMERA)
    (folder / "markers.toml").write_text(file_of(MARKERS))
    cv2.imwrite(str(folder / "view.png"), picture(VIEW, MARKERS))
    cv2.imwrite(str(folder / "bare.png"), picture(VIEW, []))
    return folder


def detect(folder, image, *more):
    given = ("--detect", folder / "markers.toml", folder / image, "--camera", folder / "camera.toml")
    return run_aerodft("calibrate", *given, "--unknowns", POSE, *more)


def test_markers_place_the_camera_and_measure_takes_the_file(folder, tmp_path):
    written = tmp_path / "calibration.toml"
    run = detect(folder, "view.png", "--json", "-o", written, "--report", tmp_path / "report")
    assert run.code == 0, run.err
    found = run.json["parameters"]
    truth = dict(zip(("east_m", "north_m", "height_agl_m"), VIEW.place, strict=True))
    truth |= {"tilt_deg": VIEW.tilt_deg, "roll_deg": 0.0, "heading_deg": VIEW.heading_deg}
    for name, value in truth.items():
        assert abs(found[name]["value"] - value) < 3 * found[name]["std"]
    assert any("misses a marker's centre by" in note for note in run.json["notes"])
    assert (tmp_path / "report" / "annotated.jpg").is_file()
    east, north = 2.0, 9.0  # ahead and to the right of the camera's foot
    u, v = VIEW.pixels([[VIEW.place[0] + east, VIEW.place[1] + north, 0.0]])[0]
    probe = f"position {u:.4f},{v:.4f}"
    measured = run_aerodft(
        "measure", "--camera", folder / "camera.toml", "--calibration", written, "--probe", probe, "--json"
    )
    assert measured.code == 0, measured.err
    turn = np.radians(VIEW.heading_deg)
    right, ahead = east * np.cos(turn) - north * np.sin(turn), east * np.sin(turn) + north * np.cos(turn)
    np.testing.assert_allclose(measured.json[0]["ground_m"][0][:2], [right, ahead], atol=0.03)


def test_without_markers_no_file_is_written(folder, tmp_path):
    run = detect(folder, "bare.png", "-o", tmp_path / "calibration.toml")
    assert run.code == 4
    assert "no surveyed marker is seen" in run.last
    assert not (tmp_path / "calibration.toml").exists()


def test_several_files_without_markers_to_detect_are_misuse(folder):
    run = run_aerodft("calibrate", folder / "markers.toml", folder / "view.png", "--camera", folder / "camera.toml")
    assert run.code == 2
    assert "--detect" in run.last
