"""Robust weights, scales and steps against scipy's distributions and least squares."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from aerodft.geometry import robust_std, robust_stds, student_loss, student_weights, weighted_step


@pytest.mark.parametrize(("dimensions", "dof"), [(1, 4.0), (2, 5.0), (3, 4.0)])
def test_the_loss_is_the_t_distributions_and_the_weights_are_its_gradient(dimensions, dof):
    at = np.random.default_rng(1).normal(scale=2.0, size=(50, dimensions))
    squares = np.sum(at**2, axis=-1)
    expected = stats.multivariate_t(np.zeros(dimensions), np.eye(dimensions), df=dof).logpdf(at)
    found = student_loss(squares, dimensions, dof)
    assert_allclose(found - found[0], -(expected - expected[0]), atol=1e-10)
    step = 1e-6
    numeric = (student_loss(squares + step, dimensions, dof) - student_loss(squares - step, dimensions, dof)) / (
        2 * step
    )
    assert_allclose(student_weights(squares, dimensions, dof) / 2, numeric, rtol=1e-6)


def test_scales_hold_against_a_third_of_strays():
    rng = np.random.default_rng(2)
    off = rng.normal(scale=3.0, size=(5, 4000))
    assert_allclose(robust_stds(off), 3.0, rtol=0.06)
    assert robust_std(off) == pytest.approx(np.median(np.abs(off)) / stats.norm.ppf(0.75), rel=1e-4)
    off[:, :1300] = 1e3
    assert np.all(robust_stds(off) < 6.0)


def test_a_step_is_the_least_squares_of_data_and_prior():
    rng = np.random.default_rng(3)
    jac, residuals, weights = rng.normal(size=(30, 2, 4)), rng.normal(size=(30, 2)), rng.uniform(0.1, 3.0, 30)
    root = rng.normal(size=(4, 4))
    prior, pull = root.T @ root, rng.normal(size=4)
    rows = np.sqrt(np.repeat(weights, 2))
    stacked = np.vstack([rows[:, None] * jac.reshape(-1, 4), root])
    right = np.concatenate([rows * residuals.ravel(), root @ pull])
    step, information = weighted_step(jac, residuals, weights, (prior, pull))
    assert_allclose(step, np.linalg.lstsq(stacked, right, rcond=None)[0], atol=1e-10)
    assert_allclose(information, stacked.T @ stacked, atol=1e-10)
    alone, _ = weighted_step(jac, residuals, weights)
    assert_allclose(alone, np.linalg.lstsq(stacked[:-4], right[:-4], rcond=None)[0], atol=1e-10)
    several, _ = weighted_step(np.stack([jac, jac]), np.stack([residuals, 2 * residuals]), np.stack([weights] * 2))
    assert_allclose(several, [alone, 2 * alone], atol=1e-10)
