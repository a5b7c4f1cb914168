"""The joint adjustment against OpenCV's calibrations and Jacobians, and its covariance against Monte-Carlo."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from aerodft.geometry import pixels_from_rays, rays_from_pixels
from aerodft.model import LensModel
from calibration.lens import BoardView, LensChoice, intrinsics_of, parse_board, ray_std_px, solve_lens
from calibration.lens.adjustment import Bundle, Corners, adjust, camera_guess, covariance, residuals_px, with_intrinsics

from .board_pictures import STOP, TrueCamera

SIZE = (960, 540)
NOISE_PX = 0.1
BOARD = parse_board("chessboard:9x6:25mm")
POINTS = BOARD.points_m(np.arange(54))
BROWN = TrueCamera(*SIZE, (800.0, 795.0), (490.0, 262.0), (-0.25, 0.08, 0.001, -0.0008))
WITH_K3 = TrueCamera(*SIZE, (800.0, 795.0), (490.0, 262.0), (-0.25, 0.08, 0.001, -0.0008, -0.05))
RATIONAL = TrueCamera(*SIZE, (800.0, 795.0), (490.0, 262.0), (0.4, -0.3, 0.001, -0.0008, 0.1, 0.6, -0.1, 0.05))
FISHEYE = TrueCamera(*SIZE, (400.0, 398.0), (490.0, 262.0), (0.05, -0.02, 0.01, -0.004), fisheye=True)


def scene(camera, count=12, seed=0, turn_rad=0.6):
    """Rotation matrices, moves, and exact views with all corners that the image holds."""
    rng = np.random.default_rng(seed)
    rotations, moves, views = [], [], []
    while len(views) < count:
        rotvec = rng.uniform(-turn_rad, turn_rad, 3)
        rotation = Rotation.from_rotvec(rotvec).as_matrix()
        depth = rng.uniform(0.25, 0.6) * camera.focal[0] / 800
        side = rng.uniform([-0.15, -0.1], [0.15, 0.1])
        move = np.array([*side, depth]) - rotation @ POINTS.mean(axis=0)
        pixels = camera.project(POINTS, rotvec, move)
        inside = np.all((pixels >= 0) & (pixels <= np.array(SIZE) - 1), axis=1)
        if np.count_nonzero(inside) >= 20:
            ids = np.flatnonzero(inside)
            views.append(BoardView(name=f"v{len(views)}", ids=ids, pixels_px=pixels[ids], points_m=POINTS[ids]))
            rotations.append(rotation)
            moves.append(move)
    return np.array(rotations), np.array(moves), views


def noisy(views, rng, std_px=NOISE_PX):
    return [
        BoardView(
            name=v.name, ids=v.ids, pixels_px=v.pixels_px + rng.normal(0, std_px, (len(v.ids), 2)), points_m=v.points_m
        )
        for v in views
    ]


def true_bundle(camera, rotations, moves):
    lens = LensModel.FISHEYE if camera.fisheye else LensModel.BROWN
    guess = camera_guess(lens, SIZE, 500.0, len(camera.distortion))
    return Bundle(with_intrinsics(guess, camera.parameters), rotations, moves)


def opencv(views, flags):
    points = [view.points_m.astype(np.float32) for view in views]
    pixels = [view.pixels_px.astype(np.float32) for view in views]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-14)
    found = cv2.calibrateCameraExtended(points, pixels, SIZE, None, None, flags=flags, criteria=stop)
    matrix, distortion, stds = found[1], found[2].ravel(), found[5].ravel()
    return np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion]), stds


@pytest.mark.parametrize("camera", [BROWN, WITH_K3], ids=["four", "k3"])
def test_brown_lenses_and_their_stds_are_opencvs(camera):
    views = noisy(scene(camera)[2], np.random.default_rng(1))
    found = solve_lens(views, SIZE).camera
    count = 4 + len(camera.distortion)
    assert len(found.distortion) == len(camera.distortion)
    want, stds = opencv(views, cv2.CALIB_FIX_K3 if count == 8 else 0)
    own = np.sqrt(np.diag(found.covariance))
    assert_allclose(own, stds[:count], rtol=0.02)
    assert np.all(np.abs(intrinsics_of(found) - want[:count]) < 0.01 * own)


@pytest.mark.parametrize("seed", range(4))
def test_the_rational_lens_bends_as_the_true_one(seed):
    """Its coefficients are hardly told apart; what they do to pixels is, and the focal length is known as OpenCV's."""
    views = noisy(scene(RATIONAL, count=16)[2], np.random.default_rng(seed))
    found = solve_lens(views, SIZE, LensChoice.RATIONAL)
    _, stds = opencv(views, cv2.CALIB_RATIONAL_MODEL)
    off = (intrinsics_of(found.camera) - RATIONAL.parameters)[:4]
    own = np.sqrt(np.diag(found.camera.covariance))[:4]
    assert np.all(np.abs(off) < 4 * own)
    assert np.all(own < 2 * stds[:4])
    seen = np.concatenate([view.pixels_px for view in views])
    matrix, distortion = RATIONAL.matrix, np.array(RATIONAL.distortion)
    flat = cv2.undistortPoints(seen[:, None], matrix, distortion, criteria=STOP)[:, 0]
    rays = np.concatenate([flat, np.ones((len(flat), 1))], axis=1)
    turned = Rotation.align_vectors(rays_from_pixels(found.camera, seen), rays)[0].apply(rays)
    again = pixels_from_rays(found.camera, turned)
    known = ray_std_px(found.camera, np.array(found.camera.covariance), seen)
    assert np.sqrt(np.mean(np.sum((again - seen) ** 2, axis=1))) < 3 * np.sqrt(np.mean(known**2)) < 0.8


def test_fisheye_lenses_are_opencvs():
    views = noisy(scene(FISHEYE)[2], np.random.default_rng(3))
    found = solve_lens(views, SIZE, LensChoice.FISHEYE).camera
    points = [view.points_m[None] for view in views]
    pixels = [view.pixels_px[None] for view in views]
    flags = cv2.fisheye.CALIB_FIX_SKEW if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2.CALIB_FIX_SKEW
    flags |= cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_USE_INTRINSIC_GUESS
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-12)
    _, matrix, distortion, _, _ = cv2.fisheye.calibrate(
        points, pixels, SIZE, FISHEYE.matrix.copy(), np.zeros((4, 1)), flags=flags, criteria=stop
    )
    want = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion.ravel()])
    assert np.all(np.abs(intrinsics_of(found) - want) < 0.05 * np.sqrt(np.diag(found.covariance)))


def dense_covariance(camera, bundle, views):
    """From OpenCV's own Jacobians: everything at once, the poses' rows and columns dropped at the end."""
    count, blocks = 4 + len(camera.distortion), []
    matrix = np.array(
        [[bundle.camera.fx_px, 0, bundle.camera.cx_px], [0, bundle.camera.fy_px, bundle.camera.cy_px], [0, 0, 1.0]]
    )
    squares = 0.0
    for index, view in enumerate(views):
        turn = cv2.Rodrigues(bundle.rotations[index])[0]
        args = (turn, bundle.translations_m[index], matrix, np.array(bundle.camera.distortion))
        if camera.fisheye:
            pixels, jac = cv2.fisheye.projectPoints(view.points_m[:, None], *args)
            own, pose = jac[:, :8], jac[:, 8:14]
        else:
            pixels, jac = cv2.projectPoints(view.points_m, *args)
            own, pose = jac[:, 6 : 6 + count], jac[:, :6]
        squares += float(np.sum((pixels.reshape(-1, 2) - view.pixels_px) ** 2))
        block = np.zeros((len(own), count + 6 * len(views)))
        block[:, :count], block[:, count + 6 * index : count + 6 * index + 6] = own, pose
        blocks.append(block)
    rows = np.vstack(blocks)
    scale = np.linalg.norm(rows, axis=0)
    inverse = np.linalg.inv((rows / scale).T @ (rows / scale)) / np.outer(scale, scale)
    return squares / (rows.shape[0] - rows.shape[1]) * inverse[:count, :count]


@pytest.mark.parametrize("camera", [BROWN, WITH_K3, FISHEYE], ids=["four", "k3", "fisheye"])
def test_the_whole_covariance_is_that_of_opencvs_jacobians(camera):
    rotations, moves, exact = scene(camera)
    views = noisy(exact, np.random.default_rng(4))
    corners = Corners.from_views(views)
    bundle = adjust(true_bundle(camera, rotations, moves), corners)
    cov, _ = covariance(bundle, corners)
    want = dense_covariance(camera, bundle, views)
    stds = np.sqrt(np.diag(want))
    assert_allclose(cov / np.outer(stds, stds), want / np.outer(stds, stds), atol=2e-5)


@pytest.mark.nightly
@pytest.mark.parametrize("camera", [BROWN, WITH_K3, FISHEYE], ids=["four", "k3", "fisheye"])
def test_over_300_calibrations_stds_and_correlations_are_what_they_say(camera):
    """Standard deviations of 300 scores are themselves known to 4 %."""
    rotations, moves, exact = scene(camera, count=8, seed=5)
    start = true_bundle(camera, rotations, moves)
    rng = np.random.default_rng(6)
    scores, distances, noise = [], [], []
    for _ in range(300):
        corners = Corners.from_views(noisy(exact, rng))
        found = adjust(start, corners)
        cov, std_px = covariance(found, corners)
        off = intrinsics_of(found.camera) - camera.parameters
        scores.append(off / np.sqrt(np.diag(cov)))
        distances.append(off @ np.linalg.solve(cov, off))
        noise.append(std_px)
    spread = np.std(scores, axis=0)
    assert np.all((spread > 0.9) & (spread < 1.1)), spread
    assert np.all(np.abs(np.mean(scores, axis=0)) < 0.2)
    assert_allclose(np.mean(distances), len(camera.parameters), rtol=0.08)
    assert_allclose(np.mean(noise), NOISE_PX, rtol=0.01)


@pytest.mark.parametrize(
    ("camera", "lens"), [(BROWN, LensChoice.BROWN), (FISHEYE, LensChoice.FISHEYE)], ids=["brown", "fisheye"]
)
def test_from_nothing_the_same_minimum_is_found_as_from_the_truth(camera, lens):
    for seed in range(12):
        rotations, moves, exact = scene(camera, count=8, seed=100 + seed)
        views = noisy(exact, np.random.default_rng(seed))
        corners = Corners.from_views(views)
        from_truth = adjust(true_bundle(camera, rotations, moves), corners)
        found = solve_lens(views, SIZE, lens)
        if found.rejected or found.strays or len(found.camera.distortion) != 4:
            continue  # another problem was solved, as it may be
        stds = np.sqrt(np.diag(found.camera.covariance))
        off = np.abs(intrinsics_of(found.camera) - intrinsics_of(from_truth.camera))
        assert np.all(off < 1e-3 * stds), f"seed {seed}: {off / stds}"


def test_a_telephoto_and_a_very_wide_lens_need_no_first_guess():
    for focal, lens, fisheye in ((6000.0, LensChoice.BROWN, False), (290.0, LensChoice.FISHEYE, True)):
        camera = TrueCamera(*SIZE, (focal, focal), (479.5, 269.5), (0.0, 0.0, 0.0, 0.0), fisheye=fisheye)
        views = noisy(scene(camera, count=14, seed=7, turn_rad=0.8)[2], np.random.default_rng(8), std_px=0.02)
        found = solve_lens(views, SIZE, lens).camera
        assert abs(found.fx_px - focal) < 4 * np.sqrt(found.covariance[0][0])


def test_residuals_are_projected_less_seen():
    rotations, moves, exact = scene(BROWN, count=4)
    shifted = [
        BoardView(name=v.name, ids=v.ids, pixels_px=v.pixels_px + [1.0, -2.0], points_m=v.points_m) for v in exact
    ]
    off = residuals_px(true_bundle(BROWN, rotations, moves), Corners.from_views(shifted))
    assert_allclose(off, np.broadcast_to([-1.0, 2.0], off.shape), atol=1e-8)
