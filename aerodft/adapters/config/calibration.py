"""Calibration files: TOML to :class:`aerodft.model.calibration.Calibration`, or to a fixed camera's pose."""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from aerodft.adapters.config.bias_tables import BiasTable, biases_from
from aerodft.adapters.config.camera import CameraTable, camera_from
from aerodft.adapters.config.fixed_pose import FixedPose
from aerodft.adapters.config.pose_tables import CalibratedPoseTable, calibrated_pose_from
from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.tables import Table, impossible
from aerodft.geometry.poses import camera_pose
from aerodft.model.calibration import Calibration
from aerodft.model.camera import Camera
from aerodft.model.measurement import ProjectionModel


class CalibrationTable(Table):
    """A calibration file: biases for a moving camera, a pose for a fixed one, or both; the lens where it was found too.

    ``provenance`` is for people.
    """

    model: Annotated[ProjectionModel, Field(strict=False)] = ProjectionModel.PINHOLE
    bias: BiasTable | None = None
    pose: CalibratedPoseTable | None = None
    camera: dict[str, Any] | None = None
    provenance: dict[str, Any] | None = None

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if self.bias is None and self.pose is None:
            raise impossible("", got="no table", expected="[bias] or [pose]")
        return self


def load_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    Args:
        path: A TOML file with ``[bias]`` (see ``bias_tables``) and/or ``[pose]`` (``height_agl_m``, ``tilt_deg``,
            ``roll_deg``, ``heading_deg``, ``lat_deg``, ``lon_deg``, ``alt_msl_m``); biases and angles are numbers
            (taken as exact) or ``{value, std}``.

    Returns:
        The calibration; its id is the hash of the file's bytes, its pose stands above the ENU origin.

    Raises:
        ConfigError: Missing file, TOML syntax, unknown key, impossible value.
    """
    return _read(path)[0]


def load_calibrated_pose(path: Path) -> FixedPose | None:
    """A calibration file's pose with its latitude and longitude; None where it has no ``[pose]``.

    Raises:
        ConfigError: As :func:`load_calibration`.
    """
    return _read(path)[1]


def load_calibrated_lens(path: Path) -> tuple[Camera | None, ProjectionModel]:
    """The camera of a calibration that found the lens too, None where it did not; and the model that it is of.

    Raises:
        ConfigError: As :func:`load_calibration`.
    """
    table = validated(CalibrationTable, parse_toml(read_bytes(path), str(path)), str(path))
    if table.camera is None:
        return None, table.model
    return camera_from(validated(CameraTable, table.camera, str(path), "camera."), str(path), "camera."), table.model


def _read(path: Path) -> tuple[Calibration, FixedPose | None]:
    data = read_bytes(path)
    table = validated(CalibrationTable, parse_toml(data, str(path)), str(path))
    identity = f"sha256:{hashlib.sha256(data).hexdigest()}"
    pose = calibrated_pose_from(table.pose, identity, str(path)) if table.pose else None
    return calibration_from(table.bias or BiasTable(), identity, pose, str(path)), pose


def calibration_from(bias: BiasTable, identity: str, pose: FixedPose | None = None, where: str = "") -> Calibration:
    """The calibration that a validated table describes.

    Raises:
        ConfigError: Its covariance is none.
    """
    stands = None
    if pose is not None:
        stands = camera_pose(
            height_agl_m=pose.height_agl_m,
            tilt_rad=pose.tilt_rad,
            roll_rad=pose.roll_rad,
            heading_rad=pose.heading_rad,
            std=pose.std,
        )
    return replace(biases_from(bias, identity, where), pose=stands)
