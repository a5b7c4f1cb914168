"""A kind of probe from outside, which states nothing but scalar and gradient: the perimeter of a polygon."""

import numpy as np

from aerodft.dft import Gradient, Kind
from aerodft.model import ProbeKind

PERIMETER = ProbeKind("perimeter")


def _sides(geometry):
    return (np.roll(geometry.points_enu_m, -1, axis=-2) - geometry.points_enu_m) * [1.0, 1.0, 0.0]


def perimeter(geometry):
    """Horizontal length of the closed polygon of all points, m."""
    return np.linalg.norm(_sides(geometry), axis=-1).sum(axis=-1)


def _gradient(geometry):
    sides = _sides(geometry)
    units = sides / np.linalg.norm(sides, axis=-1)[..., None]
    by_points = np.roll(units, 1, axis=-2) - units
    return Gradient(np.zeros_like(by_points[..., 0, :]), np.zeros_like(geometry.directions_enu), by_points)


KIND = Kind(name=PERIMETER, pixels=(3, 256), scalar=perimeter, gradient=_gradient, is_closed=True)
"""The entry."""
