"""A live calibration against finite differences, batch least squares and closed forms; and what it refuses."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from aerodft.conventions import SECOND_NS
from aerodft.geometry import camera_pose, intrinsics_covariance, matrix, pixels_from_rays, reproject
from aerodft.model import (
    BiasValues,
    Calibration,
    CameraStd,
    GeoOrigin,
    HeightSource,
    Observation,
    PoseBatch,
    PoseSample,
    PoseStd,
    Status,
    SurveyedLandmark,
)
from aerodft.service import (
    AttitudeSettings,
    ErrorStd,
    HeightSettings,
    LiveCalibration,
    PipelineSettings,
    TelemetrySettings,
)
from aerodft.sim import default_camera
from calibration.flight import BiasCalibrator
from calibration.live import BiasModel, LiveCalibrator
from tests.nights import at_night

DEG = math.pi / 180
CAMERA = default_camera(1920, 1080)
ORIGIN = GeoOrigin(lat_rad=0.8, lon_rad=0.2, alt_msl_m=100.0)
STD = PoseStd(
    height_agl_m=1.0, horizontal_m=2.0, tilt_rad=DEG, pan_rad=DEG, roll_rad=DEG, heading_rad=2 * DEG, time_s=0.05
)
PLACES = {"a": (5.0, 35.0, 0.0), "b": (-10.0, 48.0, 0.5), "c": (15.0, 58.0, 0.0)}
STEADY = ErrorStd(height_agl_m=0.0, horizontal_m=0.0, tilt_rad=0.0, pan_rad=0.0, roll_rad=0.0, heading_rad=0.0)
CERTAIN = {"noise_share": 0.0, "drift": STEADY, "outlier_fraction": 0.0}
"""What makes the filter a least squares problem."""


def landmarks(std_m=0.0):
    return tuple(
        SurveyedLandmark(name=name, position_enu_m=place, std_m=(std_m,) * 3) for name, place in PLACES.items()
    )


def settings(camera=CAMERA, **rest):
    order = (HeightSource.RANGEFINDER, HeightSource.HOME)
    height = HeightSettings(order=order, std_m={HeightSource.RANGEFINDER: 0.3, HeightSource.HOME: STD.height_agl_m})
    telemetry = TelemetrySettings(height=height, attitude=AttitudeSettings(std=STD))
    return PipelineSettings(
        station="s", camera=camera, probes=(), telemetry=telemetry, origin=ORIGIN, time_std_s=STD.time_s, **rest
    )


def calibrator(*, std_m=0.0, start=None, camera=CAMERA, **live):
    return LiveCalibrator(LiveCalibration(landmarks=landmarks(std_m), **live), settings(camera), start)


def sample(at_s=0.0, *, heading_deg=0.0, tilt_deg=50.0, **rest):
    """What the telemetry says at a time."""
    pose = camera_pose(height_agl_m=40.0, tilt_rad=tilt_deg * DEG, roll_rad=DEG, heading_rad=heading_deg * DEG, std=STD)
    pose = replace(pose, velocity_enu_mps=np.array([3.0, -1.0, 0.5]), rate_cam_radps=np.array([0.02, -0.1, 0.05]))
    return PoseSample(
        stamp_ns=round(at_s * SECOND_NS),
        status=Status.OK,
        pose=pose,
        std=STD,
        origin=ORIGIN,
        lat_rad=ORIGIN.lat_rad,
        lon_rad=ORIGIN.lon_rad,
        height_source=HeightSource.HOME,
        **rest,
    )


def model(**live):
    return BiasModel.from_settings(LiveCalibration(landmarks=(), **live), settings().telemetry, STD.time_s, None)


def now(calibrator, poses):
    return calibrator.refine(poses, [calibrator.known()], np.zeros(len(poses), dtype=np.int64))


def refined_by(calibrator, given):
    return now(calibrator, PoseBatch.from_samples([given]))[0]


def corrected(given, biases):
    return model().with_biases(PoseBatch.from_samples([given])).row(0).corrected(biases)


def moved(of, given, biases):
    """Position and rotation (a vector in camera axes) from the pose by ``of`` to that by ``biases``."""
    start, end = (corrected(given, each) for each in (of, biases))
    turn = Rotation.from_quat(start.wxyz, scalar_first=True).inv() * Rotation.from_quat(end.wxyz, scalar_first=True)
    return np.append(end.position_enu_m - start.position_enu_m, turn.as_rotvec())


def seen(name, at_s, pixel, std_px=1.0):
    stamp_ns = round(at_s * SECOND_NS)
    return Observation(name=name, stamp_ns=stamp_ns, arrival_ns=stamp_ns, pixels=(tuple(pixel),), std_px=std_px)


def truly_at(given, biases, name):
    """The pixel of a landmark where the telemetry is wrong by ``biases``."""
    pose = corrected(given, np.asarray(biases))
    return pixels_from_rays(CAMERA, (np.array(PLACES[name]) - pose.position_enu_m) @ matrix(pose.wxyz))


WRONG = np.array([0.0, 0.8, 0.9 * DEG, -0.5 * DEG, 0.4 * DEG, 1.5 * DEG, 1.2, -0.7, 0.02])


def test_poses_depend_on_biases_as_finite_differences_say():
    given = sample(heading_deg=70.0)
    follows = np.eye(6)
    follows[2, :2] = 0.2, -0.1  # a height that is counted from sloping ground goes with the place
    given = replace(given, pose=replace(given.pose, cov=follows @ given.pose.cov @ follows.T))
    step = 1e-6
    by = model().with_biases(PoseBatch.from_samples([given])).row(0).by_biases(WRONG, corrected(given, WRONG).wxyz)
    for column, unit in enumerate(np.eye(len(WRONG))):
        expected = (moved(WRONG, given, WRONG + step * unit) - moved(WRONG, given, WRONG - step * unit)) / (2 * step)
        assert_allclose(by[:, column], expected, atol=2e-5, err_msg=f"bias {column}")


def test_biases_turn_and_raise_as_a_calibration_files_do():
    start = Calibration(
        id="x", bias=BiasValues(height_m=1.5, tilt_rad=1.2 * DEG, roll_rad=-DEG, heading_rad=3 * DEG),
        bias_cov=np.diag([0.3, 0.01, 0.02, 0.03, 0.0, 0.0, 0.0, 0.0]) ** 2,
    )  # fmt: skip
    alone = refined_by(BiasCalibrator(start), sample())
    station = replace(settings(), time_std_s=0.0)
    calibrated = LiveCalibrator(LiveCalibration(landmarks=landmarks(), noise_share=0.0), station, start)
    live = refined_by(calibrated, sample())
    assert_allclose(live.pose.position_enu_m, alone.pose.position_enu_m, atol=1e-12)
    turn = Rotation.from_quat(alone.pose.wxyz, scalar_first=True).inv() * Rotation.from_quat(
        live.pose.wxyz, scalar_first=True
    )
    assert_allclose(turn.as_rotvec(), 0.0, atol=1e-12)
    assert_allclose(live.pose.cov, alone.pose.cov, atol=1e-5)
    assert live.calibration.startswith("live:")


def test_before_the_first_landmark_poses_are_the_telemetrys():
    poses = PoseBatch.from_samples([sample()])
    assert now(calibrator(), poses) is poses


def test_a_pose_that_is_not_ok_passes_unchanged_and_teaches_nothing():
    live = calibrator(start=Calibration(id="x"))
    lost = replace(sample(), pose=None, status=Status.STALE_TELEMETRY, reasons=("no height",))
    poses = PoseBatch.from_samples([lost])
    assert now(live, poses) is poses
    told = live.observe(lost, (seen("a", 0.0, (900.0, 500.0)),))
    assert (told.updates, told.refused, told.height_source) == (0, 1, None)
    assert told.innovations[0].reason == "no pose: STALE_TELEMETRY; no height"
    nowhere = replace(sample(), origin=None)
    told = live.observe(nowhere, (seen("a", 0.0, (900.0, 500.0)),))
    assert told.innovations[0].reason == "no position, so nobody knows where it should be seen"


def test_many_sights_give_what_least_squares_gives():
    """All sights at once, with the priors as residuals, by scipy; its covariance from the Jacobian at the solution.

    So near that one image after the other can be linearised; farther off, coverage over flights is what counts.
    """
    draw, wrong = np.random.default_rng(3), 0.2 * WRONG
    near = ErrorStd(
        height_agl_m=0.2,
        horizontal_m=0.4,
        tilt_rad=0.2 * DEG,
        pan_rad=0.2 * DEG,
        roll_rad=0.2 * DEG,
        heading_rad=0.4 * DEG,
    )
    poses = [sample(second, heading_deg=25 * second - 20, tilt_deg=45 + 3 * second) for second in range(4)]
    sights = []
    for told_pose in poses:
        for name in PLACES:
            pixel = truly_at(told_pose, wrong, name) + draw.normal(0, 0.5, 2)
            if np.all((pixel > 0) & (pixel < [1919, 1079])):
                sights.append((told_pose, name, pixel))
    assert len(sights) >= 8
    prior = np.sqrt(np.diag(model(initial=near).cov))
    free = prior > 0

    def residuals(scaled):
        biases = np.zeros(len(WRONG))
        biases[free] = scaled * prior[free]
        off = [(truly_at(at, biases, name) - pixel) / 0.5 for at, name, pixel in sights]
        return np.concatenate([*off, scaled])

    best = least_squares(residuals, np.zeros(np.count_nonzero(free)), x_scale=1.0, xtol=1e-14, ftol=1e-14)
    cov = np.linalg.inv(best.jac.T @ best.jac)
    live = calibrator(initial=near, **CERTAIN)
    for told_pose in poses:
        of_image = tuple(seen(n, g.stamp_ns / SECOND_NS, p, 0.5) for g, n, p in sights if g is told_pose)
        told = live.observe(told_pose, of_image)
    names = ("height_m", "tilt_rad", "pan_rad", "roll_rad", "heading_rad", "east_m", "north_m", "time_s")
    got = np.array([[getattr(told.bias, name), getattr(told.std, name)] for name in names])
    want = np.column_stack([best.x, np.sqrt(np.diag(cov))])[1:] * prior[1:, None]
    assert_allclose(got[:, 1], want[:, 1], rtol=0.02)
    assert_allclose((got[:, 0] - want[:, 0]) / want[:, 1], 0.0, atol=0.1)
    assert told.refused == 0


def test_what_was_learned_fades_into_what_the_telemetry_states():
    live = calibrator(noise_share=0.1)
    live.observe(sample(), tuple(seen(n, 0.0, truly_at(sample(), WRONG, n)) for n in PLACES))
    soon, late = now(live, PoseBatch.from_samples([sample(0.1), sample(1e7)]))
    assert soon.std.tilt_rad < 0.9 * STD.tilt_rad
    for name in ("height_agl_m", "tilt_rad", "pan_rad", "roll_rad", "heading_rad"):
        assert getattr(late.std, name) == pytest.approx(getattr(STD, name), rel=1e-6), name
    assert late.std.time_s < STD.time_s + 1e-12
    assert_allclose(late.pose.position_enu_m[2], 40.0, atol=1.0)


def test_seeing_one_marker_hundreds_of_times_does_not_make_its_place_known():
    """A place that is off by 0.5 m stays so: hovering above it tells east minus its error, never east alone."""
    above = replace(sample(), pose=replace(sample(tilt_deg=0.0).pose, position_enu_m=np.array([5.0, 35.0, 40.0])))
    above = replace(above, pose=replace(above.pose, velocity_enu_mps=np.zeros(3), rate_cam_radps=np.zeros(3)))
    stds = {}
    for std_m in (0.0, 0.5):
        live = calibrator(std_m=std_m, **CERTAIN)
        for number in range(300):
            at = replace(above, stamp_ns=number * SECOND_NS)
            told = live.observe(at, (seen("a", float(number), (959.5, 539.5)),))
        # Its pixel ties east to the landmark and to what turns the camera sideways, nothing else does.
        sideways = 40.0 * STD.pan_rad
        known = math.hypot(std_m, sideways)
        stds[std_m] = told.std.east_m
        assert told.std.east_m == pytest.approx(1 / math.hypot(1 / STD.horizontal_m, 1 / known), rel=0.02)
    assert stds[0.5] > stds[0.0]


LENS = replace(CAMERA, std=CameraStd(focal_px=20.0, principal_point_px=10.0))


def test_the_lens_is_considered_and_not_estimated():
    """Height and focal length are not told apart: the pose's std stays large, and goes with the lens's errors."""
    live, exact = calibrator(camera=LENS, **CERTAIN), calibrator(**CERTAIN)
    for number in range(50):
        given = sample(number / 10)
        sights = tuple(seen(n, number / 10, truly_at(given, np.zeros(9), n)) for n in PLACES)
        live.observe(given, sights)
        exact.observe(given, sights)
    refined = refined_by(live, sample(6.0))
    pose, lens_cov = refined.pose, intrinsics_covariance(LENS)
    assert refined.std.tilt_rad > 1.2 * refined_by(exact, sample(6.0)).std.tilt_rad
    joint = np.block([[pose.cov, pose.lens_cov], [pose.lens_cov.T, lens_cov]])
    assert np.linalg.eigvalsh(joint)[0] > -1e-9
    by = reproject(LENS, pose.position_enu_m, matrix(pose.wxyz), np.array(PLACES["b"]))
    together, lens_alone = np.hstack([-by.jac_point, by.jac_rotation, by.jac_intrinsics]), by.jac_intrinsics
    stds = [np.sqrt(np.diag(each)) for each in (together @ joint @ together.T, lens_alone @ lens_cov @ lens_alone.T)]
    assert np.all(stds[0] < 0.5 * stds[1])


@pytest.mark.parametrize(("draws", "within"), [(25, 0.25), *at_night((80, 0.15))])
def test_with_an_uncertain_lens_the_biases_are_off_by_what_they_say(draws, within):
    draw, scores = np.random.default_rng(8), []
    prior = np.sqrt(np.diag(model(noise_share=0.0).cov))
    for _ in range(draws):
        wrong = prior * draw.standard_normal(len(prior))
        wrong[-1] = 0.0
        fx_px = CAMERA.fx_px + 20.0 * draw.standard_normal()
        cx_px, cy_px = np.array([CAMERA.cx_px, CAMERA.cy_px]) + 10.0 * draw.standard_normal(2)
        true = replace(CAMERA, fx_px=fx_px, fy_px=fx_px, cx_px=cx_px, cy_px=cy_px)
        live = calibrator(camera=LENS, **CERTAIN)
        for number in range(6):
            given = sample(float(number), heading_deg=8.0 * number - 20)
            pose = corrected(given, wrong)
            sights = []
            for name, place in PLACES.items():
                pixel = pixels_from_rays(true, (np.array(place) - pose.position_enu_m) @ matrix(pose.wxyz))
                sights.append(seen(name, float(number), pixel + draw.standard_normal(2)))
            told = live.observe(given, tuple(sights))
        for name, truth in zip(("height_m", "tilt_rad", "heading_rad", "east_m"), wrong[[1, 2, 5, 6]], strict=True):
            scores.append((getattr(told.bias, name) - truth) / getattr(told.std, name))
    rms = np.sqrt(np.mean(np.square(scores)))
    assert abs(rms - 1) < within


def test_an_image_in_which_all_landmarks_are_seen_shares_its_noise():
    """Noise of 0.3 deg in the tilt of one image is in all of its landmarks: a second one teaches nothing about it."""
    one, many = (calibrator(noise=ErrorStd(tilt_rad=0.3 * DEG), drift=STEADY, outlier_fraction=0.0) for _ in range(2))
    given = sample()
    one.observe(given, (seen("a", 0.0, truly_at(given, np.zeros(9), "a"), 0.01),))
    told = many.observe(given, tuple(seen(n, 0.0, truly_at(given, np.zeros(9), n), 0.01) for n in PLACES))
    assert told.updates == 3
    assert told.std.tilt_rad > 0.28 * DEG


def test_what_is_refused_says_why():
    live = calibrator()
    given = sample()
    for number in range(1, 6):
        at = sample(number)
        live.observe(at, tuple(seen(n, number, truly_at(at, WRONG, n)) for n in PLACES))
    at = sample(6.0)
    right = truly_at(at, WRONG, "a")
    told = live.observe(
        at,
        (
            seen("a", 6.0, right + [60.0, 0.0]),
            seen("b", 6.0, (-20.0, 4.0)),
            seen("c", 6.0, truly_at(at, WRONG, "c")),
            seen("c", 6.0, truly_at(at, WRONG, "c")),
        ),
    )
    reasons = {(each.name, each.accepted): each.reason for each in told.innovations}
    assert reasons["c", True] is None
    assert reasons["c", False] == "it was seen in this image already"
    assert reasons["b", False] == "the pixel is outside the image"
    assert reasons["a", False].endswith("sigma from where it is expected, at most 3.7")
    outlier = next(each for each in told.innovations if each.name == "a")
    assert outlier.px[0] == pytest.approx(60.0, abs=5.0)
    assert outlier.chi2 > 13.8
    away = replace(given, stamp_ns=at.stamp_ns + 1, pose=sample(heading_deg=180.0).pose)
    told = live.observe(away, (seen("a", 6.0, (900.0, 500.0)),))
    assert told.innovations[0].reason == "the landmark is out of view: behind the camera, or beyond the lens model"
    assert told.innovations[0].px is None


def test_when_nearly_all_is_refused_the_estimate_begins_anew():
    """A gimbal that slipped by 3 deg: the landmarks are where they were."""
    live = calibrator()
    slipped = WRONG + np.array([0, 0, 3 * DEG, 0, 0, 0, 0, 0, 0])
    for number in range(60):
        at = sample(number / 4)
        wrong = WRONG if number < 30 else slipped
        told = live.observe(at, tuple(seen(n, number / 4, truly_at(at, wrong, n)) for n in PLACES))
    assert told.restarts == 1
    assert told.bias.tilt_rad == pytest.approx(slipped[2], abs=4 * told.std.tilt_rad)


def test_one_early_stray_is_outvoted():
    """The very first sight is 60 px off, as nobody could know then."""
    live = calibrator()
    for number in range(20):
        at = sample(number / 4)
        strayed = [60.0, 0.0] if number == 0 else [0.0, 0.0]
        sights = (seen("a", number / 4, truly_at(at, WRONG, "a") + strayed),)
        if number:
            sights += tuple(seen(n, number / 4, truly_at(at, WRONG, n)) for n in ("b", "c"))
        told = live.observe(at, sights)
    assert abs(told.bias.tilt_rad - WRONG[2]) < 2.5 * told.std.tilt_rad
    assert abs(told.bias.height_m - WRONG[1]) < 2.5 * told.std.height_m


def test_a_late_sight_counts_from_then_on():
    live = calibrator()
    for number in range(5):
        at = sample(number)
        live.observe(at, (seen("a", number, truly_at(at, WRONG, "a")),))
    before = refined_by(live, sample(5.0))
    late = sample(2.5)
    told = live.observe(late, (seen("b", 2.5, truly_at(late, WRONG, "b")),))
    after = refined_by(live, sample(5.0))
    assert told.innovations[0].accepted
    assert after.std.height_agl_m < before.std.height_agl_m
    assert after.calibration != before.calibration


def test_another_height_source_has_a_bias_of_its_own():
    live = calibrator()
    for number in range(20):
        at = sample(number / 2)
        live.observe(at, tuple(seen(n, number / 2, truly_at(at, WRONG, n)) for n in PLACES))
    ranged = replace(sample(10.0), height_source=HeightSource.RANGEFINDER, std=replace(STD, height_agl_m=0.3))
    home, other = now(live, PoseBatch.from_samples([sample(10.0), ranged]))
    assert home.pose.position_enu_m[2] == pytest.approx(40.0 + WRONG[1] + 0.5 * WRONG[-1], abs=0.5)
    assert home.std.height_agl_m < 0.5 * STD.height_agl_m
    assert other.std.height_agl_m == pytest.approx(0.3, rel=0.05)
    assert other.pose.position_enu_m[2] == pytest.approx(40.0, abs=0.1)


def test_the_corrected_place_is_where_the_map_shows_it():
    live = calibrator()
    for number in range(20):
        at = sample(number / 2)
        live.observe(at, tuple(seen(n, number / 2, truly_at(at, WRONG, n)) for n in PLACES))
    refined = refined_by(live, sample(10.0))
    metres_per_rad = 6.37e6
    north_m = (refined.lat_rad - ORIGIN.lat_rad) * metres_per_rad
    assert north_m == pytest.approx(refined.pose.position_enu_m[1], rel=0.01)


sightings = st.lists(
    st.tuples(
        st.sampled_from(sorted(PLACES)),
        st.floats(-5.0, 20.0),
        st.tuples(st.floats(-3e3, 3e3), st.floats(-3e3, 3e3)),
        st.sampled_from([0.0, 0.01, 1.0]),
        st.floats(1e-12, 1e6),
    ),
    max_size=25,
)


@hypothesis_settings(deadline=None)  # how long it takes is for the machine to say
@given(sightings, st.sampled_from([0.0, 0.3]), st.sampled_from([0.0, 0.1]))
def test_whatever_is_seen_the_estimate_stays_one(observed, std_m, outlier_fraction):
    """Any pixels, any stated precision, in any order of time: finite, and never less certain than telemetry alone."""
    live = calibrator(std_m=std_m, outlier_fraction=outlier_fraction)
    for name, at_s, off_px, share, std_px in observed:
        image = sample(at_s, heading_deg=3 * at_s)
        pixel = truly_at(image, WRONG, name) + share * np.array(off_px)
        if np.all(np.isfinite(pixel)):
            told = live.observe(image, (seen(name, at_s, pixel, std_px),))
            assert told.updates + told.refused > 0
    refined = refined_by(live, sample(20.0))
    assert np.all(np.isfinite(refined.pose.cov))
    assert np.linalg.eigvalsh(refined.pose.cov)[0] > -1e-12
    for name in ("height_agl_m", "tilt_rad", "pan_rad", "roll_rad", "heading_rad"):
        assert getattr(refined.std, name) <= 1.5 * getattr(STD, name), name
