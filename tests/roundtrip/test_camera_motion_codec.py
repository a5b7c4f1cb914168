"""Estimates of a watched camera's attitude survive their codec, and are what their published schema says."""

import math

import numpy as np
import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from aerodft.adapters.wire.schemas import SCHEMAS
from aerodft.adapters.wire.status import CAMERA_MOTION_SCHEMA, encode_camera_motion
from aerodft.model import CameraMotionEstimate, MotionState
from tests.payloads import decode_camera_motion

angle = st.floats(-math.pi, math.pi)
three = st.tuples(angle, angle, angle)
stamps = st.integers(0, 2**63 - 1)
estimates = st.builds(
    CameraMotionEstimate,
    stamp_ns=stamps,
    state=st.sampled_from(MotionState),
    turn_rad=three,
    std_rad=three,
    look_turn_rad=st.none() | three,
    since_ns=stamps,
    moved_ns=st.none() | stamps,
    points=st.integers(0, 1000),
    agreeing=st.integers(0, 1000),
    std_px=st.none() | st.floats(0, 10),
    calibration=st.none() | st.text(max_size=8),
)


@given(estimates)
def test_an_estimate_comes_back(value):
    payload = encode_camera_motion(value)
    Draft202012Validator(SCHEMAS[CAMERA_MOTION_SCHEMA]).validate(orjson.loads(payload))
    got = decode_camera_motion(payload)
    for name in ("stamp_ns", "state", "since_ns", "moved_ns", "points", "agreeing", "std_px", "calibration"):
        assert getattr(got, name) == getattr(value, name)
    np.testing.assert_allclose(got.turn_rad, value.turn_rad, rtol=1e-15, atol=1e-300)
    np.testing.assert_allclose(got.std_rad, value.std_rad, rtol=1e-15, atol=1e-300)
    assert (got.look_turn_rad is None) == (value.look_turn_rad is None)
    if value.look_turn_rad is not None:
        np.testing.assert_allclose(got.look_turn_rad, value.look_turn_rad, rtol=1e-15, atol=1e-300)


@pytest.mark.parametrize("state", MotionState)
def test_the_angle_is_that_of_the_turn(state):
    value = CameraMotionEstimate(stamp_ns=1, since_ns=1, state=state, turn_rad=(0.03, -0.04, 0.0))
    assert orjson.loads(encode_camera_motion(value))["angle_deg"] == pytest.approx(math.degrees(0.05))
