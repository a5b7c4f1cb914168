import math
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.adapters.config.camera import FixedPose, load_calibration
from aerodft.adapters.config.station import (
    Rate,
    StationConfig,
    Stills,
    VideoFile,
    load_station,
    parse_station,
    resolved_toml,
    with_calibration,
    with_derived_settings,
)
from aerodft.adapters.config.station.station_config import ObservationSettings
from aerodft.adapters.config.tables import to_deg, to_ns, to_s
from aerodft.adapters.timestamps import iso_to_unix_ns, unix_ns_to_iso
from aerodft.model import GeoOrigin, PoseStd, Probe, ProbeKind

CONFIGS = Path(__file__).parents[2] / "configs"
SERVICES = sorted((CONFIGS / "services").glob("*.toml"))


def assert_same(got: object, want: object, where: str = "station") -> None:
    """Equal to the last bit, through values that hold arrays."""
    assert type(got) is type(want), where
    if isinstance(want, np.ndarray):
        np.testing.assert_array_equal(got, want, err_msg=where)
    elif is_dataclass(want):
        for field in fields(want):
            assert_same(getattr(got, field.name), getattr(want, field.name), f"{where}.{field.name}")
    else:
        assert got == want, where


def reread(station: StationConfig) -> StationConfig:
    return parse_station(resolved_toml(station).encode(), where="resolved", folder=Path("/nowhere"))


@pytest.mark.parametrize("path", SERVICES, ids=lambda path: path.stem)
def test_an_example_survives_its_resolved_text(path: Path) -> None:
    station = load_station(path.absolute())
    assert_same(reread(station), station)
    assert resolved_toml(reread(station)) == resolved_toml(station)


CAMERA_MOTION = """
[camera_motion]
limit_deg = 0.35
every_s = 2.5
confirm_looks = 4
lever_arm_m = 0.15
reference = "bridge.jpg"
ignore = [[[0.0, 400.5], [1919.0, 380.0], [1919.0, 700.0]], [[1, 2], [3, 4], [5, 7]]]
"""


def test_a_watched_camera_survives_its_resolved_text() -> None:
    text = (CONFIGS / "services" / "fixed-camera.toml").read_text()
    station = parse_station((text + CAMERA_MOTION).encode(), where="watched", folder=Path("/stations"))
    assert station.camera_motion is not None
    assert station.camera_motion.reference == Path("/stations/bridge.jpg")
    assert_same(reread(station), station)
    elsewhere = parse_station((text + CAMERA_MOTION).encode(), where="watched", folder=Path("/elsewhere"))
    looser = parse_station(
        (text + CAMERA_MOTION.replace("0.35", "0.4")).encode(), where="watched", folder=Path("/stations")
    )
    assert elsewhere.pipeline.config_id == station.pipeline.config_id != looser.pipeline.config_id


def test_what_the_command_line_replaces_is_in_the_text_too() -> None:
    station = load_station(CONFIGS / "services" / "river-flight.toml")
    pipeline = replace(
        station.pipeline,
        origin=GeoOrigin(lat_rad=-0.6, lon_rad=2.6, alt_msl_m=12.5),
        probes=(Probe(name="x", kind=ProbeKind.DISTANCE, pixels=((0.1, 0.2), (3.0, 4.0)), elevation_m=-0.3),),
        max_range_m=None,
        tick_ns=20_000_000,
    )
    video = VideoFile(path=Path("/data/a.mp4"), start_ns=1795221278868833123)
    station = with_derived_settings(
        replace(
            station,
            pipeline=pipeline,
            images=replace(station.images, source=video, time_offset_s=0.1),
            observations=ObservationSettings(files=(Path("/data/o.jsonl"),), topic=False, time_offset_s=-0.25),
            link=None,
        )
    )
    assert_same(reread(station).pipeline.origin, station.pipeline.origin)
    assert_same(reread(station), station)


@given(tilt_deg=st.floats(0, 180), roll_deg=st.floats(-180, 180), heading_deg=st.floats(-360, 360), std=st.floats(0, 9))
def test_a_fixed_pose_survives_to_the_last_bit(
    tilt_deg: float, roll_deg: float, heading_deg: float, std: float
) -> None:
    pose = FixedPose(
        height_agl_m=4.2,
        tilt_rad=math.radians(tilt_deg),
        roll_rad=math.radians(roll_deg),
        heading_rad=math.radians(heading_deg),
        std=PoseStd(height_agl_m=std, tilt_rad=math.radians(std), heading_rad=math.radians(std)),
        calibration="sha256:00",
    )
    station = with_derived_settings(replace(load_station(CONFIGS / "services" / "fixed-camera.toml"), fixed_pose=pose))
    assert_same(reread(station), station)


def test_the_id_follows_what_numbers_depend_on_and_nothing_else() -> None:
    station = load_station(CONFIGS / "services" / "river-flight.toml")
    own = station.pipeline.config_id
    elsewhere = replace(
        station,
        outputs={"zenoh": station.outputs["zenoh"].model_copy(update={"listen": "tcp/127.0.0.1:1"})},
        record=replace(station.record, folder=Path("/elsewhere")),
        images=replace(station.images, source=Rate(rate_hz=3)),
        link=None,
        calibration=load_calibration(CONFIGS / "sites" / "river-calibration.toml").biases,
        pipeline=replace(station.pipeline, station="other"),
    )
    assert with_derived_settings(elsewhere).pipeline.config_id == own
    whole = replace(station.pipeline, max_range_m=500)  # an int where a float is meant
    assert with_derived_settings(replace(station, pipeline=whole)).pipeline.config_id == own
    stills = Stills(folder=Path("/x"), pattern="{unix_s}")
    assert (
        with_derived_settings(replace(station, images=replace(station.images, source=stills))).pipeline.config_id == own
    )
    changed = [
        replace(station, images=replace(station.images, time_offset_s=0.1)),
        replace(station, observations=replace(station.observations, time_offset_s=0.1)),
        replace(station, pipeline=replace(station.pipeline, camera=replace(station.pipeline.camera, fx_px=1500.0))),
        replace(station, pipeline=replace(station.pipeline, probes=station.pipeline.probes[:1])),
        replace(station, pipeline=replace(station.pipeline, time_std_s=0.5)),
    ]
    ids = {with_derived_settings(each).pipeline.config_id for each in changed}
    assert len(ids | {own}) == len(changed) + 1


def test_another_calibration_of_a_fixed_camera_is_another_configuration() -> None:
    station = load_station(CONFIGS / "services" / "fixed-camera.toml")
    calibrated = with_calibration(station, CONFIGS / "sites" / "bridge-calibration.toml")
    assert calibrated.pipeline.config_id != station.pipeline.config_id
    assert_same(reread(calibrated), calibrated)


def test_biases_of_a_calibration_survive_with_their_id() -> None:
    station = load_station(CONFIGS / "services" / "river-flight.toml")
    calibrated = with_calibration(station, CONFIGS / "sites" / "river-calibration.toml")
    assert_same(reread(calibrated).calibration, calibrated.calibration)


@given(angle_deg=st.floats(-720, 720))
def test_degrees_come_back_to_the_same_radians(angle_deg: float) -> None:
    angle_rad = math.radians(angle_deg)
    assert math.radians(to_deg(angle_rad)) == angle_rad


@given(tenths=st.integers(-3600, 3600))
def test_degrees_stay_short(tenths: int) -> None:
    assert to_deg(math.radians(tenths / 10)) == tenths / 10


@given(duration_ns=st.integers(0, 10**14))
def test_nanoseconds_survive_seconds(duration_ns: int) -> None:
    assert to_ns(to_s(duration_ns)) == duration_ns


@given(stamp_ns=st.integers(0, 4 * 10**18))
def test_stamps_survive_text(stamp_ns: int) -> None:
    assert iso_to_unix_ns(unix_ns_to_iso(stamp_ns)) == stamp_ns
