"""Surveyed landmarks in images of other people's: two rivers and a beach, from the command line.

Juncal is RIVeR's example (a drone's image of a river), geul OpenRiverCam's (a phone on a bank), cirn_uas the one of the
Coastal Imaging Research Network's UAS toolbox, which publishes the pose that it found from the same points.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io

from aerodft.model import Camera

from .calibration_files import aerodft, write_camera, write_landmarks

DATA = Path(__file__).parents[2].parent / "shared/data/landmarks"
POSE = "position,height,tilt,roll,heading"

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there: the surveyed images are kept apart")


@dataclass(frozen=True)
class Survey:
    """Landmarks in metres of some map, the pixels at which they are seen, and the camera."""

    camera: Camera
    points_m: np.ndarray
    pixels: np.ndarray


def juncal():
    """The image says its size; nothing is known of the lens: a field of view of 53 deg to start from."""
    points = json.loads((DATA / "juncal/full_grp_3d.json").read_text())
    height_px, width_px, _ = cv2.imread(str(DATA / "juncal/juncal_0000000000.jpg")).shape
    camera = Camera(
        name="juncal", width_px=width_px, height_px=height_px, fx_px=width_px, fy_px=width_px,
        cx_px=(width_px - 1) / 2, cy_px=(height_px - 1) / 2, distortion=(0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    return Survey(camera, np.transpose([points[key] for key in "XYZ"]), np.transpose([points[key] for key in "xy"]))


def geul():
    """Lens and points of OpenRiverCam's file."""
    config = json.loads((DATA / "geul/dk_cam_config.json").read_text())
    (fx, _, cx), (_, fy, cy), _ = config["camera_matrix"]
    camera = Camera(
        name="geul", width_px=config["width"], height_px=config["height"], fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy,
        distortion=tuple(np.ravel(config["dist_coeffs"])[:4]),
    )  # fmt: skip
    return Survey(camera, np.array(config["gcps"]["dst"]), np.array(config["gcps"]["src"], dtype=float))


def cirn():
    """Pixels and principal point both count from 1, as in MATLAB: seen from here, both are off by the same."""
    folder = DATA / "cirn_uas"
    width, height, cx, cy, fx, fy, k1, k2, k3, p1, p2 = scipy.io.loadmat(folder / "uasDemo_IO.mat")["intrinsics"][0]
    camera = Camera(
        name="cirn_uas", width_px=int(width), height_px=int(height), fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy,
        distortion=(k1, k2, p1, p2, k3),
    )  # fmt: skip
    seen = scipy.io.loadmat(folder / "uasDemo_gcpUVdInitial.mat", squeeze_me=True)["gcp"]
    surveyed = {int(row[0]): row[1:] for row in np.loadtxt(folder / "uasDemoFlight_NCSP_GCPS.txt", delimiter=",")}
    points = np.array([surveyed[int(each["num"])] for each in seen])
    return Survey(camera, points, np.array([each["UVd"] for each in seen]))


def calibrated(survey, folder, std_px=1.0, unknowns=POSE):
    """What ``calibrate`` says, beside the camera's place in the map."""
    camera = write_camera(folder / "camera.toml", survey.camera)
    landmarks = write_landmarks(folder / "landmarks.csv", survey.points_m, survey.pixels, std_px)
    answer = aerodft("calibrate", landmarks, "--camera", camera, "--unknowns", unknowns, "-o", folder / "out.toml")
    assert answer.code == 0, answer.words
    assert (folder / "out.toml").exists()
    return answer


def figures(title, answer):
    """Root mean squares of all landmarks: in the image, on the ground, and there without having seen it; printed."""
    left = answer.document["residuals"]
    px, ground_m, left_out_m = (
        math.sqrt(np.mean(np.square([each[key] for each in left if not each["outlier"]])))
        for key in ("px", "ground_m", "loo_ground_m")
    )
    print(
        f"\n{title}: {px:.3f} px rms, {ground_m:.3f} m on the ground, {left_out_m:.3f} m left out; "
        + ", ".join(f"{name} {each['value']:.6g}" for name, each in answer.document["parameters"].items())
        + f"; outliers: {answer.document['outliers'] or 'none'}"
    )
    assert px == pytest.approx(answer.document["rms_px"], rel=1e-9)
    return px, ground_m


def test_juncal_is_closer_than_river_comes(tmp_path):
    """RIVeR reports 12.5 px; std_px is that of points found by hand in such an image, so that none is left out."""
    answer = calibrated(juncal(), tmp_path, std_px=5.0, unknowns=f"{POSE},focal,k1,k2")
    px, ground_m = figures("juncal", answer)
    assert answer.document["outliers"] == []
    assert px <= 5.0
    assert ground_m <= 0.35


def test_geul_with_its_lens(tmp_path):
    answer = calibrated(geul(), tmp_path)
    px, _ = figures("geul", answer)
    assert answer.document["outliers"] == []
    assert px <= 4.3


def test_cirn_uas_is_where_its_authors_say(tmp_path):
    published = scipy.io.loadmat(DATA / "cirn_uas/uasDemo_IOEOInitial.mat")["extrinsics"][0]
    east_m, north_m, height_m, _, tilt_rad, _ = published
    answer = calibrated(cirn(), tmp_path)
    px, _ = figures(f"cirn_uas (published: height {height_m:.1f} m, tilt {math.degrees(tilt_rad):.2f} deg)", answer)
    east, north, up = answer.document["position"]
    assert answer.document["outliers"] == []
    assert px <= 1.1
    assert up == pytest.approx(height_m, abs=1.0)
    assert answer.value("tilt_deg") == pytest.approx(math.degrees(tilt_rad), abs=0.2)
    assert [east, north] == pytest.approx([east_m, north_m], abs=1.0)
