"""Draws of errors: always the same standard normal ones."""

import numpy as np
import pytest
from scipy.special import ndtr

from aerodft.dft import monte_carlo
from aerodft.dft.monte_carlo import DRAWS, standard_draws


@pytest.mark.parametrize("dimensions", [1, 13, 64, 65, 139])
def test_draws_are_standard_and_symmetric(dimensions: int) -> None:
    draws = standard_draws(dimensions)
    assert draws.shape == (DRAWS, dimensions)
    np.testing.assert_array_equal(draws[: DRAWS // 2], -draws[DRAWS // 2 :])
    np.testing.assert_allclose(draws.std(axis=0), 1.0, atol=0.02)


def test_intervals_that_were_drawn_stay_what_they_were() -> None:
    first = [-0.9998506033393144, 0.6395565507884851, 1.1246386527130725]
    np.testing.assert_allclose(standard_draws(13)[0, :3], first, rtol=1e-15)


def test_few_draws_are_each_of_another_sixteenth_of_every_error() -> None:
    sixteenths = np.floor(16 * ndtr(standard_draws(13, 32)[:16]))
    np.testing.assert_array_equal(np.sort(sixteenths, axis=0), np.tile(np.arange(16.0)[:, None], 13))


@pytest.mark.parametrize("seed", range(12))
def test_what_is_drawn_of_sums_holds_what_their_closed_form_does(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(monte_carlo, "_SEED", seed)
    draws = standard_draws.__wrapped__(20)
    rng = np.random.default_rng(1)
    weights = rng.standard_normal((400, 20)) * 10 ** rng.uniform(-1.5, 0, (400, 20))  # few of them count, mostly
    sums = weights / np.linalg.norm(weights, axis=1, keepdims=True) @ draws.T
    off = np.quantile(sums, [0.025, 0.975], axis=1) / np.array([[-1.959964], [1.959964]]) - 1
    assert np.sqrt(np.mean(np.square(off))) < 0.03
    assert abs(np.mean(off)) < 0.01
