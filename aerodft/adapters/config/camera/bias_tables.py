"""Corrections of the telemetry, as calibration files and stations have them."""

import math
from collections.abc import Callable
from typing import Annotated, Any, Final, Self, TypeAlias

import numpy as np
from pydantic import model_validator

from aerodft.adapters.config.covariance import checked_covariance
from aerodft.adapters.config.tables import (
    BiasDeg,
    Many,
    Means,
    NonNegative,
    Real,
    Table,
    TimeOffset,
    Uncertain,
    impossible,
    keys_of,
    value_of,
)
from aerodft.adapters.config.units import to_deg
from aerodft.model import BIASES, BiasValues, Calibration, FloatArray, PoseStd

Rows: TypeAlias = tuple[tuple[float, ...], ...] | None

_KEYS: Final[tuple[tuple[str, str, Callable[[float], float], Callable[[float], float]], ...]] = (
    ("height_m", "height_m", float, float),
    ("tilt_deg", "tilt_rad", math.radians, to_deg),
    ("roll_deg", "roll_rad", math.radians, to_deg),
    ("heading_deg", "heading_rad", math.radians, to_deg),
    ("pan_deg", "pan_rad", math.radians, to_deg),
    ("east_m", "east_m", float, float),
    ("north_m", "north_m", float, float),
    ("time_offset_s", "time_s", float, float),
)
"""What says which of the ``BIASES``, in their order: key and attribute, and how one becomes the other."""


class NoiseTable(Table):
    """Standard deviations of what is new in every image."""

    height_m: Annotated[NonNegative, Means("height_agl_m")] = 0.0
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
    time_offset_s: Uncertain[TimeOffset] = Uncertain(value=0.0)
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
    values = BiasValues(**{attribute: into(getattr(bias, key).value) for key, attribute, into, _ in _KEYS})
    noise = value_of(bias.noise, PoseStd)
    return Calibration(id=identity, bias=values, bias_cov=cov, lens_cov=lens_cov, noise=noise)


def _covariance(bias: BiasTable, where: str) -> FloatArray:
    if bias.covariance is not None:
        return checked_covariance(
            bias.covariance, len(BIASES), where=where, key="bias.covariance", of=", ".join(BIASES)
        )
    return np.diag(np.square([into(getattr(bias, key).std) for key, _, into, _ in _KEYS]))


def bias_document(calibration: Calibration) -> dict[str, Any]:
    """A calibration's biases as TOML keys; reading them gives the same biases again."""
    cov, count = calibration.bias_cov, len(BIASES)
    stds = (np.zeros(count) if cov is None else np.sqrt(np.diag(cov))).tolist()
    document: dict[str, Any] = {
        key: {"value": out(getattr(calibration.bias, attribute)), "std": out(std)}
        for (key, attribute, _, out), std in zip(_KEYS, stds, strict=True)
    }
    document["noise"] = keys_of(NoiseTable, calibration.noise)
    if cov is not None and np.any(cov - np.diag(np.diag(cov))):
        document["covariance"] = cov.tolist()
    if calibration.lens_cov is not None:
        document["covariance"] = np.zeros((count, count)).tolist() if cov is None else cov.tolist()
        document["lens_covariance"] = calibration.lens_cov.tolist()
    return document
