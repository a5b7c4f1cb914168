"""Every payload survives its codec, and every payload is what its published schema says."""

import math
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from aerodft.adapters.wire.events import (
    IMAGE_SCHEMA,
    OBSERVATION_SCHEMA,
    decode_image,
    decode_images,
    encode_image,
    encode_observation,
)
from aerodft.adapters.wire.measurement import (
    MEASUREMENT_SCHEMA,
    MEASUREMENTS_SCHEMA,
    encode_batch,
    encode_measurement,
    encode_measurements,
    split_measurements,
)
from aerodft.adapters.wire.payload import DEGREES_RTOL
from aerodft.adapters.wire.pose import POSE_SCHEMA, decode_pose
from aerodft.adapters.wire.schemas import SCHEMAS, schema_text
from aerodft.adapters.wire.status import STATES, STATUS_SCHEMA, StationStatus, encode_status
from aerodft.dft import PROBE_KINDS
from aerodft.errors import InputError
from aerodft.geometry import camera_attitude
from aerodft.model import (
    Ellipse95,
    GeoOrigin,
    GeoPoint,
    HeightSource,
    Image,
    Measurement,
    Observation,
    Pose,
    PoseSample,
    PoseStd,
    ProbeKind,
    ProjectionModel,
    StampClock,
    Status,
)
from aerodft.service import GIMBAL_SOURCES, HEIGHT_SOURCES
from tests.batches import measurement_batch
from tests.payloads import decode_measurement, decode_observation, decode_status, encode_pose

SCHEMA_FILES = Path(__file__).parents[2] / "docs" / "schema"

real = st.floats(allow_nan=False, allow_infinity=False, width=64, min_value=-1e12, max_value=1e12)
angle = st.floats(-math.pi, math.pi)
stamp = st.integers(0, 2**63 - 1)
text = st.text(max_size=8)
pixels = st.lists(st.tuples(real, real), max_size=3).map(tuple)
point = st.tuples(real, real, real)
points = st.none() | st.lists(point, max_size=2).map(tuple)

pose_std = st.builds(
    PoseStd,
    height_agl_m=real,
    horizontal_m=real,
    tilt_rad=angle,
    pan_rad=angle,
    roll_rad=angle,
    heading_rad=angle,
    time_s=real,
)


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    def array(*shape: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        count = math.prod(shape)
        return np.array(draw(st.lists(real, min_size=count, max_size=count))).reshape(shape)

    wxyz = camera_attitude(draw(st.floats(0, math.pi)), draw(angle), draw(angle))
    return Pose(
        position_enu_m=array(3),
        wxyz=wxyz,
        cov=array(6, 6),
        velocity_enu_mps=array(3),
        rate_cam_radps=array(3),
        time_std_s=draw(real),
    )


samples = st.builds(
    PoseSample,
    stamp_ns=stamp,
    status=st.sampled_from(Status),
    reasons=st.lists(text, max_size=2).map(tuple),
    pose=st.none() | poses(),
    std=pose_std,
    origin=st.none() | st.builds(GeoOrigin, lat_rad=angle, lon_rad=angle, alt_msl_m=st.none() | real),
    lat_rad=st.none() | angle,
    lon_rad=st.none() | angle,
    alt_msl_m=st.none() | real,
    height_source=st.none() | st.sampled_from([*HEIGHT_SOURCES, HeightSource.CALIBRATION]),
    height_datum=st.none() | text,
    attitude_source=st.none() | st.sampled_from([*GIMBAL_SOURCES]),
    telemetry_age_s=st.none() | real,
    calibration=st.none() | text,
)
measurements = st.builds(
    Measurement,
    name=text,
    kind=st.sampled_from([*PROBE_KINDS, ProbeKind.TRACK]),
    status=st.sampled_from(Status),
    reasons=st.lists(text, max_size=2).map(tuple),
    stamp_ns=stamp,
    pixels=pixels,
    std_px=real,
    camera=text,
    model=st.sampled_from(ProjectionModel),
    pose=samples,
    value=st.none() | real,
    std=st.none() | real,
    ci95=st.none() | st.tuples(real, real),
    ellipse95=st.none() | st.builds(Ellipse95, semi_major_m=real, semi_minor_m=real, azimuth_rad=angle),
    ground_m=points,
    enu_m=points,
    cov_enu_m2=st.none() | st.tuples(point, point, point),
    geo=st.none()
    | st.lists(st.builds(GeoPoint, lat_rad=angle, lon_rad=angle, alt_msl_m=st.none() | real), max_size=2).map(tuple),
    range_m=st.none() | st.lists(real, max_size=2).map(tuple),
    unit=text,
    image=st.none() | st.integers(0, 2**40),
    calibration=st.none() | text,
    config=st.none() | text,
)
images = st.builds(
    Image,
    index=st.integers(0, 2**40),
    stamp_ns=stamp,
    arrival_ns=stamp,
    clock=st.sampled_from(StampClock),
    width_px=st.none() | st.integers(1, 10**5),
    height_px=st.none() | st.integers(1, 10**5),
)
observations = st.builds(
    Observation,
    name=text,
    stamp_ns=stamp,
    arrival_ns=stamp,
    pixels=pixels,
    std_px=st.none() | st.floats(0.0, 1e12),
    clock=st.sampled_from(StampClock),
    image=st.none() | st.integers(0, 2**40),
    source=text,
)


def assert_same(got: object, want: object, path: str = "") -> None:
    """Equal field by field; ``_rad`` to the tolerance of degrees, everything else exactly."""
    if is_dataclass(want):
        assert type(got) is type(want), path
        for item in fields(want):
            assert_same(getattr(got, item.name), getattr(want, item.name), f"{path}.{item.name}")
    elif isinstance(want, np.ndarray):
        np.testing.assert_array_equal(got, want, err_msg=path, strict=True)
    elif isinstance(want, tuple) and want and is_dataclass(want[0]):
        assert isinstance(got, tuple)
        for index, (one, other) in enumerate(zip(got, want, strict=True)):
            assert_same(one, other, f"{path}[{index}]")
    elif path.endswith("_rad") and want is not None:
        assert got == pytest.approx(want, rel=DEGREES_RTOL, abs=1e-300), path
    else:
        assert got == want, path


def check(name: str, payload: bytes) -> None:
    Draft202012Validator(SCHEMAS[name]).validate(orjson.loads(payload))


@given(samples)
def test_a_pose_comes_back(sample: PoseSample) -> None:
    payload = encode_pose(sample)
    check(POSE_SCHEMA, payload)
    assert_same(decode_pose(payload), sample)


@given(measurements)
def test_a_measurement_comes_back_with_the_pose_that_the_wire_shows(value: Measurement) -> None:
    payload = encode_measurement(value)
    check(MEASUREMENT_SCHEMA, payload)
    got = decode_measurement(payload)
    shown = value.pose
    assert_same(replace(got, pose=shown), value)
    assert (got.pose.height_source, got.pose.telemetry_age_s) == (shown.height_source, shown.telemetry_age_s)
    assert_same(got.pose.lat_rad, shown.lat_rad, "lat_rad")
    assert_same(got.pose.std.tilt_rad, shown.std.tilt_rad, "tilt_rad")
    assert (got.pose.pose is None) == (shown.pose is None)
    if got.pose.pose is not None and shown.pose is not None:
        assert got.pose.pose.position_enu_m[2] == shown.pose.position_enu_m[2]
        cosine = abs(float(got.pose.pose.wxyz @ shown.pose.wxyz))
        sine = math.sqrt(max(0.0, 1.0 - min(cosine, 1.0) ** 2))
        assert sine < 1e-7, "half the angle between the attitudes"


@given(images)
def test_an_image_comes_back_exactly(image: Image) -> None:
    payload = encode_image(image)
    check(IMAGE_SCHEMA, payload)
    assert_same(decode_image(payload), image)


@given(observations)
def test_an_observation_comes_back_exactly(observation: Observation) -> None:
    payload = encode_observation(observation)
    check(OBSERVATION_SCHEMA, payload)
    assert decode_observation(payload) == observation


totals = st.dictionaries(text, st.integers(0, 2**53), max_size=3)


@given(totals, totals, st.sampled_from(STATES), stamp)
def test_a_status_comes_back_exactly(
    counts: dict[str, int], rejected: dict[str, int], state: str, stamp_ns: int
) -> None:
    value = StationStatus(station="s", stamp_ns=stamp_ns, state=state, text="t", counts=counts, rejected=rejected)
    payload = encode_status(value)
    check(STATUS_SCHEMA, payload)
    assert decode_status(payload) == value


def a_measurement(**changes: Any) -> Measurement:
    value = Measurement(
        name="w",
        kind=ProbeKind.DISTANCE,
        status=Status.OK,
        reasons=(),
        stamp_ns=1795221278868833000,
        pixels=((812.0, 604.5), (1377.0, 611.0)),
        std_px=1.0,
        camera="demo",
        model=ProjectionModel.PINHOLE,
        pose=PoseSample(stamp_ns=1, status=Status.NO_TELEMETRY),
    )
    return replace(value, **changes)


def test_what_is_not_finite_is_null_and_never_nan() -> None:
    value = a_measurement(value=math.nan, std=math.inf, ci95=(-math.inf, math.inf), ground_m=((math.nan, 1.0, 0.0),))
    payload = encode_measurement(value)
    check(MEASUREMENT_SCHEMA, payload)
    got = orjson.loads(payload)
    assert (got["value"], got["std"], got["ci95"], got["ground_m"]) == (None, None, [None, None], [[None, 1.0, 0.0]])
    sample = PoseSample(
        stamp_ns=1, status=Status.OK, pose=Pose(position_enu_m=np.full(3, np.nan), wxyz=np.array([1.0, 0, 0, 0]))
    )
    payload = encode_pose(sample)
    check(POSE_SCHEMA, payload)
    assert orjson.loads(payload)["position_enu_m"] == [None, None, None]


def test_the_wire_form_is_the_one_that_the_design_shows() -> None:
    got = orjson.loads(encode_measurement(a_measurement()))
    assert " ".join(got) == (
        "schema name kind value unit std ci95 ellipse95 status reasons pixels std_px ground_m enu_m cov_enu_m2 geo"
        " range_m stamp_ns image model camera calibration config software pose"
    )
    assert " ".join(got["pose"]) == (
        "height_agl_m height_source height_datum height_age_s tilt_deg roll_deg heading_deg lat_deg lon_deg"
        " telemetry_age_s std"
    )
    assert got["stamp_ns"] == "1795221278868833000"
    assert got["status"] == "ok"


def test_a_list_of_measurements_is_one_json_list() -> None:
    payload = encode_measurements([a_measurement(name="a"), a_measurement(name="b")])
    assert [item["name"] for item in orjson.loads(payload)] == ["a", "b"]


def test_an_images_record_has_all_of_its_measurements_byte_by_byte() -> None:
    """Values of all kinds, as if one image had them."""
    values = [a_measurement(name=f"m/{k}", value=0.1 * k) for k in range(3)]
    values.append(a_measurement(name="lost", status=Status.STALE_TELEMETRY, value=None, geo=None, reasons=("old",)))
    values.append(a_measurement(name="far", std=math.inf, ci95=(0.0, math.inf), ground_m=((math.nan, -0.0, 1e-300),)))
    record = encode_batch(measurement_batch([values])).text(0)
    check(MEASUREMENTS_SCHEMA, record)
    single = list(map(encode_measurement, values))
    assert [payload for _, payload in split_measurements(record)] == single
    assert [name for name, _ in split_measurements(record)] == ["m/0", "m/1", "m/2", "lost", "far"]
    assert len(record) < 0.7 * sum(map(len, single))


@pytest.mark.parametrize("payload", [b"{}", b"[]", b'{"schema": "aerodft.measurements/1", "measurements": [{}]}'])
def test_what_is_no_images_record_is_refused(payload: bytes) -> None:
    with pytest.raises(InputError, match=r"aerodft.measurements/1"):
        split_measurements(payload)


@pytest.mark.parametrize("damage", [b'{"index": 17}', b"{}, {}", b"", b"{", b"[]"])
def test_many_images_come_back_as_one_by_one_and_a_damaged_one_is_shown(damage: bytes) -> None:
    images = [Image(index=k, stamp_ns=10**18 + k, arrival_ns=2 * k, clock=StampClock.HOST) for k in range(5)]
    data = [encode_image(image) for image in images]
    assert list(map(encode_image, decode_images(data))) == data
    assert decode_images([]) == []
    with pytest.raises(InputError) as alone:
        decode_image(damage)
    with pytest.raises(InputError) as among:
        decode_images([*data[:3], damage, data[4]])
    assert str(among.value) == str(alone.value)


@pytest.mark.parametrize("name", SCHEMAS)
def test_the_published_schema_files_are_the_ones_in_use(name: str) -> None:
    Draft202012Validator.check_schema(SCHEMAS[name])
    file_name = name.removeprefix("aerodft.").replace("/", "-") + ".json"
    assert (SCHEMA_FILES / file_name).read_bytes() == schema_text(name)
