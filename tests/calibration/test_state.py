"""A camera as a calibration moves it: every step against differences of what it changes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.geometry import camera_angles, inverse, multiply, to_rotation_vector
from aerodft.model import Camera
from calibration.pose import BOUNDS, State, Unknowns, coefficient_names, expand_groups

from .evidence_kinds import LENSES, central, turned

POSE = ("east", "north", "height", "tilt", "roll", "heading")
ANGLES = st.tuples(st.floats(0.05, 3.0), st.floats(-3.1, 3.1), st.floats(0.0, 6.2))
STEP = 1e-6


def state_of(lens="brown", angles_rad=(0.9, 0.2, 4.0)):
    model, distortion = LENSES[lens]
    camera = Camera(
        name="c", width_px=1920, height_px=1080, fx_px=1500.0, fy_px=1450.0, cx_px=950.0, cy_px=545.0, lens=model,
        distortion=distortion,
    )  # fmt: skip
    return State.from_angles(camera, np.array([3.0, -4.0, 25.0]), angles_rad, 1.5)


def errors_between(state, moved):
    """What ``dft.projection`` calls the shared errors."""
    one, other = state.camera, moved.camera
    lens = [(b.fx_px, b.fy_px, b.cx_px, b.cy_px, *b.distortion) for b in (one, other)]
    turn = to_rotation_vector(multiply(inverse(state.wxyz), moved.wxyz))
    place = moved.position_m - state.position_m
    return np.array([*place, *turn, moved.elevation_m - state.elevation_m, *np.subtract(lens[1], lens[0])])


def all_names(state, angles=("tilt", "roll", "heading")):
    return ("east", "north", "height", *angles, "elevation", "fx", "fy", "cx", "cy", *coefficient_names(state.camera))


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("angles", [("tilt", "roll", "heading"), ("tilt",), ("roll", "heading"), ("heading",), ()])
@settings(max_examples=5, deadline=None)
@given(angles_rad=ANGLES)
def test_a_small_step_makes_the_errors_that_it_says(lens, angles, angles_rad):
    state = state_of(lens, angles_rad)
    unknowns = Unknowns(all_names(state, angles))
    sizes = np.full(len(unknowns.names), STEP)
    got = central(lambda step: errors_between(state, unknowns.moved(state, step)), len(sizes), sizes)
    assert_allclose(got, unknowns.jac_unknowns(state), atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(angles_rad=ANGLES)
def test_free_turns_are_said_as_angles(angles_rad):
    state, unknowns = state_of(angles_rad=angles_rad), Unknowns(POSE)

    def values(step):
        moved = unknowns.moved(state, step)
        change = [moved.value(name) - state.value(name) for name in POSE]
        return np.array([*change[:4], turned(change[4]), turned(change[5])])

    got, want = unknowns.to_angles(state), central(values, 6, np.full(6, STEP))
    assert_allclose(got, want, atol=1e-6 * np.max(np.abs(want)) + 1e-7)


@settings(max_examples=10, deadline=None)
@given(angles_rad=ANGLES, step=st.floats(-0.04, 0.04))
def test_an_angle_that_is_not_asked_for_stays(angles_rad, step):
    state, unknowns = state_of(angles_rad=angles_rad), Unknowns(("tilt", "height"))
    moved = unknowns.moved(state, np.array([step, 2.0]))
    changes = np.subtract(moved.angles_rad, angles_rad)
    assert_allclose([turned(change) for change in changes.tolist()], [step, 0.0, 0.0], atol=1e-9)
    assert moved.value("height") == 27.0


def test_at_nadir_a_turn_about_the_axis_is_heading():
    state, unknowns = state_of(angles_rad=(0.0, 0.0, 1.0)), Unknowns(POSE)
    moved = unknowns.moved(state, np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.0]))
    assert_allclose([float(angle) for angle in camera_angles(moved.wxyz)], [0.0, 0.0, 1.1], atol=1e-12)
    step = unknowns.to_angles(state) @ [0.0, 0.0, 0.0, 0.0, 0.1, 0.0]
    assert_allclose(step[3:], [0.0, 0.0, 0.1], atol=1e-12)


def test_past_nadir_a_camera_of_known_heading_does_not_go():
    state = state_of(angles_rad=(0.01, 0.0, 1.0))
    with pytest.raises(ValueError, match="past nadir"):
        Unknowns(("tilt",)).moved(state, np.array([-0.02]))
    free = Unknowns(POSE).moved(state, np.array([0.0, 0.0, 0.0, -0.02, 0.0, 0.0]))
    assert_allclose(free.value("tilt"), 0.01, atol=1e-12)
    assert_allclose(free.value("heading"), 1.0 + math.pi, atol=1e-12)


def test_fx_and_fy_keep_their_ratio_where_the_focal_length_is_asked_for():
    state = state_of()
    moved = Unknowns(("focal",)).moved(state, np.array([30.0]))
    assert moved.camera.fx_px == 1530.0
    assert_allclose(moved.camera.fy_px / moved.camera.fx_px, 1450 / 1500, rtol=1e-12)
    assert moved.value("focal") == moved.value("fx") == 1530.0


def test_no_camera_below_the_ground_or_of_impossible_focal_length():
    state = state_of()
    assert all(holds(state) for holds in BOUNDS.values())
    assert not BOUNDS["height"](replace(state, elevation_m=25.0))
    assert not BOUNDS["focal"](replace(state, camera=replace(state.camera, fx_px=90.0)))
    with pytest.raises(ValueError, match="above 0"):
        Unknowns(("focal",)).moved(state, np.array([-1501.0]))


@pytest.mark.parametrize("lens", LENSES)
def test_every_unknown_has_its_value(lens):
    state = state_of(lens)
    camera = state.camera
    want = [3.0, -4.0, 25.0, 0.9, 0.2, 4.0, 1.5, 1500.0, 1450.0, 950.0, 545.0, *camera.distortion]
    assert_allclose([state.value(name) for name in all_names(state)], want, rtol=1e-12)


def test_groups_are_taken_apart():
    assert expand_groups(("height", "position", "principal_point")) == ("height", "east", "north", "cx", "cy")
