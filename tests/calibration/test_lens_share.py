"""A lens that is known with stds makes the pose uncertain by as much as fits with other lenses differ."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.dft import project
from aerodft.model import CameraStd, Pose, Prior, ProjectionModel
from calibration.descent import descend
from calibration.pose import Problem, calibrate
from tests.truth.calibration_sets import Task, drawn, heights, horizon, landmarks, together

POSE = ("east", "north", "height", "tilt", "roll", "heading")
PIXEL = np.array([[700.0, 800.0]])
FOCAL_PX, CENTRE_PX, BENT = 1.0, 0.8, 0.002
EVIDENCE = {
    "landmarks": landmarks(8, 8),
    "landmarks, heights and a horizon": together(landmarks(5, 5), heights(2, 2), horizon(count=2)),
}


def scene(kind):
    world, known = drawn(Task(POSE, EVIDENCE[kind], {}, (66, 72)), np.random.default_rng(5), (1.0,), (0.0,))
    distortion = (BENT, *(0.0,) * (len(world.camera.distortion) - 1))
    std = CameraStd(focal_px=FOCAL_PX, principal_point_px=CENTRE_PX, distortion=distortion)
    stated = {"elevation": Prior(value=world.elevation_m, std=0.0)}
    return world, replace(known, priors=stated), replace(world.camera, std=std)


def other_lenses(camera):
    """The camera with one error of a standard deviation each."""
    share = FOCAL_PX / camera.fx_px
    yield replace(camera, fx_px=camera.fx_px + FOCAL_PX, fy_px=camera.fy_px * (1 + share))
    yield replace(camera, cx_px=camera.cx_px + CENTRE_PX)
    yield replace(camera, cy_px=camera.cy_px + CENTRE_PX)
    yield replace(camera, distortion=(camera.distortion[0] + BENT, *camera.distortion[1:]))


def refits(known, found, camera):
    """Fits to the same evidence with each of the other lenses."""
    problem = Problem(known, found.problem.unknowns, ProjectionModel.PINHOLE)
    state = found.solution.state
    for other in other_lenses(camera):
        uncertain = replace(other, std=state.camera.std)
        yield descend(problem, replace(state, camera=uncertain), None).state


def point_m(state):
    pose = Pose(position_enu_m=state.position_m, wxyz=state.wxyz)
    return project(state.camera, pose, PIXEL, state.elevation_m, ProjectionModel.PINHOLE)


@pytest.mark.parametrize("kind", EVIDENCE)
def test_stds_are_those_of_fits_with_other_lenses(kind):
    _, known, camera = scene(kind)
    exact, found = (calibrate(known, each, POSE) for each in (replace(camera, std=CameraStd()), camera))
    assert np.all(exact.solution.kept)
    assert_allclose(found.solution.state.position_m, exact.solution.state.position_m)
    offs = [
        [state.value(name) - exact.solution.state.value(name) for name in POSE]
        for state in refits(known, exact, camera)
    ]
    want = exact.solution.covariance + np.array(offs).T @ np.array(offs)
    size = np.sqrt(np.diag(want))
    assert_allclose(found.named_covariance / np.outer(size, size), want / np.outer(size, size), atol=0.02)
    assert_allclose(found.solution.chi2, exact.solution.chi2)


def test_a_measured_points_std_knows_that_the_pose_follows_the_lens():
    """The pose makes up for most of what the lens is off by: taken apart, the two would make the std far too large."""
    _, known, camera = scene("landmarks")
    exact, found = (calibrate(known, each, POSE) for each in (replace(camera, std=CameraStd()), camera))
    ground = point_m(found.solution.state)
    by = ground.jac_shared[0, :2]
    offs = np.array(
        [(point_m(each).points_enu_m - ground.points_enu_m)[0, :2] for each in refits(known, exact, camera)]
    )
    want = by @ exact.solution.joint @ by.T + offs.T @ offs
    got = by @ found.solution.joint @ by.T
    assert_allclose(got, want, atol=0.02 * np.trace(want))
    apart = found.solution.joint.copy()
    apart[:7, 7:] = apart[7:, :7] = 0.0
    assert np.trace(by @ apart @ by.T) > 2 * np.trace(got)


def test_what_is_asked_for_or_stated_is_not_as_the_camera_file_has_it():
    world, known, camera = scene("landmarks")
    focal_only = replace(camera, std=CameraStd(focal_px=50.0))
    exact = replace(camera, std=CameraStd())
    stated = replace(known, priors=known.priors | {"focal": Prior(value=world.camera.fx_px, std=0.0)})
    for evidence, names in ((known, (*POSE, "focal")), (stated, POSE)):
        with_std, without = (calibrate(evidence, each, names).solution for each in (focal_only, exact))
        assert_allclose(with_std.joint, without.joint)
        assert_allclose(with_std.covariance, without.covariance)


def test_the_cameras_own_covariance_is_carried_on():
    _, known, camera = scene("landmarks")
    found = calibrate(known, camera, POSE).camera
    assert_allclose(np.sqrt(np.diag(found.covariance))[[0, 2, 3, 4]], [FOCAL_PX, CENTRE_PX, CENTRE_PX, BENT])
