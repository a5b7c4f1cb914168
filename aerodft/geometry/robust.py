"""Robust estimation: scale of residuals, weights under t-distributed errors, one re-weighted step."""

from typing import Final

import numpy as np
import numpy.typing as npt

from aerodft.model import FloatArray, FloatLike

_STD_PER_MAD: Final = 1.4826  # of a normal distribution


def robust_std(deviations: npt.ArrayLike) -> float:
    """Standard deviation of deviations from 0, by the median of their absolute values."""
    return float(robust_stds(np.ravel(deviations)))


def robust_stds(deviations: npt.ArrayLike) -> FloatArray:
    """Standard deviations ``(...)`` of deviations ``(..., n)`` from 0, by the medians of their absolute values."""
    return np.asarray(_STD_PER_MAD * np.median(np.abs(deviations), axis=-1))


def student_weights(squares: FloatLike, dimensions: int, dof: float) -> FloatArray:
    """Weights ``(...)`` with which least squares has the gradient of t-distributed errors.

    Args:
        squares: ``(...)`` squared lengths of residual vectors, in squared standard deviations.
        dimensions: Of the vectors.
        dof: Degrees of freedom of the distribution.
    """
    return np.asarray((dof + dimensions) / (dof + squares))


def student_loss(squares: FloatLike, dimensions: int, dof: float) -> FloatArray:
    """Negative log likelihood ``(...)`` of t-distributed errors, up to a constant; arguments of ``student_weights``."""
    return np.asarray((dof + dimensions) / 2 * np.log1p(np.asarray(squares) / dof))


def weighted_step(
    jac: FloatArray,
    residuals: FloatArray,
    weights: FloatArray,
    prior: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """One Gauss-Newton step of weighted least squares, with the information that it is known by.

    Args:
        jac: ``(..., n, d, k)`` derivatives of the predictions of ``n`` vectors by the unknowns.
        residuals: ``(..., n, d)`` observed minus predicted.
        weights: ``(..., n)`` of the vectors.
        prior: Information ``(k, k)`` of what else is known of the unknowns, and where it has them ``(k,)``, from the
            present ones.

    Returns:
        Step ``(..., k)``, and information ``(..., k, k)``.
    """
    flat = jac.reshape(*jac.shape[:-3], -1, jac.shape[-1])
    weighted = np.swapaxes(flat * np.repeat(weights, jac.shape[-2], axis=-1)[..., None], -1, -2)
    information, slope = weighted @ flat, weighted @ residuals.reshape(*flat.shape[:-1], 1)
    if prior is not None:
        information, slope = information + prior[0], slope + (prior[0] @ prior[1])[:, None]
    return np.asarray(np.linalg.solve(information, slope)[..., 0]), np.asarray(information)
