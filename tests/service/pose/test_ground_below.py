"""Heights over uneven ground: the camera's place in ENU against closed forms, and every way to have none."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pyproj import Geod

from aerodft.geometry import ElevationGrid, Plane, Terrain, camera_pose, from_yaw_pitch_roll
from aerodft.model import (
    CODE_OF,
    ClockTrack,
    GeoOrigin,
    GimbalSource,
    GimbalTrack,
    HeightSource,
    HeightTrack,
    Pose,
    PoseStd,
    PositionTrack,
    Status,
    VehicleTrack,
)
from aerodft.service import AttitudeSettings, HeightSettings, TelemetrySettings
from aerodft.service.clocks import Ticks
from aerodft.service.pose import PoseSource, ground_below, raised_by_ground
from tests.one_image import sample_at

MS, SECOND = 1_000_000, 1_000_000_000
UTC0 = 1_795_221_168 * SECOND
LAT, LON, ALT = 47.5, 9.2, 400.0
ORIGIN = GeoOrigin(lat_rad=math.radians(LAT), lon_rad=math.radians(LON), alt_msl_m=ALT)
STD = PoseStd(horizontal_m=1.5, tilt_rad=0.01)
RISE = np.array([0.2, -0.1])
SLOPE = Plane(np.array([-0.2, 0.1, 1.0]) / math.sqrt(1.05), 3.0 / math.sqrt(1.05))  # z = 3 + 0.2 e - 0.1 n
HOME_M = 60.0


def grid(*, hole=False):
    """The slope as an elevation model of 400 m by 400 m; a hole in its north-east."""
    along = np.arange(-200.0, 201.0, 10.0)
    heights = 3.0 + RISE[0] * along[None, :] + RISE[1] * along[:, None]
    if hole:
        heights[35:, 35:] = np.nan
    return Terrain(ElevationGrid(east_m=-200.0, north_m=-200.0, cell_m=10.0, heights_m=heights))


def times(stop_ns=SECOND):
    boot = np.arange(0, stop_ns, 100 * MS, dtype=np.int64)
    return {"arrival_ns": boot + UTC0, "boot_ns": boot}


def position(east_m, north_m):
    stamps = times()
    away, azimuth = math.hypot(east_m, north_m), math.degrees(math.atan2(east_m, north_m))
    lon, lat, _ = Geod(a=6378137.0 + ALT, f=1 / 298.257223563).fwd(LON, LAT, azimuth, away)
    full = np.ones(len(stamps["boot_ns"]))
    return PositionTrack(
        **stamps,
        lat_rad=math.radians(lat) * full,
        lon_rad=math.radians(lon) * full,
        alt_msl_m=(ALT + HOME_M) * full,
        height_home_m=HOME_M * full,
    )


def measured(value_m, source=HeightSource.RANGEFINDER):
    full = np.ones(len(times()["boot_ns"]))
    slant = source == HeightSource.RANGEFINDER
    return HeightTrack(**times(), source=source, value_m=value_m * full, slant=slant, std_m=np.nan * full)


def attitudes(pitch_rad=0.0, roll_rad=0.0, yaw_rad=0.0):
    full = np.ones(len(times()["boot_ns"]))
    body = from_yaw_pitch_roll(yaw_rad * full, pitch_rad * full, roll_rad * full)
    gimbal = from_yaw_pitch_roll(0.0 * full, math.radians(-60.0) * full, 0.0 * full)
    return (
        VehicleTrack(**times(), wxyz=body),
        GimbalTrack(**times(), source=GimbalSource.GIMBAL_DEVICE, wxyz=gimbal, yaw_in_earth=full > 0),
    )


def sample(ground, *tracks, stamp_ns=UTC0 + 450 * MS, origin=ORIGIN, **height):
    settings = TelemetrySettings(height=HeightSettings(**height), attitude=AttitudeSettings(std=STD))
    poses = PoseSource(settings, origin=origin, time_std_s=0.0, ground=ground)
    clock = ClockTrack(arrival_ns=np.array([UTC0]), boot_ns=np.array([0]), unix_ns=np.array([UTC0]))
    poses.append(Ticks.one((clock, *tracks)))
    return sample_at(poses, stamp_ns, final=True)


@pytest.mark.parametrize("ground", [SLOPE, grid()], ids=["slope", "terrain"])
@pytest.mark.parametrize("source", [HeightSource.RANGEFINDER, HeightSource.TERRAIN, HeightSource.MANUAL])
def test_what_is_measured_from_below_stands_on_the_ground_there(ground, source):
    found = sample(ground, position(80.0, -50.0), measured(25.0, source), *attitudes(), order=(source,), manual_m=25.0)
    assert found.status is Status.OK
    assert_allclose(found.pose.position_enu_m, [80.0, -50.0, 3.0 + 16.0 + 5.0 + 25.0], atol=0.01)
    assert found.height_source is source


@pytest.mark.parametrize("ground", [SLOPE, grid(), None], ids=["slope", "terrain", "level"])
def test_home_relative_heights_are_counted_from_the_grounds_zero(ground):
    found = sample(ground, position(80.0, -50.0), *attitudes(), home_above_plane_m=2.5)
    assert_allclose(found.pose.position_enu_m, [80.0, -50.0, HOME_M + 2.5], atol=0.01)
    std_m = HeightSettings().std_m[HeightSource.HOME]
    assert_allclose(found.pose.cov[:3, :3], np.diag([1.5, 1.5, std_m]) ** 2)


@pytest.mark.parametrize("ground", [SLOPE, grid()], ids=["slope", "terrain"])
def test_errors_of_the_position_follow_the_slope(ground):
    home_above_plane_m = 3.0 + 16.0 + 5.0 + 25.0 - HOME_M  # so that both heights agree over this ground
    found = sample(ground, position(80.0, -50.0), measured(25.0), *attitudes(), home_above_plane_m=home_above_plane_m)
    draws = np.random.default_rng(7).normal(size=(400_000, 3)) * [1.5, 1.5, 0.2]
    draws[:, 2] += draws[:, :2] @ RISE
    assert_allclose(found.pose.cov[:3, :3], np.cov(draws.T), atol=0.02)
    level = sample(None, position(80.0, -50.0), measured(25.0), *attitudes())
    assert_allclose(found.pose.cov[3:, 3:], level.pose.cov[3:, 3:])
    assert not found.pose.cov[:3, 3:].any()


@given(pitch=st.floats(-0.4, 0.4), roll=st.floats(-0.4, 0.4), yaw=st.floats(-3, 3), range_m=st.floats(5, 90))
def test_a_rangefinder_that_leans_measures_to_where_its_beam_ends(pitch, roll, yaw, range_m):
    found = sample(SLOPE, position(10.0, 20.0), measured(range_m), *attitudes(pitch, roll, yaw))
    down_n = math.cos(yaw) * math.sin(pitch) * math.cos(roll) + math.sin(yaw) * math.sin(roll)
    down_e = math.sin(yaw) * math.sin(pitch) * math.cos(roll) - math.cos(yaw) * math.sin(roll)
    down = math.cos(pitch) * math.cos(roll)
    ground_m = 3.0 + 0.2 * (10.0 + range_m * down_e) - 0.1 * (20.0 + range_m * down_n)
    assert_allclose(found.pose.position_enu_m[2], ground_m + range_m * down, atol=0.01)


def test_the_minimum_is_about_the_height_as_it_was_measured():
    found = sample(SLOPE, position(80.0, -50.0), measured(0.9), *attitudes())
    assert (found.status, found.reasons) == (
        Status.BELOW_MIN_HEIGHT, ("rangefinder says 0.90 m, the minimum is 1 m",),
    )  # fmt: skip
    deep = sample(SLOPE, position(-180.0, 100.0), measured(5.0), *attitudes())
    assert deep.status is Status.OK
    assert deep.pose.position_enu_m[2] == pytest.approx(3.0 - 36.0 - 10.0 + 5.0, abs=0.01)


@pytest.mark.parametrize("order", [(HeightSource.RANGEFINDER,), (HeightSource.HOME,)], ids=["surface", "home"])
def test_outside_of_the_elevation_model(order):
    found = sample(grid(), position(80.0, 230.0), measured(25.0), *attitudes(), order=order)
    assert found.status is Status.BEYOND_TERRAIN
    assert found.reasons == ("below the camera, 80 m east and 230 m north of the origin, is no more elevation model",)
    assert found.pose is None
    assert found.lat_rad is not None


def test_over_a_hole_only_heights_above_the_ground_are_lost():
    flight = (position(170.0, 180.0), measured(25.0), *attitudes())
    lost = sample(grid(hole=True), *flight)
    assert lost.status is Status.NO_ELEVATION
    assert lost.reasons == (
        "below the camera, 170 m east and 180 m north of the origin, is a hole in the elevation model",
    )
    kept = sample(grid(hole=True), *flight, order=(HeightSource.HOME,))
    assert kept.status is Status.OK
    assert kept.pose.position_enu_m[2] == HOME_M


def test_without_a_position_nobody_knows_which_ground_is_below():
    never = sample(grid(), measured(25.0), *attitudes())
    assert (never.status, never.reasons) == (
        Status.NO_HEIGHT, ("no position received yet, and the ground is uneven",),
    )  # fmt: skip


def test_a_lost_position_is_stale_over_uneven_ground():
    settings = TelemetrySettings(height=HeightSettings(order=(HeightSource.MANUAL,), manual_m=9.0))
    poses = PoseSource(settings, origin=ORIGIN, time_std_s=0.0, ground=grid())
    boot = np.arange(0, 6 * SECOND, 100 * MS, dtype=np.int64)
    full = np.ones(len(boot))
    gimbal = GimbalTrack(
        arrival_ns=boot + UTC0, boot_ns=boot, source=GimbalSource.GIMBAL_DEVICE,
        wxyz=from_yaw_pitch_roll(0 * full, -full, 0 * full), yaw_in_earth=full > 0,
    )  # fmt: skip
    clock = ClockTrack(arrival_ns=np.array([UTC0]), boot_ns=np.array([0]), unix_ns=np.array([UTC0]))
    poses.append(Ticks.one((clock, position(0.0, 0.0), gimbal)))
    found = sample_at(poses, UTC0 + 4 * SECOND, final=True)
    reason = "no believable position on both sides of the stamp within 2 s, and the ground is uneven"
    assert (found.status, found.reasons, found.pose) == (Status.STALE_TELEMETRY, (reason,), None)
    assert sample_at(poses, UTC0 + 450 * MS, final=True).status is Status.OK


def test_a_slope_is_alike_everywhere_so_that_widths_need_no_position():
    found = sample(SLOPE, measured(25.0), *attitudes(), origin=None)
    assert (found.status, found.origin) == (Status.OK, None)
    assert_allclose(found.pose.position_enu_m, [0.0, 0.0, 28.0], atol=1e-9)
    home = sample(SLOPE, *attitudes(), order=(HeightSource.HOME, HeightSource.MANUAL), manual_m=5.0, origin=None)
    assert_allclose(home.pose.position_enu_m, [0.0, 0.0, 8.0], atol=1e-9)


@given(east=st.floats(-1e4, 1e4), north=st.floats(-1e4, 1e4), slope=st.floats(0, 1.2), uphill=st.floats(0, 6.28))
def test_the_footing_is_the_planes_own(east, north, slope, uphill):
    plane = Plane.sloping([100.0, -20.0, 7.0], slope, uphill)
    below = ground_below(plane, np.array([[east, north]]))
    gradient = math.tan(slope) * np.array([math.sin(uphill), math.cos(uphill)])
    assert below.status.tolist() == [CODE_OF[Status.OK]]
    assert_allclose(below.slope, [gradient], atol=1e-9)
    assert_allclose(below.height_m, [7.0 + gradient @ [east - 100.0, north + 20.0]], atol=1e-6)
    pose = camera_pose(height_agl_m=4.0, tilt_rad=0.3, east_m=east, north_m=north)
    carried = raised_by_ground(Pose.concatenate([pose]), below.height_m, below.slope)
    assert_allclose(carried.position_enu_m, [[east, north, below.height_m[0] + 4.0]])
