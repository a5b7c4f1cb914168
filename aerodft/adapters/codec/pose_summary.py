"""The shorter pose inside a measurement: what stands in it and in ``aerodft.pose/1`` alike."""

import math
from collections.abc import Hashable, Sequence
from typing import Final

import numpy as np

from aerodft.adapters.codec import wire
from aerodft.adapters.codec.angles import camera_angles_deg
from aerodft.geometry.rotation import camera_attitude
from aerodft.model.arrays import read_only
from aerodft.model.pose import HeightSource, Pose, PoseSample, PoseStd
from aerodft.model.status import Status

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


def sample_of_summary(payload: wire.Json, stamp_ns: int, status: Status) -> PoseSample:
    """The pose sample of a measurement: attitude and height, without covariance, straight above the origin.

    Args:
        payload: What ``summary_of`` made.
        stamp_ns: The measurement's stamp.
        status: The measurement's status; the sample's own where it has no pose.
    """
    angles_deg = (payload["tilt_deg"], payload["roll_deg"], payload["heading_deg"])
    pose = None
    if None not in angles_deg:
        height_m = wire.number(payload["height_agl_m"])
        pose = Pose(
            position_enu_m=read_only((0.0, 0.0, height_m)), wxyz=camera_attitude(*np.radians(np.array(angles_deg)))
        )
    return PoseSample(
        stamp_ns=stamp_ns,
        status=Status.OK if pose else status,
        pose=pose,
        std=std_of(payload["std"]),
        lat_rad=wire.radians(payload["lat"]),
        lon_rad=wire.radians(payload["lon"]),
        height_source=height_source_of(payload["height_source"]),
        height_datum=payload["height_datum"],
        height_age_s=payload.get("height_age_s"),
        telemetry_age_s=payload["telemetry_age_s"],
    )


def std_of(payload: wire.Json) -> PoseStd:
    """Standard deviations in metres, seconds and radians; those that a summary leaves out are 0."""
    return PoseStd(
        height_agl_m=wire.number(payload["height_agl_m"]),
        horizontal_m=wire.number(payload.get("horizontal_m", 0.0)),
        tilt_rad=math.radians(wire.number(payload["tilt_deg"])),
        pan_rad=math.radians(wire.number(payload["pan_deg"])),
        roll_rad=math.radians(wire.number(payload["roll_deg"])),
        heading_rad=math.radians(wire.number(payload["heading_deg"])),
        time_s=wire.number(payload.get("time_s", 0.0)),
    )


def height_source_of(value: str | None) -> HeightSource | None:
    """The source of that name; None where a payload has none.

    Raises:
        ValueError: There is no source of that name.
    """
    return None if value is None else HeightSource(value)
