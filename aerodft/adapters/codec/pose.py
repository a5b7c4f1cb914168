"""``aerodft.pose/1``: a pose sample with its full covariance."""

import math

from aerodft.adapters.codec import wire
from aerodft.adapters.codec.pose_summary import summary_of, summary_values
from aerodft.model.camera import Zoom
from aerodft.model.pose import GeoOrigin, PoseSample

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


def _zoom_payload(zoom: Zoom) -> wire.Json:
    return {"magnification": zoom.magnification, "std": zoom.std, "source": zoom.source}


def origin_payload(origin: GeoOrigin) -> wire.Json:
    """An origin as it stands in a pose."""
    return {
        "lat": math.degrees(origin.lat_rad),
        "lon": math.degrees(origin.lon_rad),
        "alt_msl_m": origin.alt_msl_m,
    }
