"""The loops from derivatives to covariances: as written for a point or two, over whole arrays, compiled for many."""

from typing import NamedTuple

import numpy as np

from aerodft.dft import propagation, propagation_arrays
from aerodft.geometry.jit import expect, is_loaded
from aerodft.model.arrays import FloatArray, IntArray

# Steps of the compiler's reckoning that go without it: for all of a call, and for each point in it.
_DEPEND, _DEPEND_POINT = 40, 1
_SPREAD, _SPREAD_POINT, _SPREAD_WRITTEN = 350, 4, 260
_JOINT, _JOINT_SCALAR, _JOINT_WRITTEN = 200, 3, 140


class SharedErrors(NamedTuple):
    """Errors that all points of an image have in common; most of them vary with few others, and many not at all.

    Attributes:
        cov: ``(n, s, s)`` of ``n`` images.
        partners: ``(s, s)`` for each error first those that it varies with in any image, in order.
        partner_count: ``(s,)`` how many these are.
    """

    cov: FloatArray
    partners: IntArray
    partner_count: IntArray

    @staticmethod
    def of(cov: FloatArray) -> "SharedErrors":
        """Errors with covariances ``(n, s, s)``."""
        vary = np.any(cov != 0.0, axis=0)
        return SharedErrors(cov, np.argsort(~vary, axis=1, kind="stable"), vary.sum(axis=1))


def depend(
    met: tuple[FloatArray, FloatArray, FloatArray],
    rotation: FloatArray,
    rays_cam: FloatArray,
    by_px: FloatArray,
    by_intrinsics: FloatArray,
    shared: FloatArray,
    own: FloatArray,
) -> None:
    """``propagation.depend``."""
    points = shared.shape[0] * shared.shape[1]
    expect(_DEPEND + _DEPEND_POINT * points)
    module = propagation if is_loaded() else propagation_arrays
    module.depend(met, rotation, rays_cam, by_px, by_intrinsics, shared, own)


def spread(
    jacobians: tuple[FloatArray, FloatArray],
    errors: SharedErrors,
    elevation_var: FloatArray,
    pixel_var: FloatArray,
    sight: FloatArray,
    cov: FloatArray,
    range_var: FloatArray,
) -> None:
    """``propagation.spread``."""
    together, written = _SPREAD + _SPREAD_POINT * range_var.size, _SPREAD_WRITTEN * range_var.size
    expect(min(together, written))
    module = propagation if written < together or is_loaded() else propagation_arrays
    module.spread(jacobians, errors, elevation_var, pixel_var, sight, cov, range_var)


def joint_variances(
    gradient: tuple[FloatArray, FloatArray, FloatArray],
    points: tuple[FloatArray, FloatArray, IntArray],
    rays: tuple[FloatArray, FloatArray, IntArray],
    errors: SharedErrors,
    own_var: FloatArray,
    out: FloatArray,
) -> None:
    """``propagation.joint_variances``."""
    together, written = _JOINT + _JOINT_SCALAR * out.size, _JOINT_WRITTEN * out.size
    expect(min(together, written))
    module = propagation if written < together or is_loaded() else propagation_arrays
    module.joint_variances(gradient, points, rays, errors, own_var, out)
