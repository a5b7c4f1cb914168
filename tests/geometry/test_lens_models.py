"""Every lens model of the registry against OpenCV or a closed form, derivatives against central differences."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.dft import Request, Setup
from aerodft.dft.maps import GroundMap
from aerodft.geometry import (
    LENS_MODELS,
    all_coefficients,
    camera_pose,
    distorted_with_jacobian,
    matrix,
    pixels_by_intrinsics,
    pixels_from_rays,
    rays_by_intrinsics,
    rays_from_pixels,
    rays_with_jacobian,
)
from aerodft.model import Camera, CameraStd, LensModel, PoseSample, PoseStd, Probe, ProbeKind, Status
from tests.one_image import measure

BASE = Camera(
    name="c", width_px=1920, height_px=1080, fx_px=900.0, fy_px=905.0, cx_px=961.3, cy_px=538.2,
    std=CameraStd(focal_px=1.0),
)  # fmt: skip
OF_EACH = {
    "brown": [(-0.12, 0.03, 1e-3, -8e-4), (0.3, 0.05, 4e-4, -6e-4, 0.01, 0.45, 0.1, 0.02)],
    "fisheye": [(0.05, -0.01, 0.002, -0.0005)],
    "division": [(-0.25,), (0.15,)],
    "omnidirectional": [(0.7, -0.1, 0.02, 1e-3, -8e-4), (1.1, -0.2, 0.05, 5e-4, 3e-4), (0.9,)],
}
CAMERAS = [
    replace(BASE, lens=LENS_MODELS[LensModel(name)].model, distortion=distortion,
            std=CameraStd(focal_px=1.0, distortion=(0.01,) * len(distortion)))
    for name, several in OF_EACH.items() for distortion in several
]  # fmt: skip
each_camera = pytest.mark.parametrize("camera", CAMERAS, ids=lambda each: f"{each.lens}-{len(each.distortion)}")


def rays(rng, count=200, widest_deg=50.0):
    angle, turn = np.radians(rng.uniform(0.5, widest_deg, count)), rng.uniform(0, 2 * math.pi, count)
    directions = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], axis=-1)
    return directions * rng.uniform(0.3, 5.0, (count, 1))


def test_every_model_is_tested():
    assert set(OF_EACH) == set(LENS_MODELS)


@each_camera
def test_pixels_to_rays_and_back(camera):
    pixels = np.random.default_rng(1).uniform([0, 0], [1919, 1079], (500, 2))
    found = rays_from_pixels(camera, pixels)
    assert np.isfinite(found).all(axis=-1).mean() > 0.9
    seen = np.isfinite(found).all(axis=-1)
    assert_allclose(pixels_from_rays(camera, found[seen]), pixels[seen], atol=1e-7)
    assert_allclose(rays_with_jacobian(camera, pixels).rays_cam[seen], found[seen], rtol=1e-12)


@each_camera
def test_jacobians_are_central_differences(camera):
    step, some = 1e-6, rays(np.random.default_rng(2), widest_deg=40.0)
    points, jac = distorted_with_jacobian(camera, some)
    moved = [distorted_with_jacobian(camera, some + sign * step * axis)[0] for axis in np.eye(3) for sign in (1, -1)]
    numeric = np.stack([(up - down) / (2 * step) for up, down in zip(moved[::2], moved[1::2], strict=True)], axis=-1)
    assert_allclose(jac, numeric, atol=2e-8)
    pixels = points * [camera.fx_px, camera.fy_px] + [camera.cx_px, camera.cy_px]
    found = rays_with_jacobian(camera, pixels)
    moved = [rays_from_pixels(camera, pixels + sign * 1e-3 * axis) for axis in np.eye(2) for sign in (1, -1)]
    numeric = np.stack([(up - down) / 2e-3 for up, down in zip(moved[::2], moved[1::2], strict=True)], axis=-1)
    assert_allclose(found.jac_px, numeric, atol=2e-8)


@each_camera
def test_derivatives_by_intrinsics_are_central_differences(camera):
    some = rays(np.random.default_rng(3), widest_deg=40.0)
    by = pixels_by_intrinsics(camera, some, distorted_with_jacobian(camera, some)[0])
    for column, name in enumerate(("fx_px", "fy_px", "cx_px", "cy_px", *camera.lens.coefficients)):
        if column - 4 >= len(camera.distortion):
            break
        ends = []
        for step in (1e-6, -1e-6):
            values = np.array(camera.distortion)
            values[max(column - 4, 0)] += step * (column >= 4)
            change = {"distortion": tuple(values)} if column >= 4 else {name: getattr(camera, name) + step}
            ends.append(pixels_from_rays(replace(camera, **change), some))
        assert_allclose(by[..., column], (ends[0] - ends[1]) / 2e-6, atol=2e-5, err_msg=name)
    # The pixel stays where it is: a ray by an intrinsic undoes the pixel by that intrinsic.
    pixels = pixels_from_rays(camera, some)
    back = distorted_with_jacobian(camera, rays_from_pixels(camera, pixels))[1] * [[camera.fx_px], [camera.fy_px]]
    assert_allclose(back @ rays_by_intrinsics(camera, pixels), -by, atol=1e-6)


@pytest.mark.parametrize("distortion", OF_EACH["omnidirectional"])
def test_opencvs_omnidirectional_camera(distortion):
    camera = replace(BASE, lens=LENS_MODELS[LensModel("omnidirectional")].model, distortion=distortion)
    some = rays(np.random.default_rng(4), widest_deg=80.0)
    xi, *brown = all_coefficients(camera)
    k = np.array([[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]])
    expected, _ = cv2.omnidir.projectPoints(some[None], np.zeros(3), np.zeros(3), k, xi, np.array(brown))
    found = pixels_from_rays(camera, some)
    is_seen = np.isfinite(found).all(axis=-1)
    assert is_seen.mean() > 0.6
    assert_allclose(found[is_seen], expected[0][is_seen], atol=1e-8)


def test_a_mirrors_view_reaches_behind_the_camera():
    """Without distortion the model is one to one up to where the ray leaves the sphere's outline."""
    for xi, widest_deg in ((0.5, 120.0), (1.0, 180.0), (2.0, 120.0)):
        camera = replace(BASE, lens=LENS_MODELS[LensModel("omnidirectional")].model, distortion=(xi,))
        for angle_deg, is_seen in ((widest_deg - 1.0, True), (widest_deg + 1.0, False)):
            angle = math.radians(min(angle_deg, 180.0))
            ray = np.array([math.sin(angle), 0.0, math.cos(angle)])
            pixel = pixels_from_rays(camera, ray)
            assert np.isfinite(pixel).all() == is_seen, (xi, angle_deg)
            if is_seen:
                back = rays_from_pixels(camera, pixel)
                assert_allclose(back / np.linalg.norm(back), ray, atol=1e-6)


@pytest.mark.parametrize("k1", [-0.25, 0.15])
def test_the_division_model_is_its_definition(k1):
    camera = replace(BASE, lens=LENS_MODELS[LensModel("division")].model, distortion=(k1,))
    some = rays(np.random.default_rng(5), widest_deg=35.0)
    x, y = ((pixels_from_rays(camera, some) - [camera.cx_px, camera.cy_px]) / [camera.fx_px, camera.fy_px]).T
    straight = some[:, :2] / some[:, 2:]
    assert_allclose(np.stack([x, y], axis=-1) / (1 + k1 * (x * x + y * y))[:, None], straight, atol=1e-12)
    outline = np.array([[camera.cx_px + 1.001 * camera.fx_px / math.sqrt(abs(k1)), camera.cy_px]])
    assert np.isfinite(rays_from_pixels(camera, outline)).all() == (k1 < 0)


def test_division_turns_behind_the_camera_beyond_its_half_turn():
    camera = replace(BASE, lens=LENS_MODELS[LensModel("division")].model, distortion=(-0.6,))
    pixel = np.array([camera.cx_px + 1.6 * camera.fx_px, camera.cy_px])
    ray = rays_from_pixels(camera, pixel)
    assert ray[2] < 0
    assert_allclose(pixels_from_rays(camera, ray), pixel, atol=1e-9)


@each_camera
def test_ground_maps_have_the_engines_points(camera):
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.5, heading_rad=0.4)
    pixels = np.random.default_rng(6).uniform([0, 0], [1919, 1079], (300, 2))
    away = rays_from_pixels(camera, pixels) @ matrix(pose.wxyz).T
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(away[:, 2] < 0, -30.0 / away[:, 2], np.nan)
    expected = pose.position_enu_m + reach[:, None] * away
    assert_allclose(GroundMap.at(camera, pose).points_enu_m(pixels), expected, rtol=1e-9, atol=1e-9)


@each_camera
def test_intervals_hold_drawn_errors_of_tilt_and_pixels(camera):
    """95 % of distances measured with a wrong tilt and noisy pixels, in 400 draws of each lens."""
    rng, std, truth_px = np.random.default_rng(7), PoseStd(tilt_rad=0.01), np.array([[800.0, 600.0], [1150.0, 500.0]])
    pose = camera_pose(height_agl_m=30.0, tilt_rad=0.6, std=std)
    points = GroundMap.at(replace(camera, std=CameraStd()), camera_pose(height_agl_m=30.0, tilt_rad=0.6))
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=pose, std=std)
    exact = replace(camera, std=CameraStd())
    pixels = tuple(map(tuple, truth_px.tolist()))
    request = Request(probe=Probe(name="d", kind=ProbeKind.DISTANCE, pixels=pixels), pixels=pixels, std_px=1.5)
    (answer,) = measure(Setup(camera=exact), sample, (request,))
    drawn = []
    for _ in range(400):
        world = GroundMap.at(exact, camera_pose(height_agl_m=30.0, tilt_rad=0.6 + 0.01 * rng.standard_normal()))
        near, far = world.points_enu_m(truth_px + 1.5 * rng.standard_normal((2, 2)))[:, :2]
        drawn.append(math.dist(near, far))
    drawn, (near, far) = np.array(drawn), points.points_enu_m(truth_px)[:, :2]
    assert_allclose(answer.value, math.dist(near, far), rtol=1e-3)
    assert 0.92 <= np.mean((answer.ci95[0] <= drawn) & (drawn <= answer.ci95[1])) <= 0.98
