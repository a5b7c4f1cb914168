"""Measuring in one image with a known pose: probes to measurements, and any number of pixels to ground points."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, overload

import numpy as np
import numpy.typing as npt

from aerodft.app.measure.probes import ImageProbe, requests_of
from aerodft.app.measure.scene import CameraPose, GroundTerms, MeasuredSurface, image_setup
from aerodft.dft import ground_frame_pose
from aerodft.dft import measure as measure_batch
from aerodft.dft.maps import GroundMap, ground_covariances
from aerodft.errors import NoAnswerError
from aerodft.model import Camera, FloatArray, Measurement, Pose, PoseBatch, PoseSample, ProjectionModel


@overload
def measure(
    camera: Camera | None,
    pose: CameraPose | PoseSample | None,
    probes: ImageProbe,
    *,
    model: ProjectionModel | str | None = None,
    ground: GroundTerms = None,
    max_range_m: float | None = None,
    calibration: str | Path | None = None,
) -> Measurement: ...


@overload
def measure(
    camera: Camera | None,
    pose: CameraPose | PoseSample | None,
    probes: Sequence[ImageProbe],
    *,
    model: ProjectionModel | str | None = None,
    ground: GroundTerms = None,
    max_range_m: float | None = None,
    calibration: str | Path | None = None,
) -> list[Measurement]: ...


def measure(
    camera: Camera | None,
    pose: CameraPose | PoseSample | None,
    probes: ImageProbe | Sequence[ImageProbe],
    *,
    model: ProjectionModel | str | None = None,
    ground: GroundTerms = None,
    max_range_m: float | None = None,
    calibration: str | Path | None = None,
) -> Measurement | list[Measurement]:
    """Measure pixels of one image.

    Args:
        camera: The camera, see ``load_camera``; None for that of the calibration.
        pose: Where it was and where it looked; None for the pose of the calibration.
        probes: What to measure: one probe, or several in the same image.
        model: ``"pinhole"`` or the paper's ``"dft"``; None for the calibration's, else the pinhole.
        ground: ``Slope`` or ``ElevationModel``; None for level ground.
        max_range_m: Maximum range in metres; None for no limit.
        calibration: A calibration file: with pose and lens, in place of both; or with what telemetry is off by, which
            is taken from the pose.

    Returns:
        A measurement for one probe, a list for several. Where ``status`` is not ``ok``, ``reasons`` says why, and
        ``value``, ``std`` and ``ci95`` are None. ``value`` and its standard deviation ``std`` are in ``unit``.

    Raises:
        AerodftError: Something is impossible, does not go together, or cannot be read.

    Example:
        >>> import aerodft as ad
        >>> camera = ad.load_camera("configs/cameras/canon-1000d.toml")
        >>> pose = ad.CameraPose(height_m=10.48, tilt_deg=67, std=ad.PoseStd(height_m=0.1, tilt_deg=0.2))
        >>> width = ad.measure(camera, pose, ad.Width([(812, 1604), (1377, 1611)]))
        >>> f"{width.value:.2f} +- {width.std:.2f} {width.unit}, {width.status}"
        '3.99 +- 0.05 m, ok'
    """
    chosen = None if model is None else ProjectionModel(model)
    surface = MeasuredSurface(max_range_m=max_range_m)
    setup, sample = image_setup(camera, pose, ground=ground, model=chosen, calibration=calibration, surface=surface)
    wanted = (probes,) if isinstance(probes, ImageProbe) else probes
    found = measure_batch(setup, PoseBatch.from_samples([sample]), requests_of(wanted))[0]
    return found[0] if isinstance(probes, ImageProbe) else found


@overload
def ground_points(
    camera: Camera,
    pose: CameraPose | PoseSample | Pose,
    pixels: npt.ArrayLike,
    *,
    elevation_m: float = 0.0,
    covariance: Literal[False] = False,
) -> FloatArray: ...


@overload
def ground_points(
    camera: Camera,
    pose: CameraPose | PoseSample | Pose,
    pixels: npt.ArrayLike,
    *,
    elevation_m: float = 0.0,
    covariance: Literal[True],
    elevation_std_m: float = 0.0,
    std_px: float = 1.0,
) -> tuple[FloatArray, FloatArray]: ...


def ground_points(
    camera: Camera,
    pose: CameraPose | PoseSample | Pose,
    pixels: npt.ArrayLike,
    *,
    elevation_m: float = 0.0,
    covariance: bool = False,
    elevation_std_m: float = 0.0,
    std_px: float = 1.0,
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Ground points that pixels show, of level ground; pinhole model.

    Args:
        camera: The camera.
        pose: Where it was and where it looked.
        pixels: ``(..., 2)`` px, in the image or beside it; (0, 0) is the middle of the top-left pixel.
        elevation_m: Height of the measured surface above the ground.
        covariance: Whether covariances are wanted as well.
        elevation_std_m: Standard deviation of the elevation.
        std_px: Standard deviation of each pixel coordinate.

    Returns:
        ``(..., 3)`` in the ground frame, m: X to the right and Y ahead of the camera, Z up, from the point of the
        ground below it; NaN at and above the horizon, and beyond the valid part of the lens. With ``covariance`` also
        ``(..., 3, 3)`` m^2, by first order: each point's from the errors of pose, intrinsics and elevation and from its
        pixel's. All points share the former, so that distances between near points are known better than these
        covariances say (see ``measure``); the pixels' are independent.

    Raises:
        AerodftError: The pose is impossible, or there is none.

    Example:
        >>> import aerodft as ad
        >>> camera = ad.load_camera("configs/cameras/canon-1000d.toml")
        >>> pose = ad.CameraPose(height_m=10.48, tilt_deg=67)
        >>> ad.ground_points(camera, pose, [(1000, 493), (1944, 1296)]).round(1)
        array([[-20.9,  70. ,   0. ],
               [  0. ,  24.7,   0. ]])
        >>> points, covariances = ad.ground_points(camera, pose, [(1944, 1296)], covariance=True)
        >>> covariances.shape
        (1, 3, 3)
    """
    ground, own = _ground_map(camera, pose, float(elevation_m))
    pixels_px = np.ascontiguousarray(pixels, dtype=np.float64)
    points = ground.points_enu_m(pixels_px)
    if not covariance:
        return points
    found = ground_covariances(camera, own, pixels_px, elevation_m, elevation_std_m, std_px)
    found[np.isnan(points[..., 0])] = np.nan
    return points, found


def _ground_map(camera: Camera, pose: CameraPose | PoseSample | Pose, elevation_m: float) -> tuple[GroundMap, Pose]:
    """Pixels to the ground frame of a pose, and the pose there."""
    known = pose.pose() if isinstance(pose, CameraPose) else pose.pose if isinstance(pose, PoseSample) else pose
    if known is None:
        raise NoAnswerError("no pose", got="a pose sample without one")
    own = ground_frame_pose(known)
    return GroundMap.at(camera, own, elevation_m), own
