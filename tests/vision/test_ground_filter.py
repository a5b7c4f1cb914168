"""The filter on the ground against what it promises: errors drawn many times, and closed forms."""

import numpy as np
import pytest

from aerodft.vision.objects.ground_tracks import distance2, initial_state, predict, update

CHI2_4D_95 = 9.487729036781154


def test_what_is_not_seen_grows_as_white_noise_in_the_acceleration_makes_it() -> None:
    start = initial_state(np.zeros(2), np.zeros((2, 2)), 0.0)
    later = predict(start, 3.0, 0.5)
    np.testing.assert_allclose(np.diag(later.cov), 0.25 * np.array([9.0, 9.0, 3.0, 3.0]))
    steps = start
    for _ in range(30):
        steps = predict(steps, 0.1, 0.5)
    np.testing.assert_allclose(steps.cov, later.cov, atol=1e-12)


def test_many_exact_sights_of_a_steady_walk_give_its_velocity() -> None:
    state = initial_state(np.array([1.0, 2.0]), np.eye(2) * 0.01, 3.0)
    for k in range(1, 200):
        state = update(predict(state, 0.1, 0.01), np.array([1.0 + 0.14 * k, 2.0 - 0.05 * k]), np.eye(2) * 1e-4)
    np.testing.assert_allclose(state.velocity_en_mps, [1.4, -0.5], atol=0.002)


@pytest.mark.nightly
@pytest.mark.parametrize("hidden", [0, 12])
def test_the_covariance_is_that_of_the_errors(hidden: int) -> None:
    """400 walks as the filter believes in them; the last images may be hidden."""
    draws, inside, dt, power = np.random.default_rng(5), 0, 0.2, 0.5
    sight_cov = np.array([[0.04, 0.01], [0.01, 0.09]])
    noise = np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) * power**2, np.eye(2))
    on = np.eye(4)
    on[0, 2] = on[1, 3] = dt
    for _ in range(400):
        truth = np.array([0.0, 0.0, *draws.normal(0, 1.0, 2)])
        state = initial_state(draws.multivariate_normal(truth[:2], sight_cov), sight_cov, 1.0)
        for k in range(40):
            truth = on @ truth + draws.multivariate_normal(np.zeros(4), noise)
            state = predict(state, dt, power)
            if k < 40 - hidden:
                state = update(state, draws.multivariate_normal(truth[:2], sight_cov), sight_cov)
        off = state.mean - truth
        inside += off @ np.linalg.solve(state.cov, off) < CHI2_4D_95
    assert 0.91 * 400 <= inside <= 0.98 * 400, "95 % of 400, within three standard deviations"


def test_one_outline_with_a_fringe_does_not_throw_a_track_off() -> None:
    state = initial_state(np.zeros(2), np.eye(2) * 0.01, 1.0)
    for k in range(1, 40):
        state = update(predict(state, 0.1, 0.5), np.array([0.1 * k, 0.0]), np.eye(2) * 0.01)
    state = predict(state, 0.1, 0.5)
    fringe = np.array([4.0, 1.0])
    assert distance2(state, fringe, np.eye(2) * 0.01) > 20
    assert abs(update(state, fringe, np.eye(2) * 0.01).mean[1]) < 0.25
