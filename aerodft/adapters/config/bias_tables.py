"""Corrections of the telemetry, as calibration files and stations have them."""

import math
from typing import Any, Self, TypeAlias

import numpy as np
from pydantic import model_validator

from aerodft.adapters.config.covariance import checked_covariance
from aerodft.adapters.config.tables import BiasDeg, Many, NonNegative, Real, Table, TimeOffset, Uncertain, impossible
from aerodft.adapters.config.units import to_deg
from aerodft.model.arrays import FloatArray
from aerodft.model.calibration import BIASES, Calibration
from aerodft.model.pose import PoseStd

Rows: TypeAlias = tuple[tuple[float, ...], ...] | None


class NoiseTable(Table):
    """Standard deviations of what is new in every image."""

    height_m: NonNegative = 0.0
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
    noise = bias.noise
    return Calibration(
        id=identity,
        height_bias_m=bias.height_m.value,
        tilt_bias_rad=math.radians(bias.tilt_deg.value),
        roll_bias_rad=math.radians(bias.roll_deg.value),
        heading_bias_rad=math.radians(bias.heading_deg.value),
        pan_bias_rad=math.radians(bias.pan_deg.value),
        east_bias_m=bias.east_m.value,
        north_bias_m=bias.north_m.value,
        time_offset_s=bias.time_offset_s.value,
        bias_cov=_covariance(bias, where),
        lens_cov=None if bias.lens_covariance is None else np.array(bias.lens_covariance),
        noise=PoseStd(
            height_agl_m=noise.height_m,
            horizontal_m=noise.horizontal_m,
            tilt_rad=math.radians(noise.tilt_deg),
            pan_rad=math.radians(noise.pan_deg),
            roll_rad=math.radians(noise.roll_deg),
            heading_rad=math.radians(noise.heading_deg),
        ),
    )


def _covariance(bias: BiasTable, where: str) -> FloatArray:
    if bias.covariance is not None:
        return checked_covariance(
            bias.covariance, len(BIASES), where=where, key="bias.covariance", of=", ".join(BIASES)
        )
    angles = (bias.tilt_deg, bias.roll_deg, bias.heading_deg, bias.pan_deg)
    others = (bias.east_m, bias.north_m, bias.time_offset_s)
    stds = [bias.height_m.std, *(math.radians(angle.std) for angle in angles), *(each.std for each in others)]
    return np.diag(np.square(stds))


def bias_document(calibration: Calibration) -> dict[str, Any]:
    """A calibration's biases as TOML keys; reading them gives the same biases again."""
    cov, noise = calibration.bias_cov, calibration.noise
    count = len(BIASES)
    height, tilt, roll, heading, pan, east, north, time = np.sqrt(np.zeros(count) if cov is None else np.diag(cov))
    document: dict[str, Any] = {
        "height_m": _uncertain(calibration.height_bias_m, height),
        "tilt_deg": _uncertain(to_deg(calibration.tilt_bias_rad), to_deg(tilt)),
        "roll_deg": _uncertain(to_deg(calibration.roll_bias_rad), to_deg(roll)),
        "heading_deg": _uncertain(to_deg(calibration.heading_bias_rad), to_deg(heading)),
        "pan_deg": _uncertain(to_deg(calibration.pan_bias_rad), to_deg(pan)),
        "east_m": _uncertain(calibration.east_bias_m, east),
        "north_m": _uncertain(calibration.north_bias_m, north),
        "time_offset_s": _uncertain(calibration.time_offset_s, time),
        "noise": {
            "height_m": noise.height_agl_m,
            "horizontal_m": noise.horizontal_m,
            "tilt_deg": to_deg(noise.tilt_rad),
            "pan_deg": to_deg(noise.pan_rad),
            "roll_deg": to_deg(noise.roll_rad),
            "heading_deg": to_deg(noise.heading_rad),
        },
    }
    if cov is not None and np.any(cov - np.diag(np.diag(cov))):
        document["covariance"] = cov.tolist()
    if calibration.lens_cov is not None:
        document["covariance"] = np.zeros((count, count)).tolist() if cov is None else cov.tolist()
        document["lens_covariance"] = calibration.lens_cov.tolist()
    return document


def _uncertain(value: float, std: float) -> dict[str, float]:
    return {"value": value, "std": float(std)}
