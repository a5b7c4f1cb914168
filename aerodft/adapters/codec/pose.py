"""``aerodft.pose/1``: a pose sample with its full covariance."""

import math

from aerodft.adapters.codec import wire
from aerodft.adapters.codec.pose_summary import height_source_of, std_of, summary_of, summary_values
from aerodft.model.arrays import read_only
from aerodft.model.pose import GeoOrigin, GimbalSource, Pose, PoseSample
from aerodft.model.status import Status
from aerodft.model.zoom import Zoom, ZoomSource

SCHEMA = "aerodft.pose/1"


def encode_pose(sample: PoseSample) -> bytes:
    """A pose sample as ``aerodft.pose/1``."""
    return wire.dump(payload_of(sample, summary_of(sample, summary_values(sample))))


def payload_of(sample: PoseSample, own: wire.Json) -> wire.Json:
    """As ``aerodft.pose/1``, with its summary."""
    pose, origin = sample.pose, sample.origin
    payload: wire.Json = {
        "schema": SCHEMA,
        "stamp_ns": str(sample.stamp_ns),
        "status": sample.status,
        "reasons": sample.reasons,
    }
    payload |= own
    payload["std"] = own["std"] | {"horizontal_m": sample.std.horizontal_m, "time_s": sample.std.time_s}
    payload["alt_msl_m"] = sample.alt_msl_m
    payload["attitude_source"] = sample.attitude_source
    payload["calibration"] = sample.calibration
    payload["zoom"] = None if sample.zoom is None else _zoom_payload(sample.zoom)
    payload["position_enu_m"] = pose.position_enu_m if pose else None
    payload["wxyz"] = pose.wxyz if pose else None
    payload["cov"] = pose.cov if pose else None
    payload["velocity_enu_mps"] = pose.velocity_enu_mps if pose else None
    payload["rate_cam_radps"] = pose.rate_cam_radps if pose else None
    payload["time_std_s"] = pose.time_std_s if pose else None
    payload["origin"] = None if origin is None else origin_payload(origin)
    payload["software"] = wire.SOFTWARE
    return payload


def decode_pose(data: bytes) -> PoseSample:
    """``aerodft.pose/1`` to a pose sample; position, attitude and covariance exact, angles of ``std`` to an ulp.

    Raises:
        InputError: The payload is not of that schema.
    """
    return wire.load(data, SCHEMA, _sample)


def _sample(payload: wire.Json) -> PoseSample:
    origin = payload["origin"]
    return PoseSample(
        stamp_ns=int(payload["stamp_ns"]),
        status=Status(payload["status"]),
        reasons=tuple(payload["reasons"]),
        pose=_pose(payload),
        std=std_of(payload["std"]),
        origin=None if origin is None else _origin(origin),
        lat_rad=wire.radians(payload["lat"]),
        lon_rad=wire.radians(payload["lon"]),
        alt_msl_m=payload["alt_msl_m"],
        height_source=height_source_of(payload["height_source"]),
        height_datum=payload["height_datum"],
        height_age_s=payload.get("height_age_s"),
        attitude_source=None if payload["attitude_source"] is None else GimbalSource(payload["attitude_source"]),
        telemetry_age_s=payload["telemetry_age_s"],
        calibration=payload["calibration"],
        zoom=_zoom(payload),
    )


def _pose(payload: wire.Json) -> Pose | None:
    if payload["wxyz"] is None:
        return None
    return Pose(
        position_enu_m=read_only(wire.numbers(payload["position_enu_m"])),
        wxyz=read_only(wire.numbers(payload["wxyz"])),
        cov=read_only([wire.numbers(row) for row in payload["cov"]]),
        velocity_enu_mps=read_only(wire.numbers(payload["velocity_enu_mps"])),
        rate_cam_radps=read_only(wire.numbers(payload["rate_cam_radps"])),
        time_std_s=wire.number(payload["time_std_s"]),
    )


def _zoom_payload(zoom: Zoom) -> wire.Json:
    return {"magnification": zoom.magnification, "std": zoom.std, "source": zoom.source}


def _zoom(payload: wire.Json) -> Zoom | None:
    zoom = payload.get("zoom")  # recordings made before there was one have none
    if zoom is None:
        return None
    return Zoom(
        magnification=wire.number(zoom["magnification"]),
        std=wire.number(zoom["std"]),
        source=ZoomSource(zoom["source"]),
    )


def origin_payload(origin: GeoOrigin) -> wire.Json:
    """An origin as it stands in a pose."""
    return {
        "lat": math.degrees(origin.lat_rad),
        "lon": math.degrees(origin.lon_rad),
        "alt_msl_m": origin.alt_msl_m,
    }


def _origin(payload: wire.Json) -> GeoOrigin:
    return GeoOrigin(
        lat_rad=math.radians(payload["lat"]), lon_rad=math.radians(payload["lon"]), alt_msl_m=payload["alt_msl_m"]
    )
