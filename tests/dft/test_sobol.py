"""Our scrambled Sobol points against scipy's, to the last bit: intervals that were drawn must stay what they were."""

import numpy as np
import pytest
from scipy.stats import qmc

from aerodft.dft.sampling import DRAWS, standard_draws
from aerodft.dft.sobol import MOST_DIMENSIONS, scrambled_sobol


@pytest.mark.parametrize("dimensions", [1, 2, 3, 9, 22, MOST_DIMENSIONS])
@pytest.mark.parametrize(("count", "seed"), [(2, 1), (512, 20), (4096, 7)])
def test_the_points_are_scipy_s(dimensions: int, count: int, seed: int) -> None:
    theirs = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed)).random(count)
    np.testing.assert_array_equal(scrambled_sobol(dimensions, count, seed), theirs)


@pytest.mark.parametrize("dimensions", [MOST_DIMENSIONS, MOST_DIMENSIONS + 1])
def test_normal_draws_are_standard_on_both_sides_of_the_table_s_end(dimensions: int) -> None:
    draws = standard_draws(dimensions)
    assert draws.shape == (DRAWS, dimensions)
    np.testing.assert_array_equal(draws[: DRAWS // 2], -draws[DRAWS // 2 :])
    np.testing.assert_allclose(draws.std(axis=0), 1.0, atol=0.02)
