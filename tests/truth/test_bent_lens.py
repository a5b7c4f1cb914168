"""Uncertain coefficients of a lens that bends strongly, against draws whose radial polynomial is solved."""

import numpy as np
import pytest

import aerodft as ad
from aerodft.model import Camera, CameraStd

HEIGHT_M, FOCAL_PX, CENTRE_PX, STD_PX, DRAWS = 100.0, 1000.0, 950.0, 0.5, 20_000
DISTORTION, COEFFICIENT_STDS = (-0.2, 0.02, 0.0, 0.0), np.array([0.005, 0.002, 0.0, 0.0])
DOWN = ad.CameraPose(
    height_m=HEIGHT_M,
    tilt_deg=0.0,
    std=ad.PoseStd(height_m=0.0, tilt_deg=0.0, pan_deg=0.0, roll_deg=0.0, heading_deg=0.0, position_m=0.0),
)


def measured(off_axis_px, share):
    """The slant range of a pixel beside the principal point, with a share of the coefficients' stds."""
    stds = tuple((share * COEFFICIENT_STDS).tolist())
    camera = Camera(
        name="bent",
        width_px=1901,
        height_px=1001,
        fx_px=FOCAL_PX,
        fy_px=FOCAL_PX,
        cx_px=CENTRE_PX,
        cy_px=500.0,
        distortion=DISTORTION,
        std=CameraStd(distortion=stds),
    )
    return ad.measure(camera, DOWN, ad.Range((CENTRE_PX + off_axis_px, 500.0), std_px=STD_PX))


def drawn(off_axis_px, share):
    """Slant ranges of draws: radii by bisection of r (1 + k1 r^2 + k2 r^4), infinite beyond its turning point."""
    rng = np.random.default_rng(4)
    k1, k2 = (np.array(DISTORTION) + share * COEFFICIENT_STDS * rng.standard_normal((DRAWS, 4))).T[:2]
    radius = (off_axis_px + STD_PX * rng.standard_normal(DRAWS)) / FOCAL_PX
    root = (-3 * k1 - np.sqrt(np.maximum(9 * k1**2 - 20 * k2, 0.0))) / (10 * k2)
    low, high = np.zeros(DRAWS), np.sqrt(root)
    is_beyond = high * (1 + k1 * high**2 + k2 * high**4) < radius
    for _ in range(60):
        middle = (low + high) / 2
        is_below = middle * (1 + k1 * middle**2 + k2 * middle**4) < radius
        low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
    return np.where(is_beyond, np.inf, HEIGHT_M * np.hypot(1.0, low))


@pytest.mark.parametrize("share", [0.2, 1.0])
@pytest.mark.parametrize("off_axis_px", [300.0, 600.0, 700.0, 750.0, 800.0, 850.0, 900.0, 940.0])
def test_an_interval_holds_or_the_lens_is_refused(off_axis_px, share):
    found, ranges_m = measured(off_axis_px, share), drawn(off_axis_px, share)
    if found.ci95 is None:
        assert (found.status, off_axis_px >= 900.0) == ("ILL_CONDITIONED", True)
        assert "the lens's own errors change its scale" in found.reasons[0]
    else:
        held = np.mean((ranges_m >= found.ci95[0]) & (ranges_m <= found.ci95[1]))
        print(f"\n{off_axis_px:.0f} px, {share}: {100 * held:.1f} %")
        assert 0.92 <= held <= 0.98


def test_what_is_refused_stays_refused():
    refused = [measured(880.0, share).status == "ILL_CONDITIONED" for share in (0.1, 0.3, 0.6, 1.0, 2.0, 5.0, 20.0)]
    assert refused == sorted(refused)
    assert refused[-1]
    assert not refused[0]
