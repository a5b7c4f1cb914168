"""Pure parts of the river's measurement against closed forms: outliers, median under shared errors, steps."""

import numpy as np
import pytest

from aerodft.dft import BankPair, Setup, river_widths
from aerodft.geometry import camera_pose
from aerodft.model import Camera, PoseStd
from aerodft.vision.river.banks import flag_outliers, locate_edges

FIFTH_OF_A_PIXEL = 0.2


def test_a_step_is_found_within_its_std():
    """Land from column 100.3 on, an area sample of it, between noise of 4 grey levels; many rows, drawn anew."""
    random = np.random.default_rng(1)
    share = np.clip(np.arange(200) - 100.3 + 0.5, 0.0, 1.0)
    image = 60.0 + 60.0 * share[None, :, None] + random.normal(0, 4, (4000, 200, 3))
    image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    rows = np.arange(20.0, 3980.0, 20.0)
    near = np.stack([np.full(len(rows), 98.0), rows], axis=-1)
    across, along = np.tile([1.0, 0.0], (len(rows), 1)), np.tile([0.0, 1.0], (len(rows), 1))
    edges = locate_edges(image, near, across, along, np.full(len(rows), 12.0))
    error = edges.pixels_px[:, 0] - 100.3
    assert abs(error.mean()) < FIFTH_OF_A_PIXEL / 2
    assert error.std() < FIFTH_OF_A_PIXEL
    assert np.mean(np.abs(error) <= 1.96 * np.hypot(edges.std_px, 0.2)) >= 0.9
    np.testing.assert_array_equal(edges.pixels_px[:, 1], rows)


def test_a_post_in_front_of_a_winding_bank_stands_out():
    stations = np.arange(0.0, 60.0)
    offsets = 11.0 + 2.0 * np.sin(stations / 15.0)
    offsets[[20, 21]] -= 1.5
    offsets[40] = np.nan
    found = flag_outliers(stations, offsets, np.full(60, 0.01), 22.0)
    assert np.flatnonzero(found).tolist() == [20, 21]


def test_a_rough_bank_is_rough_everywhere():
    """Banks that are off by half a metre at every point have no point that stands out."""
    random = np.random.default_rng(2)
    found = flag_outliers(np.arange(80.0), random.normal(11.0, 0.5, 80), np.full(80, 0.01), 22.0)
    assert np.count_nonzero(found) <= 2


@pytest.mark.parametrize("count", [1, 40])
def test_what_all_widths_share_does_not_average_out(count):
    """From straight above, a height that is 1 % off makes each width and their median 1 % wrong."""
    camera = Camera.from_fov(name="flat", width_px=1000, height_px=1000, hfov_rad=1.0, vfov_rad=1.0)
    pose = camera_pose(height_agl_m=50.0, tilt_rad=0.0, std=PoseStd(height_agl_m=0.5))
    v = np.linspace(100.0, 900.0, count)
    pixels = np.stack([np.stack([np.full(count, u), v], axis=-1) for u in (200.0, 800.0)], axis=1)
    across = np.tile([[-1.0, 0.0], [1.0, 0.0]], (count, 1, 1))
    alone = np.full((count, 2), 1.0)
    widths = river_widths(Setup(camera=camera), pose, BankPair(pixels, across, alone, 0.0, np.zeros(len(pixels))))
    metre_px = camera.fx_px / 50.0
    np.testing.assert_allclose(widths.width_m, 600.0 / metre_px)
    np.testing.assert_allclose(widths.std_m, np.hypot(0.01 * widths.width_m, np.sqrt(2.0) / metre_px))
    median, std, (low, high) = widths.median(np.ones(count, dtype=bool))
    own = np.sqrt(2.0) / metre_px * (1.0 if count == 1 else 1.2533 / np.sqrt(count))
    assert std == pytest.approx(np.hypot(0.01 * median, own), rel=0.06)
    assert high - low == pytest.approx(2 * 1.96 * std, rel=0.06)
