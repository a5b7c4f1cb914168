"""What evidence demands of a guess: nothing of the truth; elsewhere, derivatives and covariances by finite steps."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft import project
from aerodft.model import Camera, GroundPoint, KnownHeight, KnownLength, Landmark, Pose, ProjectionModel, SlantRange
from calibration.pose import State, Unknowns
from calibration.pose.residuals import Distances

from .evidence_kinds import (
    KINDS,
    LENSES,
    central,
    condition_of,
    freedoms,
    moved_by_shared,
    nearby,
    off_by,
    scene,
    shared_sizes,
    with_stds,
)

SEEDS = st.integers(0, 2**32 - 1)
ANGULAR = {"landmark of unknown east", "landmark of unknown north", "landmark of unknown height", "vertical"} | {
    "parallel", "right angle",
}  # fmt: skip
"""Conditions on planes: their unit is chosen at each guess anew, so that derivatives hold where they are met."""
TABLE_CAMERA = Camera.from_fov(
    name="paper", width_px=3888, height_px=2592, hfov_rad=math.radians(64.3), vfov_rad=math.radians(45.3)
)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("kind", KINDS)
def test_the_truth_meets_every_condition(kind, lens):
    world, evidence = scene(kind, lens, np.random.default_rng(3))
    found = condition_of(evidence)(world.state())
    stds = np.sqrt(np.diag(found.cov))
    assert_allclose(found.off / stds, 0.0, atol=2e-4, err_msg="OpenCV's rays are good to 1e-4 px")


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=3, deadline=None)
@given(seed=SEEDS)
def test_derivatives_by_everything_a_camera_is_off_by(kind, lens, seed):
    rng = np.random.default_rng(seed)
    world, evidence = scene(kind, lens, rng)
    state, condition = guess(world, kind, rng), condition_of(evidence)
    sizes, found = shared_sizes(state), condition(state)
    want = central(lambda steps: condition(moved_by_shared(state, steps)).off, len(sizes), sizes)
    assert_allclose(found.jac_shared * sizes, want * sizes, atol=1e-5 * np.max(np.abs(want * sizes)))


def guess(world, kind, rng):
    return world.state() if kind in ANGULAR else nearby(world.state(), rng)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("kind", KINDS)
def test_covariance_is_that_of_pixels_and_of_what_is_known(kind, lens):
    rng = np.random.default_rng(7)
    world, exact = scene(kind, lens, rng)
    evidence, state = with_stds(exact, world.above_m), guess(world, kind, rng)
    pixels, known = freedoms(evidence)

    def off(steps):
        return condition_of(off_by(evidence, steps[:pixels], steps[pixels:]))(state).off

    by = central(off, pixels + known, np.array([1e-2] * pixels + [1e-3] * known))
    want = by @ np.diag([evidence.std_px**2] * pixels + [1.0] * known) @ by.T
    assert_allclose(condition_of(evidence)(state).cov, want, rtol=1e-4, atol=1e-6 * np.max(want))


@pytest.mark.parametrize("kind", KINDS)
def test_whitened_errors_have_unit_covariance(kind):
    """Drawn: 600 times the same scene, seen and measured anew."""
    rng = np.random.default_rng(11)
    world, exact = scene(kind, "brown", rng)
    evidence = with_stds(exact, world.above_m)
    state, (pixels, known) = world.state(), freedoms(evidence)
    whitened = []
    for _ in range(600):
        seen = off_by(evidence, evidence.std_px * rng.normal(size=pixels), rng.normal(size=known))
        found = condition_of(seen)(state)
        whitened.append(np.linalg.solve(np.linalg.cholesky(found.cov), found.off))
    cov = np.atleast_2d(np.cov(np.array(whitened), rowvar=False))
    assert_allclose(cov, np.eye(len(cov)), atol=4 * math.sqrt(2 / 600))


PAPER_STATE = State.from_angles(TABLE_CAMERA, np.array([1.0, -2.0, 9.0]), (1.0, 0.0, 0.4), 0.0, ProjectionModel.DFT)
PAPER_EVIDENCE = {
    "range": SlantRange(name="range", pixel=(1200.0, 1500.0), range_m=20.0, std_m=0.1),
    "ground": GroundPoint(name="ground", pixel=(2500.0, 1600.0), xy_m=(4.0, 15.0), std_m=0.1),
    "length": KnownLength(name="length", pixels=((1200.0, 1500.0), (2500.0, 1700.0)), length_m=8.0, elevation_m=0.4),
    "height": KnownHeight(name="height", base=(1200.0, 1500.0), top=(1200.0, 1300.0), height_m=2.0),
    "landmark": Landmark(name="landmark", pixel=(1200.0, 1500.0), position_m=(3.0, 14.0, 0.5), std_m=(0.1, 0.2, 0.3)),
    "landmark of unknown east": Landmark(name="landmark", pixel=(1200.0, 1500.0), position_m=(None, 14.0, 0.5)),
    "landmark of unknown north": Landmark(name="landmark", pixel=(1200.0, 1500.0), position_m=(3.0, None, 0.5)),
}


def seen_on_the_ground(pixel):
    """Where the paper's equations see a pixel: a landmark there meets its condition."""
    pose = Pose(position_enu_m=PAPER_STATE.position_m, wxyz=PAPER_STATE.wxyz)
    east, north, _ = project(TABLE_CAMERA, pose, np.array(pixel), 0.0, ProjectionModel.DFT).points_enu_m.tolist()
    return Landmark(name="landmark", pixel=pixel, position_m=(east, north, None))


PAPER_EVIDENCE["landmark of unknown height"] = seen_on_the_ground((1200.0, 1500.0))


@pytest.mark.parametrize("kind", PAPER_EVIDENCE)
def test_derivatives_of_the_papers_model(kind):
    """By what it knows: place, tilt, heading, elevation and focal lengths."""
    condition, (place, turned) = condition_of(PAPER_EVIDENCE[kind]), (PAPER_STATE.position_m, (1.0, 0.0, 0.4))

    def found(steps):
        tilt, heading, elevation, fx, fy = steps[3:].tolist()
        camera = replace(TABLE_CAMERA, fx_px=TABLE_CAMERA.fx_px + fx, fy_px=TABLE_CAMERA.fy_px + fy)
        angles = (turned[0] + tilt, 0.0, turned[2] + heading)
        return condition(State.from_angles(camera, place + steps[:3], angles, elevation, ProjectionModel.DFT))

    unknowns = Unknowns(("east", "north", "height", "tilt", "heading", "elevation", "fx", "fy"))
    got = found(np.zeros(8)).jac_shared @ unknowns.jac_unknowns(PAPER_STATE)
    want = central(lambda steps: found(steps).off, 8, np.array([1e-5] * 6 + [1e-2] * 2))
    assert_allclose(got, want, atol=1e-6 * np.max(np.abs(want)))


@pytest.mark.parametrize(("tilt_deg", "missed"), [(50.0, 0), (78.0, 1), (115.0, 4)])
def test_of_many_ranges_and_lengths_each_is_what_it_is_alone(tilt_deg, missed):
    pixels = [(200.0, 500.0), (640.5, 700.25), (1100.0, 610.0), (900.0, 20.0)]
    camera = Camera.from_fov(name="c", width_px=1280, height_px=720, hfov_rad=1.05, vfov_rad=0.63)
    state = State.from_angles(camera, np.array([3.0, -2.0, 11.0]), (math.radians(tilt_deg), 0.02, 0.7), 0.4)
    ranges = [SlantRange(name="r", pixel=at, range_m=20.0 + k, std_px=0.5 + k) for k, at in enumerate(pixels)]
    lengths = [
        KnownLength(name="l", pixels=(pixels[1], at), length_m=9.0, std_m=0.02 * k, elevation_m=0.3 * k)
        for k, at in enumerate(pixels)
        if k != 1
    ]
    for together in (ranges, lengths):
        many = Distances({3 * k: each for k, each in enumerate(together)})
        alone = [condition_of(each)(state) for each in together]
        off, shared, variance = many.residuals(state)
        assert np.count_nonzero(np.isnan(off)) == min(missed, len(together))
        assert_allclose(off, [each.off[0] for each in alone], rtol=1e-12)
        seen = np.isfinite(off)
        assert_allclose(shared[seen], np.array([each.jac_shared[0] for each in alone])[seen], rtol=1e-12)
        assert_allclose(variance[seen], np.array([each.cov[0, 0] for each in alone])[seen], rtol=1e-12)
