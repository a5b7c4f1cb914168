"""Camera attitudes of recorded flights, as a live station would have had them, against what the vehicles say."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil
from scipy.spatial.transform import Rotation

from aerodft.adapters.telemetry import CompositeDecoder, open_log
from aerodft.geometry import ElevationGrid, Terrain, camera_angles, camera_from_gimbal, east_north, matrix
from aerodft.model import GeoOrigin, GimbalSource, HeightSource, PoseStd, RawBlock, ReportFrame, Status, Track
from aerodft.service import LAST, AttitudeSettings, HeightSettings, TelemetrySettings
from aerodft.service.clocks import Ticks
from aerodft.service.pose import PoseSource
from tests.one_image import sample_at

DATA = Path(__file__).parents[2].parent / "shared" / "data"
CONTROL, SERVO, QUAD = "sitl/brushless_ctl.tlog", "sitl/servo_consumer.tlog", "logs/dronekit_quad.tlog"
TILT_STD = math.radians(1.0)
SETTINGS = TelemetrySettings(
    height=HeightSettings(order=(HeightSource.HOME,), min_m=-10.0),
    attitude=AttitudeSettings(std=PoseStd(tilt_rad=TILT_STD, pan_rad=TILT_STD, roll_rad=TILT_STD)),
)
UNKNOWN = 2**31 - 1
BLOCK = 200  # frames that arrive together

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there: the recorded flights are kept apart")


def with_frame(frame):
    return replace(SETTINGS, attitude=replace(SETTINGS.attitude, frame=frame))


def utc_ns(clock, boot_ns):
    return int(clock.to_utc(Track(arrival_ns=np.array([0]), boot_ns=np.array([boot_ns])), LAST)[0])


def flown(name, boots_ms=None, settings=SETTINGS, source=None):
    """Poses at these times since boot (else every three seconds), each as soon as it was final; and their source."""
    source = source or PoseSource(settings, origin=None, time_std_s=0.0)
    decoder, samples = CompositeDecoder(None), []
    wanted_ns = [] if boots_ms is None else [round(ms * 1e6) for ms in boots_ms]
    next_ns = None
    for block in (event for event in open_log(DATA / name).events() if isinstance(event, RawBlock)):
        for start in range(0, len(block.offset), BLOCK):
            tracks = decoder.decode(block.rows(slice(start, min(start + BLOCK, len(block.offset)))))
            source.append(Ticks.one(tracks))
            if not source.clock.is_utc_known:
                continue
            if boots_ms is None:
                arrived_ns = int(source.clock.host_to_utc(block.arrival_ns[start : start + 1])[0])
                next_ns = next_ns or arrived_ns
                if arrived_ns > next_ns + 3 * 10**9:
                    samples.append(sample_at(source, next_ns, final=True))
                    next_ns = arrived_ns
            while (
                wanted_ns and (sample := sample_at(source, utc_ns(source.clock, wanted_ns[0]), final=False)) is not None
            ):
                samples.append(sample)
                wanted_ns.pop(0)
    return samples, source


def tilt_deg(sample):
    return math.degrees(camera_angles(sample.pose.wxyz)[0])


@pytest.fixture(scope="module")
def looks():
    """Every CAMERA_FOV_STATUS of the control link, and home, read with pymavlink alone."""
    log = mavutil.mavlink_connection(str(DATA / CONTROL), dialect="ardupilotmega")
    found, home = [], None
    while (message := log.recv_match(type=["CAMERA_FOV_STATUS", "HOME_POSITION"])) is not None:
        if message.get_type() == "CAMERA_FOV_STATUS":
            found.append(message)
        else:
            home = message
    log.close()
    return found, home


@pytest.fixture(scope="module")
def hill():
    along = np.arange(-1500.0, 1501.0, 10.0)
    heights_m = 0.05 * along[:, None] + 20 * (1 - np.cos(along[None, :] / 250))
    return Terrain(ElevationGrid(east_m=-1500.0, north_m=-1500.0, cell_m=10.0, heights_m=heights_m))


@pytest.fixture(scope="module")
def control(looks, hill):
    """Every CAMERA_FOV_STATUS of the control link with the pose at its time, and where home is."""
    asked, home = looks
    origin = GeoOrigin(
        lat_rad=math.radians(home.latitude * 1e-7), lon_rad=math.radians(home.longitude * 1e-7), alt_msl_m=584.0
    )
    source = PoseSource(SETTINGS, origin=origin, time_std_s=0.0, ground=hill)
    samples, _ = flown(CONTROL, [each.time_boot_ms for each in asked], source=source)
    return list(zip(asked, samples, strict=False)), origin  # the last ones have no telemetry after them


def test_attitudes_are_the_autopilots_own(control):
    errors_deg, std_deg = [], []
    for message, sample in control[0]:
        if sample.pose is None:
            continue
        truth = Rotation.from_quat(camera_from_gimbal(np.array(message.q)), scalar_first=True)
        apart = Rotation.from_quat(sample.pose.wxyz, scalar_first=True).inv() * truth
        errors_deg.append(np.degrees(apart.as_rotvec()))
        std_deg.append(np.degrees([sample.std.tilt_rad, sample.std.pan_rad, sample.std.roll_rad]))
    size = np.linalg.norm(errors_deg, axis=-1)
    ratio = np.max(np.abs(errors_deg) / np.array(std_deg))
    print(f"\n{len(size)} attitudes: 95 % within {np.percentile(size, 95):.5f} deg, the worst at {ratio:.2f} std")
    assert len(size) > 1100
    assert np.percentile(size, 95) < 0.01
    assert ratio < 3.0


def test_the_optical_axis_meets_the_hill_where_the_autopilot_says(control, hill):
    taken, origin = control
    errors = []
    for message, sample in taken:
        if UNKNOWN in {message.lat_image, message.lat_camera} or message.alt_image >= message.alt_camera - 1000:
            continue
        place = east_north(origin, *np.radians([message.lat_image * 1e-7, message.lon_image * 1e-7]))
        reported = np.array([*place, message.alt_image / 1000 - 584.0])
        met = hill.meet(sample.pose.position_enu_m, matrix(sample.pose.wxyz)[:, 2], 0.0)
        range_m = np.linalg.norm(reported - sample.pose.position_enu_m)
        errors.append(np.linalg.norm(met.points_enu_m - reported) / range_m)
    print(f"\n{len(errors)} rays: median {np.nanmedian(errors):.2%} of the range, {np.isnan(errors).sum()} miss")
    assert np.isnan(errors).mean() < 0.03
    assert np.nanmedian(errors) < 0.02


@pytest.fixture(scope="module")
def leg_ms():
    """Time since boot of the start of the servo flight's fast leg."""
    control = json.loads((DATA / "sitl/servo_ctl.json").read_text())
    seen = next(sample for sample in control["samples"] if sample["tag"] == "leg 4 s")
    return seen["SYSTEM_TIME"]["time_boot_ms"] - 4000


@pytest.fixture(scope="module")
def servo(leg_ms):
    """The servo flight from 20 s before its fast leg to its end: 44 s, ten poses a second; and their source."""
    return flown(SERVO, np.arange(leg_ms - 20000, leg_ms + 24000, 100))


def test_a_servo_mount_is_found_out_before_its_leg_and_read_rightly(servo):
    samples, source = servo[0][240:], servo[1]
    tilts_deg = [tilt_deg(sample) for sample in samples]
    print(f"\ntilts on the leg: {min(tilts_deg):.2f} to {max(tilts_deg):.2f} deg")
    assert len(samples) == 200
    assert {sample.status for sample in samples} == {Status.OK}
    assert max(abs(tilt - 60.0) for tilt in tilts_deg) <= 0.5
    assert all("is body-frame" in sample.reasons[0] for sample in samples)
    assert source.gimbal_frames()[GimbalSource.GIMBAL_DEVICE].frame is ReportFrame.BODY


def test_before_the_verdict_the_std_covers_both_readings(servo):
    """From the pitching down to the verdict, the standard's reading is off by the vehicle's tilt."""
    samples = servo[0][:240]
    open_samples = [s for s in samples if not any("is body-frame" in reason for reason in s.reasons)]
    lied = [s for s in open_samples if abs(tilt_deg(s) - 60.0) > 0.5 and tilt_deg(s) > 47]
    assert lied, "the lie shows before it is found out"
    assert all(abs(tilt_deg(s) - 60.0) < 3.0 * math.degrees(s.std.tilt_rad) for s in lied)


@pytest.mark.nightly
def test_the_quads_mount_is_against_the_vehicle_and_looks_above_the_horizon():
    samples, source = flown(QUAD)
    evidence = source.gimbal_frames()[GimbalSource.MOUNT_STATUS]
    read = [sample for sample in samples if sample.reasons and "is body-frame" in sample.reasons[0]]
    tilts, rolls, _ = (np.degrees(each) for each in camera_angles(np.stack([s.pose.wxyz for s in read])))
    print(
        f"\n{evidence}: tilt {np.median(tilts):.1f}, roll {np.median(rolls):.1f} deg, of {len(read)} of {len(samples)}"
    )
    assert evidence.frame is ReportFrame.BODY
    assert not evidence.contradictory
    assert np.median(tilts) == pytest.approx(93.0, abs=1.0)
    assert np.median(rolls) == pytest.approx(-12.0, abs=1.5)


def test_what_is_stated_wrongly_is_refused_in_a_sentence(leg_ms):
    samples, _ = flown(SERVO, np.arange(leg_ms + 4000, leg_ms + 24000, 500), settings=with_frame(ReportFrame.EARTH))
    assert {sample.status for sample in samples} == {Status.NO_ATTITUDE}
    for (reason,) in {sample.reasons for sample in samples}:
        assert reason.startswith(
            "GIMBAL_DEVICE_ATTITUDE_STATUS is body-frame (against the vehicle, not the horizon): it undid "
        )
        assert reason.endswith('; set telemetry.attitude.frame = "auto" or "body"')


@pytest.mark.nightly
def test_what_is_stated_rightly_needs_no_evidence(leg_ms):
    samples, _ = flown(SERVO, np.arange(leg_ms + 4000, leg_ms + 24000, 500), settings=with_frame(ReportFrame.BODY))
    assert max(abs(tilt_deg(sample) - 60.0) for sample in samples) <= 0.5
    assert {sample.reasons for sample in samples} == {()}
