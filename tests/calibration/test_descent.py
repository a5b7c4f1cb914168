"""Descents end where scipy's do, and losses cost and weigh what they say."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

from aerodft.model import EvidenceSet, ProjectionModel
from calibration.descent import Loss, Residuals, descend
from calibration.pose import ROBUST, Problem, Unknowns
from tests.truth.calibration_sets import Task, drawn, landmarks, lengths, ranges, together

OWNER = np.array([0, 0, 1, 2, 2, 2, -1])
KEPT = np.array([True, False, True])


def rows(values):
    values = np.asarray(values, dtype=np.float64)
    return Residuals(values, np.eye(len(values)), OWNER, values, np.zeros(len(values)))


@pytest.mark.parametrize("scale", [None, 3.0])
@pytest.mark.parametrize("kept", [None, KEPT])
def test_weighted_residuals_are_the_derivative_of_the_cost(scale, kept):
    values = np.array([0.5, -2.0, 7.0, 3.0, -4.0, 1.0, 2.5])
    loss, step = Loss(OWNER, scale, kept), 1e-6
    got = loss.weights(rows(values)) * values
    ups = [loss.cost(rows(values + step * row)) - loss.cost(rows(values - step * row)) for row in np.eye(7)]
    assert_allclose(got, np.array(ups) / (2 * step), atol=1e-7)


def test_costs_by_hand():
    values = [3.0, 4.0, 2.0, 0.0, 0.0, 6.0, 1.0]
    assert_allclose(Loss(OWNER).cost(rows(values)), 0.5 * (25 + 4 + 36 + 1))
    assert_allclose(Loss(OWNER, None, KEPT).cost(rows(values)), 0.5 * (25 + 36 + 1))
    cauchy = 9 * (np.log1p(25 / 9) + np.log1p(4 / 9) + np.log1p(36 / 9))
    assert_allclose(Loss(OWNER, 3.0).cost(rows(values)), 0.5 * (cauchy + 1), err_msg="an observation counts as a whole")


def near_the_truth(task, seed, std_share=0.0):
    world, known = drawn(task, np.random.default_rng(seed), std_px=(1.0,), std_share=(std_share,))
    problem = Problem(EvidenceSet(evidence=known.evidence), Unknowns(task.unknowns), ProjectionModel.PINHOLE)
    step = np.array([0.02 * world.above_m if name == "height" else 0.01 for name in task.unknowns])
    return problem, problem.unknowns.moved(world.state(), step)


MIXED = Task(("height", "tilt", "roll", "heading"), together(landmarks(6, 8), ranges(2, 3), lengths(1, 2)))


@pytest.mark.parametrize("seed", range(4))
def test_plain_descents_end_where_scipys_do(seed):
    problem, start = near_the_truth(Task(("height", "tilt", "heading"), landmarks(8, 8)), seed)

    def values(step):
        return problem.evaluate(problem.unknowns.moved(start, step)).values

    theirs = least_squares(values, np.zeros(3), x_scale=[1.0, 0.01, 0.01], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    ours = descend(problem, start)
    assert_allclose(ours.cost, theirs.cost, rtol=1e-9)
    want = problem.unknowns.moved(start, theirs.x)
    for name in problem.unknowns.names:
        assert_allclose(ours.state.value(name), want.value(name), rtol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_robust_descents_end_where_scipys_do(seed):
    """Ranges are one row each: as scipy weighs them. One is twice as long as it was."""
    problem, start = near_the_truth(Task(("height", "tilt"), ranges(8, 8)), seed)
    spoilt = [*problem.known.evidence]
    spoilt[2] = type(spoilt[2])(**{name: getattr(spoilt[2], name) for name in ("name", "pixel", "std_px", "std_m")},
                                range_m=2 * spoilt[2].range_m)  # fmt: skip
    problem = Problem(EvidenceSet(evidence=tuple(spoilt)), problem.unknowns, ProjectionModel.PINHOLE)

    def values(step):
        return problem.evaluate(problem.unknowns.moved(start, step)).values

    theirs = least_squares(values, np.zeros(2), loss="cauchy", f_scale=ROBUST, x_scale=[1.0, 0.01], xtol=1e-12)
    ours = descend(problem, start, ROBUST)
    assert_allclose(ours.cost, theirs.cost, rtol=1e-4)
    assert_allclose(ours.state.value("tilt"), problem.unknowns.moved(start, theirs.x).value("tilt"), atol=1e-4)


def test_what_is_not_kept_does_not_pull():
    problem, start = near_the_truth(MIXED, 5, std_share=0.002)
    kept = np.ones(len(problem.known.evidence), dtype=bool)
    kept[1] = False
    others = EvidenceSet(evidence=tuple(each for index, each in enumerate(problem.known.evidence) if index != 1))
    want = descend(Problem(others, problem.unknowns, ProjectionModel.PINHOLE), start)
    got = descend(problem, start, None, kept)
    assert_allclose(got.cost, want.cost, rtol=1e-9)
    assert_allclose(got.state.position_m, want.state.position_m, atol=1e-6)


def test_a_step_that_no_camera_can_take_is_not_taken():
    """From far above, ranges of a camera just above the ground: no guess on the way is below it."""
    task = Task(("height",), ranges(3, 3))
    world, known = drawn(task, np.random.default_rng(6), std_px=(0.0,), std_share=(0.0,))
    problem = Problem(known, Unknowns(("height",)), ProjectionModel.PINHOLE)
    start = problem.unknowns.moved(world.state(), np.array([300.0]))
    assert_allclose(descend(problem, start).state.value("height"), world.truth["height"], atol=1e-6)
