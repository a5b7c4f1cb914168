"""Covariances over whole arrays are the compiled loops', to the last bit: with what misses the ground, and zeros."""

import numpy as np
import pytest

from aerodft.dft import propagation, propagation_arrays
from aerodft.dft.loops import SharedErrors
from aerodft.geometry.jit import load_compiler
from aerodft.model.arrays import FloatArray

load_compiler()  # what is compared with is compiled
INTRINSICS = 4
ERRORS = 7 + INTRINSICS


def assert_same_bits(ours: FloatArray, theirs: FloatArray) -> None:
    np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(np.signbit(ours[ours == 0]), np.signbit(theirs[ours == 0]))


def some(rng: np.random.Generator, *shape: int, wild: bool = False) -> FloatArray:
    """Numbers of many sizes; wild ones with zeros of both signs, infinities and NaN among them."""
    values = rng.normal(size=shape) * 10.0 ** rng.integers(-6, 7, shape)
    if wild:
        odd = rng.random(shape) < 0.1
        values[odd] = rng.choice([0.0, -0.0, np.inf, -np.inf, np.nan], int(odd.sum()))
    return values


def covariances(rng: np.random.Generator, count: int) -> FloatArray:
    """``(count, s, s)``: correlated in blocks, as poses and lenses are; each image has its own zeros."""
    factor = some(rng, count, ERRORS, ERRORS)
    factor[:, 3:6, :3] = factor[:, :3, 3:6] = 0.0
    cov = factor @ factor.transpose(0, 2, 1)
    cov[:, 6] = cov[:, :, 6] = 0.0
    cov[rng.random(count) < 0.3, 7:] = 0.0
    return cov


@pytest.mark.parametrize(("images", "points"), [(1, 1), (1, 7), (40, 1), (30, 6), (3, 0), (0, 2)])
@pytest.mark.parametrize("wild", [False, True])
@pytest.mark.parametrize("of_each", [False, True])
def test_points(images: int, points: int, wild: bool, of_each: bool) -> None:  # noqa: FBT001 - drawn
    rng = np.random.default_rng(images * 100 + points)
    shape = images, points
    met = some(rng, *shape, 3, 3, wild=wild), some(rng, *shape, 3, 3, wild=wild), some(rng, *shape, 3, wild=wild)
    seen = (images if of_each else 1, points)
    rays = some(rng, images, 3, 3), some(rng, *seen, 3), some(rng, *seen, 3, 2), some(rng, *seen, 3, INTRINSICS)
    both = []
    for module in (propagation_arrays, propagation):
        shared, own = np.empty((*shape, 3, ERRORS)), np.empty((*shape, 3, 2))
        module.depend(met, *rays, shared, own)
        both.append((shared, own))
    assert_same_bits(both[0][0], both[1][0])
    assert_same_bits(both[0][1], both[1][1])
    cov, elevation_var, pixel_var = covariances(rng, images), some(rng, points) ** 2, some(rng, points) ** 2
    sight, spreads = some(rng, *shape, 3, wild=wild), []
    for module in (propagation_arrays, propagation):
        out = np.empty((*shape, 3, 3)), np.empty(shape)
        module.spread(both[0], SharedErrors.of(cov), elevation_var, pixel_var, sight, *out)
        spreads.append(out)
    assert_same_bits(spreads[0][0], spreads[1][0])
    assert_same_bits(spreads[0][1], spreads[1][1])
    assert wild or not points * images or (spreads[0][1] != 0).any()


@pytest.mark.parametrize(("images", "scalars", "of"), [(1, 1, 1), (50, 1, 2), (1, 5, 4), (20, 3, 2), (4, 0, 2)])
@pytest.mark.parametrize("wild", [False, True])
def test_scalars_of_several_points(images: int, scalars: int, of: int, wild: bool) -> None:  # noqa: FBT001 - drawn
    rng = np.random.default_rng(images * 100 + scalars * 10 + of)
    shape = images, scalars
    gradient = some(rng, *shape, 3), some(rng, *shape, of, 3, wild=wild), some(rng, *shape, of, 3, wild=wild)
    gradient[1][..., 0] = 0.0  # a horizontal length does not depend on everything
    points, rays = (
        (*(some(rng, images, 9, 3, size, wild=wild) for size in (ERRORS, 2)), rng.integers(0, 9, (scalars, of)))
        for _ in range(2)
    )
    errors, own_var = SharedErrors.of(covariances(rng, images)), some(rng, scalars, 2) ** 2
    ours, theirs = np.empty(shape), np.empty(shape)
    propagation_arrays.joint_variances(gradient, points, rays, errors, own_var, ours)
    propagation.joint_variances(gradient, points, rays, errors, own_var, theirs)
    assert_same_bits(ours, theirs)


def test_errors_that_vary_together_in_no_image_are_left_out() -> None:
    """By the definition: a sum over all pairs, of which only zeros are left out."""
    rng = np.random.default_rng(5)
    cov = covariances(rng, 3)
    errors = SharedErrors.of(cov)
    for one in range(ERRORS):
        partners = errors.partners[one, : errors.partner_count[one]].tolist()
        assert partners == [other for other in range(ERRORS) if cov[:, one, other].any()]
    assert errors.partner_count[6] == 0, "the elevation varies with nothing"
    assert errors.partner_count.max() < ERRORS
