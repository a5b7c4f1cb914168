"""How far apart two measurements of one thing are, in units and in standard deviations.

Combined standard deviations take two measurements as independent: the root of the sum of their variances. Two of the
same pixels and telemetry are not: their errors are shared, and the same difference is more of a surprise than it says.
There a second figure takes all that the surer one does not know as unknown to the other too (what a better calibration
leaves open, the worse one did not know either): the variance of the difference is then the difference of variances.
"""

from dataclasses import dataclass

import numpy as np

from aerodft.geometry.geodesy import east_north
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.model.pose import GeoOrigin
from replay.series import Series

_TURN_DEG = 360.0
_EQUAL = 1e-6  # variances that are closer than this part of themselves do not tell what was learned


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Apart:
    """Of each pair, ``(k,)``; NaN where one of the two has no number.

    Attributes:
        change: Second minus first; of a ``position`` how far it moved, horizontally, and never below 0.
        size: What per cent are of: the first value, of a ``position`` its range.
        std_change: Second standard deviation minus first; of a ``position`` of the longer axis.
        combined: Combined standard deviation; of a ``position`` in the direction in which it moved.
        sigmas: Change in combined standard deviations, not below 0; of a ``position`` Mahalanobis' distance.
        shared_std: Standard deviation of the change where errors are shared; NaN where both are equally sure.
        is_lopsided: One has a standard deviation or a value, the other has none under the same status.
    """

    change: FloatArray
    size: FloatArray
    std_change: FloatArray
    combined: FloatArray
    sigmas: FloatArray
    shared_std: FloatArray
    is_lopsided: BoolArray


def apart_of_values(unit: str, first: Series, second: Series) -> Apart:
    """How far apart the values of paired rows are."""
    change = second.value - first.value
    if unit == "deg":
        change = (change + _TURN_DEG / 2) % _TURN_DEG - _TURN_DEG / 2
    combined = np.hypot(first.std, second.std)
    return Apart(
        change=change,
        size=first.value,
        std_change=np.where(np.isnan(change), np.nan, second.std - first.std),
        combined=combined,
        sigmas=_ratio(np.abs(change), combined),
        shared_std=_shared(first.std**2, second.std**2),
        is_lopsided=_lopsided(first, second, change, (first.std, second.std)),
    )


def apart_of_places(unit: str, first: Series, second: Series) -> Apart:  # noqa: ARG001 - as of values
    """How far apart the places of paired rows are."""
    places = first.place, second.place
    moved = _moved(*places)
    change = np.hypot(*moved.T)
    covs = _cov(places[0]), _cov(places[1])
    both = covs[0] + covs[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = np.nan_to_num(moved / change[:, None])
    along = np.einsum("ki,kij,kj->k", ahead, both, ahead)
    stds = np.sqrt(_longest(covs[0])), np.sqrt(_longest(covs[1]))
    return Apart(
        change=change,
        size=places[0][:, 5],
        std_change=stds[1] - stds[0],
        combined=np.sqrt(np.where(change > 0, along, _longest(both))),
        sigmas=_mahalanobis(moved, both),
        shared_std=_shared(*(np.einsum("ki,kij,kj->k", ahead, cov, ahead) for cov in covs)),
        is_lopsided=_lopsided(first, second, change, stds),
    )


def _lopsided(first: Series, second: Series, change: FloatArray, stds: tuple[FloatArray, FloatArray]) -> BoolArray:
    """Where one of two has a standard deviation, or a value under the same status, that the other has not."""
    values = (np.isnan(first.value) != np.isnan(second.value)) & (first.status == second.status)
    is_sided = (np.isnan(stds[0]) != np.isnan(stds[1])) & ~np.isnan(change)
    return np.asarray(values | is_sided, dtype=np.bool_)


def _moved(first: FloatArray, second: FloatArray) -> FloatArray:
    """East and north of the second places from the first, m: on the map, else from the stations' origins."""
    lat, lon = np.radians(first[:, 0]), np.radians(first[:, 1])
    offset = np.full((len(first), 2), np.nan)
    known = np.flatnonzero(~np.isnan(first[:, :2] + second[:, :2]).any(axis=1))
    if len(known):
        home = GeoOrigin(lat_rad=float(lat[known[0]]), lon_rad=float(lon[known[0]]), alt_msl_m=0.0)
        then = east_north(home, np.radians(second[known, 0]), np.radians(second[known, 1]))
        offset[known] = then - east_north(home, lat[known], lon[known])
    return np.where(np.isnan(offset), second[:, 6:8] - first[:, 6:8], offset)


def _cov(place: FloatArray) -> FloatArray:
    """``(k, 2, 2)`` of east and north."""
    return place[:, [2, 3, 3, 4]].reshape(-1, 2, 2)


def _longest(cov: FloatArray) -> FloatArray:
    """The larger eigenvalue, ``(k,)``."""
    mean = (cov[:, 0, 0] + cov[:, 1, 1]) / 2
    return mean + np.hypot((cov[:, 0, 0] - cov[:, 1, 1]) / 2, cov[:, 0, 1])


def _mahalanobis(moved: FloatArray, cov: FloatArray) -> FloatArray:
    east, north = moved.T
    determinant = cov[:, 0, 0] * cov[:, 1, 1] - cov[:, 0, 1] ** 2
    square = cov[:, 1, 1] * east**2 - 2 * cov[:, 0, 1] * east * north + cov[:, 0, 0] * north**2
    return np.sqrt(np.maximum(_ratio(square, determinant), 0))


def _shared(variance: FloatArray, other: FloatArray) -> FloatArray:
    gap = np.abs(variance - other)
    root: FloatArray = np.sqrt(gap)
    return np.where(gap > _EQUAL * (variance + other), root, np.nan)


def _ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    """NaN where nothing is below."""
    ratio = np.full(above.shape, np.nan)
    np.divide(above, below, out=ratio, where=below > 0)
    return ratio
