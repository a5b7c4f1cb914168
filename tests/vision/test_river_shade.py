"""A bank's place in its profile, where shade fades into the water or the land beside it."""

import cv2
import numpy as np
import pytest

from aerodft.vision.river.banks import locate_edges

SIZE_PX = 200
WINDOW_PX = 16.0


def shaded_bank(fade_px, *, on_land, turned_rad, seed):
    """A straight bank through the middle, a side of it 40 % darker towards it: the image, its middle, unit vector."""
    unit = np.array([np.cos(turned_rad), np.sin(turned_rad)])
    middle = (SIZE_PX - 1) / 2 + 0.3 * unit
    fine = np.arange(0, SIZE_PX, 0.25) - 0.375
    beyond = (np.stack(np.meshgrid(fine, fine), axis=-1) - middle) @ unit
    shade = (1 - 0.4 * np.exp(-np.abs(beyond) / fade_px) * ((beyond > 0) == on_land))[..., None]
    image = np.where((beyond > 0)[..., None], [90.0, 150.0, 140.0], [90.0, 80.0, 60.0]) * shade
    image = cv2.GaussianBlur(cv2.resize(image, (SIZE_PX, SIZE_PX), interpolation=cv2.INTER_AREA), (0, 0), 0.6)
    noise = np.random.default_rng(seed).normal(0.0, 2.0, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8), middle, unit


@pytest.mark.parametrize("on_land", [False, True], ids=["water", "land"])
@pytest.mark.parametrize("fade_px", [16.0, 25.0, 40.0])
def test_shade_that_fades_moves_no_bank(fade_px, on_land):
    """By 0.05 px at most; a step between the levels far from it would be off by 0.1 to 0.2 px where land is shaded."""
    for seed, turned_rad in enumerate((0.3, 1.2, 2.5, 4.0)):
        image, middle, unit = shaded_bank(fade_px, on_land=on_land, turned_rad=turned_rad, seed=seed)
        along = np.array([-unit[1], unit[0]])
        on_bank = middle + np.linspace(-40.0, 40.0, 11)[:, None] * along
        near = on_bank + np.random.default_rng(seed).normal(0.0, 1.0, (11, 1)) * unit
        units, window = np.broadcast_to(unit, near.shape), np.full(len(near), WINDOW_PX)
        found = locate_edges(image, near, units, np.broadcast_to(along, near.shape), window, shaded=True)
        error = np.sum((found.pixels_px - on_bank) * unit, axis=-1)
        print(f"{fade_px:g} px, {turned_rad:g} rad: {np.median(error):+.3f} px")
        assert abs(np.median(error)) < 0.05
