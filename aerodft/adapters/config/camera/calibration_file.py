"""Calibration files, read and written: biases of the telemetry, or a fixed camera's pose, and the lens."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import numpy as np
import tomli_w
from pydantic import Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.camera.camera_file import camera_document, camera_from
from aerodft.adapters.config.camera.fixed_pose import (
    CalibratedPoseTable,
    FixedPose,
    StdTable,
    calibrated_pose_from,
    stds_from,
)
from aerodft.adapters.config.covariance import as_rows, check_covariance, check_lens_covariance, symmetric
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.tables import SiAttribute, Table, Uncertain, si_value
from aerodft.adapters.files import write_whole
from aerodft.errors import located, os_errors_as
from aerodft.model import BIASES, BiasValues, Calibration, Camera, KnownPoint, PoseStd, ProjectionModel

_IN_ORDER = ("height_m", "tilt_rad", "roll_rad", "heading_rad", "pan_rad", "east_m", "north_m", "time_s")
"""Attributes of ``BiasValues`` in the order of ``BIASES``."""


class BiasTable(Table):
    """Corrections that are added to the telemetry's values; and an offset that is added to the images' stamps.

    ``covariance`` has 8 rows, in the order of ``model.calibration.BIASES`` and in metres, radians and seconds; it takes
    the place of the single stds. ``lens_covariance`` has 8 rows, of as many as the lens has.
    """

    height_m: Uncertain[keys.Real] = Uncertain(value=0.0)
    tilt_deg: Uncertain[keys.BiasDeg] = Uncertain(value=0.0)
    roll_deg: Uncertain[keys.BiasDeg] = Uncertain(value=0.0)
    heading_deg: Uncertain[keys.BiasDeg] = Uncertain(value=0.0)
    pan_deg: Uncertain[keys.BiasDeg] = Uncertain(value=0.0)
    east_m: Uncertain[keys.Real] = Uncertain(value=0.0)
    north_m: Uncertain[keys.Real] = Uncertain(value=0.0)
    time_offset_s: Annotated[Uncertain[keys.TimeOffset], SiAttribute("time_s")] = Uncertain(value=0.0)
    noise: StdTable = StdTable()
    covariance: keys.Matrix | None = None
    lens_covariance: keys.Matrix | None = None

    @model_validator(mode="after")
    def _covariances_fit(self) -> Self:
        check_covariance(self.covariance, len(BIASES), ", ".join(BIASES))
        check_lens_covariance(self.covariance, self.lens_covariance, len(BIASES))
        return self


BiasTableT = TypeVar("BiasTableT", bound=BiasTable)


def biases_from(bias: BiasTable, identity: str) -> Calibration:
    """The calibration that a validated table describes.

    Args:
        bias: The table.
        identity: The calibration's id.
    """
    stds = si_value(BiasValues, bias, part="std")
    variances = np.diag(np.square([getattr(stds, attribute) for attribute in _IN_ORDER]))
    return Calibration(
        id=identity,
        bias=si_value(BiasValues, bias),
        bias_cov=variances if bias.covariance is None else symmetric(bias.covariance),
        lens_cov=None if bias.lens_covariance is None else np.array(bias.lens_covariance),
        noise=stds_from(bias.noise, PoseStd()),
    )


def bias_table(calibration: Calibration, kind: type[BiasTableT], **further: str) -> BiasTableT:
    """The table of a calibration's biases; reading it gives equal biases.

    Args:
        calibration: The biases.
        kind: The table, which may have further keys.
        further: Those further keys.
    """
    cov, lens_cov = calibration.bias_cov, calibration.lens_cov
    full = np.zeros((len(BIASES), len(BIASES))) if cov is None else cov
    stds = dict(zip(_IN_ORDER, np.sqrt(np.diag(full)).tolist(), strict=True))
    is_diagonal = not np.any(full - np.diag(np.diag(full)))
    return kind.from_si(
        calibration.bias,
        stds=BiasValues(**stds),
        noise=StdTable.from_si(calibration.noise),
        covariance=None if is_diagonal and lens_cov is None else as_rows(full),
        lens_covariance=None if lens_cov is None else as_rows(lens_cov),
        **further,
    )


class KnownPointTable(Table):
    """A surveyed point: where it is seen, if that stays, and its height above the measured plane."""

    name: keys.Text
    pixel: keys.Pixel | None = None
    elevation_m: keys.Real
    elevation_std_m: keys.NonNegative = 0.0


class CalibrationTable(Table):
    """A calibration file: biases for a moving camera, a pose for a fixed one, or both; the lens where it was found too.

    ``landmark`` has the surveyed points, ``plane_elevation_m`` the measured plane in the heights of the landmarks'
    file. ``provenance`` is for people.
    """

    model: Annotated[ProjectionModel, Field(strict=False)] = ProjectionModel.PINHOLE
    bias: BiasTable | None = None
    pose: CalibratedPoseTable | None = None
    camera: dict[str, Any] | None = None
    plane_elevation_m: keys.Real | None = None
    landmark: keys.Many[KnownPointTable] | None = None
    provenance: dict[str, Any] | None = None

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if self.bias is None and self.pose is None:
            raise impossible("", got="no table", expected="[bias] or [pose]")
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationFile:
    """Contents of a calibration file.

    Attributes:
        biases: Of the telemetry, all of them 0 without ``[bias]``; their id is the hash of the file's bytes.
        pose: A fixed camera's, with its latitude and longitude; None without ``[pose]``.
        camera: With the lens that was found too; None where the lens was taken as it is.
        model: The projection model that all this is of.
        points: Its surveyed points, by name.
        plane_elevation_m: The measured plane in the heights of the landmarks' file; None where nobody said.
    """

    biases: Calibration
    pose: FixedPose | None
    camera: Camera | None
    model: ProjectionModel
    points: dict[str, KnownPoint]
    plane_elevation_m: float | None


def load_calibration(path: Path) -> CalibrationFile:
    """Read a calibration file.

    Args:
        path: A TOML file with ``[bias]`` (see ``BiasTable``) and/or ``[pose]`` (``height_agl_m``, ``tilt_deg``,
            ``roll_deg``, ``heading_deg``, ``lat_deg``, ``lon_deg``, ``alt_msl_m``); biases and angles are numbers
            (taken as exact) or ``{value, std}``.

    Raises:
        ConfigError: Missing file, TOML syntax, unknown key, impossible value.
    """
    data = read_bytes(path)
    identity = f"sha256:{hashlib.sha256(data).hexdigest()}"
    with located(path):
        table = validated(CalibrationTable, parse_toml(data))
        camera = None if table.camera is None else camera_from(table.camera, "camera.")
    return CalibrationFile(
        biases=biases_from(table.bias or BiasTable(), identity),
        pose=calibrated_pose_from(table.pose, identity) if table.pose else None,
        camera=camera,
        model=table.model,
        points={each.name: si_value(KnownPoint, each) for each in table.landmark or ()},
        plane_elevation_m=table.plane_elevation_m,
    )


def write_calibration(
    path: Path,
    found: FixedPose | Calibration,
    camera: Camera | None,
    model: ProjectionModel,
    provenance: dict[str, Any],
    points: tuple[dict[str, KnownPoint], float] | None = None,
) -> None:
    """Write a calibration, as ``load_calibration`` reads it.

    Args:
        path: The TOML file; one that is there is replaced.
        found: A fixed camera's pose, or what telemetry is off by.
        camera: The camera where its lens was found too; None where it was taken as it is.
        model: The projection model that it is of, and for.
        provenance: Where all this comes from, for people; what is None is left out.
        points: Surveyed points by name, and the measured plane in the heights of their file.

    Raises:
        InputError: The file cannot be written.
    """
    known, plane_m = points or ({}, None)
    landmarks = tuple(KnownPointTable.from_si(each, name=name) for name, each in known.items())
    table = CalibrationTable.model_construct(
        model=model,
        plane_elevation_m=plane_m,
        landmark=landmarks or None,
        provenance={key: value for key, value in provenance.items() if value is not None},
        bias=bias_table(found, BiasTable) if isinstance(found, Calibration) else None,
        pose=CalibratedPoseTable.from_si(found, stds=found.std) if isinstance(found, FixedPose) else None,
        camera=None if camera is None else camera_document(camera),
    )
    with os_errors_as("the calibration cannot be written", where=path, expected="a file to write to"):
        write_whole(path, tomli_w.dumps(table.to_toml()).encode())
