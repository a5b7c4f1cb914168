"""Whole residuals at the truth: derivatives by every unknown, against differences; stds against drawn errors."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.model import EvidenceSet, Landmark, Prior, ProjectionModel
from calibration.pose import OUT_OF_SIGHT, Problem, Unknowns, coefficient_names
from tests.truth.scenes import opencv_pixels

from .evidence_kinds import KINDS, LENSES, central, nearby, off_by, scene, with_stds

SEEDS = st.integers(0, 2**32 - 1)


def problem_of(evidence, names, priors=None):
    return Problem(EvidenceSet(evidence=tuple(evidence), priors=priors or {}), Unknowns(names), ProjectionModel.PINHOLE)


def everything(state):
    lens = ("fx", "fy", "cx", "cy", *coefficient_names(state.camera))
    return ("east", "north", "height", "tilt", "roll", "heading", "elevation", *lens)


def steps_of(names, above_m):
    """Of which central differences are good to 1e-7 of the largest."""
    sizes = {"east": 1e-5 * above_m, "north": 1e-5 * above_m, "height": 1e-5 * above_m, "elevation": 1e-5 * above_m}
    sizes |= dict.fromkeys(("fx", "fy", "focal", "cx", "cy"), 1e-2)
    return np.array([sizes.get(name, 1e-5) for name in names])


def assert_derivatives(problem, state, above_m):
    names = problem.unknowns.names
    sizes = steps_of(names, above_m)
    want = central(lambda step: problem.evaluate(problem.unknowns.moved(state, step)).values, len(names), sizes) * sizes
    got = problem.evaluate(state).jac_unknowns * sizes
    assert_allclose(got, want, atol=2e-5 * np.max(np.abs(want)))


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=2, deadline=None)
@given(seed=SEEDS)
def test_derivatives_by_every_unknown(kind, lens, seed):
    world, exact = scene(kind, lens, np.random.default_rng(seed))
    evidence, state = with_stds(exact, world.above_m), world.state()
    assert_derivatives(problem_of([evidence], everything(state)), state, world.above_m)


@pytest.mark.parametrize("names", [("height", "tilt"), ("tilt", "heading", "focal"), ("roll", "east", "k1")])
@settings(max_examples=3, deadline=None)
@given(seed=SEEDS)
def test_derivatives_by_a_few_unknowns(names, seed):
    world, evidence = scene("landmark", "brown", np.random.default_rng(seed))
    state = world.state()
    assume(world.tilt_rad > 0.01)  # less may be stepped over
    assert_derivatives(problem_of([evidence], names), state, world.above_m)


@pytest.mark.parametrize("tilt_rad", [0.0, 1e-12, math.pi / 2, math.pi])
def test_derivatives_straight_down_and_elsewhere(tilt_rad):
    world, _ = scene("landmark", "brown", np.random.default_rng(4))
    looking = replace(world, tilt_rad=tilt_rad)
    points = world.position_m + [[0.9, 1.8, 9.0], [-2.7, 0.9, 13.5], [1.8, -2.2, 9.0]] @ looking.axes.T
    problem = problem_of(landmarks_at(looking, points), everything(looking.state()))
    assert_derivatives(problem, looking.state(), world.above_m)


def landmarks_at(world, points, **stds):
    """As OpenCV sees them."""
    pixels = opencv_pixels(world.camera, world.axes, world.position_m, points)
    return [
        Landmark(name=str(index), pixel=tuple(pixel), position_m=tuple(point), **stds)
        for index, (pixel, point) in enumerate(zip(pixels.tolist(), points.tolist(), strict=True))
    ]


@pytest.mark.parametrize("names", [("height", "tilt", "roll", "heading", "focal"), ("height", "heading", "elevation")])
@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_derivatives_of_priors(names, seed):
    rng = np.random.default_rng(seed)
    world, evidence = scene("ground", "brown", rng)
    state = nearby(world.state(), rng)
    problem = problem_of([evidence], names, {name: Prior(value=world.truth[name], std=0.3) for name in names})
    rows, sizes = problem.evaluate(state).owner < 0, np.full(len(names), 1e-6)
    want = central(lambda step: problem.evaluate(problem.unknowns.moved(state, step)).values[rows], len(names), sizes)
    assert_allclose(problem.evaluate(state).jac_unknowns[rows], want, atol=1e-6 * np.max(np.abs(want)))


def test_a_prior_of_an_angle_is_met_on_the_turn():
    world, evidence = scene("landmark", "straight", np.random.default_rng(1))
    state = replace(world, heading_rad=0.01).state()
    problem = problem_of([evidence], ("heading",), {"heading": Prior(value=2 * math.pi - 0.01, std=0.02)})
    assert_allclose(problem.evaluate(state).values[-1], 1.0, rtol=1e-9)


def test_whitened_landmarks_have_unit_covariance():
    """Their pixels and their places are uncertain, and next to the camera the places say more: drawn 2,000 times."""
    rng = np.random.default_rng(5)
    world, _ = scene("landmark", "brown", rng)
    points = world.position_m + [[0.5, 0.4, 6.0], [-3.0, 2.0, 12.0], [8.0, 5.0, 40.0]] @ world.axes.T
    exact, state = landmarks_at(world, points, std_px=0.7, std_m=(0.02, 0.01, 0.05)), world.state()
    drawn = []
    for _ in range(2000):
        seen = [off_by(each, 0.7 * rng.normal(size=2), rng.normal(size=3)) for each in exact]
        drawn.append(problem_of(seen, ("height", "tilt")).evaluate(state).values)
    assert_allclose(np.cov(np.array(drawn), rowvar=False), np.eye(6), atol=4 * math.sqrt(2 / 2000))


def test_residuals_are_opencvs_pixels_less_what_was_seen():
    world, _ = scene("landmark", "rational", np.random.default_rng(6))
    points = world.position_m + [[0.5, 0.4, 6.0], [-3.0, 2.0, 12.0]] @ world.axes.T
    landmarks = [
        replace(each, pixel=(each.pixel[0] - 3.0, each.pixel[1] + 1.0)) for each in landmarks_at(world, points)
    ]
    found = problem_of(landmarks, ("height", "tilt")).evaluate(world.state())
    assert_allclose(found.px.reshape(-1, 2), [[3.0, -1.0]] * 2, atol=1e-6)
    assert_allclose(found.owner, [0, 0, 1, 1])


def test_what_a_guess_does_not_see_counts_more_than_anything_it_sees():
    world, above = scene("range", "straight", np.random.default_rng(2))
    behind = replace(
        landmarks_at(world, world.position_m + [[0.0, 0.0, 5.0]] @ world.axes.T)[0],
        position_m=tuple((world.position_m - world.axes[:, 2] * 5.0).tolist()),
    )
    level = replace(world, tilt_rad=math.radians(130.0))
    for evidence, guess in ((behind, world), (above, level)):
        found = problem_of([evidence], ("height", "tilt")).evaluate(guess.state())
        assert_allclose(found.values, OUT_OF_SIGHT)
        assert_allclose(found.jac_unknowns, 0.0)
        assert np.all(np.isinf(found.px))
