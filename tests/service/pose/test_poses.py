"""The pose at a stamp: a flight whose position, height and attitude are closed forms, and every way to have none."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pyproj import Geod
from scipy.spatial.transform import Rotation

from aerodft.geometry import camera_angles, from_yaw_pitch_roll, pose_covariance
from aerodft.model import (
    NO_BOOT_TIME,
    ClockTrack,
    GeoOrigin,
    GimbalSource,
    GimbalTrack,
    HeightSource,
    HeightTrack,
    PoseStd,
    PositionTrack,
    Status,
    VehicleTrack,
)
from aerodft.service import AttitudeSettings, HeightSettings, TelemetrySettings
from aerodft.service.clocks import Ticks
from aerodft.service.pose import PoseSource
from tests.one_image import sample_at

MS, SECOND = 1_000_000, 1_000_000_000
UTC0 = 1_795_221_168 * SECOND
LAT0, LON0, ALT0 = math.radians(-35.0), math.radians(149.0), 600.0
PERIOD = 100 * MS
STD = PoseStd(horizontal_m=1.5, tilt_rad=0.01, pan_rad=0.02, roll_rad=0.03, heading_rad=0.04)
HOME_ONLY = HeightSettings(order=(HeightSource.HOME,))
NORTH_M_PER_RAD = Geod(ellps="WGS84").inv(149.0, -35.0, 149.0, -34.999)[2] / math.radians(0.001) + ALT0


def times(start_ns, stop_ns, *, stamped=True):
    boot = np.arange(start_ns, stop_ns, PERIOD, dtype=np.int64)
    return {"arrival_ns": boot + UTC0, "boot_ns": boot if stamped else np.full_like(boot, NO_BOOT_TIME)}


def clock(boot_ns=0):
    return ClockTrack(
        arrival_ns=np.array([UTC0 + boot_ns]), boot_ns=np.array([boot_ns]), unix_ns=np.array([UTC0 + boot_ns])
    )


def height_home_m(boot_ns):
    return 20.0 + 2.0 * boot_ns / SECOND


def position(start_ns, stop_ns):
    """Northwards at 5 m/s, climbing at 2 m/s."""
    stamps = times(start_ns, stop_ns)
    seconds = stamps["boot_ns"] / SECOND
    return PositionTrack(
        **stamps,
        lat_rad=LAT0 + 5.0 * seconds / NORTH_M_PER_RAD,
        lon_rad=np.full_like(seconds, LON0),
        alt_msl_m=ALT0 + height_home_m(stamps["boot_ns"]),
        height_home_m=height_home_m(stamps["boot_ns"]),
    )


def gimbal(start_ns, stop_ns, *, pitch_deg=-60.0):
    stamps = times(start_ns, stop_ns)
    yaw = 0.1 * stamps["boot_ns"] / SECOND
    pitch = np.full(len(yaw), math.radians(pitch_deg))
    return GimbalTrack(
        **stamps,
        source=GimbalSource.GIMBAL_DEVICE,
        wxyz=from_yaw_pitch_roll(yaw, pitch, 0.0),
        yaw_in_earth=np.full(len(yaw), fill_value=True),
    )


def vehicle(start_ns, stop_ns, *, pitch_rad=0.0):
    stamps = times(start_ns, stop_ns)
    zero = np.zeros(len(stamps["boot_ns"]))
    return VehicleTrack(**stamps, wxyz=from_yaw_pitch_roll(zero, zero + pitch_rad, zero))


def source(*tracks, origin=None, time_std_s=0.02, **settings):
    settings.setdefault("height", HOME_ONLY)
    settings.setdefault("attitude", AttitudeSettings(std=STD, is_demand=False))
    poses = PoseSource(TelemetrySettings(**settings), origin=origin, time_std_s=time_std_s)
    poses.append(Ticks.one((clock(), *tracks)))
    return poses


@settings(deadline=None)
@given(st.integers(0, 2900 * MS))
def test_height_position_and_attitude_are_the_closed_forms(boot_ns):
    poses = source(position(0, 3 * SECOND), gimbal(0, 3 * SECOND), vehicle(0, 3 * SECOND))
    sample = sample_at(poses, UTC0 + boot_ns, final=False)
    assert sample.status is Status.OK
    seconds = boot_ns / SECOND
    assert_allclose(sample.pose.position_enu_m, [0.0, 5.0 * seconds, 20.0 + 2.0 * seconds], atol=2e-4)
    tilt, roll, heading = camera_angles(sample.pose.wxyz)
    assert_allclose([tilt, roll, heading], [math.radians(30.0), 0.0, 0.1 * seconds], atol=1e-9)
    assert_allclose(sample.lat_rad, LAT0 + 5.0 * seconds / NORTH_M_PER_RAD, atol=1e-12)
    assert_allclose(sample.alt_msl_m, ALT0 + 20.0 + 2.0 * seconds)
    assert (sample.height_source, sample.height_datum) == (HeightSource.HOME, "home")
    assert sample.attitude_source is GimbalSource.GIMBAL_DEVICE


def test_velocity_and_rate_are_those_of_the_closed_forms():
    poses = source(position(0, SECOND), gimbal(0, SECOND), vehicle(0, SECOND))
    pose = sample_at(poses, UTC0 + 450 * MS, final=False).pose
    assert_allclose(pose.velocity_enu_mps, [0.0, 5.0, 2.0], atol=1e-3)
    down_cam = Rotation.from_quat(pose.wxyz, scalar_first=True).inv().apply([0.0, 0.0, -1.0])
    assert_allclose(pose.rate_cam_radps, 0.1 * down_cam, atol=1e-9)


def test_the_covariance_is_that_of_the_stated_stds_and_the_height_used():
    poses = source(position(0, SECOND), gimbal(0, SECOND), vehicle(0, SECOND))
    sample = sample_at(poses, UTC0 + 450 * MS, final=False)
    assert (sample.std.height_agl_m, sample.std.tilt_rad, sample.std.time_s) == (1.0, 0.01, 0.02)
    assert_allclose(sample.pose.cov, pose_covariance(sample.pose.wxyz, sample.std.values))
    assert sample.pose.time_std_s == 0.02
    assert sample.telemetry_age_s == pytest.approx(0.05)


def test_the_first_fix_is_the_origin_and_its_foot_lies_on_the_plane():
    height = HeightSettings(order=(HeightSource.HOME,), home_above_plane_m=4.0)
    poses = source(position(0, SECOND), gimbal(0, SECOND), height=height)
    origin = sample_at(poses, UTC0, final=False).origin
    assert_allclose([origin.lat_rad, origin.lon_rad, origin.alt_msl_m], [LAT0, LON0, ALT0 - 4.0])


def test_a_configured_origin_stays():
    origin = GeoOrigin(lat_rad=LAT0 - 100.0 / NORTH_M_PER_RAD, lon_rad=LON0, alt_msl_m=ALT0)
    poses = source(position(0, SECOND), gimbal(0, SECOND), origin=origin)
    assert_allclose(sample_at(poses, UTC0, final=False).pose.position_enu_m[:2], [0.0, 100.0], atol=0.02)


def test_without_a_position_there_are_widths_but_no_map():
    manual = HeightSettings(order=(HeightSource.MANUAL,), manual_m=30.0)
    poses = source(gimbal(0, SECOND), vehicle(0, SECOND), height=manual)
    sample = sample_at(poses, UTC0 + 50 * MS, final=False)
    assert sample.status is Status.OK
    assert (sample.origin, sample.lat_rad, sample.lon_rad, sample.alt_msl_m) == (None, None, None, None)
    assert_allclose(sample.pose.position_enu_m, [0.0, 0.0, 30.0])


def test_an_image_waits_for_the_telemetry_after_it():
    poses = source(position(0, SECOND), gimbal(0, SECOND), vehicle(0, SECOND))
    stamp_ns = UTC0 + 1050 * MS
    assert sample_at(poses, stamp_ns, final=False) is None
    poses.append(Ticks.one((position(SECOND, 2 * SECOND),)))
    assert sample_at(poses, stamp_ns, final=False) is None  # the gimbal is not there yet
    poses.append(Ticks.one((gimbal(SECOND, 2 * SECOND), vehicle(SECOND, 2 * SECOND))))
    assert sample_at(poses, stamp_ns, final=False).status is Status.OK


def miss(poses, boot_ns, *, final=True):
    sample = sample_at(poses, UTC0 + boot_ns, final=final)
    assert sample.pose is None
    return sample.status, sample.reasons


def test_no_telemetry():
    empty = PoseSource(TelemetrySettings(height=HOME_ONLY), origin=None, time_std_s=0.0)
    assert miss(empty, 0)[0] is Status.NO_TELEMETRY
    status, reasons = miss(source(position(SECOND, 2 * SECOND), gimbal(SECOND, 2 * SECOND)), 500 * MS)
    assert status is Status.NO_TELEMETRY
    assert reasons[0] == "no height received yet from home"
    assert reasons[1].startswith("no camera attitude received yet from GIMBAL_DEVICE_ATTITUDE_STATUS, MOUNT_ORIENT")


def test_no_height():
    poses = source(gimbal(0, SECOND), vehicle(0, SECOND))
    assert miss(poses, 500 * MS) == (Status.NO_HEIGHT, ("no height received yet from home",))


def test_no_attitude():
    status, reasons = miss(source(position(0, SECOND), vehicle(0, SECOND)), 500 * MS)
    assert status is Status.NO_ATTITUDE
    assert len(reasons) == 1
    assert reasons[0].startswith("no camera attitude received yet from ")


def test_stale_telemetry_in_a_gap_and_after_the_end():
    poses = source(position(0, 20 * SECOND), gimbal(0, SECOND), gimbal(19 * SECOND, 20 * SECOND))
    in_gap = "no camera attitude on both sides of the stamp within 1 s from GIMBAL_DEVICE_ATTITUDE_STATUS,"
    for boot_ns in (SECOND, 10 * SECOND, 18_950 * MS):
        status, reasons = miss(poses, boot_ns, final=False)
        assert status is Status.STALE_TELEMETRY
        assert reasons[0].startswith(in_gap)
    status, reasons = miss(poses, 30 * SECOND)
    assert status is Status.STALE_TELEMETRY
    assert reasons[0] == "no height on both sides of the stamp within 2 s from home"
    assert reasons[1].startswith(in_gap)


def test_below_the_minimum_height_there_is_a_pose_but_no_number():
    height = HeightSettings(order=(HeightSource.HOME,), min_m=21.0)
    poses = source(position(0, SECOND), gimbal(0, SECOND), height=height)
    low, high = sample_at(poses, UTC0, final=False), sample_at(poses, UTC0 + 600 * MS, final=False)
    assert (low.status, low.reasons) == (
        Status.BELOW_MIN_HEIGHT,
        ("home says 20.00 m, the minimum is 21 m",),
    )
    assert low.pose is not None
    assert high.status is Status.OK


def test_a_tilted_rangefinder_is_corrected_by_the_vehicles_attitude():
    stamps = times(0, SECOND)
    slant = HeightTrack(
        **stamps,
        source=HeightSource.RANGEFINDER,
        value_m=np.full(10, 53.6),
        slant=True,
        std_m=np.full(10, math.nan),
    )
    tilted = vehicle(0, SECOND, pitch_rad=math.radians(-21.8))
    poses = source(slant, tilted, gimbal(0, SECOND), height=HeightSettings())
    sample = sample_at(poses, UTC0 + 50 * MS, final=False)
    assert sample.height_source == HeightSource.RANGEFINDER
    assert sample.pose.position_enu_m[2] == pytest.approx(53.6 * math.cos(math.radians(21.8)))


def test_the_height_falls_through_to_the_next_source_when_one_dies():
    stamps = times(0, SECOND)
    rangefinder = HeightTrack(
        **stamps, source=HeightSource.RANGEFINDER, value_m=np.full(10, 15.0), slant=True, std_m=np.full(10, math.nan)
    )
    flight = (position(0, 8 * SECOND), gimbal(0, 8 * SECOND), vehicle(0, 8 * SECOND))
    poses = source(rangefinder, *flight, height=HeightSettings())
    assert sample_at(poses, UTC0 + 500 * MS, final=False).height_source == HeightSource.RANGEFINDER
    fallen = sample_at(poses, UTC0 + 2 * SECOND, final=False)
    assert fallen.height_source == HeightSource.HOME
    assert fallen.pose.position_enu_m[2] == pytest.approx(24.0)


def test_after_a_reboot_old_samples_are_not_mixed_with_new_ones():
    poses = source(position(0, SECOND), gimbal(0, SECOND), vehicle(0, SECOND))
    rebooted = PositionTrack(
        arrival_ns=UTC0 + np.array([60, 61, 62]) * SECOND,
        boot_ns=np.array([0, 1, 2]) * SECOND,
        lat_rad=np.full(3, LAT0),
        lon_rad=np.full(3, LON0),
        alt_msl_m=np.full(3, ALT0),
        height_home_m=np.zeros(3),
    )
    poses.append(Ticks.one((position(30 * SECOND, 31 * SECOND),)))
    poses.append(Ticks.one((rebooted,)))
    assert miss(poses, 500 * MS)[0] is Status.STALE_TELEMETRY
    assert miss(poses, 30_500 * MS)[0] is Status.STALE_TELEMETRY
