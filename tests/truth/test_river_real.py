"""Banks of three real rivers against lines that a person drew along them, in pixels of images of 1920 x 1080.

Nobody has surveyed these widths: this says whether the banks are where they are seen, not how wide the rivers are.
"""

import cv2
import numpy as np
import pytest

from aerodft.sim import default_camera
from tests.commands import run_aerodft
from tests.nights import at_night
from tests.truth.calibration_files import write_camera
from tests.truth.test_calibration_real import DATA, POSE, calibrated, geul, juncal

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there: the real images are kept apart")

DRAWN = {
    "canuelas": (
        [(754, 0), (750, 90), (758, 195), (795, 300), (822, 420), (832, 525), (802, 585), (792, 675), (802, 780)]
        + [(795, 900), (780, 1080)],
        [(1287, 0), (1252, 105), (1268, 210), (1204, 300), (1208, 405), (1192, 525), (1200, 600), (1212, 645)]
        + [(1238, 780), (1252, 900), (1282, 1080)],
    ),
    "juncal": (
        [(0, 462), (90, 454), (195, 417), (375, 372), (570, 315), (705, 285), (840, 252), (960, 225), (1050, 180)]
        + [(1140, 154), (1245, 130), (1350, 112), (1552, 105)],
        [(1545, 225), (1538, 345), (1440, 435), (1358, 510), (1358, 645), (1395, 735), (1418, 840), (1350, 960)]
        + [(1252, 1035), (1050, 1065), (1035, 1080)],
    ),
    "geul": (
        [(0, 663), (105, 597), (228, 544), (351, 509), (456, 483), (597, 407), (702, 333), (825, 281), (983, 207)]
        + [(1123, 149), (1264, 114), (1351, 61), (1544, 26)],
        [(1773, 18), (1816, 105), (1825, 193), (1755, 316), (1737, 421), (1641, 500), (1650, 579), (1544, 684)]
        + [(1430, 720), (1422, 825), (1299, 913), (1334, 1018), (1211, 1081)],
    ),
}
NEAR = 0.06  # of the river's width in the image: what a hand and grass that hangs over the water leave open
LEAST = {"canuelas": 1.0, "juncal": 1.0, "geul": 0.97}  # shares of banks


def _canuelas(folder):
    """Seen from above; neither lens nor height are known, and pixels need neither."""
    camera = write_camera(folder / "camera.toml", default_camera(1920, 1080))
    return DATA.parent / "rivers/canuelas_0000000006.jpg", ["--camera", camera, "--height", 20, "--tilt", 0]


def _juncal(folder):
    calibrated(juncal(), folder, std_px=5.0, unknowns=f"{POSE},focal,k1,k2")
    return DATA / "juncal/juncal_0000000000.jpg", _calibration(folder)


def _geul(folder):
    calibrated(geul(), folder)
    found, image = cv2.VideoCapture(str(DATA / "geul/dk_control.mp4")).read()
    assert found
    cv2.imwrite(str(folder / "geul.png"), image)
    return folder / "geul.png", _calibration(folder)


def _calibration(folder):
    return ["--camera", folder / "camera.toml", "--calibration", folder / "out.toml"]


@pytest.mark.parametrize(
    ("name", "prepare"), [("canuelas", _canuelas), ("juncal", _juncal), *at_night(("geul", _geul))]
)
def test_banks_are_where_a_person_sees_them(name, prepare, tmp_path):
    image, options = prepare(tmp_path)
    done = run_aerodft("river", image, *options, "-o", tmp_path / "out", "--json")
    assert done.code == 0, done.err
    document = done.json
    used = [each for each in document["transects"] if each["status"] == "ok"]
    left, right = (np.array([each[side] for each in used]) for side in ("left", "right"))
    apart = np.linalg.norm(left - right, axis=-1)
    away = np.stack([_nearest(left, DRAWN[name]), _nearest(right, DRAWN[name])], axis=-1) / apart[:, None]
    share = float(np.mean(away < NEAR))
    print(
        f"\n{name}: {100 * share:.0f} % of {away.size} bank points within {100 * NEAR:.0f} % of the width of the drawn"
        f" banks, median {100 * np.median(away):.1f} %; confidence {document['confidence']:.2f}"
    )
    assert len(used) >= 10
    assert share >= LEAST[name]
    assert document["confidence"] > 0.9


def _nearest(points, lines):
    """How far each point ``(n, 2)`` is from the nearest of the lines."""
    away = []
    for line in (np.array(each, dtype=float) for each in lines):
        start, step = line[:-1], np.diff(line, axis=0)
        along = np.einsum("nkj,kj->nk", points[:, None] - start, step) / np.sum(step**2, axis=-1)
        feet = start + np.clip(along, 0, 1)[..., None] * step
        away.append(np.min(np.linalg.norm(points[:, None] - feet, axis=-1), axis=-1))
    return np.min(away, axis=0)
