"""``aerodft.calibration_estimate/1``: what a live calibration says after the landmarks of one image."""

import math
from typing import Final

from aerodft.adapters.wire import payload as wire
from aerodft.model import BiasValues, CalibrationEstimate
from aerodft.version import SOFTWARE

SCHEMA = "aerodft.calibration_estimate/1"

_SI: Final = ("height_m", "east_m", "north_m", "time_s")
_ANGLES: Final = ("tilt", "pan", "roll", "heading")


def encode_estimate(estimate: CalibrationEstimate) -> bytes:
    """An estimate as ``aerodft.calibration_estimate/1``."""
    values, stds = _wire(estimate.bias), _wire(estimate.std)
    return wire.dump(
        {
            "schema": SCHEMA,
            "stamp_ns": str(estimate.stamp_ns),
            "calibration": estimate.calibration,
            "height_source": estimate.height_source,
            "bias": {key: {"value": value, "std": stds[key]} for key, value in values.items()},
            "innovations": [
                {
                    "name": each.name,
                    "px": each.px,
                    "sigma_px": each.sigma_px,
                    "chi2": each.chi2,
                    "accepted": each.accepted,
                    "reason": each.reason,
                }
                for each in estimate.innovations
            ],
            "updates": estimate.updates,
            "refused": estimate.refused,
            "restarts": estimate.restarts,
            "software": SOFTWARE,
        }
    )


def _wire(values: BiasValues) -> dict[str, float]:
    """Keys with their units on the wire, in the schema's order."""
    lengths = {key: getattr(values, key) for key in _SI}
    return {**lengths, **{f"{name}_deg": math.degrees(getattr(values, f"{name}_rad")) for name in _ANGLES}}
