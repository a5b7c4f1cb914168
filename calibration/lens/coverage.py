"""What the views of a board leave open, in sentences."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from aerodft.geometry.intrinsics import rays_by_intrinsics
from aerodft.geometry.lens import distorted_with_jacobian, pixels_from_rays, rays_from_pixels
from aerodft.geometry.rotation import skew
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from calibration.lens.adjustment import View, with_coefficients
from calibration.lens.choice import cells
from calibration.lens.solution import LensSolution, largest_turn_rad

_GRID: Final = (9, 6)
_REGION: Final = (3, 2)  # cells of each of nine regions
_REGIONS: Final = (
    ("upper left", "top", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "bottom", "lower right"),
)
_COVERED = 0.34  # of a region's cells
_GOOD_TURN_DEG = 30.0
_GOOD_SIZE = 0.33  # of the image's width or height
_GOOD_VIEWS = 10


def covered_cells(views: Sequence[View], size_px: tuple[int, int]) -> np.ndarray:
    """``(down, across)`` how many views have corners in each cell of the image."""
    counts = np.zeros(_GRID[::-1], dtype=int)
    for view in views:
        across, down = cells(view, size_px, _GRID).T
        counts[down, across] += 1
    return counts


def missing(solution: LensSolution) -> tuple[str, ...]:
    """Sentences on what would make the calibration better; none where nothing is missing."""
    views, size_px = solution.views, (solution.camera.width_px, solution.camera.height_px)
    sentences = []
    open_regions = _open_regions(covered_cells(views, size_px) > 0)
    if open_regions:
        where = " or ".join([", ".join(open_regions[:-1]), open_regions[-1]] if len(open_regions) > 1 else open_regions)
        sentences.append(f"hardly any corners in the {where} of the image: hold the board there")
    turn_deg = math.degrees(largest_turn_rad(solution.bundle.rotations[:, :, 2]))
    if turn_deg < _GOOD_TURN_DEG:
        sentences.append(
            f"the boards are turned by at most {turn_deg:.0f} deg from each other:"
            " tilt them by 30 to 45 deg to the left, right, top and bottom"
        )
    largest = max(float(np.max(np.ptp(view.pixels_px, axis=0) / size_px)) for view in views)
    if largest < _GOOD_SIZE:
        sentences.append(f"the board never fills more than {100 * largest:.0f} % of the image: come closer")
    if len(views) < _GOOD_VIEWS:
        sentences.append(f"{len(views)} views are few: 15 to 40 make the lens better known")
    return tuple(sentences)


def _open_regions(covered: np.ndarray) -> list[str]:
    across, down = _REGION
    found = []
    for row, names in enumerate(_REGIONS):
        for column, name in enumerate(names):
            region = covered[row * down : (row + 1) * down, column * across : (column + 1) * across]
            if np.mean(region) < _COVERED:
                found.append(name)
    return found


def distortion_px(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    """How far the lens moves pixels ``(..., 2)`` from where it would have them with coefficients of 0.

    That is a pinhole for a Brown lens, and for a fisheye one whose pixels are apart as angles are. NaN where the lens
    has no inverse.
    """
    ideal = with_coefficients(camera, 0)
    return np.asarray(pixels_px - pixels_from_rays(ideal, rays_from_pixels(camera, pixels_px)))


def ray_std_px(camera: Camera, cov: FloatArray, pixels_px: FloatArray) -> FloatArray:
    """How well the rays of pixels ``(n, 2)`` are known, in pixels: the longer half axis of one sigma, ``(n,)``.

    A part of that is as if the whole camera were turned, which a pose that is found with this camera makes up for; it
    is left out.

    Args:
        camera: The camera, with its covariance.
        cov: Of its intrinsics.
        pixels_px: Pixels; those that the lens has no inverse for are NaN.
    """
    rays = rays_from_pixels(camera, pixels_px)
    sound = np.all(np.isfinite(rays), axis=-1)
    rays = rays[sound]
    by_ray = distorted_with_jacobian(camera, rays)[1] * np.array([[camera.fx_px], [camera.fy_px]])
    by_intrinsics = by_ray @ rays_by_intrinsics(camera, pixels_px[sound])
    flat, turned = by_intrinsics.reshape(-1, len(cov)), (by_ray @ skew(rays)).reshape(-1, 3)
    left = (flat - turned @ np.linalg.lstsq(turned, flat, rcond=None)[0]).reshape(-1, 2, len(cov))
    found = np.full(len(pixels_px), np.nan)
    found[sound] = np.sqrt(np.linalg.eigvalsh(left @ cov @ left.swapaxes(-1, -2))[:, -1].clip(0))
    return found
