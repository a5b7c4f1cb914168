"""Calibrations to files, as ``calibration.load_calibration`` and ``load_calibrated_camera`` read them."""

from pathlib import Path
from typing import Any

import tomli_w

from aerodft.adapters.config.bias_tables import bias_document
from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.config.fixed_pose import FixedPose
from aerodft.adapters.config.units import to_deg
from aerodft.adapters.whole_file import replaced
from aerodft.errors import InputError
from aerodft.model.calibration import Calibration
from aerodft.model.camera import Camera
from aerodft.model.measurement import ProjectionModel


def write_calibration(
    path: Path, pose: FixedPose, camera: Camera | None, model: ProjectionModel, provenance: dict[str, Any]
) -> None:
    """Write a fixed camera's calibration.

    Args:
        path: The TOML file; one that is there is replaced.
        pose: What was found.
        camera: The camera where its lens was found too; None where it was taken as it is.
        model: The projection model that it is of, and for.
        provenance: Where all this comes from, for people; what is None is left out.

    Raises:
        InputError: The file cannot be written.
    """
    _write(path, {"pose": _pose(pose)}, camera, model, provenance)


def write_biases(
    path: Path, found: Calibration, camera: Camera | None, model: ProjectionModel, provenance: dict[str, Any]
) -> None:
    """Write what telemetry is off by; as :func:`write_calibration`, which writes a pose."""
    _write(path, {"bias": bias_document(found)}, camera, model, provenance)


def _write(
    path: Path, found: dict[str, Any], camera: Camera | None, model: ProjectionModel, provenance: dict[str, Any]
) -> None:
    document: dict[str, Any] = {
        "model": str(model),
        "provenance": {key: value for key, value in provenance.items() if value is not None},
        **found,
    }
    if camera is not None:
        document["camera"] = camera_document(camera)
    try:
        write_whole(path, tomli_w.dumps(document).encode())
    except OSError as error:
        what, expected = "the calibration cannot be written", "a file to write to"
        raise InputError(what, where=path, got=error.strerror, expected=expected) from error


def write_whole(path: Path, data: bytes) -> None:
    """Write all of a file or none of it, as ``replaced``."""
    with replaced(path) as partial:
        partial.write_bytes(data)


def _pose(pose: FixedPose) -> dict[str, Any]:
    std = pose.std
    stated: dict[str, Any] = {
        "height_agl_m": {"value": pose.height_agl_m, "std": std.height_agl_m},
        "tilt_deg": {"value": to_deg(pose.tilt_rad), "std": to_deg(std.tilt_rad)},
        "roll_deg": {"value": to_deg(pose.roll_rad), "std": to_deg(std.roll_rad)},
        "heading_deg": {"value": to_deg(pose.heading_rad), "std": to_deg(std.heading_rad)},
    }
    if pose.lat_rad is not None and pose.lon_rad is not None:
        stated |= {"lat_deg": to_deg(pose.lat_rad), "lon_deg": to_deg(pose.lon_rad)}
        if pose.alt_msl_m is not None:
            stated["alt_msl_m"] = pose.alt_msl_m
    else:
        stated |= {"east_m": pose.east_m, "north_m": pose.north_m}
    stated["covariance"] = [list(row) for row in pose.covariance]
    if pose.lens_covariance:
        stated["lens_covariance"] = [list(row) for row in pose.lens_covariance]
    return stated
