"""What is planted is found: exactly without errors, as stated with them, however the world is turned or told."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import kstest

from aerodft.model import EvidenceSet, Prior, ProjectionModel
from calibration.pose import Problem, Unknowns
from calibration.pose.solve import solve
from tests.nights import at_night
from tests.truth.calibration_scenes import World
from tests.truth.calibration_sets import (
    DEG,
    POSE,
    TASKS,
    Task,
    drawn,
    ground,
    guess,
    heights,
    horizon,
    landmarks,
    lengths,
    lines,
    ranges,
    several,
    solved,
    together,
    verticals,
)

from .evidence_kinds import turned

LEVELS = ("tilt", "roll")
EXACT = {
    "landmarks": Task(POSE, landmarks(5, 8)),
    "three landmarks": Task(("height", "tilt", "roll"), landmarks(3, 3)),
    "landmarks of unknown height": Task(POSE, together(landmarks(4, 4), landmarks(3, 3, unknown=2))),
    "landmarks of unknown east": Task(("height", "tilt", "north"), landmarks(6, 6, unknown=0)),
    "ranges": Task(("height", "tilt"), ranges(3, 5), {"height": 0.1, "tilt": 3 * DEG}),
    "points from the foot": Task(("height", *LEVELS), ground(4, 4), {"height": 0.1, "tilt": 3 * DEG, "roll": 2 * DEG}),
    "lengths": Task(("height", "tilt"), lengths(4, 5), {"height": 0.1, "tilt": 3 * DEG}),
    "heights": Task(("height", "tilt"), heights(4, 5), {"height": 0.1, "tilt": 3 * DEG}, (40, 70)),
    "verticals": Task(LEVELS, verticals(3, 4), {"tilt": 3 * DEG, "roll": 2 * DEG}, (40, 70)),
    "parallels and right angles": Task(LEVELS, lines(2, 2), {"tilt": 3 * DEG, "roll": 2 * DEG}, (30, 70)),
    "horizon": Task(LEVELS, horizon(count=3), {"tilt": 3 * DEG, "roll": 2 * DEG}, (72, 82)),
    "the sea's horizon": Task(LEVELS, horizon(count=3, is_sea=True), {"tilt": 3 * DEG, "roll": 2 * DEG}, (72, 82)),
    "a lens": Task((*POSE, "fx", "fy", "cx", "cy", "k1", "k2"), landmarks(25, 30, most_above=0.4)),
    "water": Task((*POSE, "elevation"), together(landmarks(6, 8), ranges(3, 3))),
}


def exact(task, seed):
    """Without errors; of what is guessed, the guess alone is off: 10,000 times less certain than what is seen."""
    world, known = drawn(task, np.random.default_rng(seed), std_px=(0.0,), std_share=(0.0,))
    wide = {name: replace(prior, std=1e4 * prior.std) for name, prior in known.priors.items()}
    return world, replace(known, priors=wide)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("task", EXACT.values(), ids=EXACT)
def test_without_errors_the_truth_is_found(task, seed):
    world, known = exact(task, seed)
    solution, errors = solved(task, world, known)
    sizes = {"east": world.above_m, "north": world.above_m, "height": world.above_m, "elevation": world.above_m}
    sizes |= {name: world.truth[name] for name in ("fx", "fy", "cx", "cy")}
    assert np.all(solution.kept)
    for name, error in errors.items():
        assert abs(error) <= 1e-6 * sizes.get(name, 1.0), name


def poses(known, start, names=POSE, *, is_good=False):
    problem = Problem(known, Unknowns(names), ProjectionModel.PINHOLE)
    return solve(problem, start, guess_is_good=is_good)


def values(solution, names=POSE):
    return np.array([solution.state.value(name) for name in names])


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_observations_does_not_matter(seed):
    task, rng = TASKS["a pose from some of everything"], np.random.default_rng(seed)
    world, known = drawn(task, rng)
    order = rng.permutation(len(known.evidence))
    shuffled = replace(known, evidence=tuple(known.evidence[index] for index in order))
    start = guess(world, POSE, known.priors)
    one, other = poses(known, start), poses(shuffled, start)
    stds = np.sqrt(np.diag(one.covariance))
    assert_allclose((values(one) - values(other)) / stds, 0.0, atol=1e-3)
    assert_allclose(other.covariance / np.outer(stds, stds), one.covariance / np.outer(stds, stds), atol=1e-3)
    assert_allclose(other.kept, one.kept[order])


@pytest.mark.parametrize("seed", range(3))
def test_a_world_that_is_shifted_and_turned_has_its_camera_shifted_and_turned(seed):
    """By 1.1 rad clockwise, and by kilometres; the covariance turns along."""
    rng = np.random.default_rng(seed)
    world, known = drawn(TASKS["a pose from landmarks"], rng)
    turn, shift = 1.1, np.array([3000.0, -2000.0, 40.0])
    turning = np.array([[math.cos(turn), math.sin(turn), 0], [-math.sin(turn), math.cos(turn), 0], [0, 0, 1.0]])
    moved = tuple(
        replace(each, position_m=tuple((turning @ each.position_m + shift).tolist())) for each in known.evidence
    )
    isotropic = [tuple(replace(each, std_m=(0.01,) * 3) for each in some) for some in (known.evidence, moved)]
    start = guess(world, POSE, {})
    one, other = (poses(EvidenceSet(evidence=evidence), start) for evidence in isotropic)
    by = np.eye(6)
    by[:3, :3] = turning
    stds = np.sqrt(np.diag(other.covariance))
    assert_allclose((other.state.position_m - turning @ one.state.position_m - shift) / stds[:3], 0.0, atol=1e-3)
    off = values(other)[3:] - values(one)[3:] - [0.0, 0.0, turn]
    assert_allclose([turned(angle) for angle in off.tolist()] / stds[3:], 0.0, atol=1e-3)
    assert_allclose(
        by @ one.covariance @ by.T / np.outer(stds, stds), other.covariance / np.outer(stds, stds), atol=1e-3
    )


@pytest.mark.parametrize("seed", range(3))
def test_the_first_guess_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    world, known = drawn(TASKS["a pose from landmarks"], rng)
    want = values(poses(known, world.state(), is_good=True))
    for _ in range(3):
        elsewhere = replace(
            world, position_m=rng.normal(size=3) * 50 + [0, 0, 200], tilt_rad=rng.uniform(0, 3),
            heading_rad=rng.uniform(0, 6), roll_rad=rng.uniform(-3, 3),
        ).state()  # fmt: skip
        assert_allclose(values(poses(known, elsewhere, is_good=True)), want, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("off_px", [30.0, 300.0])
def test_outliers_are_left_out_by_name(off_px):
    rng, task = np.random.default_rng(9), Task(("height", "tilt", "roll", "heading"), landmarks(12, 12))
    for _ in range(5):
        world, known = drawn(task, rng, std_px=(1.0,), std_share=(0.0,))
        evidence, wrong = list(known.evidence), rng.choice(12, 2, replace=False)
        for index in wrong:
            angle = rng.uniform(0, 2 * math.pi)
            u, v = evidence[index].pixel
            evidence[index] = replace(
                evidence[index], pixel=(u + off_px * math.cos(angle), v + off_px * math.sin(angle))
            )
        solution, errors = solved(task, world, replace(known, evidence=tuple(evidence)))
        assert_allclose(np.flatnonzero(~solution.kept), np.sort(wrong))
        stds = np.sqrt(np.diag(solution.covariance))
        assert np.all(np.abs(list(errors.values()) / stds) < 4.5)


@pytest.mark.parametrize(("scenes", "within"), [(40, 0.15), *at_night((150, 0.08))])
def test_chi_squares_are_distributed_as_such(scenes, within):
    """So are their chances: evenly, over scenes whose stds are true."""
    rng, task = np.random.default_rng(10), Task(("height", "tilt", "heading"), landmarks(6, 12))
    found = [solved(task, *drawn(task, rng))[0] for _ in range(scenes)]
    assert kstest([solution.p_value for solution in found], "uniform").pvalue > 1e-3
    assert_allclose(np.mean([solution.chi2 / solution.dof for solution in found]), 1.0, atol=within)


@pytest.mark.parametrize("stated", [0.2, 1.0, 5.0])
def test_stds_that_are_stated_too_small_are_scaled_up(stated):
    rng, task = np.random.default_rng(11), Task(("height", "tilt", "heading"), landmarks(60, 60))
    world, known = drawn(task, rng, std_px=(1.0,), std_share=(0.0,))
    said = tuple(replace(each, std_px=stated) for each in known.evidence)
    solution, _ = solved(task, world, replace(known, evidence=said))
    assert_allclose(solution.sigma_scale, max(0.7, 1 / stated), rtol=0.25)
    truth = poses(replace(known, evidence=said), world.state(), task.unknowns, is_good=True)
    own = truth.residuals.jac_unknowns
    to_angles = Unknowns(task.unknowns).to_angles(truth.state)
    want = to_angles @ np.linalg.inv(own.T @ own) @ to_angles.T * solution.sigma_scale**2
    assert_allclose(solution.covariance, want, rtol=1e-3)


def test_without_degrees_of_freedom_nothing_is_tested():
    task = Task(("height", "tilt"), ranges(2, 2), {})
    world, known = drawn(task, np.random.default_rng(12), std_px=(1.0,), std_share=(0.0,))
    solution = poses(known, world.state(), task.unknowns, is_good=True)
    assert (solution.dof, solution.p_value, solution.misfit) == (0, None, 1.0)
    assert_allclose(solution.sigma_scale, 4.303 / 1.960, rtol=1e-3)  # Student's t of the two that stated stds count for
    assert_allclose(solution.chi2, 0.0, atol=1e-9)


def test_a_prior_and_what_is_seen_are_weighed_by_their_stds():
    """Closed form: a height from one range straight down, and from a person."""
    world = replace(World.random(np.random.default_rng(13)), tilt_rad=0.0, roll_rad=0.0, elevation_m=0.0)
    camera = replace(world.camera, distortion=())
    range_ = several(World.range_, "range", 1, 1)(replace(world, camera=camera))[0]
    below = replace(range_, pixel=(camera.cx_px, camera.cy_px), range_m=20.0, std_m=0.3)
    known = EvidenceSet(evidence=(below,), priors={"height": Prior(value=21.0, std=0.4)})
    solution = poses(known, replace(world, camera=camera).state(), ("height",), is_good=True)
    assert_allclose(solution.state.value("height"), (20 / 0.09 + 21 / 0.16) / (1 / 0.09 + 1 / 0.16), rtol=1e-9)
    assert_allclose(solution.covariance / solution.sigma_scale**2, [[1 / (1 / 0.09 + 1 / 0.16)]], rtol=1e-6)


def test_what_nothing_tells_is_not_certain_at_all():
    """Ranges do not tell a heading; rounding says it to a million turns."""
    world, known = drawn(Task(("height", "tilt"), ranges(4, 4)), np.random.default_rng(14))
    solution = poses(known, world.state(), ("height", "tilt", "heading"), is_good=True)
    assert solution.covariance[2, 2] > 1e12
