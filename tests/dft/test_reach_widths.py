"""Widths of many images against drawn errors: shared ones stay, own ones average out, wrong banks hardly count."""

import numpy as np
import pytest

from aerodft.dft import ImageWidths, RiverWidths, fuse_widths

TRUE_M = np.linspace(18.0, 26.0, 25)
OWN_M, SHARED_M = 0.12, 0.2
IMAGES = 16


def seen(rng, *, shared, own_m=OWN_M, stated_m=OWN_M, wrong=0.0, rows=None):
    """One image's widths of some transects."""
    rows = np.arange(len(TRUE_M)) if rows is None else rows
    slope = np.full((len(rows), 1), SHARED_M) * TRUE_M[rows, None] / TRUE_M.mean()
    width = TRUE_M[rows] + slope @ shared + own_m * rng.standard_normal(len(rows))
    width = np.where(rng.random(len(rows)) < wrong, width * 1.3, width)
    points = np.zeros((len(rows), 2, 3))
    points[:, 0, 1], points[:, 1, 1], points[..., 0] = width / 2, -width / 2, rows[:, None]
    return ImageWidths(rows, RiverWidths(width, slope, np.full(len(rows), stated_m), np.zeros(len(rows)), points))


def flights(count, **more):
    """Fused flights, each with a shared error of its own."""
    for seed in range(count):
        rng = np.random.default_rng(seed)
        shared = rng.standard_normal(1)
        yield fuse_widths([seen(rng, shared=shared, **more) for _ in range(IMAGES)], len(TRUE_M))


@pytest.mark.parametrize("more", [{}, {"stated_m": OWN_M / 4}, {"wrong": 0.1}])
def test_intervals_hold_the_truth_as_often_as_they_say(more):
    inside, median_inside = [], []
    for found in flights(400, **more):
        low, high = found.widths.ci95_m.T
        inside.append(np.mean((low <= TRUE_M) & (high >= TRUE_M)))
        _, _, (least, most) = found.widths.median(found.images > 0)
        median_inside.append(least <= np.median(TRUE_M) <= most)
    assert 0.92 < np.mean(inside) < 0.98
    assert 0.92 < np.mean(median_inside) < 0.98


def test_what_all_images_share_does_not_average_out():
    (found,) = flights(1)
    shared_m = SHARED_M * TRUE_M / TRUE_M.mean()
    assert np.all(found.widths.std_m > shared_m)
    own_m = np.sqrt(found.widths.std_m**2 - shared_m**2)
    assert np.median(own_m) < 2 * OWN_M / np.sqrt(IMAGES)


def test_scatter_beyond_what_images_state_is_found():
    for found in flights(3, stated_m=OWN_M / 4):
        assert found.scatter_ratio == pytest.approx(4, rel=0.25)
        assert np.median(found.scatter_m) == pytest.approx(OWN_M, rel=0.25)


def test_images_that_are_larger_as_wholes_show_as_drift_and_count():
    rng = np.random.default_rng(3)
    tilts = rng.normal(0, 0.02, IMAGES)
    looks = [seen(rng, shared=np.array([tilt * TRUE_M.mean() / SHARED_M])) for tilt in tilts]
    found = fuse_widths(looks, len(TRUE_M))
    np.testing.assert_allclose(found.drift - found.drift.mean(), tilts - tilts.mean(), atol=0.004)
    whole = found.widths.shared[:, -1] / TRUE_M
    np.testing.assert_allclose(whole, np.std(tilts, ddof=1) / np.sqrt(IMAGES), rtol=0.2)


def test_transects_that_no_image_shows_have_no_width():
    rng = np.random.default_rng(4)
    rows = np.arange(5, 15)
    found = fuse_widths([seen(rng, shared=np.zeros(1), rows=rows) for _ in range(2)], len(TRUE_M))
    np.testing.assert_array_equal(np.isfinite(found.widths.width_m), np.isin(np.arange(len(TRUE_M)), rows))
    np.testing.assert_array_equal(found.images, 2 * np.isin(np.arange(len(TRUE_M)), rows))
    assert np.all(np.isnan(found.scatter_m))
    empty = fuse_widths([], 3)
    assert not empty.images.any()
    assert np.all(np.isnan(empty.widths.width_m))
