"""``aerodft.calibration_estimate/1``: what a live calibration says after the landmarks of one image."""

import math
from typing import Final

from aerodft.adapters.codec import wire
from aerodft.model.estimate import BiasValues, CalibrationEstimate, Innovation
from aerodft.model.pose import HeightSource

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
            "software": wire.SOFTWARE,
        }
    )


def decode_estimate(data: bytes) -> CalibrationEstimate:
    """``aerodft.calibration_estimate/1`` to an estimate; angles to an ulp.

    Raises:
        InputError: The payload is not of that schema.
    """
    return wire.load(data, SCHEMA, _estimate)


def _estimate(payload: wire.Json) -> CalibrationEstimate:
    source = payload["height_source"]
    return CalibrationEstimate(
        stamp_ns=int(payload["stamp_ns"]),
        calibration=payload["calibration"],
        height_source=None if source is None else HeightSource(source),
        bias=_values(payload["bias"], "value"),
        std=_values(payload["bias"], "std"),
        innovations=tuple(map(_innovation, payload["innovations"])),
        updates=payload["updates"],
        refused=payload["refused"],
        restarts=payload["restarts"],
    )


def _innovation(payload: wire.Json) -> Innovation:
    px, sigma = payload["px"], payload["sigma_px"]
    return Innovation(
        name=payload["name"],
        px=None if px is None else (px[0], px[1]),
        sigma_px=None if sigma is None else (sigma[0], sigma[1]),
        chi2=payload["chi2"],
        reason=payload["reason"],
    )


def _wire(values: BiasValues) -> dict[str, float]:
    """Keys with their units on the wire, in the schema's order."""
    lengths = {key: getattr(values, key) for key in _SI}
    return {**lengths, **{f"{name}_deg": math.degrees(getattr(values, f"{name}_rad")) for name in _ANGLES}}


def _values(payload: wire.Json, part: str) -> BiasValues:
    lengths = {key: wire.number(payload[key][part]) for key in _SI}
    angles = {f"{name}_rad": math.radians(wire.number(payload[f"{name}_deg"][part])) for name in _ANGLES}
    return BiasValues(**lengths, **angles)
