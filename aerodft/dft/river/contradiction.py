"""Test of the widths of several images against the errors that the images state.

A residual is an image's width of a transect less the fused one, so a river that varies along its course leaves none. It
is compared with the stated errors: those that all widths of an image share (of pose, lens, elevation), with the width
that a displaced transect would have, and each bank pair's own. Deviations of neighbouring transects of one image from a
straight line count as own errors too: bushes and picks vary from transect to transect, wrong poses do not.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.model import FloatArray, IntArray

CAUSES: Final = ("clock", "scale")
"""Errors that all images may have in common, as ``RiverWidths.by_cause`` has them: stamps (s), focal length (share)."""

_MIN_TRANSECTS: Final = 3  # of an image that is tested
_SECOND_DIFFERENCE_VAR: Final = 6.0  # variance of a - 2 b + c for independent a, b, c of variance 1
_MAX_LEFT: Final = (
    0.8,
    0.7,
)  # of the residuals' mean size, beside each cause; 0.2 to 0.75 in simulated flights
_ITERATIONS: Final = 20  # of the fit by absolute values
_SMALLEST: Final = 1e-3  # relative residual below which the fit counts a residual fully


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Scatter of several images against their stated errors.

    Attributes:
        stds: Root of the median over images of chi-square per width. It is below about 1 where the stated standard
            deviations hold, and 0 where no transect is seen twice.
        cause: The one of ``CAUSES`` that explains most of the scatter as one error of all images; None where none does.
        error: That error to first order, s or share of the focal length. A clock's holds to about a fifth up to 1 s, of
            a focal length's the sign alone.
    """

    stds: float
    cause: str | None = None
    error: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Residuals ``(r,)`` of all images' widths of transects that at least two images show.

    Attributes:
        image: Image of each.
        transect: Transect of each.
        width_m: Width by the image, m.
        fused_m: Fused width of the transect, m.
        residual_m: The difference, with the share of the image itself in the fused width allowed for, m.
        own_m: Stated standard deviations of the independent errors, m.
        shared: ``(r, s)`` change by one standard deviation of each error that the image's widths share, m.
        shift_m: Standard deviation of the transect's place along the river, m.
        spacing_m: Distance of neighbouring transects, m.
        by_cause: ``(r, 2)`` derivatives by the ``CAUSES``, less their means of each transect.
    """

    image: IntArray
    transect: IntArray
    width_m: FloatArray
    fused_m: FloatArray
    residual_m: FloatArray
    own_m: FloatArray
    shared: FloatArray
    shift_m: FloatArray
    spacing_m: float
    by_cause: FloatArray


def image_contradiction(residuals: Residuals) -> Contradiction:
    """Compare images' widths with each other and with their stated errors.

    The median over images decides, so that masks which ran onto a bank in some of them do not.
    """
    found = [_reduced_chi2(residuals, rows) for rows in _images(residuals)]
    if not found:
        return Contradiction(0.0)
    cause, error = _likely_cause(residuals.residual_m / residuals.fused_m, residuals)
    return Contradiction(float(np.sqrt(np.median(found))), cause, error)


def _images(residuals: Residuals) -> list[IntArray]:
    """Rows of each image that has enough of them, by ascending transect."""
    order = np.lexsort((residuals.transect, residuals.image))
    parts = np.split(order, np.flatnonzero(np.diff(residuals.image[order])) + 1)
    return [part for part in parts if len(part) >= _MIN_TRANSECTS]


def _reduced_chi2(residuals: Residuals, rows: IntArray) -> float:
    """Chi-square of one image under its own and its shared errors: per width, or per shared error where that is more.

    One error of an image as a whole is one direction among as many as there are widths.
    """
    own_m = np.maximum(residuals.own_m[rows], _roughness_m(residuals, rows))
    errors, shared = residuals.residual_m[rows] / own_m, residuals.shared[rows] / own_m[:, None]
    axes, scales, _ = np.linalg.svd(shared, full_matrices=False)
    along = axes.T @ errors
    all_widths = float(np.sum(errors**2) - np.sum(along**2 * scales**2 / (1.0 + scales**2))) / len(rows)
    is_shared = scales > 1.0  # shared errors move these widths by more than their own ones do
    return max(all_widths, float(np.mean((along**2 / (1.0 + scales**2))[is_shared])) if is_shared.any() else 0.0)


def _roughness_m(residuals: Residuals, rows: IntArray) -> float:
    """Root mean square deviation of one image's widths from lines through neighbours one place std away."""
    width_m, transect = residuals.width_m[rows], residuals.transect[rows]
    lag = max(1, round(float(np.median(residuals.shift_m[rows])) / residuals.spacing_m))
    by_transect = np.full(int(transect[-1] - transect[0]) + 1 + 2 * lag, np.nan)
    by_transect[transect - transect[0] + lag] = width_m
    bent_m = by_transect[: -2 * lag] - 2 * by_transect[lag:-lag] + by_transect[2 * lag :]
    bent_m = bent_m[np.isfinite(bent_m)]
    return float(np.sqrt(np.mean(bent_m**2) / _SECOND_DIFFERENCE_VAR)) if len(bent_m) >= _MIN_TRANSECTS else 0.0


def _likely_cause(relative: FloatArray, residuals: Residuals) -> tuple[str | None, float]:
    """The cause of which one common error leaves the least of the relative residuals ``(r,)``, and that error."""
    before = float(np.mean(np.abs(relative)))
    left, errors = [], []
    for column in (residuals.by_cause / residuals.fused_m[:, None]).T:
        weight, error = np.ones(len(relative)), 0.0
        for _ in range(_ITERATIONS):
            length = float(np.sum(weight * column**2))
            error = float(np.sum(weight * column * relative)) / length if length > 0 else 0.0
            weight = 1.0 / np.maximum(np.abs(relative - error * column), _SMALLEST)
        left.append(float(np.mean(np.abs(relative - error * column))))
        errors.append(error)
    best = int(np.argmin(left))
    return (CAUSES[best], errors[best]) if left[best] < _MAX_LEFT[best] * before else (None, 0.0)
