"""Reprojections against OpenCV's, derivatives against finite differences."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from aerodft.geometry import camera_attitude, from_rotation_vector, matrix, multiply, reproject
from aerodft.model import Camera, CameraStd, LensModel

BROWN = Camera(
    name="brown", width_px=1920, height_px=1080, fx_px=1500.0, fy_px=1480.0, cx_px=970.0, cy_px=530.0,
    distortion=(-0.1, 0.02, 1e-3, -1e-3, 0.005), std=CameraStd(distortion=(0.01,) * 5),
)  # fmt: skip
RATIONAL = replace(
    BROWN, distortion=(0.3, -0.1, 1e-3, -1e-3, 0.02, 0.35, -0.08, 0.01), std=CameraStd(distortion=(0.01,) * 8)
)
FISHEYE = replace(
    BROWN, lens=LensModel.FISHEYE, distortion=(0.05, -0.01, 0.004, -0.001), std=CameraStd(distortion=(0.01,) * 4)
)
LENSES = {"brown": BROWN, "rational": RATIONAL, "fisheye": FISHEYE}
POSITION = np.array([3.0, -2.0, 40.0])
scenes = {
    "tilt": st.floats(0, 1.3),
    "roll": st.floats(-1, 1),
    "heading": st.floats(0, 6.2),
    "seen": st.tuples(st.floats(-0.5, 0.5), st.floats(-0.3, 0.3), st.floats(5, 200)),
}


def placed(tilt, roll, heading, seen):
    wxyz = camera_attitude(tilt, roll, heading)
    x, y, far = seen
    return wxyz, POSITION + matrix(wxyz) @ np.array([x * far, y * far, far])


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
@given(**scenes)
@settings(max_examples=60, deadline=None)
def test_pixels_are_opencvs(lens, tilt, roll, heading, seen):
    wxyz, point = placed(tilt, roll, heading, seen)
    cam_r_enu = matrix(wxyz).T
    rotation, away = Rotation.from_matrix(cam_r_enu).as_rotvec(), -cam_r_enu @ POSITION
    intrinsics = np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1.0]])
    project = cv2.fisheye.projectPoints if lens.lens is LensModel.FISHEYE else cv2.projectPoints
    theirs, *_ = project(point.reshape(1, 1, 3), rotation, away, intrinsics, np.array(lens.distortion))
    found = reproject(lens, POSITION, matrix(wxyz), point)
    assume(not np.isnan(found.pixels_px[0]))
    assert_allclose(found.pixels_px, theirs.reshape(2), atol=1e-6)


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
@given(**scenes)
@settings(max_examples=40, deadline=None)
def test_derivatives_are_finite_differences(lens, tilt, roll, heading, seen):
    wxyz, point = placed(tilt, roll, heading, seen)
    step = 1e-6
    found = reproject(lens, POSITION, matrix(wxyz), point)
    assume(not np.isnan(found.pixels_px[0]))

    def pixels(move=(0, 0, 0), turn=(0, 0, 0), bend=None):
        camera = lens
        if bend is not None:
            fx, fy, cx, cy, *coefficients = (
                np.array([lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.distortion]) + bend
            )
            camera = replace(lens, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, distortion=tuple(coefficients))
        turned = matrix(multiply(wxyz, from_rotation_vector(np.array(turn, dtype=float))))
        return reproject(camera, POSITION, turned, point + np.array(move)).pixels_px

    for name, jac in (("move", found.jac_point), ("turn", found.jac_rotation), ("bend", found.jac_intrinsics)):
        for column in range(jac.shape[-1]):
            shift = step * np.eye(jac.shape[-1])[column]
            want = (pixels(**{name: shift}) - pixels(**{name: -shift})) / (2 * step)
            assert_allclose(jac[:, column], want, rtol=1e-5, atol=1e-3, err_msg=f"{name} {column}")


def test_behind_the_camera_there_is_no_pixel():
    wxyz = camera_attitude(0.0, 0.0, 0.0)
    found = reproject(BROWN, POSITION, matrix(wxyz), POSITION + [[0, 0, 5.0], [0, 0, -5.0]])
    assert np.isnan(found.pixels_px[0]).all()
    assert_allclose(found.pixels_px[1], [BROWN.cx_px, BROWN.cy_px])
