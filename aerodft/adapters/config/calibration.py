"""Calibration files: TOML to :class:`aerodft.model.calibration.Calibration`, or to a fixed camera's pose."""

import hashlib
import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from aerodft.adapters.config.bias_tables import BiasTable, biases_from, check_lens_covariance
from aerodft.adapters.config.camera import CameraTable, camera_from
from aerodft.adapters.config.covariance import as_rows, checked_covariance
from aerodft.adapters.config.fixed_pose import FixedPose
from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.tables import (
    HeadingDeg,
    Latitude,
    Longitude,
    Many,
    Positive,
    Real,
    RollDeg,
    Table,
    TiltDeg,
    Uncertain,
    impossible,
)
from aerodft.geometry.poses import camera_pose
from aerodft.model.calibration import Calibration
from aerodft.model.camera import Camera
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import PoseStd


class CalibratedPoseTable(Table):
    """A fixed camera's pose, each number with or without its standard deviation."""

    height_agl_m: Uncertain[Positive]
    tilt_deg: Uncertain[TiltDeg]
    roll_deg: Uncertain[RollDeg] = Uncertain(value=0.0)
    heading_deg: Uncertain[HeadingDeg] = Uncertain(value=0.0)
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    alt_msl_m: Real | None = None
    east_m: Real = 0.0
    north_m: Real = 0.0
    covariance: Many[Many[Real]] | None = None
    lens_covariance: Many[Many[Real]] | None = None

    @model_validator(mode="after")
    def _position_is_whole(self) -> Self:
        check_position(self.lat_deg, self.lon_deg)
        check_local(self.lat_deg, self.east_m, self.north_m)
        check_lens_covariance(self.covariance, self.lens_covariance)
        return self


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


def check_position(lat_deg: float | None, lon_deg: float | None) -> None:
    """Refuse half of a position (for validators)."""
    if (lat_deg is None) != (lon_deg is None):
        missing = "lat_deg" if lat_deg is None else "lon_deg"
        raise impossible(missing, got="nothing", expected="both lat_deg and lon_deg, or none of them")


def check_local(lat_deg: float | None, east_m: float, north_m: float) -> None:
    """Refuse a local place beside a geographic one (for validators)."""
    if lat_deg is not None and (east_m or north_m):
        raise impossible("east_m" if east_m else "north_m", got="it beside lat_deg", expected="one of the two")


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
    pose = fixed_from(table.pose, identity, str(path)) if table.pose else None
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


def fixed_from(table: CalibratedPoseTable, identity: str, where: str) -> FixedPose:
    """The fixed pose that a validated table describes.

    Raises:
        ConfigError: Its covariance is none.
    """
    covariance: tuple[tuple[float, ...], ...] = ()
    if table.covariance is not None:
        covariance = as_rows(checked_covariance(table.covariance, 6, where=where, key="pose.covariance"))
    return FixedPose(
        height_agl_m=table.height_agl_m.value,
        tilt_rad=math.radians(table.tilt_deg.value),
        roll_rad=math.radians(table.roll_deg.value),
        heading_rad=math.radians(table.heading_deg.value),
        lat_rad=None if table.lat_deg is None else math.radians(table.lat_deg),
        lon_rad=None if table.lon_deg is None else math.radians(table.lon_deg),
        alt_msl_m=table.alt_msl_m,
        std=PoseStd(
            height_agl_m=table.height_agl_m.std,
            tilt_rad=math.radians(table.tilt_deg.std),
            roll_rad=math.radians(table.roll_deg.std),
            heading_rad=math.radians(table.heading_deg.std),
        ),
        covariance=covariance,
        lens_covariance=tuple(map(tuple, table.lens_covariance or ())),
        east_m=table.east_m,
        north_m=table.north_m,
        calibration=identity,
    )
