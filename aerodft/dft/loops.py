"""The loops from derivatives to covariances: as written for a point or two, over whole arrays, compiled for many."""

from aerodft.dft import propagation, propagation_arrays
from aerodft.geometry.jit import expect, is_loaded
from aerodft.model.arrays import FloatArray

# Steps of the compiler's reckoning that go without it: for all of a call, and for each point in it.
_DEPEND, _DEPEND_POINT = 40, 1
_SPREAD, _SPREAD_POINT, _SPREAD_WRITTEN = 350, 4, 260
_JOINT, _JOINT_SCALAR, _JOINT_WRITTEN = 200, 3, 140


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
    shared_cov: FloatArray,
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
    module.spread(jacobians, shared_cov, elevation_var, pixel_var, sight, cov, range_var)


def joint_variances(
    gradient: tuple[FloatArray, FloatArray, FloatArray],
    jacobians: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    shared_cov: FloatArray,
    elevation_var: FloatArray,
    pixel_var: FloatArray,
    out: FloatArray,
) -> None:
    """``propagation.joint_variances``."""
    together, written = _JOINT + _JOINT_SCALAR * out.size, _JOINT_WRITTEN * out.size
    expect(min(together, written))
    module = propagation if written < together or is_loaded() else propagation_arrays
    module.joint_variances(gradient, jacobians, shared_cov, elevation_var, pixel_var, out)
