"""Images of a reach that contradict each other beyond their stated errors, and those that do not."""

import numpy as np
import pytest

from aerodft.dft import ImageWidths, RiverWidths, fuse_widths

IMAGES, TRANSECTS, SPACING_M = 12, 30, 2.0
OWN_M, LIMIT = 0.1, 3.0
BY_HEIGHT = 1 / 40  # share of a width by a metre of height
SHIFT_STD_M = 2.0
STATION_M = SPACING_M * np.arange(TRANSECTS)
PLAIN_M = 22 + 2 * np.sin(STATION_M / 15)


def reach(  # noqa: PLR0913 - one error each
    rng, *, true_m=PLAIN_M, height_std_m=1.0, height_m=None, shift_m=0.0, wrong=0, stamp_s=0.0, focal=0.0
):
    """Images with drawn errors: their heights are off by ``height_m``, their places by ``shift_m`` (stds)."""
    height_m = height_std_m if height_m is None else height_m
    looks = []
    for index in range(IMAGES):
        station_m = STATION_M + shift_m * rng.standard_normal()
        width_m = np.interp(station_m, STATION_M, true_m)
        rates = rng.normal(0, 0.3) * (1 + 0.3 * np.linspace(-1, 1, TRANSECTS))  # of the width, share per second
        height_of_image_m = 40 * rng.uniform(0.5, 1.5)
        by_focal = np.full(TRANSECTS, -height_of_image_m / 40)
        scale = height_m * rng.standard_normal() * BY_HEIGHT + rates * stamp_s + by_focal * focal
        seen_m = width_m * (1 + scale) + OWN_M * rng.standard_normal(TRANSECTS)
        seen_m = seen_m * 1.5 if index < wrong else seen_m
        points = np.zeros((TRANSECTS, 2, 3))
        points[:, 0, 1], points[:, 1, 1], points[..., 0] = seen_m / 2, -seen_m / 2, STATION_M[:, None]
        shared = np.stack([height_std_m * BY_HEIGHT * seen_m, np.zeros(TRANSECTS)], axis=-1)
        shift = np.stack([np.zeros(TRANSECTS), np.full(TRANSECTS, SHIFT_STD_M)], axis=-1)
        by_cause = np.stack([rates * seen_m, by_focal * seen_m], axis=-1)
        own_m, zeros = np.full(TRANSECTS, OWN_M), np.zeros(TRANSECTS)
        widths = RiverWidths(seen_m, shared, own_m, zeros, points, shift, by_cause)
        looks.append(ImageWidths(np.arange(TRANSECTS), widths))
    return fuse_widths(looks, TRANSECTS).contradiction


def test_errors_as_stated_come_to_about_one():
    for seed in range(20):
        assert 0.3 < reach(np.random.default_rng(seed)).stds < 1.3


BUSHES_M = 22 + np.random.default_rng(0).normal(0, 1.0, TRANSECTS)
WIDENING_M = np.linspace(10, 40, TRANSECTS)


@pytest.mark.parametrize(
    "river",
    [
        {"true_m": BUSHES_M},
        {"true_m": BUSHES_M, "shift_m": SHIFT_STD_M},
        {"true_m": WIDENING_M, "shift_m": SHIFT_STD_M},
        {"wrong": 4},
        {"height_std_m": 4.0},
    ],
)
def test_a_river_whose_banks_vary_does_not_contradict_itself(river):
    """Rough or widening banks seen from unsure places, and a third of the masks run onto the bank."""
    for seed in range(10):
        assert reach(np.random.default_rng(seed), **river).stds < 0.7 * LIMIT


@pytest.mark.parametrize("wrong", [{"stamp_s": 2.0}, {"focal": 0.3}, {"height_m": 8.0}])
def test_what_stated_errors_cannot_explain_is_found(wrong):
    for seed in range(10):
        assert reach(np.random.default_rng(seed), height_std_m=0.5, **wrong).stds > LIMIT


@pytest.mark.parametrize("stamp_s", [0.5, -1.0])
def test_a_clock_s_error_is_named_with_its_size(stamp_s):
    for seed in range(10):
        found = reach(np.random.default_rng(seed), height_std_m=0.1, stamp_s=stamp_s)
        assert (found.cause, found.error) == ("clock", pytest.approx(stamp_s, rel=0.3))


@pytest.mark.parametrize("focal", [0.2, -0.2])
def test_a_focal_length_s_error_is_named_with_its_sign(focal):
    for seed in range(10):
        found = reach(np.random.default_rng(seed), height_std_m=0.1, focal=focal)
        assert (found.cause, np.sign(found.error)) == ("scale", np.sign(focal))


def test_one_image_contradicts_nobody():
    rng = np.random.default_rng(1)
    points = np.zeros((5, 2, 3))
    widths = RiverWidths(rng.normal(20, 1, 5), np.zeros((5, 1)), np.full(5, 0.1), np.zeros(5), points)
    assert fuse_widths([ImageWidths(np.arange(5), widths)], 5).contradiction.stds == 0.0
    assert fuse_widths([], 3).contradiction.stds == 0.0
