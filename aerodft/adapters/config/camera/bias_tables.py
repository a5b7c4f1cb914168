"""Corrections of the telemetry, as calibration files and stations have them."""

from typing import Annotated, Self, TypeAlias

import numpy as np
from pydantic import model_validator

from aerodft.adapters.config.covariance import as_rows, checked_covariance
from aerodft.adapters.config.tables import (
    BiasDeg,
    Many,
    NonNegative,
    Real,
    SiAttribute,
    Table,
    TimeOffset,
    Uncertain,
    impossible,
    si_value,
)
from aerodft.model import BIASES, BiasValues, Calibration, FloatArray, PoseStd

Rows: TypeAlias = tuple[tuple[float, ...], ...] | None

_IN_ORDER = ("height_m", "tilt_rad", "roll_rad", "heading_rad", "pan_rad", "east_m", "north_m", "time_s")
"""Attributes of ``BiasValues`` in the order of ``BIASES``."""


class NoiseTable(Table):
    """Standard deviations of what is new in every image."""

    height_m: Annotated[NonNegative, SiAttribute("height_agl_m")] = 0.0
    horizontal_m: NonNegative = 0.0
    tilt_deg: NonNegative = 0.0
    pan_deg: NonNegative = 0.0
    roll_deg: NonNegative = 0.0
    heading_deg: NonNegative = 0.0


class BiasTable(Table):
    """Corrections that are added to the telemetry's values; and an offset that is added to the images' stamps.

    ``covariance`` has 8 rows, in the order of ``model.calibration.BIASES`` and in metres, radians and seconds; it takes
    the place of the single stds. ``lens_covariance`` has 8 rows, of as many as the lens has.
    """

    height_m: Uncertain[Real] = Uncertain(value=0.0)
    tilt_deg: Uncertain[BiasDeg] = Uncertain(value=0.0)
    roll_deg: Uncertain[BiasDeg] = Uncertain(value=0.0)
    heading_deg: Uncertain[BiasDeg] = Uncertain(value=0.0)
    pan_deg: Uncertain[BiasDeg] = Uncertain(value=0.0)
    east_m: Uncertain[Real] = Uncertain(value=0.0)
    north_m: Uncertain[Real] = Uncertain(value=0.0)
    time_offset_s: Annotated[Uncertain[TimeOffset], SiAttribute("time_s")] = Uncertain(value=0.0)
    noise: NoiseTable = NoiseTable()
    covariance: Many[Many[Real]] | None = None
    lens_covariance: Many[Many[Real]] | None = None

    @model_validator(mode="after")
    def _covariances_fit(self) -> Self:
        check_lens_covariance(self.covariance, self.lens_covariance, len(BIASES))
        return self


def check_lens_covariance(covariance: Rows, lens: Rows, count: int = 6) -> None:
    """Refuse a covariance with the lens without that of the pose, or of another size (for validators)."""
    if lens is None:
        return
    if covariance is None:
        raise impossible("lens_covariance", got="it without covariance", expected="both")
    if len(lens) != count or len({len(row) for row in lens}) != 1:
        expected = f"{count} rows of as many as the lens has"
        raise impossible("lens_covariance", got=f"{len(lens)} rows", expected=expected)


def biases_from(bias: BiasTable, identity: str, where: str) -> Calibration:
    """The calibration that a validated table describes.

    Args:
        bias: The table.
        identity: The calibration's id.
        where: The file's name in messages.

    Raises:
        ConfigError: Its covariance is none.
    """
    cov = _covariance(bias, where)
    lens_cov = None if bias.lens_covariance is None else np.array(bias.lens_covariance)
    return Calibration(
        id=identity,
        bias=si_value(BiasValues, bias),
        bias_cov=cov,
        lens_cov=lens_cov,
        noise=si_value(PoseStd, bias.noise),
    )


def _covariance(bias: BiasTable, where: str) -> FloatArray:
    if bias.covariance is not None:
        return checked_covariance(
            bias.covariance, len(BIASES), where=where, key="bias.covariance", of=", ".join(BIASES)
        )
    stds = si_value(BiasValues, bias, part="std")
    return np.diag(np.square([getattr(stds, attribute) for attribute in _IN_ORDER]))


def bias_table(calibration: Calibration, identity: str | None = None) -> BiasTable:
    """The table of a calibration's biases; reading it gives equal biases.

    Args:
        calibration: The biases.
        identity: Id of the calibration, where the table is to say it.
    """
    cov, lens_cov = calibration.bias_cov, calibration.lens_cov
    full = np.zeros((len(BIASES), len(BIASES))) if cov is None else cov
    stds = dict(zip(_IN_ORDER, np.sqrt(np.diag(full)).tolist(), strict=True))
    is_diagonal = not np.any(full - np.diag(np.diag(full)))
    return BiasTable.from_si(
        calibration.bias,
        stds=BiasValues(**stds),
        calibration_id=identity,
        noise=NoiseTable.from_si(calibration.noise),
        covariance=None if is_diagonal and lens_cov is None else as_rows(full),
        lens_covariance=None if lens_cov is None else as_rows(lens_cov),
    )
