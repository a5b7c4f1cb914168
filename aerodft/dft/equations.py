"""The paper's equations, to the letter, one function each.

Y. Salih, M. T. Simsim, A. S. Malik: "Distance and Size Measurements of Objects in the Scene from a Single 2D Image".
Angles in rad, lengths in m, pixels (i, j) from the image's top-left corner; all arguments broadcast. Angles are taken
linear in pixels and Eq. 5 holds for small depression only: use the pinhole model to measure. The paper's text speaks
of an Equation (9) for widths, which it does not have: Eq. 7 is meant.
"""

import math

import numpy as np

from aerodft.model import BoolArray, FloatArray, FloatLike


def tilt_is_valid(tilt_rad: FloatLike, vfov_rad: FloatLike) -> BoolArray:
    """Eq. 1: the upper image border is below the horizon, ``theta < 90 deg - FOV_V / 2``."""
    return np.asarray(horizon_excess(tilt_rad, vfov_rad) < 0)


def horizon_excess(tilt_rad: FloatLike, vfov_rad: FloatLike) -> FloatArray:
    """Eq. 1 as an angle (rad): how far the upper image border is past the horizon; negative where it is below."""
    return np.asarray(np.asarray(tilt_rad) + np.asarray(vfov_rad) / 2 - math.pi / 2)


def tilt_warning(tilt_rad: float, vfov_rad: float) -> str | None:
    """Eq. 1 as a message: the excess and the tilt that would satisfy it; None where it holds."""
    if tilt_is_valid(tilt_rad, vfov_rad):
        return None
    return (
        f"Eq. 1 does not hold: tilt {math.degrees(tilt_rad):.2f} deg with a vertical field of view of"
        f" {math.degrees(vfov_rad):.2f} deg puts the upper image border"
        f" {math.degrees(float(horizon_excess(tilt_rad, vfov_rad))):.2f} deg past the horizon, expected a tilt below"
        f" {90 - math.degrees(vfov_rad) / 2:.2f} deg"
    )


def rotation_angle(i_px: FloatLike, width_px: float, hfov_rad: FloatLike) -> FloatArray:
    """Eq. 2: ``phi = (i - W/2) FOV_H / W``; negative on the left."""
    return np.asarray((np.asarray(i_px, dtype=np.float64) - width_px / 2) * (hfov_rad / width_px))


def vertical_angle(j_px: FloatLike, tilt_rad: FloatLike, height_px: float, vfov_rad: FloatLike) -> FloatArray:
    """Eq. 3: ``psi = theta + (H/2 - j) FOV_V / H``; 0 straight down."""
    return np.asarray(tilt_rad + (height_px / 2 - np.asarray(j_px, dtype=np.float64)) * (vfov_rad / height_px))


def ground_ahead(height_m: FloatLike, psi_rad: FloatLike) -> FloatArray:
    """Eq. 4: ``Y = h tan(psi)``; NaN at and above the horizon."""
    psi = np.asarray(psi_rad, dtype=np.float64)
    return np.asarray(np.where(np.abs(psi) < math.pi / 2, height_m * np.tan(psi), np.nan))


def ground_right(ahead_m: FloatLike, phi_rad: FloatLike) -> FloatArray:
    """Eq. 5: ``X = Y tan(phi)``."""
    return np.asarray(ahead_m * np.tan(np.asarray(phi_rad, dtype=np.float64)))


def depth(height_m: FloatLike, ahead_m: FloatLike, right_m: FloatLike) -> FloatArray:
    """Eq. 6: ``Z = sqrt(h^2 + Y^2 + X^2)``, the slant range."""
    return np.asarray(np.sqrt(np.square(height_m) + np.square(ahead_m) + np.square(right_m)))


def object_height(height_m: FloatLike, base_ahead_m: FloatLike, top_ahead_m: FloatLike) -> FloatArray:
    """Eq. 8: height of an object whose base is seen at ``Y1`` and whose top at ``Y2``: ``h (Y2 - Y1) / Y2``."""
    top = np.asarray(top_ahead_m, dtype=np.float64)
    return np.asarray(height_m * (top - base_ahead_m) / top)


def ground_point(height_m: FloatLike, psi_rad: FloatLike, phi_rad: FloatLike) -> FloatArray:
    """Eq. 4 and 5 together: ``(..., 2)`` of X (right) and Y (ahead), m; NaN at and above the horizon."""
    ahead = ground_ahead(height_m, psi_rad)
    right = ground_right(ahead, phi_rad)
    return np.stack(np.broadcast_arrays(right, ahead), axis=-1)
