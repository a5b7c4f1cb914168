"""Draws of errors: always the same standard normal ones."""

import numpy as np
import pytest

from aerodft.dft.monte_carlo import DRAWS, standard_draws


@pytest.mark.parametrize("dimensions", [1, 13, 64, 65, 139])
def test_draws_are_standard_and_symmetric(dimensions: int) -> None:
    draws = standard_draws(dimensions)
    assert draws.shape == (DRAWS, dimensions)
    np.testing.assert_array_equal(draws[: DRAWS // 2], -draws[DRAWS // 2 :])
    np.testing.assert_allclose(draws.std(axis=0), 1.0, atol=0.02)


def test_intervals_that_were_drawn_stay_what_they_were() -> None:
    first = [1.3696880989401818, 0.7031938346421072, -0.7870172007899139]
    np.testing.assert_allclose(standard_draws(13)[0, :3], first, rtol=1e-15)
