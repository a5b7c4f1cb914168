"""Draws of errors: always the same standard normal ones."""

import numpy as np
import pytest
from scipy.special import ndtr

from aerodft.dft import monte_carlo
from aerodft.dft.covariance import Z95
from aerodft.dft.monte_carlo import DRAWS, central_interval, standard_draws
from aerodft.model import FloatArray


@pytest.mark.parametrize("dimensions", [1, 13, 64, 65, 139])
def test_draws_are_standard_and_symmetric(dimensions: int) -> None:
    draws = standard_draws(dimensions)
    assert draws.shape == (DRAWS, dimensions)
    np.testing.assert_array_equal(draws[: DRAWS // 2], -draws[DRAWS // 2 :])
    np.testing.assert_allclose(draws.std(axis=0), 1.0, atol=0.02)


def test_intervals_that_were_drawn_stay_what_they_were() -> None:
    first = [-1.007276159040442, 0.1062744744310362, -1.1858612877284307]
    np.testing.assert_allclose(standard_draws(13)[0, :3], first, rtol=1e-15)


def test_few_draws_are_each_of_another_sixteenth_of_every_error() -> None:
    sixteenths = np.floor(16 * ndtr(standard_draws(13, 32)[:16]))
    np.testing.assert_array_equal(np.sort(sixteenths, axis=0), np.tile(np.arange(16.0)[:, None], 13))


def sums_of(draws: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Standard normal sums ``(400, d)`` of 20 errors, of which few count, mostly."""
    weights = rng.standard_normal((400, 20)) * 10 ** rng.uniform(-1.5, 0, (400, 20))
    return np.asarray(weights / np.linalg.norm(weights, axis=1, keepdims=True) @ draws.T)


def share_off(ends: FloatArray, low: float, high: float) -> FloatArray:
    """How far intervals end off, as shares of half of their true length."""
    return 2 * (ends - [[low], [high]]) / (high - low)


@pytest.mark.parametrize("seed", range(12))
def test_what_is_drawn_of_sums_holds_what_their_closed_form_does(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(monte_carlo, "_SEED", seed)
    sums = sums_of(standard_draws.__wrapped__(20), np.random.default_rng(1))
    off = share_off(central_interval(sums), -Z95, Z95)
    assert np.sqrt(np.mean(np.square(off))) < 0.03
    assert abs(np.mean(off)) < 0.01


def test_first_order_takes_noise_off_and_adds_none_where_it_tells_nothing() -> None:
    rng, draws = np.random.default_rng(1), standard_draws(20)
    sums, others = sums_of(draws, rng), sums_of(draws, rng)
    bent, ends = np.exp(0.3 * sums), np.exp([-0.3 * Z95, 0.3 * Z95])
    plain = share_off(np.quantile(bent, [0.025, 0.975], axis=1), *ends)
    by_first_order = share_off(central_interval(bent, sums), *ends)
    assert np.std(by_first_order) < 0.45 * np.std(plain)
    assert np.abs(by_first_order).max() < 0.45 * np.abs(plain).max()
    plain = share_off(np.quantile(sums, [0.025, 0.975], axis=1), -Z95, Z95)
    by_what_tells_nothing = share_off(central_interval(sums, others), -Z95, Z95)
    assert np.std(by_what_tells_nothing) < np.std(plain)


def test_draws_without_a_value_lie_beyond_the_upper_end() -> None:
    drawn = np.arange(1000.0)
    drawn[:15] = np.nan  # part of the window about the upper end
    assert central_interval(drawn)[1] == pytest.approx(15 + 0.975 * 999)
    drawn[:30] = np.nan
    assert central_interval(drawn)[1] == np.inf
