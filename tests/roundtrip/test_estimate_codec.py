"""Estimates of a live calibration survive their codec, and are what their published schema says."""

import math
from dataclasses import fields

import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from aerodft.adapters.wire.payload import DEGREES_RTOL
from aerodft.adapters.wire.schemas import SCHEMAS
from aerodft.adapters.wire.status import CALIBRATION_SCHEMA, encode_estimate
from aerodft.model import BiasValues, CalibrationEstimate, HeightSource, Innovation
from aerodft.service import HEIGHT_SOURCES
from tests.payloads import decode_estimate

real = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12)
angle = st.floats(-math.pi, math.pi)
values = st.builds(
    BiasValues,
    height_m=real,
    east_m=real,
    north_m=real,
    tilt_rad=angle,
    pan_rad=angle,
    roll_rad=angle,
    heading_rad=angle,
    time_s=real,
)
pair = st.none() | st.tuples(real, real)
innovations = st.builds(
    Innovation,
    name=st.text(max_size=8),
    px=pair,
    sigma_px=pair,
    chi2=st.none() | real,
    reason=st.none() | st.text(max_size=8),
)
estimates = st.builds(
    CalibrationEstimate,
    stamp_ns=st.integers(0, 2**63 - 1),
    calibration=st.none() | st.text(max_size=8),
    height_source=st.none() | st.sampled_from([*HEIGHT_SOURCES, HeightSource.CALIBRATION]),
    bias=values,
    std=values,
    innovations=st.lists(innovations, max_size=3).map(tuple),
    updates=st.integers(0, 10**9),
    refused=st.integers(0, 10**9),
    restarts=st.integers(0, 10**9),
)


@given(estimates)
def test_an_estimate_comes_back(value: CalibrationEstimate) -> None:
    payload = encode_estimate(value)
    Draft202012Validator(SCHEMAS[CALIBRATION_SCHEMA]).validate(orjson.loads(payload))
    got = decode_estimate(payload)
    for field in fields(CalibrationEstimate):
        if field.name not in {"bias", "std"}:
            assert getattr(got, field.name) == getattr(value, field.name), field.name
    for part in ("bias", "std"):
        for field in fields(BiasValues):
            one, other = (getattr(getattr(each, part), field.name) for each in (got, value))
            assert one == pytest.approx(other, rel=DEGREES_RTOL, abs=1e-300), (part, field.name)


def test_whether_a_landmark_was_used_is_on_the_wire() -> None:
    seen = (Innovation(name="a", px=(1.0, 2.0)), Innovation(name="b", reason="it was not there"))
    payload = encode_estimate(CalibrationEstimate(stamp_ns=1, calibration=None, innovations=seen))
    got = orjson.loads(payload)["innovations"]
    assert [(each["name"], each["accepted"], each["reason"]) for each in got] == [
        ("a", True, None),
        ("b", False, "it was not there"),
    ]
