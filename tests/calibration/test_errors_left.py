"""What a calibration leaves: against OpenCV, closed forms, and fits from which an observation was really taken away."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.model import EvidenceSet, ProjectionModel
from calibration.pose import Problem, Unknowns, ground_error_m, rms_px
from calibration.pose.result import leave_one_out_steps, observation_residuals
from calibration.pose.solve import solve
from tests.truth.calibration_sets import TASKS, Task, drawn, landmarks, ranges, solved
from tests.truth.scenes import opencv_pixels, opencv_rays

from .evidence_kinds import scene

POSE = ("east", "north", "height", "tilt", "roll", "heading")
KINDS = {
    "a pose from landmarks": TASKS["a pose from landmarks"],
    "three unknowns from landmarks": Task(("height", "tilt", "heading"), landmarks(6, 9)),
    "a lens from landmarks": TASKS["a lens from landmarks"],
    "a pose from some of everything": TASKS["a pose from some of everything"],
    "a laser rangefinder": TASKS["a laser rangefinder"],
    "points from the foot": TASKS["points from the foot"],
    "lines and horizon": TASKS["lines and horizon"],
}


def problem_of(known, names):
    return Problem(known, Unknowns(names), ProjectionModel.PINHOLE)


@pytest.mark.parametrize("task", KINDS.values(), ids=KINDS)
def test_leave_one_out_is_a_fit_without_the_observation(task):
    """One step of Newton's misses the refit by the square of a small distance: stds of a hundredth of a pixel."""
    world, known = drawn(task, np.random.default_rng(8), std_px=(0.01,), std_share=(1e-5,))
    tight = {name: replace(prior, std=1e-4) for name, prior in known.priors.items()}
    known = replace(known, priors={name: replace(p, value=world.truth[name]) for name, p in tight.items()})
    problem = problem_of(known, task.unknowns)
    solution = descended(problem, world)
    steps, left = leave_one_out_steps(solution), observation_residuals(problem, solution)
    stds = np.sqrt(np.diag(solution.covariance))
    for index, evidence in enumerate(known.evidence):
        others = replace(known, evidence=known.evidence[:index] + known.evidence[index + 1 :])
        refit = descended(problem_of(others, task.unknowns), world).state
        moved = problem.unknowns.moved(solution.state, steps[index])
        off = [moved.value(name) - refit.value(name) for name in task.unknowns]
        assert_allclose(off / stds, 0.0, atol=0.02, err_msg=evidence.name)
        want = ground_error_m(refit, evidence)
        assert left[index].loo_ground_m == (None if want is None else pytest.approx(want, rel=0.02, abs=1e-6))


def descended(problem, world):
    solution = solve(problem, world.state(), guess_is_good=True)
    assert np.all(solution.kept)
    return solution


def test_what_is_left_of_landmarks_is_their_distance_in_the_image_and_on_the_ground():
    task = TASKS["a pose from landmarks"]
    world, known = drawn(task, np.random.default_rng(2), std_px=(1.0,), std_share=(0.0,))
    solution, _ = solved(task, world, known)
    left = observation_residuals(problem_of(known, POSE), solution)
    eye_m, axes = solution.state.position_m, solution.state.rotation
    for each, landmark in zip(left, known.evidence, strict=True):
        seen = opencv_pixels(world.camera, axes, eye_m, np.array([landmark.position_m]))[0]
        ray = axes @ opencv_rays(world.camera, [landmark.pixel])[0]
        met = eye_m + ray * (landmark.position_m[2] - eye_m[2]) / ray[2]
        assert each.name == landmark.name
        assert_allclose(each.px, math.dist(seen, landmark.pixel), atol=1e-6)
        assert_allclose(each.sigma, each.px / landmark.std_px, rtol=1e-12)
        assert_allclose(each.ground_m, math.dist(met, landmark.position_m), atol=1e-5)
    assert_allclose(rms_px(known.evidence, left), math.sqrt(np.mean([each.px**2 for each in left])), rtol=1e-12)


def test_an_outlier_has_not_been_seen_by_the_fit():
    task = Task(("height", "tilt", "heading"), landmarks(8, 8))
    world, known = drawn(task, np.random.default_rng(3), std_px=(0.5,), std_share=(0.0,))
    off = replace(known.evidence[3], pixel=(known.evidence[3].pixel[0] + 40.0, known.evidence[3].pixel[1]))
    known = replace(known, evidence=(*known.evidence[:3], off, *known.evidence[4:]))
    solution, _ = solved(task, world, known)
    left = observation_residuals(problem_of(known, task.unknowns), solution)
    assert [each.name for each in left if each.is_outlier] == [off.name]
    assert left[3].loo_ground_m == left[3].ground_m
    assert_allclose(left[3].px, 40.0, atol=4.0)
    assert_allclose(rms_px(known.evidence, left), math.sqrt(np.mean([e.px**2 for e in left if not e.is_outlier])))


def test_what_nothing_else_tells_cannot_be_left_out():
    """Two ranges for two unknowns: either alone tells one."""
    task = Task(("height", "tilt"), ranges(2, 2))
    world, known = drawn(task, np.random.default_rng(4), std_px=(1.0,), std_share=(0.0,))
    solution = solve(problem_of(known, task.unknowns), world.state(), guess_is_good=True)
    left = observation_residuals(problem_of(known, task.unknowns), solution)
    assert [each.loo_ground_m for each in left] == [None, None]
    assert_allclose([each.ground_m for each in left], 0.0, atol=1e-6)
    assert rms_px(known.evidence, left) is None


@pytest.mark.parametrize(
    "kind", ["range", "ground", "landmark", "landmark of unknown east", "landmark of unknown north"]
)
def test_nothing_is_left_on_the_ground_of_the_truth(kind):
    world, evidence = scene(kind, "brown", np.random.default_rng(5))
    assert_allclose(ground_error_m(world.state(), evidence), 0.0, atol=1e-4)


def test_errors_on_the_ground_by_closed_forms():
    world, range_ = scene("range", "straight", np.random.default_rng(6))
    assert_allclose(ground_error_m(world.state(), replace(range_, range_m=range_.range_m - 0.7)), 0.7, rtol=1e-9)
    world, ground = scene("ground", "straight", np.random.default_rng(7))
    off = replace(ground, xy_m=(ground.xy_m[0] + 3.0, ground.xy_m[1] - 4.0))
    assert_allclose(ground_error_m(world.state(), off), 5.0, rtol=1e-9)
    world, landmark = scene("landmark of unknown north", "straight", np.random.default_rng(8))
    east, north, up = landmark.position_m
    assert_allclose(
        ground_error_m(world.state(), replace(landmark, position_m=(east - 2.0, north, up))), 2.0, rtol=1e-9
    )


@pytest.mark.parametrize("kind", ["landmark of unknown height", "length", "height", "vertical", "parallel", "horizon"])
def test_what_has_no_place_has_no_error_on_the_ground(kind):
    world, evidence = scene(kind, "brown", np.random.default_rng(5))
    assert ground_error_m(world.state(), evidence) is None


def test_above_the_horizon_nothing_is_left_on_the_ground():
    world, evidence = scene("landmark", "brown", np.random.default_rng(5))
    upwards = replace(world, tilt_rad=math.radians(150.0)).state()
    assert ground_error_m(upwards, evidence) is None
    problem = problem_of(EvidenceSet(evidence=(evidence,) * 3), ("height", "tilt"))
    solution = replace(solve(problem, world.state(), guess_is_good=True), state=upwards)
    assert [each.ground_m for each in observation_residuals(problem, solution)] == [None] * 3
