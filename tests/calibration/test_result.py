"""Whole calibrations: what is asked of what is known, and what people get."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.dft import project
from aerodft.geometry import camera_attitude
from aerodft.model import Camera, CameraMode, EvidenceSet, Horizon, LensModel, Pose, Prior, ProjectionModel, Vertical
from calibration.descent import descend
from calibration.pose import Problem, calibrate, unknowns_of
from tests.truth.calibration_scenes import World
from tests.truth.calibration_sets import DEG, TASKS, Task, drawn, landmarks, ranges, together

POSE = ("east", "north", "height", "tilt", "roll", "heading")


def seen(task, seed, **stds):
    world, known = drawn(task, np.random.default_rng(seed), **({"std_px": (0.0,), "std_share": (0.0,)} | stds))
    return world, known


@pytest.mark.parametrize("seed", range(3))
def test_a_camera_of_which_nothing_is_known_is_found(seed):
    """Not even where to start: a start of 10 m and a radian is what everybody gets."""
    world, known = seen(Task(POSE, landmarks(6, 10)), seed)
    found = calibrate(replace(known, priors={}), world.camera, ("height", "tilt", "roll", "heading", "position"))
    state = found.solution.state
    assert_allclose(state.position_m, world.position_m, atol=1e-5 * world.above_m)
    assert_allclose(state.rotation, world.axes, atol=1e-6)
    assert found.weakest.is_determined
    assert_allclose(found.rms_px, 0.0, atol=1e-4)


def test_what_is_known_exactly_stays():
    world, known = seen(Task(("height", "tilt"), ranges(4, 4)), 3)
    stated = {"heading": Prior(value=2.0, std=0.0), "roll": Prior(value=world.roll_rad, std=0.0)} | {
        "elevation": Prior(value=world.elevation_m, std=0.0),
    }  # fmt: skip
    found = calibrate(replace(known, priors=stated), world.camera, ("height", "tilt"))
    state = found.solution.state
    assert found.problem.unknowns.names == ("height", "tilt")
    assert_allclose([state.value("heading"), state.value("roll")], [2.0, world.roll_rad], atol=1e-12)
    assert_allclose(state.value("height"), world.truth["height"], rtol=1e-6)
    assert np.all(found.pose_covariance[:2] == 0.0)


def test_what_somebody_knows_with_a_std_is_solved_for_too():
    world, known = seen(Task(("height", "tilt"), ranges(4, 4)), 3)
    priors = {"roll": Prior(value=0.01, std=2 * DEG), "east": Prior(value=1.0, std=0.0)}
    found = unknowns_of(("height", "tilt"), replace(known, priors=priors), world.camera, ProjectionModel.PINHOLE)
    assert found.names == ("height", "tilt", "roll")


def test_a_height_is_said_above_the_ground():
    """The camera's and the ground's are known to 1 m each, their difference, from ranges, to centimetres."""
    task = Task((*POSE, "elevation"), together(landmarks(5, 5), ranges(4, 4)))
    world, known = seen(task, 4, std_px=(1.0,))
    found = calibrate(known, world.camera, task.unknowns)
    names, cov = found.problem.unknowns.names, found.solution.covariance
    height, ground = names.index("height"), names.index("elevation")
    want = cov[height, height] + cov[ground, ground] - 2 * cov[height, ground]
    assert_allclose(found.named_covariance[height, height], want, rtol=1e-9)
    assert_allclose(found.named_covariance[ground, ground], cov[ground, ground], rtol=1e-12)


def test_a_lens_comes_with_its_covariance_and_with_that_of_the_pose():
    """A measured point's std from the joint covariance is that of fits to evidence drawn anew: 300 times."""
    task = TASKS["a lens from landmarks"]
    world, known = seen(task, 5)
    start = {name: Prior(value=world.truth[name], std=0.0) for name in (*POSE, "elevation", "focal")}
    exact = calibrate(replace(known, priors=start), world.camera, task.unknowns)
    pixel, rng, points = np.array([[700.0, 800.0]]), np.random.default_rng(6), []
    for _ in range(300):
        noisy = tuple(replace(e, pixel=tuple((e.pixel + rng.normal(size=2)).tolist())) for e in known.evidence)
        problem = Problem(EvidenceSet(evidence=noisy), exact.problem.unknowns, ProjectionModel.PINHOLE)
        points.append(ground(descend(problem, world.state()).state, pixel, world.elevation_m).points_enu_m[0, :2])
    by = ground(exact.solution.state, pixel, world.elevation_m).jac_shared[0, :2]
    assert_allclose(exact.lens_covariance, exact.solution.joint[:6, 7:])
    assert_allclose(np.array(exact.camera.covariance), exact.solution.joint[7:, 7:])
    stds = np.sqrt(np.diag(by @ exact.solution.joint @ by.T)) / exact.solution.sigma_scale
    assert_allclose(stds, np.std(points, axis=0), rtol=4 / math.sqrt(2 * 300))


def test_a_lens_that_is_found_is_still_of_its_mode():
    """Else images of another zoom would pass beside a calibrated lens."""
    world, known = seen(TASKS["a lens from landmarks"], 4)
    mode = CameraMode(device="Canon 1000D", focal_mm=18.0)
    found = calibrate(known, replace(world.camera, mode=mode), TASKS["a lens from landmarks"].unknowns)
    assert found.camera.mode == mode


def ground(state, pixel, elevation_m):
    pose = Pose(position_enu_m=state.position_m, wxyz=state.wxyz)
    return project(state.camera, pose, pixel, elevation_m, ProjectionModel.PINHOLE)


def test_a_lens_that_nobody_asks_for_stays_exact():
    world, known = seen(Task(POSE, landmarks(6, 6)), 7, std_px=(1.0,))
    found = calibrate(known, world.camera, POSE)
    assert found.camera == world.camera
    assert found.camera.covariance == ()


@pytest.mark.parametrize(
    ("names", "model", "says"),
    [
        (("height", "pitch"), ProjectionModel.PINHOLE, "got pitch, expected some of height, tilt"),
        (("height", "k9"), ProjectionModel.PINHOLE, "got k9, expected some of"),
        (("focal", "fy"), ProjectionModel.PINHOLE, "got focal beside fx or fy"),
        (("height", "roll"), ProjectionModel.DFT, "got roll for the dft model"),
        (("height", "k1"), ProjectionModel.DFT, "got k1 for the dft model"),
        (("height", "principal_point"), ProjectionModel.DFT, "got cx for the dft model"),
    ],
)
def test_unknowns_that_there_are_not(names, model, says):
    world, known = seen(Task(("height",), ranges(3, 3)), 8)
    with pytest.raises(ValueError, match=says):
        calibrate(known, world.camera, names, model)


def test_a_roll_that_somebody_knows_is_no_unknown_of_the_papers_model():
    """Its pixels do not depend on it: a std of it would be made up."""
    world, known = seen(Task(("height", "tilt"), ranges(4, 4)), 3)
    priors = {name: Prior(value=0.01, std=2 * DEG) for name in ("roll", "tilt")}
    found = unknowns_of(("height",), replace(known, priors=priors), world.camera, ProjectionModel.DFT)
    assert found.names == ("height", "tilt")


def test_the_papers_model_has_no_verticals():
    world = World.random(np.random.default_rng(9))
    known = EvidenceSet(evidence=(Vertical(name="mast", pixels=((900.0, 100.0), (910.0, 700.0))),))
    with pytest.raises(ValueError, match="got mast for the dft model, which has no rays"):
        calibrate(known, world.camera, ("tilt",), ProjectionModel.DFT)


@pytest.mark.parametrize(("is_sea", "dip_rad"), [(False, 0.0), (True, math.sqrt(2 * 50.0 * 0.87 / 6_371_000.0))])
def test_the_papers_horizon_is_the_row_at_a_right_angle_to_straight_down(is_sea, dip_rad):
    """Eq. 3: ``psi = theta + (H/2 - j) FOV_V / H``, which is 90 degrees there, or less by the sea's dip."""
    camera = Camera.from_fov(name="paper", width_px=3888, height_px=2592, hfov_rad=64.3 * DEG, vfov_rad=45.3 * DEG)
    rows, tilt_rad = (np.array([-300.2, -299.6]), 70.0 * DEG)
    exact = camera.height_px * (0.5 - (math.pi / 2 - dip_rad - tilt_rad) / camera.vfov_rad)
    pixels = tuple((u, exact + v - rows.mean()) for u, v in zip((0.0, 3000.0), rows.tolist(), strict=True))
    known = EvidenceSet(
        evidence=(Horizon(name="sky", pixels=pixels, is_sea=is_sea, std_px=2.0),),
        priors={"height": Prior(value=50.0, std=0.0)},
    )
    found = calibrate(known, camera, ("tilt",), ProjectionModel.DFT)
    assert_allclose(found.solution.state.value("tilt"), tilt_rad, atol=1e-9)
    assert_allclose(found.left[0].px, np.ptp(rows) / math.sqrt(2), rtol=1e-6)
    std_rad = 2.0 * camera.vfov_rad / camera.height_px / math.sqrt(2)
    assert_allclose(math.sqrt(found.solution.covariance[0, 0]), std_rad * found.solution.sigma_scale, rtol=1e-6)


def test_the_papers_field_of_view_follows_from_a_horizon_and_a_tilt():
    """A wrong derivative by the focal length would stop beside it."""
    camera = Camera.from_fov(name="paper", width_px=3888, height_px=2592, hfov_rad=64.3 * DEG, vfov_rad=45.3 * DEG)
    row_px = camera.height_px * (0.5 - (math.pi / 2 - 70.0 * DEG) / camera.vfov_rad)
    known = EvidenceSet(
        evidence=(Horizon(name="sky", pixels=((100.0, row_px), (3500.0, row_px))),),
        priors={"tilt": Prior(value=70.0 * DEG, std=0.0), "focal": Prior(value=1.1 * camera.fx_px, std=0.0)},
    )
    found = calibrate(known, camera, ("focal",), ProjectionModel.DFT)
    assert_allclose(found.camera.vfov_rad, 45.3 * DEG, rtol=1e-8)


def test_a_fisheyes_coefficients_are_its_own():
    world, known = seen(Task(("height",), ranges(3, 3)), 10)
    fisheye = replace(world.camera, lens=LensModel.FISHEYE, distortion=(0.0, 0.0, 0.0, 0.0))
    assert unknowns_of(("k4",), known, fisheye, ProjectionModel.PINHOLE).names == ("k4",)
    with pytest.raises(ValueError, match="got p1"):
        unknowns_of(("p1",), known, fisheye, ProjectionModel.PINHOLE)


@pytest.mark.parametrize("heading_rad", [0.3, 2.5, 5.0])
def test_the_papers_model_finds_a_heading(heading_rad):
    """Landmarks where the paper's equations see their pixels: a wrong derivative would stop beside them."""
    world, known = seen(Task(("height",), landmarks(6, 6)), 11)
    camera = replace(world.camera, distortion=())
    pose = Pose(position_enu_m=np.array([3.0, -2.0, 12.0]), wxyz=camera_attitude(1.0, 0.0, heading_rad))
    pixels = np.array([each.pixel for each in known.evidence])
    places = project(camera, pose, pixels, 0.0, ProjectionModel.DFT).points_enu_m
    evidence = tuple(
        replace(each, position_m=tuple(place)) for each, place in zip(known.evidence, places.tolist(), strict=True)
    )
    stated = {"east": 3.0, "north": -2.0, "height": 10.0, "tilt": 0.9, "heading": heading_rad + 0.4}
    rough = {name: Prior(value=value, std=0.0) for name, value in stated.items()}
    found = calibrate(
        EvidenceSet(evidence=evidence, priors=rough), camera, ("height", "tilt", "heading"), ProjectionModel.DFT
    )
    got = [found.solution.state.value(name) for name in ("height", "tilt", "heading")]
    assert_allclose(got, [12.0, 1.0, heading_rad], atol=1e-6)
