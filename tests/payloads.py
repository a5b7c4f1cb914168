"""Payloads back to values: what a subscriber does, and round trips need."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from aerodft.adapters.wire.events import decode_observations
from aerodft.adapters.wire.measurement import MEASUREMENT_SCHEMA
from aerodft.adapters.wire.payload import Json, load_payload, number_or_nan, pixel_pairs
from aerodft.adapters.wire.pose import encode_poses, radians_or_none, std_of
from aerodft.adapters.wire.status import CALIBRATION_SCHEMA, CAMERA_MOTION_SCHEMA, STATUS_SCHEMA, StationStatus
from aerodft.geometry import camera_attitude
from aerodft.model import (
    BiasValues,
    CalibrationEstimate,
    CameraMotionEstimate,
    Ellipse95,
    GeoPoint,
    Health,
    HeightSource,
    Innovation,
    Measurement,
    MotionState,
    Observation,
    Pose,
    PoseBatch,
    PoseSample,
    ProbeKind,
    ProjectionModel,
    Status,
    read_only,
)

_AXES = ("tilt_deg", "pan_deg", "roll_deg")
_SI = ("height_m", "east_m", "north_m", "time_s")
_ANGLES = ("tilt", "pan", "roll", "heading")


def decode_measurement(data: bytes) -> Measurement:
    """``aerodft.measurement/1`` to a measurement.

    Exact but for degrees (``wire.DEGREES_RTOL``); its pose has height and attitude, no covariance.
    """
    return load_payload(data, MEASUREMENT_SCHEMA, _measurement)


def _measurement(payload: Json) -> Measurement:
    own_status = Status(payload["status"])
    stamp_ns = int(payload["stamp_ns"])
    ci95, geo, ranges_m = payload["ci95"], payload["geo"], payload["range_m"]
    return Measurement(
        name=payload["name"],
        kind=ProbeKind(payload["kind"]),
        status=own_status,
        reasons=tuple(payload["reasons"]),
        stamp_ns=stamp_ns,
        pixels=pixel_pairs(payload["pixels"]),
        std_px=number_or_nan(payload["std_px"]),
        camera=payload["camera"],
        model=ProjectionModel(payload["model"]),
        pose=_sample_of_summary(payload["pose"], stamp_ns, own_status),
        value=payload["value"],
        std=payload["std"],
        ci95=None if ci95 is None else (number_or_nan(ci95[0]), number_or_nan(ci95[1])),
        ellipse95=None if payload["ellipse95"] is None else _ellipse(payload["ellipse95"]),
        ground_m=_rows(payload["ground_m"]),
        enu_m=_rows(payload["enu_m"]),
        cov_enu_m2=_rows(payload["cov_enu_m2"]),
        geo=None if geo is None else tuple(map(_geo, geo)),
        range_m=None if ranges_m is None else _numbers(ranges_m),
        unit=payload["unit"],
        image=payload["image"],
        calibration=payload["calibration"],
        config=payload["config"],
    )


def _ellipse(payload: Json) -> Ellipse95:
    return Ellipse95(
        semi_major_m=number_or_nan(payload["semi_major_m"]),
        semi_minor_m=number_or_nan(payload["semi_minor_m"]),
        azimuth_rad=math.radians(number_or_nan(payload["azimuth_deg"])),
    )


def _geo(payload: Json) -> GeoPoint:
    return GeoPoint(
        lat_rad=math.radians(number_or_nan(payload["lat_deg"])),
        lon_rad=math.radians(number_or_nan(payload["lon_deg"])),
        alt_msl_m=payload["alt_msl_m"],
    )


def encode_pose(sample: PoseSample) -> bytes:
    """One pose sample as ``aerodft.pose/1``."""
    return encode_poses(PoseBatch.from_samples([sample])).text(0)


def _sample_of_summary(payload: Json, stamp_ns: int, own_status: Status) -> PoseSample:
    """The pose of a measurement: attitude and height, without covariance, straight above the origin."""
    angles_deg = (payload["tilt_deg"], payload["roll_deg"], payload["heading_deg"])
    pose = None
    if None not in angles_deg:
        height_m = number_or_nan(payload["height_agl_m"])
        pose = Pose(
            position_enu_m=read_only((0.0, 0.0, height_m)), wxyz=camera_attitude(*np.radians(np.array(angles_deg)))
        )
    return PoseSample(
        stamp_ns=stamp_ns,
        status=Status.OK if pose else own_status,
        pose=pose,
        std=std_of(payload["std"]),
        lat_rad=radians_or_none(payload["lat_deg"]),
        lon_rad=radians_or_none(payload["lon_deg"]),
        height_source=_height_source_of(payload["height_source"]),
        height_datum=payload["height_datum"],
        height_age_s=payload.get("height_age_s"),
        telemetry_age_s=payload["telemetry_age_s"],
    )


def _height_source_of(value: str | None) -> HeightSource | None:
    """The source of that name; None where a payload has none.

    Raises:
        ValueError: There is no source of that name.
    """
    return None if value is None else HeightSource(value)


def decode_status(data: bytes) -> StationStatus:
    """``aerodft.status/1`` to a station's state."""
    return load_payload(data, STATUS_SCHEMA, _status)


def _status(payload: Json) -> StationStatus:
    return StationStatus(
        station=payload["station"],
        stamp_ns=int(payload["stamp_ns"]),
        state=payload["state"],
        text=payload["text"],
        counts=payload["counts"],
        health=None if payload.get("health") is None else _health(payload["health"]),
        rejected=payload.get("rejected", {}),
    )


def _health(payload: Json) -> Health:
    gps, estimator, link = payload["gps"], payload["estimator"], payload["link"]
    return Health(
        heartbeat_age_s=payload["heartbeat_age_s"],
        gps_fix=gps["fix"],
        gps_age_s=gps["age_s"],
        satellites=gps["satellites"],
        horizontal_std_m=gps["horizontal_std_m"],
        vertical_std_m=gps["vertical_std_m"],
        ratios=estimator["test_ratios"],
        has_attitude=estimator["has_attitude"],
        received=link["received"],
        lost=link["lost"],
        ages_s=payload["ages_s"],
    )


def decode_camera_motion(data: bytes) -> CameraMotionEstimate:
    """``aerodft.camera_motion/1`` to an estimate; angles to an ulp."""
    return load_payload(data, CAMERA_MOTION_SCHEMA, _camera_motion)


def _camera_motion(payload: Json) -> CameraMotionEstimate:
    turn, look, moved = payload["turn"], payload["look"], payload["moved_ns"]
    return CameraMotionEstimate(
        stamp_ns=int(payload["stamp_ns"]),
        state=MotionState(payload["state"]),
        since_ns=int(payload["since_ns"]),
        moved_ns=None if moved is None else int(moved),
        turn_rad=_three_radians([turn[name]["value"] for name in _AXES]),
        std_rad=_three_radians([turn[name]["std"] for name in _AXES]),
        look_turn_rad=None if look is None else _three_radians([look[name] for name in _AXES]),
        points=payload["points"],
        agreeing=payload["agreeing"],
        std_px=payload["std_px"],
        calibration=payload["calibration"],
    )


def _three_radians(values_deg: list[float | None]) -> tuple[float, float, float]:
    x, y, z = (math.radians(number_or_nan(value)) for value in values_deg)
    return x, y, z


def decode_estimate(data: bytes) -> CalibrationEstimate:
    """``aerodft.calibration_estimate/1`` to an estimate; angles to an ulp."""
    return load_payload(data, CALIBRATION_SCHEMA, _estimate)


def _estimate(payload: Json) -> CalibrationEstimate:
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


def _innovation(payload: Json) -> Innovation:
    px, sigma = payload["px"], payload["sigma_px"]
    return Innovation(
        name=payload["name"],
        px=None if px is None else (px[0], px[1]),
        sigma_px=None if sigma is None else (sigma[0], sigma[1]),
        chi2=payload["chi2"],
        reason=payload["reason"],
    )


def _values(payload: Json, part: str) -> BiasValues:
    lengths = {key: number_or_nan(payload[key][part]) for key in _SI}
    angles = {f"{name}_rad": math.radians(number_or_nan(payload[f"{name}_deg"][part])) for name in _ANGLES}
    return BiasValues(**lengths, **angles)


def decode_observation(data: bytes) -> Observation:
    """``aerodft.observation/1`` to an observation."""
    (observation,) = decode_observations([data])
    return observation


def _numbers(values: Iterable[float | None]) -> tuple[float, ...]:
    return tuple(map(number_or_nan, values))


def _rows(values: Iterable[Sequence[float | None]] | None) -> tuple[tuple[float, ...], ...] | None:
    return None if values is None else tuple(map(_numbers, values))
