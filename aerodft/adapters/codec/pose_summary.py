"""The shorter pose inside a measurement: what stands in it and in ``aerodft.pose/1`` alike."""

import math
from collections.abc import Hashable, Sequence
from typing import Final

from aerodft.adapters.codec import wire
from aerodft.adapters.codec.angles import camera_angles_deg
from aerodft.model.pose import PoseSample

_STDS: Final = ("height_agl_m", "tilt_deg", "pan_deg", "roll_deg", "heading_deg")


def summary_key(sample: PoseSample) -> tuple[Hashable, ...]:
    """What summaries have in common that differ in numbers only."""
    return (
        sample.pose is None,
        sample.lat_rad is None,
        sample.lon_rad is None,
        sample.height_source,
        sample.height_datum,
        sample.height_age_s is None,
        sample.telemetry_age_s is None,
    )


def summary_values(sample: PoseSample) -> list[float | None]:
    """The numbers of a summary in its order (metres, seconds, degrees), None where they are not known."""
    pose, std = sample.pose, sample.std
    tilt_deg = roll_deg = heading_deg = height_m = None
    if pose is not None:
        tilt_deg, roll_deg, heading_deg = camera_angles_deg(*pose.wxyz.tolist())
        height_m = float(pose.position_enu_m[2]) - sample.datum_enu_m
    return [
        height_m,
        sample.height_age_s,
        tilt_deg,
        roll_deg,
        heading_deg,
        wire.degrees(sample.lat_rad),
        wire.degrees(sample.lon_rad),
        sample.telemetry_age_s,
        std.height_agl_m,
        math.degrees(std.tilt_rad),
        math.degrees(std.pan_rad),
        math.degrees(std.roll_rad),
        math.degrees(std.heading_rad),
    ]


def summary_of(sample: PoseSample, values: Sequence[float | None]) -> wire.Json:
    """Height, angles, position, age and their standard deviations, as a measurement shows them.

    Args:
        sample: The pose sample.
        values: Its ``summary_values``.
    """
    height_m, height_age_s, tilt_deg, roll_deg, heading_deg, lat_deg, lon_deg, age_s, *stds = values
    return {
        "height_agl_m": height_m,
        "height_source": sample.height_source,
        "height_datum": sample.height_datum,
        "height_age_s": height_age_s,
        "tilt_deg": tilt_deg,
        "roll_deg": roll_deg,
        "heading_deg": heading_deg,
        "lat": lat_deg,
        "lon": lon_deg,
        "telemetry_age_s": age_s,
        "std": dict(zip(_STDS, stds, strict=True)),
    }
