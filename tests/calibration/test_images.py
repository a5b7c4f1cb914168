"""Biases of telemetry from many images, against simulated flights whose truth OpenCV projects."""

import math
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.model import BIASES, Landmark, Prior, ProjectionModel, SlantRange
from calibration.descent import NormalEquations
from calibration.flight import calibrate_images
from calibration.flight.result import ImagesProblem, solve_images
from calibration.flight.state import OWN, ImagesState, SharedUnknowns
from calibration.pose import LIMIT, start_state

from .image_flights import CAMERA, DEG, NOISE, SHARE, STD, Flight, drawn

SHARED = math.sqrt(1 - SHARE**2)
PRIORS = {name: Prior(value=0.0, std=SHARED * std) for name, std in STD.items()}
VAGUE = {name: Prior(value=0.0, std=1e4 * std) for name, std in STD.items()}
ASKED = ("height", "tilt", "roll", "heading", "time")
PINHOLE = ProjectionModel.PINHOLE
SCENES = 70
STILL = {"speed_mps": 0.0, "turn_radps": 0.0}
EXACT = {"std_px": 0.0, "noise": np.zeros(OWN)}


def without(priors, *names):
    return {name: prior for name, prior in priors.items() if name not in names}


def found(result):
    return {name: result.solution.state.value(name) for name in result.names}


def stds(result):
    return dict(zip(result.names, np.sqrt(np.diag(result.solution.covariance)).tolist(), strict=True))


def test_what_is_exact_is_found_exactly():
    truth = drawn(np.random.default_rng(3))
    views = Flight(truth, **EXACT).views(np.random.default_rng(4))
    result = calibrate_images(views, VAGUE, CAMERA, ASKED)
    for name, value in found(result).items():
        assert_allclose(value, truth[name], atol=1e-5 * STD[name], err_msg=name)
    assert result.rms_px < 1e-5


@pytest.mark.nightly
@pytest.mark.parametrize("tilt_deg", [10.0, 45.0])
def test_errors_are_as_large_as_stated(tilt_deg):
    rng, scores, chances = np.random.default_rng(round(tilt_deg)), defaultdict(list), []
    start = ImagesState(start_state({}, CAMERA, PINHOLE), np.zeros(len(BIASES)), np.zeros((4, OWN)))
    for _ in range(SCENES):
        truth = drawn(rng)
        views = Flight(truth, images=4, landmarks=4, tilt_deg=tilt_deg).views(rng)
        solution = solve_images(ImagesProblem(views, SharedUnknowns(BIASES), PRIORS, PINHOLE), start)
        chances.append(solution.p_value)
        for name, std in zip(BIASES, np.sqrt(np.diag(solution.covariance)).tolist(), strict=True):
            scores[name].append((solution.state.value(name) - truth[name]) / std)
    print({name: round(float(np.std(z)), 2) for name, z in scores.items()})
    assert_allclose(np.std(np.concatenate(list(scores.values()))), 1.0, atol=0.08)
    for name, z in scores.items():
        assert_allclose(np.std(z), 1.0, atol=0.3, err_msg=name)  # 70 scenes tell it to 0.085
        assert abs(np.mean(z)) < 4 / math.sqrt(len(z)), name
    assert_allclose(np.mean(chances), 0.5, atol=0.12)


def test_what_is_new_in_each_image_is_not_averaged_away_as_pixels_are():
    """However many landmarks, one image's attitude is no better than its noise; more images are."""

    def tilt_std(images, landmarks):
        flight = Flight(images=images, landmarks=landmarks, std_px=0.05, **STILL)
        priors = without(PRIORS, "time", "pan", "east", "north")
        return stds(calibrate_images(flight.views(np.random.default_rng(1)), priors, CAMERA, ("tilt",)))["tilt"]

    few, many = tilt_std(4, 6), tilt_std(4, 40)
    assert 0.98 * NOISE[3] / math.sqrt(4) < many < few < 3 * NOISE[3] / math.sqrt(4)
    assert tilt_std(16, 6) < 0.6 * few


@pytest.mark.parametrize("motion", [{"turn_radps": 0.0}, {"speed_mps": 0.0}], ids=["flies", "turns"])
def test_a_time_offset_is_told_by_motion(motion):
    truth = {"time": 0.35, "heading": DEG}
    views = Flight(truth, images=10, **motion).views(np.random.default_rng(2))
    result = calibrate_images(views, without(PRIORS, "time"), CAMERA, ASKED)
    assert_allclose(found(result)["time"], 0.35, atol=4 * stds(result)["time"])
    assert stds(result)["time"] < 0.03
    assert result.weakest.is_determined


def weak(views, names, priors=PRIORS):
    weakest = calibrate_images(views, priors, CAMERA, names).weakest
    assert weakest.std_share > LIMIT
    return set(weakest.combination), weakest.sentence


def test_a_hovering_drone_does_not_tell_the_time():
    views = Flight(drawn(np.random.default_rng(1)), **STILL).views(np.random.default_rng(6))
    for priors in (PRIORS, without(PRIORS, "time")):
        names, sentence = weak(views, ASKED, priors)
        assert names == {"time"}
        assert "moves or turns" in sentence


def test_an_even_turn_does_not_tell_heading_from_time():
    hover = Flight(landmarks=8, **STILL)
    views = tuple(
        replace(view, track=replace(view.track, wxyz=turned(view.track)))
        for view in hover.views(np.random.default_rng(7))
    )
    names, sentence = weak(views, ASKED, without(PRIORS, "time", "pan", "east", "north"))
    assert names >= {"time", "heading"}
    assert "turns the other way" in sentence


def turned(track):
    """The same pose in the middle, turning clockwise by 0.3 rad/s about the vertical."""
    from aerodft.geometry import from_rotation_vector, multiply  # noqa: PLC0415

    about = np.zeros((len(track.offset_s), 3))
    about[:, 2] = -0.3 * track.offset_s
    return multiply(from_rotation_vector(about), track.wxyz)


def test_one_landmark_straight_below_does_not_tell_the_height():
    below = tuple(replace(view, evidence=(straight_below(view),)) for view in looking_down(8))
    names, sentence = weak(below, ("height",), without(PRIORS, "tilt", "roll", "heading", "pan", "time"))
    assert names == {"height"}
    assert "away from the point below" in sentence


def straight_below(view):
    """The camera's foot, seen in the principal point."""
    east, north, _ = view.track.pose(0.0).position_enu_m.tolist()
    return Landmark(name=f"{view.name}/below", pixel=(CAMERA.cx_px, CAMERA.cy_px), position_m=(east, north, 0.0))


def looking_down(seed):
    """Straight down, whatever way the image's up points."""
    return Flight(images=2, tilt_deg=0.0, spread_deg=0.0, **STILL).views(np.random.default_rng(seed))


def test_straight_down_roll_and_heading_are_one():
    names, sentence = weak(looking_down(9), ("roll", "heading"))
    assert names == {"roll", "heading"}
    assert "turn about one axis" in sentence


def test_an_outlier_is_left_out_by_name():
    truth = drawn(np.random.default_rng(1))
    views = Flight(truth).views(np.random.default_rng(10))
    wrong = views[3].evidence[2]
    moved = replace(wrong, pixel=(wrong.pixel[0] + 40.0, wrong.pixel[1] - 25.0))
    evidence = tuple(moved if each is wrong else each for each in views[3].evidence)
    views = (*views[:3], replace(views[3], evidence=evidence), *views[4:])
    result = calibrate_images(views, PRIORS, CAMERA, ASKED)
    assert [left.name for left in result.left if left.is_outlier] == ["IMG_3/p2"]
    for name, std in stds(result).items():
        assert abs(found(result)[name] - truth[name]) < 4 * std, name


def test_without_an_observation_is_as_a_fit_that_never_saw_it():
    views = Flight(drawn(np.random.default_rng(1)), images=4, landmarks=4).views(np.random.default_rng(11))
    whole = calibrate_images(views, PRIORS, CAMERA, ASKED)
    less = (replace(views[0], evidence=views[0].evidence[1:]), *views[1:])
    from calibration.pose import ground_error_m  # noqa: PLC0415

    again = calibrate_images(less, PRIORS, CAMERA, ASKED)
    expected = ground_error_m(again.solution.cameras[0], views[0].evidence[0])
    assert_allclose(whole.left[0].loo_ground_m, expected, rtol=2e-2)


def test_the_lens_is_found_with_the_biases():
    truth = drawn(np.random.default_rng(1))
    flights = [Flight(truth, images=6, landmarks=8, height_m=height) for height in (25.0, 80.0)]
    views = tuple(view for seed, flight in enumerate(flights) for view in flight.views(np.random.default_rng(seed)))
    views = tuple(replace(view, name=f"{index}") for index, view in enumerate(views))
    wrong = replace(CAMERA, fx_px=1.03 * CAMERA.fx_px, fy_px=1.03 * CAMERA.fy_px)
    result = calibrate_images(views, PRIORS, wrong, ("height", "focal"))
    assert_allclose(result.camera.fx_px, CAMERA.fx_px, atol=4 * stds(result)["focal"])
    assert stds(result)["focal"] < 5.0
    assert np.any(result.bias_covariance[:, len(BIASES) :])


def ranged(view, height_m=0.0):
    """An image with slant ranges in the place of landmarks, of a vehicle that is higher than reported."""
    eye = view.track.pose(0.0).position_enu_m + [0.0, 0.0, height_m]
    return replace(
        view,
        evidence=tuple(
            SlantRange(name=each.name, pixel=each.pixel, range_m=math.dist(eye, each.position_m), std_m=0.05)
            for each in view.evidence
        ),
    )


def test_evidence_without_a_place_counts_too():
    flight = Flight({"height": 0.8}, images=4, relief_m=0.0, noise=np.zeros(OWN), **STILL)
    views = tuple(ranged(view, 0.8) for view in flight.views(np.random.default_rng(12)))
    result = calibrate_images(views, without(PRIORS, "time"), CAMERA, ("height",))
    assert_allclose(found(result)["height"], 0.8, atol=4 * stds(result)["height"])


def test_a_height_above_unknown_ground_is_as_uncertain_as_that():
    """A telemetry that knows its height exactly does not know the ground."""
    flight = Flight(images=4, relief_m=0.0, noise=np.zeros(OWN), **STILL)
    views = tuple(ranged(view) for view in flight.views(np.random.default_rng(14)))
    result = calibrate_images(views, without(PRIORS, "height", "time"), CAMERA, ("tilt", "elevation"))
    variance = result.bias_covariance[BIASES.index("height"), BIASES.index("height")]
    assert_allclose(math.sqrt(variance), stds(result)["elevation"])
    assert 0 < variance < 1


def problem_and_guess():
    rng = np.random.default_rng(13)
    views = Flight(drawn(rng), images=3, landmarks=4).views(rng)
    names = (*BIASES, "focal", "k1")
    problem = ImagesProblem(views, SharedUnknowns(names), PRIORS, PINHOLE)
    start = ImagesState(start_state({}, CAMERA, PINHOLE), np.zeros(len(BIASES)), np.zeros((3, OWN)))
    shared = [0.1, 0.01, 0.02, 0.03, 0.01, 0.2, 0.3, 0.05, 3.0, 0.01]
    return problem, problem.moved(start, np.append(shared, rng.normal(size=3 * OWN)))


def dense(residuals):
    """The whole Jacobian."""
    count = residuals.jac_unknowns.shape[1] - OWN
    jac = np.zeros((len(residuals.values), count + OWN * len(residuals.images)))
    jac[:, :count] = residuals.jac_unknowns[:, :count]
    for index, rows in enumerate(residuals.images):
        jac[rows, count + OWN * index : count + OWN * (index + 1)] = residuals.jac_unknowns[rows, count:]
    return jac


def test_derivatives_are_those_of_finite_steps():
    problem, guess = problem_and_guess()
    jac = dense(problem.evaluate(guess))
    for column in range(jac.shape[1]):
        step = np.zeros(jac.shape[1])
        step[column] = 1e-6
        ends = [problem.evaluate(problem.moved(guess, sign * step)).values for sign in (1, -1)]
        expected = (ends[0] - ends[1]) / 2e-6
        size = max(1.0, float(np.abs(expected).max()))
        assert_allclose(jac[:, column] / size, expected / size, atol=2e-5, err_msg=f"unknown {column}")


@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_eliminating_what_is_new_gives_the_whole_step(damping):
    problem, guess = problem_and_guess()
    residuals = problem.evaluate(guess)
    weights = np.random.default_rng(1).uniform(0.2, 1.0, len(residuals.values))
    arrow, jac = residuals.normal(weights), dense(residuals)
    assert isinstance(arrow, NormalEquations)
    whole, slope = jac.T @ (weights[:, None] * jac), jac.T @ (weights * residuals.values)
    assert_allclose(arrow.slope, slope, rtol=1e-9, atol=1e-6)
    expected = -np.linalg.solve(whole + damping * np.diag(np.diag(whole)), slope)
    assert_allclose(arrow.step(damping), expected, rtol=1e-4, atol=1e-6)
    inverse = np.linalg.inv(whole)
    count = len(problem.unknowns.names)
    assert_allclose(np.linalg.inv(arrow.reduced()), inverse[:count, :count], rtol=1e-4, atol=1e-12)
