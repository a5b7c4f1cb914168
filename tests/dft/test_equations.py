"""The paper's equations against closed forms written out here."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft import equations as eq

TILT = st.floats(0.0, math.pi)
VFOV = st.floats(0.01, 3.0)


@given(tilt=TILT, vfov=VFOV)
def test_equation_1_is_a_bound_and_an_angle(tilt, vfov):
    excess = float(eq.horizon_excess(tilt, vfov))
    assert_allclose(excess, tilt - (math.pi / 2 - vfov / 2), atol=1e-12)
    assert bool(eq.tilt_is_valid(tilt, vfov)) == (excess < 0)
    assert (eq.tilt_warning(tilt, vfov) is None) == (excess < 0)


def test_equation_1_says_by_how_much():
    canon = math.radians(45.3)
    assert eq.tilt_warning(math.radians(67.0), canon) is None
    said = eq.tilt_warning(math.radians(70.0), canon)
    assert "tilt 70.00 deg" in said
    assert "2.65 deg past the horizon" in said
    assert "a tilt below 67.35 deg" in said


def test_equations_2_and_3_at_centre_corner_and_border():
    assert_allclose(eq.rotation_angle(np.array([0.0, 320.0, 640.0]), 640, 0.8), [-0.4, 0.0, 0.4])
    assert_allclose(eq.vertical_angle(np.array([0.0, 240.0, 480.0]), 1.0, 480, 0.6), [1.3, 1.0, 0.7])


@pytest.mark.parametrize("shape", [(), (1,), (5, 3)])
def test_equations_4_to_6_are_a_right_angled_triangle(shape):
    psi, phi = np.full(shape, math.atan(4 / 3)), np.full(shape, math.atan(0.5))
    ahead = eq.ground_ahead(3.0, psi)
    right = eq.ground_right(ahead, phi)
    for found, want in ((ahead, 4.0), (right, 2.0), (eq.depth(3.0, ahead, right), math.sqrt(9 + 16 + 4))):
        assert_allclose(found, np.full(shape, want))
    assert_allclose(eq.ground_point(3.0, psi, phi), np.broadcast_to([2.0, 4.0], (*shape, 2)))


@pytest.mark.parametrize("psi", [math.pi / 2, -math.pi / 2, 1.7])
def test_at_and_above_the_horizon_there_is_no_ground(psi):
    assert np.isnan(eq.ground_ahead(10.0, psi))
    assert np.isnan(eq.ground_point(10.0, psi, 0.1)).all()


@given(camera=st.floats(1, 100), share=st.floats(0.01, 0.95), ahead=st.floats(0.5, 200))
def test_equation_8_finds_the_height_that_casts_its_top_there(camera, share, ahead):
    """The ray over an object's top meets the ground where similar triangles say."""
    height = share * camera
    top_ahead = ahead * camera / (camera - height)
    assert_allclose(eq.object_height(camera, ahead, top_ahead), height, rtol=1e-9)
