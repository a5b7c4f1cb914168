"""Quantization error by Section 5.1 of the paper: the largest change of depth among the 8 neighbours.

Depth is the slant range Z of Eq. 6 in the paper's own model (``aerodft.dft.equations``); pixels (i, j) as there.

Missing neighbours and depths:

- A neighbour outside the image does not count: it cannot be picked by mistake.
- A neighbour at or above the horizon makes the error infinite: one pixel wrong, and the depth has no bound.
- A pixel outside the image, or itself at or above the horizon, has no depth: its error is NaN.
"""

import numpy as np

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.dft import equations
from aerodft.model import BoolArray, Camera, FloatArray

_NEIGHBOURS = np.array([(i, j) for j in (-1, 0, 1) for i in (-1, 0, 1) if i or j], dtype=np.float64)


def pixel_depth(camera: Camera, height_m: float, tilt_rad: float, pixels_px: FloatArray) -> FloatArray:
    """Depth Z (m) of pixels ``(..., 2)`` by Eq. 2 to 6, in the image or not; NaN at and above the horizon.

    Raises:
        ValueError: The height is not above 0.
    """
    if not height_m > 0:
        raise ValueError(f"height {height_m} m, must be above 0")
    pixels = np.asarray(pixels_px, dtype=np.float64)
    psi = equations.vertical_angle(pixels[..., 1], tilt_rad, camera.height_px, camera.vfov_rad)
    phi = equations.rotation_angle(pixels[..., 0], camera.width_px, camera.hfov_rad)
    ahead = equations.ground_ahead(height_m, psi)
    return equations.depth(height_m, ahead, equations.ground_right(ahead, phi))


def quantization_error(camera: Camera, height_m: float, tilt_rad: float, pixels_px: FloatArray) -> FloatArray:
    """Largest change of depth among each pixel's 8 neighbours.

    Args:
        camera: Image size and fields of view; the paper's model knows nothing else of a camera.
        height_m: Above the surface that is seen.
        tilt_rad: Of the optical axis from straight down.
        pixels_px: ``(..., 2)`` pixels (i, j), whole or not.

    Returns:
        ``(...)`` m; see the module for infinite and NaN.

    Raises:
        ValueError: The height is not above 0.
    """
    pixels = np.asarray(pixels_px, dtype=np.float64)
    depth = np.where(_inside(camera, pixels), pixel_depth(camera, height_m, tilt_rad, pixels), np.nan)
    around = pixels[..., None, :] + _NEIGHBOURS
    depth_around = pixel_depth(camera, height_m, tilt_rad, around)
    change = np.abs(np.where(np.isnan(depth_around), np.inf, depth_around) - depth[..., None])
    counted = np.where(_inside(camera, around), change, 0.0)
    return np.asarray(np.where(np.isnan(depth), np.nan, counted.max(axis=-1)))


def quantization_column(
    camera: Camera, height_m: float, tilt_rad: float, column_px: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Depth and quantization error down one column.

    Args:
        camera: As for ``quantization_error``.
        height_m: Above the surface that is seen.
        tilt_rad: Of the optical axis from straight down.
        column_px: The column i; None for the middle, W/2, where X = 0.

    Returns:
        ``(H,)`` depth and ``(H,)`` error, m, from the top row (the farthest) to the bottom.

    Raises:
        ValueError: The height is not above 0.
    """
    column = camera.width_px / 2 if column_px is None else column_px
    rows = np.arange(camera.height_px, dtype=np.float64)
    pixels = np.stack([np.full_like(rows, column), rows], axis=-1)
    error = quantization_error(camera, height_m, tilt_rad, pixels)
    return pixel_depth(camera, height_m, tilt_rad, pixels), error


def _inside(camera: Camera, pixels_px: FloatArray) -> BoolArray:
    size = np.array([camera.width_px, camera.height_px])
    low, high = -PIXEL_CENTRE_OFFSET_PX, size - PIXEL_CENTRE_OFFSET_PX
    return np.asarray(np.all((pixels_px >= low) & (pixels_px <= high), axis=-1))
