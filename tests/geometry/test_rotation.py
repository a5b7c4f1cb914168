"""Rotations as mathematics, and against SciPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from aerodft.geometry import rotation

RNG = np.random.default_rng(7)
angle = st.floats(-3.1, 3.1)


def random_wxyz(*shape):
    raw = RNG.normal(size=(*shape, 4))
    return raw / np.linalg.norm(raw, axis=-1, keepdims=True)


def scipy_of(wxyz):
    return Rotation.from_quat(np.roll(wxyz, -1, axis=-1).reshape(-1, 4))


@pytest.mark.parametrize("shape", [(), (1,), (5,), (2, 3)])
def test_group(shape):
    a, b = random_wxyz(*shape), random_wxyz(*shape)
    identity = np.broadcast_to([1.0, 0, 0, 0], (*shape, 4))
    assert_allclose(rotation.multiply(a, rotation.inverse(a)), identity, atol=1e-15)
    assert_allclose(rotation.matrix(rotation.multiply(a, b)), rotation.matrix(a) @ rotation.matrix(b), atol=1e-14)
    assert_allclose(rotation.matrix(a).reshape(-1, 3, 3), scipy_of(a).as_matrix().reshape(-1, 3, 3), atol=1e-14)


def test_exponential_and_logarithm():
    vectors = np.concatenate(
        [0.9 * RNG.uniform(-1.7, 1.7, (50, 3)), np.zeros((1, 3)), 1e-300 * np.ones((1, 3)), [[1e-9, 0, 0]]]
    )
    wxyz = rotation.from_rotation_vector(vectors)
    assert_allclose(rotation.to_rotation_vector(wxyz), vectors, atol=1e-14)
    assert_allclose(scipy_of(wxyz).as_rotvec(), vectors, atol=1e-12)


def test_slerp_takes_the_shorter_way():
    a, b = random_wxyz(), random_wxyz()
    for sign in (1.0, -1.0):
        ends = rotation.slerp(a, sign * b, np.array([0.0, 1.0]))
        assert_allclose(rotation.matrix(ends[0]), rotation.matrix(a), atol=1e-14)
        assert_allclose(rotation.matrix(ends[1]), rotation.matrix(b), atol=1e-14)
    quarter = rotation.slerp(np.array([1.0, 0, 0, 0]), rotation.from_rotation_vector(np.array([0, 0, 2.0])), 0.25)
    assert_allclose(rotation.to_rotation_vector(quarter), [0, 0, 0.5], atol=1e-15)


@given(angle, st.floats(-1.5, 1.5), angle)
def test_aerospace_angles_are_scipys(yaw, pitch, roll):
    wxyz = rotation.from_yaw_pitch_roll(yaw, pitch, roll)
    assert_allclose(rotation.matrix(wxyz), Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix(), atol=1e-14)
    assert_allclose(rotation.yaw_pitch_roll(wxyz), [yaw, pitch, roll], atol=1e-9)


@given(angle)
def test_rotations_about_an_axis_are_scipys(about):
    for number, axis in enumerate("xyz"):
        found = rotation.matrix(rotation.about_axis(number, about))
        assert_allclose(found, Rotation.from_euler(axis, about).as_matrix(), atol=1e-14)


@given(st.floats(1e-6, 3.14), angle, st.floats(0, 6.28))
def test_camera_angles_invert_the_attitude(tilt, roll, heading):
    wxyz = rotation.camera_attitude(tilt, roll, heading)
    again = rotation.camera_attitude(*rotation.camera_angles(wxyz))
    assert_allclose(rotation.matrix(again), rotation.matrix(wxyz), atol=1e-9)


@given(angle, st.floats(0, 6.28))
def test_nadir_has_no_roll(roll, heading):
    tilt, found, _ = rotation.camera_angles(rotation.camera_attitude(0.0, roll, heading))
    assert (float(tilt), float(found)) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_skew_is_the_cross_product():
    a, b = RNG.normal(size=(2, 5, 3))
    assert_allclose((rotation.skew(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-15)


def test_single_ones_are_those_of_a_batch_to_the_last_bit():
    wxyz, rng = random_wxyz(200), np.random.default_rng(8)
    np.testing.assert_array_equal([rotation.matrix(one) for one in wxyz], rotation.matrix(wxyz))
    angles = np.transpose([rotation.camera_angles(one) for one in wxyz])
    np.testing.assert_array_equal(angles, rotation.camera_angles(wxyz))
    one, other = rng.standard_normal((2, 200, 3))
    found = [rotation.cross(*pair) for pair in zip(one, other, strict=True)]
    np.testing.assert_array_equal(found, np.cross(one, other))
