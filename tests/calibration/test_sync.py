"""Alignments against flights whose clocks are known."""

from dataclasses import replace

import numpy as np
import pytest

from aerodft.errors import NoAnswerError
from aerodft.geometry import inverse, multiply, to_rotation_vector
from aerodft.model import GimbalSource, ReportFrame
from aerodft.service import AttitudeSettings, FixedMount
from aerodft.service.attitude import AttitudeHistory, AttitudeSeries
from aerodft.sim.trajectory import heading_wxyz
from aerodft.vision.camera_motion import PlaneMotion, Turns
from calibration.sync import align
from calibration.sync.motion import CameraMotion, integrated_path
from tests.nights import at_night

from .sync_flights import Clocks, hovering, wandering
from .sync_views import reported, seen_flight

SETTINGS = AttitudeSettings()
CLIP_S, MARGIN_S = 45.0, 15.0


def filmed(trajectory, clocks, seed):
    """Pairs by the video's clock, and the reference at which the offset holds."""
    start = trajectory.start_ns + round(MARGIN_S * 1e9)
    utc = start + np.arange(0, round(CLIP_S * 1e9), 200_000_000)
    middle = int((utc[0] + utc[-1]) // 2)
    return seen_flight(trajectory, utc, clocks.video_ns(utc, middle), seed), middle - round(clocks.offset_s * 1e9)


def errors(found, clocks, reference_ns):
    offset_s = clocks.offset_s + clocks.drift * (found.reference_ns - reference_ns) / 1e9
    return np.array([found.offset_s, found.drift, found.lag_s]) - [offset_s, clocks.drift, clocks.lag_s]


@pytest.mark.parametrize("seed", [1, *at_night(2)])
def test_offset_drift_and_lag_are_found_from_far_away(seed):
    clocks, trajectory = Clocks.drawn(seed), wandering(seed, CLIP_S + 2 * MARGIN_S)
    pairs, reference_ns = filmed(trajectory, clocks, seed)
    found = align(pairs, reported(trajectory, lag_s=clocks.lag_s, noise_rad=3e-4, seed=seed), SETTINGS, 20.5)
    off = errors(found, clocks, reference_ns)
    assert found.is_lag_determined
    assert np.all(np.abs(off) < [0.01, 5e-4, 0.01]), off
    assert np.all(np.abs(off) < 3 * found.stds), off / found.stds
    rates = found.rates
    covered = np.isfinite(rates.logged_radps[:, 0])
    assert np.mean(covered) > 0.9
    left = rates.seen_radps[covered] - rates.logged_radps[covered]
    assert np.median(np.abs(left)) < 0.2 * np.std(rates.seen_radps)


@pytest.mark.parametrize("time_constant_s", [0.25, *at_night(0.12)])
def test_a_camera_that_catches_up_slowly_is_known_as_such(time_constant_s):
    clocks, trajectory = Clocks(-8.0, 0.006, 0.25), wandering(8, CLIP_S + 2 * MARGIN_S)
    pairs, reference_ns = filmed(trajectory, clocks, 8)
    log = reported(trajectory, lag_s=clocks.lag_s, time_constant_s=time_constant_s, noise_rad=1e-3, seed=8)
    found = align(pairs, log, SETTINGS, 10.0)
    off = errors(found, clocks, reference_ns)
    assert np.all(np.abs(off) < [0.01, 5e-4, 0.015]), off
    assert np.all(np.abs(off) < 3 * found.stds), off / found.stds
    assert abs(found.time_constant_s - time_constant_s) < 0.05
    assert found.lateness_s > found.time_constant_s


@pytest.mark.nightly
def test_a_log_with_a_hole_is_aligned_by_what_is_there():
    clocks, trajectory = Clocks(2.0, -0.01, 0.1), wandering(10, CLIP_S + 2 * MARGIN_S)
    pairs, reference_ns = filmed(trajectory, clocks, 10)
    whole = reported(trajectory, lag_s=clocks.lag_s, noise_rad=1e-3, seed=10)
    (source, told), middle_ns = next(iter(whole.gimbals.items())), trajectory.start_ns + round(30e9)
    there = np.abs(told.stamp_ns - middle_ns) > 4_000_000_000
    holed = AttitudeSeries(stamp_ns=told.stamp_ns[there], wxyz=told.wxyz[there], yaw_in_earth=told.yaw_in_earth[there])
    found = align(pairs, replace(whole, gimbals={source: holed}), SETTINGS, 10.0)
    off = errors(found, clocks, reference_ns)
    assert np.all(np.abs(off) < [0.01, 5e-4, 0.015]), off
    assert np.all(np.abs(off) < 3 * found.stds), off / found.stds


@pytest.mark.nightly
def test_reports_against_north_leave_the_lag_open_and_the_camera_aligned():
    clocks, trajectory = Clocks(3.0, 0.01, 0.22), wandering(4, CLIP_S + 2 * MARGIN_S)
    pairs, reference_ns = filmed(trajectory, clocks, 4)
    found = align(pairs, reported(trajectory, lag_s=clocks.lag_s, in_earth=True), SETTINGS, 10.0)
    offset, _, lag = errors(found, clocks, reference_ns)
    assert not found.is_lag_determined
    assert found.position_std_s() > 0.05  # the lag's uncertainty is part of the offset's
    assert abs(offset) < 3 * found.position_std_s()
    assert abs(offset - lag) < 0.005
    assert found.attitude_std_s() < 0.01


def test_a_hover_with_a_locked_gimbal_is_refused():
    trajectory = hovering(CLIP_S + 2 * MARGIN_S)
    pairs, _ = filmed(trajectory, Clocks(1.0, 0.0, 0.1), 1)
    with pytest.raises(NoAnswerError, match="too little motion to tell"):
        align(pairs, reported(trajectory, lag_s=0.1, noise_rad=3e-4), SETTINGS, 20.0)


def test_a_video_of_another_flight_is_refused():
    pairs, _ = filmed(wandering(5, CLIP_S + 2 * MARGIN_S), Clocks(0.0, 0.0, 0.1), 5)
    with pytest.raises(NoAnswerError, match=r"not of this flight|about as well"):
        align(pairs, reported(wandering(6, CLIP_S + 2 * MARGIN_S), lag_s=0.1), SETTINGS, 20.0)


def with_focal_error(pairs, share):
    """Pairs as rays of a camera file whose focal length is off by so much."""
    by = 1 / (1 + share)
    return [
        replace(pair, matches=replace(pair.matches, earlier=m.earlier * by, later=m.later * by, px=m.px * by))
        for pair in pairs
        for m in [pair.matches]
    ]


@pytest.mark.parametrize(("seed", "share"), [(3, -0.3), *at_night((1, 0.1), (1, -0.3), (3, 0.3), (1, -0.08))])
def test_a_wrong_focal_length_is_called_that(seed, share):
    """Where an offset is found all the same, and where none is."""
    clocks, trajectory = Clocks(0.4, 0.001, 0.12), wandering(seed, CLIP_S + 2 * MARGIN_S)
    pairs, _ = filmed(trajectory, clocks, seed)
    log = reported(trajectory, lag_s=clocks.lag_s, noise_rad=3e-4, seed=seed)
    with pytest.raises(NoAnswerError, match="the camera file's focal length contradicts the log") as refused:
        align(with_focal_error(pairs, share), log, SETTINGS, 2.0)
    fitting = float(refused.value.got.split()[-4])
    assert fitting == pytest.approx(1 / (1 + share), rel=0.06)
    if abs(share) <= 0.1:
        assert align(with_focal_error(pairs, share), log, SETTINGS, 2.0, 0.1).offset_s == pytest.approx(0.4, abs=0.05)


def test_a_wrong_mount_is_called_that():
    clocks, trajectory = Clocks(0.3, 0.0, 0.0), wandering(7, CLIP_S + 2 * MARGIN_S)
    pairs, _ = filmed(trajectory, clocks, 7)
    stamps, _, gimbal = true_attitudes(trajectory)
    bolted = AttitudeHistory(vehicle=series(stamps, gimbal, in_earth=True), gimbals={}, frames={})
    mount = FixedMount(yaw_rad=0.0, pitch_rad=np.radians(-75.0), roll_rad=0.0)
    settings = AttitudeSettings(order=(GimbalSource.FIXED_MOUNT,), fixed_mount=mount)
    with pytest.raises(NoAnswerError, match="fixed_mount contradicts the video: got yaw 0, pitch -75") as refused:
        align(pairs, bolted, settings, 2.0)
    assert "yaw 0, pitch 0 deg" in refused.value.expected


def test_what_is_not_there_is_named():
    trajectory = wandering(1, CLIP_S + 2 * MARGIN_S)
    pairs, _ = filmed(trajectory, Clocks(0.0, 0.0, 0.1), 1)
    with pytest.raises(NoAnswerError, match="at least 25"):
        align(pairs[:10], reported(trajectory, lag_s=0.1), SETTINGS, 5.0)
    nothing = AttitudeHistory(vehicle=None, gimbals={}, frames={})
    with pytest.raises(NoAnswerError, match="no camera attitude in the log"):
        align(pairs, nothing, SETTINGS, 5.0)
    mounts = AttitudeSettings(order=(GimbalSource.MOUNT_STATUS,))
    with pytest.raises(
        NoAnswerError, match="got GIMBAL_DEVICE_ATTITUDE_STATUS, ATTITUDE, expected one of MOUNT_STATUS"
    ):
        align(pairs, reported(trajectory, lag_s=0.1), mounts, 5.0)
    with pytest.raises(NoAnswerError, match="do not overlap in time"):
        align(pairs, reported(trajectory.shifted(500_000_000_000), lag_s=0.1), SETTINGS, 5.0)


def true_attitudes(trajectory):
    """Stamps at 20 Hz, ``ned_SO3_body`` and ``ned_SO3_gimbal`` there."""
    stamps = np.arange(trajectory.start_ns, trajectory.end_ns, 50_000_000, dtype=np.int64)
    at = trajectory.at(stamps)
    return stamps, at.ned_wxyz_body, multiply(heading_wxyz(at.ned_wxyz_body), at.level_wxyz_gimbal)


def series(stamps, wxyz, *, in_earth):
    return AttitudeSeries(stamp_ns=stamps, wxyz=wxyz, yaw_in_earth=np.full(len(stamps), float(in_earth)))


def test_a_camera_that_is_bolted_to_the_vehicle_has_no_lag():
    clocks, trajectory = Clocks(-6.0, 0.004, 0.0), wandering(7, CLIP_S + 2 * MARGIN_S)
    pairs, reference_ns = filmed(trajectory, clocks, 7)
    stamps, _, gimbal = true_attitudes(trajectory)
    bolted = AttitudeHistory(vehicle=series(stamps, gimbal, in_earth=True), gimbals={}, frames={})
    mount = FixedMount(yaw_rad=0.0, pitch_rad=0.0, roll_rad=0.0)
    found = align(pairs, bolted, AttitudeSettings(order=(GimbalSource.FIXED_MOUNT,), fixed_mount=mount), 10.0)
    offset, drift, lag = errors(found, clocks, reference_ns)
    assert (found.lag_s, lag, found.is_lag_determined) == (0.0, 0.0, True)
    assert abs(offset) < 0.005
    assert abs(drift) < 2e-4


@pytest.mark.nightly
def test_reports_against_the_vehicle_are_read_as_such():
    clocks, trajectory = Clocks(4.0, -0.012, 0.0), wandering(9, CLIP_S + 2 * MARGIN_S)
    pairs, reference_ns = filmed(trajectory, clocks, 9)
    stamps, body, gimbal = true_attitudes(trajectory)
    history = AttitudeHistory(
        vehicle=series(stamps, body, in_earth=True),
        gimbals={GimbalSource.MOUNT_STATUS: series(stamps, multiply(inverse(body), gimbal), in_earth=False)},
        frames={GimbalSource.MOUNT_STATUS: ReportFrame.BODY},
    )
    offset, drift, lag = errors(align(pairs, history, SETTINGS, 10.0), clocks, reference_ns)
    assert abs(offset) < 0.005
    assert abs(lag) < 0.005
    assert abs(drift) < 2e-4


def test_a_turn_that_no_plane_explains_is_not_believed():
    trajectory = wandering(1, 20.0)
    camera = CameraMotion(reported(trajectory, lag_s=0.0), SETTINGS, trajectory.start_ns)
    utc = trajectory.start_ns + np.arange(2_000_000_000, 18_000_000_000, 200_000_000)
    pairs = seen_flight(trajectory, utc, utc, 1)
    at = trajectory.at(utc).enu_wxyz_cam
    turns_rad = to_rotation_vector(multiply(inverse(at[:-1]), at[1:]))
    chi2 = np.ones(len(pairs))
    turns_rad[30:40] += 0.02  # land and water as one
    chi2[30:40] = 500.0
    motion = PlaneMotion(
        start_ns=utc[:-1],
        end_ns=utc[1:],
        homography=np.tile(np.eye(3), (len(pairs), 1, 1)),
        cov=np.tile(np.eye(8), (len(pairs), 1, 1)),
    )
    turns = Turns(rotvec_rad=turns_rad, cov_rad2=np.tile(1e-8 * np.eye(3), (len(pairs), 1, 1)), chi2=chi2)
    path = integrated_path(pairs, motion, turns, camera, np.zeros(3), trajectory.start_ns)
    times_s = (utc - trajectory.start_ns) / 1e9
    off_rad = np.linalg.norm(to_rotation_vector(multiply(inverse(path.at(times_s)), at)), axis=-1)
    assert np.max(off_rad) < 0.005  # it was 0.35 of ten such turns
    seen = path.sees((times_s[:-1] + times_s[1:]) / 2)
    assert seen.tolist() == (chi2 == 1.0).tolist()
    assert path.stray_rad(times_s)[35] > 50 * path.stray_rad(times_s)[5]
