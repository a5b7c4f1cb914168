"""A watched camera: what looks come to, how long that takes, and whether what is stated of the pose is true."""

import math
from dataclasses import replace

import numpy as np
import pytest

from aerodft.dft import Request, Setup
from aerodft.geometry import (
    RelativeRotation,
    camera_pose,
    find_rotation,
    from_rotation_vector,
    inverse,
    matrix,
    multiply,
    pixels_from_rays,
    rays_from_pixels,
    rotated_pixels,
    to_rotation_vector,
)
from aerodft.model import (
    FIXED_POINTS,
    Camera,
    CameraStd,
    MotionState,
    Observation,
    PoseBatch,
    PoseSample,
    PoseStd,
    Probe,
    ProbeKind,
    Status,
)
from aerodft.service import CameraMotionSettings, PipelineSettings
from calibration.camera_motion import CameraMotionCalibrator, CameraMotionState, KnownTurn, Look, rotated_pose
from tests.nights import at_night
from tests.one_image import measure

CAMERA = Camera(
    name="c",
    width_px=1920,
    height_px=1080,
    fx_px=1590.0,
    fy_px=1600.0,
    cx_px=970.0,
    cy_px=530.0,
    distortion=(-0.18, 0.06, 0.0012, -0.0007),
)
STD = PoseStd(height_agl_m=0.02, tilt_rad=0.001, pan_rad=0.001, roll_rad=0.001)
FIXED = PoseSample(
    stamp_ns=0,
    status=Status.OK,
    pose=camera_pose(height_agl_m=8.0, tilt_rad=math.radians(62), heading_rad=2.2, std=STD),
    std=STD,
)
WIDTH = Probe(name="w", kind=ProbeKind.DISTANCE, pixels=((410.0, 720.0), (1630.0, 705.0)), std_px=0.5)
SECOND_NS = 1_000_000_000
START_NS = 1_795_221_168 * SECOND_NS
NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


class Station:
    """A watched camera that looks once a second; ``turn`` is what it has turned by in truth, ``later_SO3_earlier``."""

    def __init__(self, seed=0, noise_px=0.1, shake_deg=0.0, camera=CAMERA, **watch):
        self.rng = np.random.default_rng(seed)
        self.calibrator = CameraMotionCalibrator(
            CameraMotionSettings(**watch), PipelineSettings(station="s", camera=camera, probes=(), config_id="sha256:1")
        )
        self.places = self.rng.uniform([40, 40], [1880, 1040], size=(60, 2)).round()
        self.noise_px, self.shake_rad, self.seconds = noise_px, math.radians(shake_deg), 0
        self.in_truth = NO_TURN

    @property
    def stamp_ns(self):
        return START_NS + self.seconds * SECOND_NS

    def shaken(self, turn):
        return multiply(from_rotation_vector(self.rng.normal(scale=self.shake_rad, size=3)), turn)

    def look(self, turn=NO_TURN):
        self.in_truth = self.shaken(turn)
        now = rotated_pixels(CAMERA, self.in_truth, self.places) + self.rng.normal(scale=self.noise_px, size=(60, 2))
        now[:6] += self.rng.normal(scale=20, size=(6, 2))
        inside = np.all((now > 0) & (now < [1919, 1079]), axis=-1)
        return self.see(self.places[inside], now[inside])

    def see(self, then=(), now=()):
        flat = np.stack([np.reshape(then, (-1, 2)), np.reshape(now, (-1, 2))], axis=1).reshape(-1, 2)
        self.seconds += 1
        seen = Observation(
            name=FIXED_POINTS, stamp_ns=self.stamp_ns, arrival_ns=self.stamp_ns, pixels=tuple(map(tuple, flat.tolist()))
        )
        assert self.calibrator.fits(seen)
        return self.calibrator.observe(replace(FIXED, stamp_ns=self.stamp_ns), (seen,))

    def pose(self, later_s=0.5):
        given = replace(FIXED, stamp_ns=self.stamp_ns + round(later_s * SECOND_NS))
        return self.calibrator.refine(PoseBatch.from_samples([given]), [self.calibrator.known()], np.array([0]))[0]


def bump(angle_deg, seed=0):
    axis = np.random.default_rng(seed).normal(size=3)
    return from_rotation_vector(math.radians(angle_deg) * axis / np.linalg.norm(axis))


def width(sample, pixels=WIDTH.pixels):
    return measure(Setup(camera=CAMERA), sample, (Request(probe=WIDTH, pixels=pixels, std_px=0.5),))[0]


def true_width(turn):
    pose = replace(FIXED.pose, wxyz=multiply(FIXED.pose.wxyz, inverse(turn)))
    return width(replace(FIXED, pose=pose)).value


def test_before_the_first_look_nothing_changes():
    np.testing.assert_array_equal(Station().pose().pose.wxyz, FIXED.pose.wxyz)
    np.testing.assert_array_equal(Station().pose().pose.cov, FIXED.pose.cov)
    assert Station().pose().reasons == ()


@pytest.mark.parametrize("angle_deg", [0.3, 2.0, 8.0])
def test_a_bump_is_said_within_three_looks_and_the_numbers_go_on(angle_deg):
    station, turn = Station(), bump(angle_deg)
    before = [station.look().state for _ in range(20)]
    assert set(before) == {MotionState.STEADY}
    assert station.pose().reasons == ()
    states, statuses = [], []
    for _ in range(5):
        states.append(station.look(turn).state)
        statuses.append(station.pose().status)
    assert states == [MotionState.MOVING] * 2 + [MotionState.MOVED] * 3
    assert statuses == [Status.CAMERA_MOVED] * 2 + [Status.OK] * 3
    said = width(station.pose())
    assert said.status is Status.OK
    (reason,) = said.reasons
    assert reason.startswith(f"CAMERA_MOVED: turned by {angle_deg:.2f} deg since 2026-11-21T00:33:09Z")
    assert said.ci95[0] < true_width(turn) < said.ci95[1]
    assert abs(said.value - true_width(turn)) < 0.003 * said.value
    assert said.calibration.startswith("watch:")


def test_while_a_camera_moves_there_is_no_number_but_a_reason():
    station = Station()
    for _ in range(10):
        station.look()
    for index in range(6):
        assert station.look(bump(3.0 + 2.0 * index)).state is MotionState.MOVING
        said = width(station.pose())
        assert (said.status, said.value) == (Status.CAMERA_MOVED, None)
        assert "is not known yet" in said.reasons[0]


def test_one_look_elsewhere_is_forgotten():
    station = Station()
    for _ in range(10):
        station.look()
    assert station.look(bump(5.0)).state is MotionState.MOVING
    assert station.look().state is MotionState.STEADY
    assert station.pose().reasons == ()


def test_a_camera_that_is_put_back_is_steady_again():
    station = Station()
    for turn in [NO_TURN] * 10 + [bump(2.0)] * 10:
        estimate = station.look(turn)
    assert (estimate.state, estimate.moved_ns) == (MotionState.MOVED, START_NS + 11 * SECOND_NS)
    for _ in range(4):
        estimate = station.look()
    assert (estimate.state, estimate.moved_ns) == (MotionState.STEADY, None)
    assert station.pose().reasons == ()


def test_the_second_bump_has_a_time_of_its_own():
    station = Station()
    for turn in [NO_TURN] * 10 + [bump(2.0, 1)] * 10 + [bump(3.0, 2)] * 5:
        estimate = station.look(turn)
    assert (estimate.state, estimate.moved_ns) == (MotionState.MOVED, START_NS + 21 * SECOND_NS)


def test_a_slow_drift_is_followed_and_said_once_it_passes_the_limit():
    station, axis = Station(), np.array([0.6, 0.0, 0.8])
    for step in range(60):
        angle_deg = 0.005 * step
        estimate = station.look(from_rotation_vector(math.radians(angle_deg) * axis))
        assert station.pose().status is Status.OK
        assert np.linalg.norm(np.degrees(estimate.turn_rad) + angle_deg * axis) < 0.03
        assert (
            estimate.state is (MotionState.MOVED if angle_deg > 0.24 else MotionState.STEADY) or 0.2 < angle_deg <= 0.24
        )


def test_a_step_below_the_limit_is_corrected_without_a_word():
    station, turn = Station(), bump(0.12)
    for _ in range(20):
        station.look()
    for _ in range(4):
        estimate = station.look(turn)
        assert estimate.state is MotionState.STEADY
    assert np.degrees(np.linalg.norm(estimate.turn_rad)) == pytest.approx(0.12, abs=0.005)
    said = width(station.pose())
    assert said.reasons == ()
    assert said.ci95[0] < true_width(turn) < said.ci95[1]


def straight(rotvec, std_rad=1e-5):
    """A look that tells just that."""
    turn = RelativeRotation(
        from_rotation_vector(rotvec),
        std_rad**2 * np.eye(3),
        np.zeros((3, 4)),
        np.ones(60, bool),
        np.zeros((60, 2)),
        0.1,
    )
    return Look(turn, 60)


@pytest.mark.parametrize("masts", [1, *at_night(4)])
def test_a_mast_in_the_wind_raises_no_alarm_in_thousands_of_looks(masts):
    rng, states = np.random.default_rng(12), set()
    for _ in range(masts):
        state = CameraMotionState(CameraMotionSettings())
        for second in range(2500):
            state.take(START_NS + second * SECOND_NS, straight(rng.normal(scale=math.radians(0.05), size=3)))
            states.add(state.state)
        assert math.sqrt(state.variance_rad2) == pytest.approx(math.radians(0.05), rel=0.25)
    assert states == {MotionState.STEADY}


@pytest.mark.parametrize("stations", [4, *at_night(16)])
def test_turns_are_as_far_off_as_stated_in_the_wind_before_and_after_a_bump(stations):
    z, held = [], 0
    for seed in range(stations):
        station, turn = Station(seed, shake_deg=0.05), bump(2.0, seed)
        for index, now in enumerate([NO_TURN] * 12 + [turn] * 12):
            estimate = station.look(now)
            if index % 12 >= 4:
                in_image = station.shaken(now)
                hat = inverse(from_rotation_vector(np.array(estimate.turn_rad)))
                z.append(to_rotation_vector(multiply(in_image, inverse(hat))) / estimate.std_rad)
                said = width(station.pose())
                held += said.ci95[0] < true_width(in_image) < said.ci95[1]
    assert 0.75 < np.std(z) < 1.1
    assert held >= 0.95 * len(z)


def test_darkness_keeps_the_numbers_says_so_and_trusts_them_less_by_the_hour():
    station, turn = Station(), bump(2.0)
    for now in [NO_TURN] * 5 + [turn] * 30:
        station.look(now)
    light = width(station.pose())
    states = [station.see().state for _ in range(3)]
    assert states == [MotionState.MOVED, MotionState.MOVED, MotionState.UNCHECKED]
    dusk, night = width(station.pose()), width(station.pose(9 * 3600.0))
    assert dusk.status is Status.OK
    assert dusk.value == night.value == light.value
    assert dusk.reasons[0].startswith("CAMERA_MOVED: turned by 2.00 deg")
    assert "no steady points were recognised for" in dusk.reasons[1]
    added = math.sqrt(night.pose.std.tilt_rad**2 - light.pose.std.tilt_rad**2)
    assert math.degrees(added) == pytest.approx(0.6, rel=0.01)  # the limit of 0.2 deg, times the square root of 9 h
    assert night.std > 2 * light.std
    assert station.look(turn).state is MotionState.MOVED
    assert len(width(station.pose()).reasons) == 1


def test_a_station_that_starts_in_the_dark_says_that_nothing_is_known():
    station = Station()
    station.see()
    assert station.pose().reasons == ()
    station.see()
    station.see()
    np.testing.assert_array_equal(station.pose().pose.cov, FIXED.pose.cov)
    assert "recognised yet" in station.pose().reasons[0]


def displaced(places, shift_m):
    """Where the ground's points are seen by the same camera in another place."""
    pose = FIXED.pose
    rotation = matrix(pose.wxyz)
    rays = rays_from_pixels(CAMERA, places) @ rotation.T
    ground = -rays * (pose.position_enu_m[2] / rays[:, 2:])
    return pixels_from_rays(CAMERA, (ground - np.asarray(shift_m)) @ rotation)


@pytest.mark.parametrize("shift_m", [(0.5, 0.0, 0.0), (0.0, 0.0, 0.7), (-0.6, 0.6, 0.2)])
def test_a_camera_that_was_carried_away_is_not_taken_for_one_that_turned(shift_m):
    station = Station()
    for _ in range(10):
        station.look()
    now = displaced(station.places, shift_m)
    inside = np.all((now > 0) & (now < [1919, 1079]), axis=-1)
    for _ in range(5):
        noisy = now[inside] + station.rng.normal(scale=0.1, size=(inside.sum(), 2))
        estimate = station.see(station.places[inside], noisy)
    assert estimate.state is MotionState.UNKNOWN_VIEW
    said = width(station.pose())
    assert (said.status, said.value) == (Status.CAMERA_MOVED, None)
    assert "calibrate it anew" in said.reasons[0]


def test_the_lens_goes_along_with_the_bump_as_far_as_its_lever():
    station = Station(lever_arm_m=0.5)
    for turn in [NO_TURN] * 5 + [bump(8.0)] * 5:
        station.look(turn)
    assert station.pose().pose.cov[2, 2] == pytest.approx(
        0.02**2 + (2 * 0.5 * math.sin(math.radians(4.0))) ** 2, rel=1e-3
    )


def test_pose_and_lens_are_off_together_as_stated():
    camera = replace(CAMERA, std=CameraStd(focal_px=12.0, principal_point_px=6.0))
    rng, rotvec, off, lens = np.random.default_rng(3), np.array([0.08, -0.1, 0.06]), [], []
    places = rng.uniform([300, 200], [1600, 900], size=(50, 2))
    hat = None
    for _ in range(200):
        share, du, dv = rng.normal(size=3) * [12.0, 6.0, 6.0]
        fields = {"fx_px": share, "fy_px": share * camera.fy_px / camera.fx_px, "cx_px": du, "cy_px": dv}
        true = replace(camera, **{key: getattr(camera, key) + step for key, step in fields.items()})
        hat = find_rotation(camera, places, rotated_pixels(true, from_rotation_vector(rotvec), places))
        error = to_rotation_vector(multiply(hat.wxyz, from_rotation_vector(-rotvec)))  # of enu_SO3_cam: exp(e) after it
        off.append(error)
        lens.append(list(fields.values()))
    known = KnownTurn(
        from_rotation_vector(rotvec), np.zeros((3, 3)), hat.jac_intrinsics, np.cov(np.array(lens).T), shift_m=0.0
    )
    pose = rotated_pose(camera_pose(height_agl_m=8.0, tilt_rad=1.0), known)
    drawn = np.cov(np.concatenate([off, lens], axis=1).T)
    scale = np.sqrt(np.diag(drawn))
    np.testing.assert_allclose(
        pose.cov[3:, 3:] / np.outer(scale[:3], scale[:3]), drawn[:3, :3] / np.outer(scale[:3], scale[:3]), atol=0.05
    )
    np.testing.assert_allclose(
        pose.lens_cov[3:] / np.outer(scale[:3], scale[3:]), drawn[:3, 3:] / np.outer(scale[:3], scale[3:]), atol=0.05
    )


def test_odd_pixels_are_no_pairs():
    odd = Observation(name=FIXED_POINTS, stamp_ns=1, arrival_ns=1, pixels=((1.0, 2.0),))
    assert not Station().calibrator.fits(odd)
    assert Station().calibrator.observes(FIXED_POINTS)
    assert not Station().calibrator.observes("p1")
