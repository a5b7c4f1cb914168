"""A probe's value with its interval: first order where that is enough, drawn where it is not.

First order is enough as long as no point's slant range is less certain than ``FIRST_ORDER_LIMIT``: over 5 % the ground
runs away from the ray too fast for a straight line. The dft model has first order only.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from aerodft.dft.equations import object_height
from aerodft.dft.quantities import SCALARS, Gradient, Sight, bearing, gradient, slant_range
from aerodft.dft.sampling import Spread, draw_sights, spread
from aerodft.dft.seen import Seen, dependence
from aerodft.dft.uncertainty import CHI2_2D_95, Z95
from aerodft.geometry.rotation import camera_angles
from aerodft.model.arrays import FloatArray
from aerodft.model.measurement import ProjectionModel
from aerodft.model.probe import ProbeKind

SIGNED = (ProbeKind.HEIGHT, ProbeKind.BEARING)
"""Kinds whose values may be negative: no other interval reaches below 0."""

_EDGE, _QUICK = 0.25, 4  # 256 draws tell their 95 % within a tenth


@dataclass(frozen=True, slots=True)
class Value:
    """A scalar, its standard deviation, and its central 95 %; not symmetric where it was drawn."""

    value: float
    std: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Drawn:
    """What drawing the errors gave.

    Attributes:
        value: None for a position.
        range_spreads: Of the slant range of each point that lies on the ground.
        cov_enu_m2: ``(3, 3)`` of the first point: its 95 % ellipse holds 95 % of the draws.
    """

    value: Value | None
    range_spreads: tuple[Spread, ...]
    cov_enu_m2: FloatArray


def first_order(seen: Seen) -> Value | None:
    """Value by linear propagation; None for a position."""
    if not seen.has_scalar:
        return None
    value, by = scalar_with_gradient(seen)
    std = std_of(seen, by)
    low = value - Z95 * std
    return Value(value, std, (low if seen.kind in SIGNED else max(low, 0.0), value + Z95 * std))


def scalar_with_gradient(seen: Seen) -> tuple[float, Gradient]:
    """The value of what has one, without its errors, and its derivatives."""
    if seen.model is ProjectionModel.DFT and seen.kind in _PAPER:
        return _PAPER[seen.kind](seen)
    sight = seen.sight
    return float(SCALARS[seen.kind](sight)), gradient(seen.kind, sight)


def drawn(seen: Seen) -> Drawn:
    """Value by drawing the stated errors; pinhole only."""
    sights = draw_sights(seen)
    ranges = _range_spreads(seen, sights)
    value = None
    if seen.has_scalar:
        centre, _ = scalar_with_gradient(seen)
        found = spread(_near(seen.kind, SCALARS[seen.kind](sights), centre))
        value = Value(centre, (found.high - found.low) / (2 * Z95), (found.low, found.high))
    return Drawn(value, ranges, _scatter(sights.points_enu_m[:, 0], seen.ground.points_enu_m[0]))


def has_edge(seen: Seen, range_std_m: FloatArray) -> bool:
    """Whether the ground's shape makes more, or less, of the errors than its slope where it is met says.

    Args:
        seen: The probe.
        range_std_m: ``(k,)`` first-order standard deviations of its points' slant ranges.
    """
    if seen.surface is None or not seen.surface.has_edges:
        return False
    widths = np.array([found.high - found.low for found in _range_spreads(seen, draw_sights(seen, _QUICK))])
    return bool(np.any(np.abs(widths - 2 * Z95 * range_std_m) > _EDGE * 2 * Z95 * range_std_m))


def _range_spreads(seen: Seen, sights: Sight) -> tuple[Spread, ...]:
    return tuple(
        spread(slant_range(replace(sights, points_enu_m=sights.points_enu_m[:, index : index + 1])))
        for index in range(seen.on_ground)
    )


def _near(kind: ProbeKind, values: FloatArray, centre: float) -> FloatArray:
    """Bearings on the same turn as ``centre``; other values as they are."""
    return centre + np.remainder(values - centre + np.pi, 2 * np.pi) - np.pi if kind is ProbeKind.BEARING else values


def std_of(seen: Seen, by: Gradient) -> float:
    """Joint standard deviation: shared errors add up over points and rays before they are squared."""
    shared, own = dependence(seen, by)
    variance = float(shared @ seen.shared_cov @ shared) + seen.std_px**2 * float(np.sum(own * own))
    return math.sqrt(max(variance, 0.0))


def _paper_height(seen: Seen) -> tuple[float, Gradient]:
    """Eq. 8 and its derivatives; NaN unless base and top are both seen against the ground."""
    _, _, heading = camera_angles(seen.pose.wxyz)
    ahead = np.array([math.sin(heading), math.cos(heading), 0.0])
    base, top = (seen.ground.points_enu_m - seen.pose.position_enu_m) @ ahead
    height = float(seen.pose.position_enu_m[2]) - seen.elevation_m
    with np.errstate(divide="ignore", invalid="ignore"):  # a top straight below has no height
        by_points = np.stack([-height / top * ahead, height * base / top**2 * ahead])
        by_height = np.array([0.0, 0.0, 1 - base / top])
    by = Gradient(by_height - by_points.sum(axis=0), np.zeros((2, 3)), by_points - [[0, 0, 1 - base / top], [0, 0, 0]])
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(object_height(height, base, top)), by


def _paper_bearing(seen: Seen) -> tuple[float, Gradient]:
    """Of the ground point from the camera's foot, or of the second from the first."""
    points, none = seen.ground.points_enu_m, np.zeros(3)
    if len(points) > 1:
        return float(bearing(seen.sight)), gradient(ProbeKind.BEARING, seen.sight)
    ray = Sight(seen.pose.position_enu_m, points - seen.pose.position_enu_m, points)
    by = gradient(ProbeKind.BEARING, ray).by_directions
    return float(bearing(ray)), Gradient(none - by[0], np.zeros((1, 3)), by)


_PAPER: dict[ProbeKind, Callable[[Seen], tuple[float, Gradient]]] = {
    ProbeKind.HEIGHT: _paper_height,
    ProbeKind.BEARING: _paper_bearing,
}


def _scatter(draws_enu_m: FloatArray, centre_enu_m: FloatArray) -> FloatArray:
    """Second moment ``(3, 3)`` about the measured point, scaled so that its 95 % ellipse holds 95 % of the draws.

    Its shape is that of the nearer 95 %: a few draws near the horizon would stretch it without bound.
    """
    away = draws_enu_m - centre_enu_m
    far = np.where(np.isnan(away[:, 0]), np.inf, np.hypot(away[:, 0], away[:, 1]))
    if np.count_nonzero(np.isinf(far)) > 0.05 * len(far):
        return np.full((3, 3), np.inf)  # no ellipse holds them; the point is refused for its range anyway
    near = far <= np.sort(far)[int(0.95 * len(far)) - 1]
    nearest = away[near]
    moment = nearest.T @ nearest.copy() / len(nearest)  # of one array with itself it would differ in the last bits
    squared = np.einsum("ni,ij,nj->n", away[:, :2], np.linalg.pinv(moment[:2, :2]), away[:, :2])
    scale = np.sort(np.where(np.isnan(squared), np.inf, squared))[int(np.ceil(0.95 * len(far))) - 1] / CHI2_2D_95
    return np.asarray(moment * scale)
