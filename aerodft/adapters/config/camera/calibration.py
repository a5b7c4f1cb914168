"""Calibration files, read and written: biases of the telemetry, or a fixed camera's pose, and the lens."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import tomli_w
from pydantic import Field, model_validator

from aerodft.adapters.atomic_file import write_whole
from aerodft.adapters.config.camera.bias_tables import BiasTable, bias_table, biases_from
from aerodft.adapters.config.camera.camera import CameraTable, camera_document, camera_from
from aerodft.adapters.config.camera.fixed_pose import FixedPose
from aerodft.adapters.config.camera.pose_tables import CalibratedPoseTable, calibrated_pose_from, calibrated_pose_table
from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.tables import Table, impossible
from aerodft.errors import InputError
from aerodft.model import Calibration, Camera, ProjectionModel


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


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationFile:
    """What a calibration file says.

    Attributes:
        biases: Of the telemetry, all of them 0 without ``[bias]``; their id is the hash of the file's bytes.
        pose: A fixed camera's, with its latitude and longitude; None without ``[pose]``.
        camera: With the lens that was found too; None where the lens was taken as it is.
        model: The projection model that all this is of.
    """

    biases: Calibration
    pose: FixedPose | None
    camera: Camera | None
    model: ProjectionModel


def load_calibration(path: Path) -> CalibrationFile:
    """Read a calibration file.

    Args:
        path: A TOML file with ``[bias]`` (see ``bias_tables``) and/or ``[pose]`` (``height_agl_m``, ``tilt_deg``,
            ``roll_deg``, ``heading_deg``, ``lat_deg``, ``lon_deg``, ``alt_msl_m``); biases and angles are numbers
            (taken as exact) or ``{value, std}``.

    Raises:
        ConfigError: Missing file, TOML syntax, unknown key, impossible value.
    """
    where, data = str(path), read_bytes(path)
    table = validated(CalibrationTable, parse_toml(data, where), where)
    identity = f"sha256:{hashlib.sha256(data).hexdigest()}"
    lens = None if table.camera is None else validated(CameraTable, table.camera, where, "camera.")
    return CalibrationFile(
        biases=biases_from(table.bias or BiasTable(), identity, where),
        pose=calibrated_pose_from(table.pose, identity, where) if table.pose else None,
        camera=None if lens is None else camera_from(lens, where, "camera."),
        model=table.model,
    )


def write_calibration(
    path: Path,
    found: FixedPose | Calibration,
    camera: Camera | None,
    model: ProjectionModel,
    provenance: dict[str, Any],
) -> None:
    """Write a calibration, as ``load_calibration`` reads it.

    Args:
        path: The TOML file; one that is there is replaced.
        found: A fixed camera's pose, or what telemetry is off by.
        camera: The camera where its lens was found too; None where it was taken as it is.
        model: The projection model that it is of, and for.
        provenance: Where all this comes from, for people; what is None is left out.

    Raises:
        InputError: The file cannot be written.
    """
    table = CalibrationTable.model_construct(
        model=model,
        provenance={key: value for key, value in provenance.items() if value is not None},
        bias=bias_table(found) if isinstance(found, Calibration) else None,
        pose=calibrated_pose_table(found) if isinstance(found, FixedPose) else None,
        camera=None if camera is None else camera_document(camera),
    )
    try:
        write_whole(path, tomli_w.dumps(table.to_toml()).encode())
    except OSError as error:
        what, expected = "the calibration cannot be written", "a file to write to"
        raise InputError(what, where=path, got=error.strerror, expected=expected) from error
