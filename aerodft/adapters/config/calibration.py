"""Calibration files: TOML to :class:`aerodft.model.calibration.Calibration`, or to a fixed camera's pose."""

import hashlib
import math
from pathlib import Path
from typing import Annotated, Any, Self, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from aerodft.adapters.config.camera import CameraTable, camera_from
from aerodft.adapters.config.covariance import as_rows, checked_covariance
from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.station import FixedPose
from aerodft.adapters.config.tables import (
    BiasDeg,
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
from aerodft.adapters.config.units import to_deg
from aerodft.geometry.poses import camera_pose
from aerodft.model.calibration import Calibration
from aerodft.model.camera import Camera
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import PoseStd

Rows: TypeAlias = tuple[tuple[float, ...], ...] | None


class BiasTable(Table):
    """Corrections that are added to the telemetry's values."""

    height_m: Uncertain[Real] = Uncertain(value=0.0)
    tilt_deg: Uncertain[BiasDeg] = Uncertain(value=0.0)
    roll_deg: Uncertain[BiasDeg] = Uncertain(value=0.0)
    heading_deg: Uncertain[BiasDeg] = Uncertain(value=0.0)


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


def check_lens_covariance(covariance: Rows, lens: Rows) -> None:
    """Refuse a covariance with the lens without that of the pose, or of another size (for validators)."""
    if lens is None:
        return
    if covariance is None:
        raise impossible("lens_covariance", got="it without covariance", expected="both")
    if len(lens) != 6 or len({len(row) for row in lens}) != 1:  # noqa: PLR2004 - position and rotation
        raise impossible("lens_covariance", got=f"{len(lens)} rows", expected="6 rows of as many as the lens has")


def load_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    Args:
        path: A TOML file with ``[bias]`` (``height_m``, ``tilt_deg``, ``roll_deg``, ``heading_deg``) and/or ``[pose]``
            (``height_agl_m``, ``tilt_deg``, ``roll_deg``, ``heading_deg``, ``lat_deg``, ``lon_deg``, ``alt_msl_m``);
            biases and angles are numbers (taken as exact) or ``{value, std}``.

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
    return calibration_from(table.bias or BiasTable(), identity, pose), pose


def calibration_from(bias: BiasTable, identity: str, pose: FixedPose | None = None) -> Calibration:
    """The calibration that a validated table describes."""
    angles = (bias.tilt_deg, bias.roll_deg, bias.heading_deg)
    stds = [bias.height_m.std, *(math.radians(angle.std) for angle in angles)]
    return Calibration(
        id=identity,
        pose=None
        if pose is None
        else camera_pose(
            height_agl_m=pose.height_agl_m,
            tilt_rad=pose.tilt_rad,
            roll_rad=pose.roll_rad,
            heading_rad=pose.heading_rad,
            std=pose.std,
        ),
        height_bias_m=bias.height_m.value,
        tilt_bias_rad=math.radians(bias.tilt_deg.value),
        roll_bias_rad=math.radians(bias.roll_deg.value),
        heading_bias_rad=math.radians(bias.heading_deg.value),
        bias_cov=np.diag(np.square(stds)),
    )


def bias_document(calibration: Calibration) -> dict[str, Any]:
    """A calibration's biases as TOML keys; reading them gives the same biases (independent ones) again."""
    variances = np.zeros(4) if calibration.bias_cov is None else np.diag(calibration.bias_cov)
    height, tilt, roll, heading = (math.sqrt(variance) for variance in variances)
    return {
        "height_m": {"value": calibration.height_bias_m, "std": height},
        "tilt_deg": {"value": to_deg(calibration.tilt_bias_rad), "std": to_deg(tilt)},
        "roll_deg": {"value": to_deg(calibration.roll_bias_rad), "std": to_deg(roll)},
        "heading_deg": {"value": to_deg(calibration.heading_bias_rad), "std": to_deg(heading)},
    }


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
