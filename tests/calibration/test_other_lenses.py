"""Pose and coefficients of lenses that are neither Brown's nor fisheyes, from landmarks seen through closed forms."""

import math

import cv2
import numpy as np
import pytest
import tomli_w

import aerodft as ad
from aerodft.errors import InputError
from tests.truth.scenes import camera_axes

FOCAL_PX, CENTRE = 1200.0, (959.5, 539.5)
TILT, ROLL, HEADING, HEIGHT_M = 0.9, 0.02, 0.5, 20.0
TRUE = {"division": (-0.3,), "omnidirectional": (0.8, -0.1, 0.02, 0.0, 0.0)}


def pixels_of(lens, rays):
    if lens == "division":
        (k1,), (x, y, z) = TRUE[lens], rays.T
        flat = x * x + y * y
        scale = 2 / (z + np.sqrt(z * z - 4 * k1 * flat))
        return FOCAL_PX * scale[:, None] * rays[:, :2] + CENTRE
    xi, *brown = TRUE[lens]
    k = np.array([[FOCAL_PX, 0.0, CENTRE[0]], [0.0, FOCAL_PX, CENTRE[1]], [0.0, 0.0, 1.0]])
    return cv2.omnidir.projectPoints(rays[None], np.zeros(3), np.zeros(3), k, xi, np.array(brown))[0][0]


def evidence_of(tmp_path, lens, stated, rng, noise_px=0.3):
    """Camera file and evidence of 40 landmarks that this lens shows within the image."""
    keys = {"name": "c", "width_px": 1920, "height_px": 1080, "fx_px": FOCAL_PX, "fy_px": FOCAL_PX}
    camera = keys | {"cx_px": CENTRE[0], "cy_px": CENTRE[1], "lens": lens, "distortion": list(stated)}
    (tmp_path / "camera.toml").write_text(tomli_w.dumps(camera))
    points = np.column_stack([rng.uniform(-60, 80, (3000, 2)), rng.uniform(0, 4, 3000)])
    rays = (points - [0.0, 0.0, HEIGHT_M]) @ camera_axes(TILT, ROLL, HEADING)
    points, rays = points[rays[:, 2] > 1.0], rays[rays[:, 2] > 1.0]
    pixels = pixels_of(lens, rays)
    inside = np.flatnonzero(np.all((pixels > 20) & (pixels < [1900, 1060]), axis=-1))[:40]
    seen = pixels[inside] + noise_px * rng.standard_normal((len(inside), 2))
    marks = [
        {"name": f"m{row}", "position_m": point, "pixel": pixel, "std_m": 0.01, "std_px": noise_px}
        for row, (point, pixel) in enumerate(zip(points[inside].tolist(), seen.tolist(), strict=True))
    ]
    (tmp_path / "evidence.toml").write_text(tomli_w.dumps({"crs": "local", "landmark": marks}))
    return tmp_path / "evidence.toml", tmp_path / "camera.toml"


@pytest.mark.parametrize(("lens", "name"), [("division", "k1"), ("omnidirectional", "k1")])
def test_pose_and_a_coefficient_are_found(tmp_path, lens, name):
    names = {"division": ("k1",), "omnidirectional": ("xi", "k1", "k2", "p1", "p2")}[lens]
    stated = [0.0 if each == name else value for each, value in zip(names, TRUE[lens], strict=True)]
    files = evidence_of(tmp_path, lens, stated, np.random.default_rng(1))
    found = ad.calibrate(*files, ["position", "height", "tilt", "roll", "heading", name])
    truth = {"height_agl_m": HEIGHT_M, "tilt_deg": math.degrees(TILT), name: TRUE[lens][names.index(name)]}
    for key, true in truth.items():
        assert abs(found.values[key] - true) < 3.5 * found.stds[key], key
    assert found.stds["height_agl_m"] < 0.2
    assert found.stds[name] < 0.02


def test_a_file_of_another_lens_is_named_with_the_coefficients_of_its_model(tmp_path):
    files = evidence_of(tmp_path, "division", (0.2,), np.random.default_rng(2))
    with pytest.raises(InputError) as refused:
        ad.calibrate(*files, ["position", "height", "tilt", "roll", "heading"])
    assert "not of this camera's lens" in str(refused.value)
    assert "1200 px and k1 -0.299, with which all fits" in str(refused.value)
    assert "focal,k1 to `unknowns`" in str(refused.value)
