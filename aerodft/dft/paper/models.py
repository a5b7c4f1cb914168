"""One image measured under both projection models, and which of the paper's approximations make the difference."""

from dataclasses import dataclass, replace

import numpy as np

from aerodft.dft import equations
from aerodft.dft.engine import measure
from aerodft.dft.request import Request, Setup
from aerodft.geometry import camera_angles
from aerodft.model import Camera, FloatArray, FloatLike, Measurement, Pose, PoseBatch, PoseSample, ProjectionModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelDifference:
    """One probe under both models; differences are ``dft`` minus ``pinhole``, None where either has no value.

    Attributes:
        pinhole: The measurement with intrinsics, lens and any attitude.
        dft: The measurement by the paper's equations.
        value: Difference of the values; None also for kinds without a value.
        percent: The difference in percent of the pinhole's value; None also where that is 0.
        ground_m: ``(n, 2)`` difference of X and Y of every ground point, in the ground frame.
        equation_5_m: ``(n,)`` part of X due to Eq. 5; None also where not every point is on the probe's plane.
        angles_m: ``(n, 2)`` rest of X, and all of Y: due to angles linear in pixels (and to lens distortion, an
            off-centre principal point and roll, which the paper does not model).
    """

    pinhole: Measurement
    dft: Measurement
    value: float | None = None
    percent: float | None = None
    ground_m: FloatArray | None = None
    equation_5_m: FloatArray | None = None
    angles_m: FloatArray | None = None


def right_by_geometry(height_m: FloatLike, tilt_rad: FloatLike, psi_rad: FloatLike, phi_rad: FloatLike) -> FloatArray:
    """X (m) from the angles of Eq. 2 and 3 by exact geometry, where Eq. 5 has ``Y tan(phi)``.

    A ray at ``phi`` from the image's middle column, seen from the optical axis, leaves it at
    ``h cos(psi - theta) / cos(psi)`` of distance along the axis: ``X = h tan(phi) cos(psi - theta) / cos(psi)``. Eq. 5
    gives ``sin(psi) / cos(psi - theta)`` of that: nothing at nadir, half at 30 degrees, nearly all at the horizon.

    Returns:
        X, broadcast over the arguments; NaN at and above the horizon.
    """
    psi = np.asarray(psi_rad, dtype=np.float64)
    ahead = equations.ground_ahead(height_m, psi)  # for its NaN
    along_axis = height_m * np.cos(psi - tilt_rad) / np.cos(psi)
    return np.asarray(np.where(np.isnan(ahead), np.nan, along_axis * np.tan(phi_rad)))


def compare_models(setup: Setup, sample: PoseSample, requests: tuple[Request, ...]) -> list[ModelDifference]:
    """Measure every request at one pose under both models; ``setup.model`` is ignored."""
    poses = PoseBatch.from_samples([sample])
    pinhole, dft = (
        measure(replace(setup, model=model), poses, requests)[0]
        for model in (ProjectionModel.PINHOLE, ProjectionModel.DFT)
    )
    return [_difference(setup, sample, *each) for each in zip(requests, pinhole, dft, strict=True)]


def _difference(
    setup: Setup, sample: PoseSample, request: Request, pinhole: Measurement, dft: Measurement
) -> ModelDifference:
    if sample.pose is None or pinhole.ground_m is None or dft.ground_m is None:
        return ModelDifference(pinhole=pinhole, dft=dft)
    pinhole_m, dft_m = np.array(pinhole.ground_m), np.array(dft.ground_m)
    value = None if pinhole.value is None or dft.value is None else dft.value - pinhole.value
    found = ModelDifference(
        pinhole=pinhole,
        dft=dft,
        value=value,
        percent=None if value is None or not pinhole.value else 100 * value / pinhole.value,
        ground_m=dft_m[:, :2] - pinhole_m[:, :2],
    )
    on_plane = [
        len(points) == request.count and np.allclose(points[:, 2], request.probe.elevations_m(request.count))
        for points in (pinhole_m, dft_m)
    ]
    return _split(found, setup.camera, sample.pose, request) if all(on_plane) else found


def _split(found: ModelDifference, camera: Camera, pose: Pose, request: Request) -> ModelDifference:
    pixels = request.pixels_px
    tilt, _, _ = camera_angles(pose.wxyz)
    height = pose.position_enu_m[2] - np.array(request.probe.elevations_m(request.count))
    psi = equations.vertical_angle(pixels[:, 1], tilt, camera.height_px, camera.vfov_rad)
    phi = equations.rotation_angle(pixels[:, 0], camera.width_px, camera.hfov_rad)
    by_equation_5 = equations.ground_right(equations.ground_ahead(height, psi), phi)
    equation_5 = by_equation_5 - right_by_geometry(height, tilt, psi, phi)
    angles = np.asarray(found.ground_m) - np.stack([equation_5, np.zeros_like(equation_5)], axis=-1)
    return replace(found, equation_5_m=equation_5, angles_m=angles)
