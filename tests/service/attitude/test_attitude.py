"""The camera's attitude against scipy's rotations: interpolation, frames of yaw, mounts, and rates."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation, Slerp

from aerodft.model import GimbalSource, GimbalTrack, GimbalTypeTrack, MountAxes, ReportFrame, VehicleTrack
from aerodft.service import LAST, AttitudeSettings, FixedMount
from aerodft.service.attitude import GIMBAL_MOUNTS, AttitudeSources
from aerodft.service.streams import END_OF_TIME, Missing, Query

MS, SECOND = 1_000_000, 1_000_000_000
NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
CAMERA_IN_GIMBAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # columns: right, down, forward
ANGLES = st.floats(-3.1, 3.1)
TILTS = st.floats(-1.5, 1.5)


def ypr(*angles_rad):
    return Rotation.from_euler("ZYX", angles_rad)


def wxyz(rotation):
    return rotation.as_quat(scalar_first=True)


def camera(ned_gimbal):
    """``enu_SO3_cam`` of a camera that looks along the gimbal's x axis."""
    return Rotation.from_matrix(NED_TO_ENU @ ned_gimbal.as_matrix() @ CAMERA_IN_GIMBAL)


def rows(stamps_ns, **columns):
    stamps = np.array(stamps_ns, dtype=np.int64)
    return {"arrival_ns": stamps, "boot_ns": stamps, **columns}


def gimbal(stamps_ns, rotations, *, earth, source=GimbalSource.GIMBAL_DEVICE):
    frames = np.broadcast_to(np.asarray(earth), len(stamps_ns)).copy()
    return GimbalTrack(
        **rows(stamps_ns, wxyz=np.stack([wxyz(r) for r in rotations])), source=source, yaw_in_earth=frames
    )


def vehicle(stamps_ns, rotations):
    return VehicleTrack(**rows(stamps_ns, wxyz=np.stack([wxyz(r) for r in rotations])))


@dataclass
class Found:
    """The attitude at one stamp."""

    wxyz: np.ndarray
    rate_cam_radps: np.ndarray
    age_s: float
    report_std_rad: np.ndarray
    source: GimbalSource
    is_demand: bool
    reasons: tuple[str, ...]


class Sources:
    """All that was reported, as of one tick."""

    def __init__(self, settings):
        self.all = AttitudeSources(settings)

    def at(self, stamp_ns, watermark_ns):
        """What is found at a stamp; why there is nothing; or why reports are refused."""
        batch = self.all.at(Query(np.array([stamp_ns]), LAST, np.array([watermark_ns])))
        missing = Missing(batch.missing[0])
        if missing is Missing.REFUSED:
            return batch.refusals[0]
        if missing is not Missing.NOTHING:
            assert batch.note.tolist() == [-1]
            return missing
        numbers = batch.wxyz[0], batch.rate_cam_radps[0], batch.age_s[0], batch.report_std_rad[0]
        return Found(*numbers, *batch.notes[batch.note[0]])


def sources(*tracks, **settings):
    made = Sources(AttitudeSettings(**settings))
    for track in tracks:
        made.all.append(track, track.boot_ns)
    return made


def assert_same(found, expected, atol_rad=1e-9):
    error = Rotation.from_quat(found.wxyz, scalar_first=True).inv() * expected
    assert_allclose(error.magnitude(), 0.0, atol=atol_rad)


@given(ANGLES, TILTS, ANGLES, TILTS, st.floats(0.01, 0.99))
def test_between_two_reports_it_is_scipys_slerp(yaw, pitch, yaw_after, pitch_after, weight):
    ends = [ypr(yaw, pitch, 0.1), ypr(yaw_after, pitch_after, -0.2)]
    apart = (ends[0].inv() * ends[1]).magnitude()
    if apart > math.pi - 1e-6:
        return  # half a turn has no shorter way
    attitude = sources(gimbal([0, 100 * MS], ends, earth=True))
    stamp_ns = round(weight * 100 * MS)
    truth = Slerp([0, 100 * MS], Rotation.concatenate(ends))(stamp_ns)
    found = attitude.at(stamp_ns, 100 * MS)
    assert_same(found, camera(truth), atol_rad=1e-7)
    assert found.source is GimbalSource.GIMBAL_DEVICE


def test_a_report_of_the_opposite_sign_is_the_same_attitude():
    track = gimbal([0, 100 * MS], [ypr(0.3, -0.5, 0.0)] * 2, earth=True)
    flipped = GimbalTrack(
        arrival_ns=track.arrival_ns,
        boot_ns=track.boot_ns,
        source=track.source,
        wxyz=track.wxyz * np.array([[1.0], [-1.0]]),
        yaw_in_earth=track.yaw_in_earth,
    )
    found = sources(flipped).at(50 * MS, 100 * MS)
    assert_same(found, camera(ypr(0.3, -0.5, 0.0)), atol_rad=1e-7)
    assert_allclose(found.rate_cam_radps, 0.0, atol=1e-7)


@given(ANGLES, TILTS, ANGLES, st.floats(-1.4, 1.4), st.floats(-1.0, 1.0))
def test_a_yaw_against_the_vehicle_is_added_to_its_heading_alone(pan, pitch, heading, nose, bank):
    """Roll and pitch of the report are against the horizon: the vehicle's own do not enter."""
    attitude = sources(
        gimbal([0, 100 * MS], [ypr(pan, pitch, 0.05)] * 2, earth=False),
        vehicle([0, 100 * MS], [ypr(heading, nose, bank)] * 2),
    )
    assert_same(attitude.at(50 * MS, 100 * MS), camera(ypr(pan + heading, pitch, 0.05)))


def test_at_nadir_the_heading_still_turns_the_image():
    attitude = sources(
        gimbal([0, 100 * MS], [ypr(0.0, -math.pi / 2, 0.0)] * 2, earth=False),
        vehicle([0, 100 * MS], [ypr(math.radians(80), -0.3, 0.1)] * 2),
    )
    found = Rotation.from_quat(attitude.at(50 * MS, 100 * MS).wxyz, scalar_first=True)
    up_in_image = found.apply([0.0, -1.0, 0.0])
    assert_allclose(up_in_image, [math.sin(math.radians(80)), math.cos(math.radians(80)), 0.0], atol=1e-9)
    assert_allclose(found.apply([0.0, 0.0, 1.0]), [0.0, 0.0, -1.0], atol=1e-9)


def test_an_earth_yaw_needs_no_vehicle_and_a_vehicle_yaw_does():
    stamps = [0, 100 * MS]
    level = [ypr(0.0, -0.5, 0.0)] * 2
    assert_same(sources(gimbal(stamps, level, earth=True)).at(50 * MS, 100 * MS), camera(level[0]))
    alone = sources(gimbal(stamps, level, earth=False))
    assert alone.at(50 * MS, 100 * MS) is Missing.NEVER
    assert alone.at(150 * MS, 100 * MS) is Missing.PENDING


def test_when_the_frame_of_yaw_changes_there_is_nothing_to_interpolate():
    stamps = [0, 100 * MS, 200 * MS, 300 * MS]
    attitude = sources(
        gimbal(stamps, [ypr(0.0, -0.5, 0.0)] * 4, earth=[True, True, False, False]),
        vehicle(stamps, [ypr(1.0, 0.0, 0.0)] * 4),
    )
    assert_same(attitude.at(50 * MS, END_OF_TIME), camera(ypr(0.0, -0.5, 0.0)))
    assert attitude.at(150 * MS, END_OF_TIME) is Missing.STALE
    assert_same(attitude.at(250 * MS, END_OF_TIME), camera(ypr(1.0, -0.5, 0.0)))


@given(ANGLES, st.floats(-1.4, 1.4), ANGLES, TILTS, ANGLES, st.floats(-0.5, 0.5))
def test_a_bolted_camera_turns_with_the_body(heading, nose, bank, mount_pitch, mount_yaw, mount_roll):
    mount = FixedMount(yaw_rad=mount_yaw, pitch_rad=mount_pitch, roll_rad=mount_roll)
    body = ypr(heading, nose, bank)
    attitude = sources(vehicle([0, 100 * MS], [body] * 2), order=(GimbalSource.FIXED_MOUNT,), fixed_mount=mount)
    found = attitude.at(50 * MS, 100 * MS)
    assert_same(found, camera(body * ypr(mount_yaw, mount_pitch, mount_roll)), atol_rad=1e-7)
    assert found.source is GimbalSource.FIXED_MOUNT


def test_a_fixed_mount_that_was_not_described_is_no_source():
    attitude = sources(vehicle([0, 100 * MS], [ypr(0, 0, 0)] * 2), order=(GimbalSource.FIXED_MOUNT,))
    assert attitude.at(50 * MS, 100 * MS) is Missing.NEVER


def test_the_first_source_in_order_that_has_a_value_wins():
    stamps = [0, 100 * MS]
    good = gimbal(stamps, [ypr(0.0, -0.2, 0.0)] * 2, earth=True, source=GimbalSource.MOUNT_STATUS)
    dead = gimbal([-5 * SECOND], [ypr(0.0, -0.9, 0.0)], earth=True)
    found = sources(good, dead).at(50 * MS, 100 * MS)
    assert found.source is GimbalSource.MOUNT_STATUS
    better = gimbal(stamps, [ypr(0.0, -0.9, 0.0)] * 2, earth=True)
    assert sources(good, better).at(50 * MS, 100 * MS).source is GimbalSource.GIMBAL_DEVICE
    assert sources(dead).at(50 * MS, 100 * MS) is Missing.STALE


def test_never_across_a_gap():
    attitude = sources(gimbal([0, 1001 * MS], [ypr(0, 0, 0)] * 2, earth=True), max_gap_ns=SECOND)
    assert attitude.at(500 * MS, 1001 * MS) is Missing.STALE
    assert not isinstance(attitude.at(1001 * MS, 1001 * MS), Missing)


def finite_difference_rate(attitude, stamp_ns, step_ns, watermark_ns):
    before, after = (
        Rotation.from_quat(attitude.at(stamp_ns + sign * step_ns, watermark_ns).wxyz, scalar_first=True)
        for sign in (-1, 1)
    )
    return (before.inv() * after).as_rotvec() / (2 * step_ns / SECOND)


@pytest.mark.parametrize("earth", [True, False])
@pytest.mark.parametrize("pitch", [-math.pi / 2, -0.7, 0.0])
def test_rates_are_finite_differences(earth, pitch):
    """Also where the vehicle turns, pitches and banks under a gimbal that pans and tilts."""
    stamps = [0, 100 * MS]
    attitude = sources(
        gimbal(stamps, [ypr(0.2, pitch, 0.0), ypr(0.23, pitch + 0.02, 0.01)], earth=earth),
        vehicle(stamps, [ypr(3.12, -0.35, 0.3), ypr(-3.13, -0.31, 0.38)]),
    )
    found = attitude.at(50 * MS, 100 * MS)
    truth = finite_difference_rate(attitude, 50 * MS, 20 * MS, 100 * MS)
    assert np.linalg.norm(truth) > 0.3
    assert_allclose(found.rate_cam_radps, truth, atol=0.01)


def test_a_bolted_cameras_rate_is_a_finite_difference():
    mount = FixedMount(yaw_rad=0.3, pitch_rad=-1.2, roll_rad=0.1)
    attitude = sources(
        vehicle([0, 100 * MS], [ypr(3.12, -0.35, 0.3), ypr(-3.13, -0.31, 0.38)]),
        order=(GimbalSource.FIXED_MOUNT,),
        fixed_mount=mount,
    )
    truth = finite_difference_rate(attitude, 50 * MS, 20 * MS, 100 * MS)
    assert_allclose(attitude.at(50 * MS, 100 * MS).rate_cam_radps, truth, atol=1e-9)


def test_exactly_on_a_sample_there_is_a_value_and_no_rate():
    attitude = sources(gimbal([0, 100 * MS], [ypr(0, -0.1, 0), ypr(0, -0.2, 0)], earth=True))
    found = attitude.at(100 * MS, 100 * MS)
    assert_same(found, camera(ypr(0, -0.2, 0)))
    assert (found.age_s, found.rate_cam_radps.tolist()) == (0.0, [0.0, 0.0, 0.0])


def swaying(stamps, pitch=-0.7, lean=0.25):
    """A vehicle that rocks fast, and a level-held camera; the pitch is changed now and then."""
    seconds = np.asarray(stamps) / SECOND
    nose = lean * np.sin(2.1 * seconds)
    wanted = pitch + 0.2 * np.round(1.5 * np.sin(0.3 * seconds))
    return [ypr(0.4, each, 0.0) for each in nose], [ypr(0.4, each, 0.0) for each in wanted]


@pytest.mark.parametrize(
    "source", [GimbalSource.GIMBAL_DEVICE, GimbalSource.MOUNT_ORIENTATION, GimbalSource.MOUNT_STATUS]
)
def test_a_report_against_the_vehicle_is_found_out_and_composed_as_rotations(source):
    stamps = list(range(0, 40 * SECOND, 100 * MS))
    bodies, cameras = swaying(stamps)
    reports = [body.inv() * looking for body, looking in zip(bodies, cameras, strict=True)]
    attitude = sources(vehicle(stamps, bodies), gimbal(stamps, reports, earth=False, source=source))
    found = attitude.at(stamps[-1], END_OF_TIME)
    assert_same(found, camera(cameras[-1]))
    assert "is body-frame" in found.reasons[0]
    assert found.is_demand
    refused = sources(
        vehicle(stamps, bodies), gimbal(stamps, reports, earth=False, source=source), frame=ReportFrame.EARTH
    ).at(stamps[-1], END_OF_TIME)
    assert isinstance(refused, str)
    assert str(source) in refused


@pytest.mark.parametrize("is_another", [False, True])
def test_what_was_told_of_a_gimbal_is_forgotten_when_another_one_answers(is_another):
    """A servo mount for 40 s, then what it says of itself once more, or what a gimbal held to the horizon says."""
    stamps = list(range(0, 80 * SECOND, 100 * MS))
    bodies, cameras = swaying(stamps)
    half = len(stamps) // 2
    servo = [body.inv() * looking for body, looking in zip(bodies[:half], cameras[:half], strict=True)]
    identity = np.array([7, 8 if is_another else 7])
    can = np.zeros(2, dtype=np.bool_)
    said = GimbalTypeTrack(message="any", **rows([stamps[0], stamps[half - 1]], identity=identity, cannot_roll=can))
    attitude = sources(vehicle(stamps[:half], bodies[:half]), gimbal(stamps[:half], servo, earth=False))
    assert "is body-frame" in attitude.at(stamps[half - 1], END_OF_TIME).reasons[0]
    attitude.all.append(said, said.boot_ns)
    assert (attitude.at(stamps[half - 1], END_OF_TIME) is Missing.STALE) == is_another
    first = slice(half, half + 8)
    attitude.all.append(vehicle(stamps[first], bodies[first]), np.array(stamps[first]))
    attitude.all.append(gimbal(stamps[first], cameras[first], earth=True), np.array(stamps[first]))
    found = attitude.at(stamps[half + 7], END_OF_TIME)
    assert any("is body-frame" in reason for reason in found.reasons) != is_another
    if is_another:
        assert_same(found, camera(cameras[half + 7]))


@pytest.mark.parametrize(
    ("silent_s", "vehicle_goes_on", "is_forgotten"), [(9, True, False), (60, False, False), (11, True, True)]
)
def test_what_was_told_of_a_gimbal_is_forgotten_after_a_silence_of_its_own(silent_s, vehicle_goes_on, is_forgotten):
    """In which it may have been exchanged; while the vehicle is not heard either, the link was lost."""
    stamps = np.arange(0, (42 + silent_s) * SECOND, 100 * MS)
    bodies, cameras = map(Rotation.concatenate, swaying(stamps))
    heard = (stamps < 40 * SECOND) | (stamps >= (40 + silent_s) * SECOND)
    known = heard | vehicle_goes_on
    attitude = sources(
        vehicle(stamps[known], bodies[known]), gimbal(stamps[heard], (bodies.inv() * cameras)[heard], earth=False)
    )
    frame = attitude.all.evidence()[GimbalSource.GIMBAL_DEVICE].frame
    assert frame is (None if is_forgotten else ReportFrame.BODY)


def test_the_doubt_is_the_vehicles_tilt_and_goes_with_the_evidence():
    stamps = list(range(0, 40 * SECOND, 100 * MS))
    bodies, cameras = swaying(stamps)
    attitude = sources(vehicle(stamps, bodies), gimbal(stamps, cameras, earth=True), is_demand=False)
    early = sources(vehicle(stamps[:8], bodies[:8]), gimbal(stamps[:8], cameras[:8], earth=True), is_demand=False)
    assert early.at(stamps[7], END_OF_TIME).report_std_rad[0] == pytest.approx(
        0.5 * abs(0.25 * math.sin(1.47)), rel=1e-6
    )
    assert_allclose(attitude.at(stamps[-1], END_OF_TIME).report_std_rad, 0.0, atol=1e-12)


@given(ANGLES, TILTS, st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_a_camera_that_sits_askew_on_its_gimbal(yaw, pitch, mount_yaw, mount_pitch, mount_roll):
    mount = FixedMount(yaw_rad=mount_yaw, pitch_rad=mount_pitch, roll_rad=mount_roll)
    report = ypr(yaw, pitch, 0.1)
    attitude = sources(gimbal([0, 100 * MS], [report] * 2, earth=True), camera_on_gimbal=mount)
    expected = camera(report * ypr(mount_yaw, mount_pitch, mount_roll))
    assert_same(attitude.at(50 * MS, 100 * MS), expected, atol_rad=1e-7)


@pytest.mark.parametrize("earth", [True, False])
def test_rates_of_what_is_against_the_vehicle_are_finite_differences(earth):
    stamps = [0, 100 * MS]
    attitude = sources(
        gimbal(stamps, [ypr(0.2, -0.7, 0.0), ypr(0.23, -0.68, 0.01)], earth=earth),
        vehicle(stamps, [ypr(3.12, -0.35, 0.3), ypr(-3.13, -0.31, 0.38)]),
        frame=ReportFrame.BODY,
    )
    truth = finite_difference_rate(attitude, 50 * MS, 20 * MS, 100 * MS)
    assert np.linalg.norm(truth) > 0.3
    assert_allclose(attitude.at(50 * MS, 100 * MS).rate_cam_radps, truth, atol=0.01)


def test_only_what_varies_by_itself_and_keeps_to_the_horizon_is_a_measurement():
    stamps = list(range(0, 40 * SECOND, 100 * MS))
    bodies, cameras = swaying(stamps)
    generator = np.random.default_rng(5)
    noisy = [each * Rotation.from_rotvec(1e-3 * generator.standard_normal(3)) for each in cameras]
    for reports, is_demand in ((cameras, True), (noisy, False)):
        attitude = sources(vehicle(stamps, bodies), gimbal(stamps, reports, earth=True))
        assert attitude.at(stamps[-1], END_OF_TIME).is_demand is is_demand
        stated = sources(vehicle(stamps, bodies), gimbal(stamps, reports, earth=True), is_demand=not is_demand)
        assert stated.at(stamps[-1], END_OF_TIME).is_demand is not is_demand


@pytest.mark.parametrize(("demand", "after_s", "is_said"), [(True, 0.2, True), (True, 3.0, False), (False, 0.2, False)])
def test_a_gimbal_that_may_still_be_on_its_way_is_said(demand, after_s, is_said):
    stamps = np.arange(0, 10 * SECOND, 100 * MS)
    way = [ypr(0.3, -1.0 if stamp < 5 * SECOND else -0.5, 0.0) for stamp in stamps]
    attitude = sources(gimbal(stamps, way, earth=True), frame=ReportFrame.EARTH, is_demand=demand)
    found = attitude.at(5 * SECOND + round(after_s * SECOND), END_OF_TIME)
    said = [reason for reason in found.reasons if "may still be turning" in reason]
    assert bool(said) is is_said
    assert is_said == (np.max(found.report_std_rad) > math.radians(5))


@pytest.mark.parametrize("yaw_in_earth", [False, True])
def test_servo_angles_are_composed_by_the_mounts_axes(yaw_in_earth):
    """Packed as Euler angles, turned in another order; straight down the roll servo levels the camera.

    Where the vehicle's nose is up, a tilt servo turns beyond straight down, which packed angles do not: by half a turn
    of yaw and roll.
    """
    rng = np.random.default_rng(3)
    vehicle = Rotation.from_euler("ZYX", rng.uniform([-180, -30, -30], [180, 30, 30], (200, 3)), degrees=True)
    yaw, pitch, roll = rng.uniform([-180, -125, -40], [180, 60, 40], (200, 3)).T
    pitch[:100], roll[:100] = -90.0, 0.0
    for row in range(100):  # what levels the camera at this yaw
        down = Rotation.from_euler("Z", -yaw[row], degrees=True).apply(vehicle[row].inv().apply([0.0, 0.0, 1.0]))
        roll[row] = np.degrees(np.arctan2(-down[1], down[2]))
    heading = vehicle.as_euler("ZYX", degrees=True)[:, 0] if yaw_in_earth else 0.0
    packed = Rotation.from_euler("ZYX", np.stack([yaw + heading, pitch, roll], axis=-1), degrees=True)
    meant = Rotation.from_euler("ZXY", np.stack([yaw + heading, roll, pitch], axis=-1), degrees=True)
    reported, bodies = wxyz(packed), wxyz(vehicle)
    outer = GIMBAL_MOUNTS[MountAxes.ROLL_OUTER].camera_wxyz(reported, bodies, yaw_in_earth=yaw_in_earth)
    assert np.degrees((meant.inv() * Rotation.from_quat(outer, scalar_first=True)).magnitude()).max() < 0.1
    assert GIMBAL_MOUNTS[MountAxes.TILT_OUTER].camera_wxyz(reported, bodies, yaw_in_earth=yaw_in_earth) is reported
    alone = GIMBAL_MOUNTS[MountAxes.TILT_ONLY].camera_wxyz(reported, bodies, yaw_in_earth=yaw_in_earth)
    tilted = Rotation.from_euler("ZY", np.stack([yaw + heading, pitch], axis=-1), degrees=True)
    assert np.degrees((tilted.inv() * Rotation.from_quat(alone, scalar_first=True)).magnitude()).max() < 0.1


@pytest.mark.parametrize(
    ("cannot_roll", "stated"), [(True, None), (False, MountAxes.TILT_ONLY), (True, MountAxes.ROLL_OUTER)]
)
def test_a_mount_without_a_roll_servo_rolls_with_the_vehicle(cannot_roll, stated):
    """An autopilot reports the angle of the servo that is not there."""
    body = Rotation.from_euler("ZYX", [0.4, 0.1, 0.3])
    said = GimbalTypeTrack(message="any", **rows([0], identity=np.array([7]), cannot_roll=np.array([cannot_roll])))
    attitude = sources(said, frame=ReportFrame.BODY, axes=stated)
    for track in (vehicle([0, 100 * MS], [body] * 2), gimbal([0, 100 * MS], [ypr(0.0, -0.9, -0.3)] * 2, earth=False)):
        attitude.all.append(track, track.boot_ns)
    servos = ("Y", [-0.9]) if stated is not MountAxes.ROLL_OUTER else ("XY", [-0.3, -0.9])
    assert_same(attitude.at(50 * MS, 100 * MS), camera(body * Rotation.from_euler(*servos)))


def test_two_gimbal_messages_that_contradict_each_other_give_no_attitude():
    stamps = list(range(0, 2 * SECOND, 100 * MS))
    for apart_deg, is_refused in ((40.0, True), (10.0, True), (4.0, False), (0.5, False)):
        pitches = {GimbalSource.GIMBAL_DEVICE: -1.0, GimbalSource.MOUNT_ORIENTATION: -1.0 + math.radians(apart_deg)}
        tracks = (gimbal(stamps, [ypr(0.0, p, 0.0)] * len(stamps), earth=True, source=s) for s, p in pitches.items())
        found = sources(*tracks, frame=ReportFrame.EARTH).at(1900 * MS, 1900 * MS)
        assert (isinstance(found, str) and "contradict each other" in found) is is_refused, apart_deg
        if not is_refused:
            grown_rad = math.radians(apart_deg) if apart_deg > math.sqrt(2) else 0.0
            assert_allclose(found.report_std_rad[0], grown_rad, atol=math.radians(0.05))


def test_a_message_outside_the_order_contradicts_nobody():
    stamps = list(range(0, 2 * SECOND, 100 * MS))
    right = gimbal(stamps, [ypr(0.0, -1.0, 0.0)] * len(stamps), earth=True)
    wrong = gimbal(stamps, [ypr(0.0, 1.0, 0.0)] * len(stamps), earth=True, source=GimbalSource.MOUNT_ORIENTATION)
    found = sources(right, wrong, order=(GimbalSource.GIMBAL_DEVICE,)).at(1900 * MS, 1900 * MS)
    assert found.source is GimbalSource.GIMBAL_DEVICE
