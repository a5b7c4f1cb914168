"""``aerodft.pose/1``: a pose sample with its full covariance; and the shorter pose that stands in a measurement."""

import math
from typing import Final

import numpy as np

from aerodft.adapters.wire.packed_json import PackedBytes, encode_payloads, flat
from aerodft.adapters.wire.payload import Json, degrees_or_none, dump_payload, load_payload, number_or_nan
from aerodft.conventions import NADIR_TILT_RAD
from aerodft.model import (
    HORIZONTAL,
    TIME,
    FloatArray,
    GeoOrigin,
    GeoPoint,
    GimbalSource,
    HeightSource,
    HeightSwitch,
    Pose,
    PoseBatch,
    PoseSample,
    PoseStd,
    Status,
    Zoom,
    ZoomSource,
    read_only,
)
from aerodft.version import SOFTWARE

POSE_SCHEMA = "aerodft.pose/1"

_ARRAYS: Final = ("position_enu_m", "wxyz", "cov", "velocity_enu_mps", "rate_cam_radps")
_ANGLES: Final = ("tilt", "pan", "roll", "heading")


def encode_poses(poses: PoseBatch) -> PackedBytes:
    """Each of some poses as ``aerodft.pose/1``."""
    pose = poses.pose
    parts = [flat(getattr(pose, name)) for name in _ARRAYS]
    parts.append(np.broadcast_to(pose.time_std_s, len(poses))[:, None])
    parts.append(flat(np.broadcast_to(pose.lens_cov, (len(poses), *pose.lens_cov.shape[-2:]))))
    arrays = np.where(poses.has_pose[:, None], np.concatenate(parts, axis=1), np.nan)
    others = (poses.std[:, [HORIZONTAL, TIME]], poses.lat_lon_alt[:, 2:], poses.zoom)
    return encode_payloads(
        poses.kind_index[:, None],
        lambda row: _payload(poses[row]),
        {"stamp_ns": poses.stamp_ns},
        np.concatenate([summary_numbers(poses), *others, arrays], axis=1),
        [[like.reasons, like.calibration] for like in poses.variant_of_each],
        fixed={"origin"},
    )


def _payload(sample: PoseSample) -> Json:
    pose, origin, zoom, summary = sample.pose, sample.origin, sample.zoom, summary_payload(sample)
    return {
        "schema": POSE_SCHEMA,
        "stamp_ns": str(sample.stamp_ns),
        "status": sample.status,
        "reasons": sample.reasons,
        **summary,
        "std": {**summary["std"], "horizontal_m": sample.std.horizontal_m, "time_s": sample.std.time_s},
        "alt_msl_m": sample.alt_msl_m,
        "attitude_source": sample.attitude_source,
        "calibration": sample.calibration,
        "zoom": zoom and {"magnification": zoom.magnification, "std": zoom.std, "source": zoom.source},
        **{name: getattr(pose, name) if pose else None for name in (*_ARRAYS, "time_std_s")},
        "lens_cov": pose.lens_cov if pose and pose.lens_cov.size else None,
        "origin": None if origin is None else geo_payload(origin),
        "software": SOFTWARE,
    }


def decode_pose(data: bytes) -> PoseSample:
    """``aerodft.pose/1`` to a pose sample: position, attitude and covariance exact, angles of ``std`` to an ulp.

    Raises:
        InputError: The payload is not of that schema.
    """
    return load_payload(data, POSE_SCHEMA, _sample)


def _sample(payload: Json) -> PoseSample:
    origin, zoom, pose = payload["origin"], payload.get("zoom"), _pose(payload)  # recordings of old have no zoom
    return PoseSample(
        stamp_ns=int(payload["stamp_ns"]),
        status=Status(payload["status"]),
        reasons=tuple(payload["reasons"]),
        pose=pose,
        std=std_of(payload["std"]),
        origin=None if origin is None else _origin(origin),
        lat_rad=radians_or_none(payload["lat_deg"]),
        lon_rad=radians_or_none(payload["lon_deg"]),
        alt_msl_m=payload["alt_msl_m"],
        height_source=None if payload["height_source"] is None else HeightSource(payload["height_source"]),
        height_datum=payload["height_datum"],
        datum_enu_m=0.0 if pose is None else float(pose.position_enu_m[2]) - payload["height_agl_m"],
        height_age_s=payload.get("height_age_s"),
        attitude_source=None if payload["attitude_source"] is None else GimbalSource(payload["attitude_source"]),
        telemetry_age_s=payload["telemetry_age_s"],
        calibration=payload["calibration"],
        zoom=zoom and Zoom(**{**zoom, "source": ZoomSource(zoom["source"])}),
    )


def _pose(payload: Json) -> Pose | None:
    if payload["wxyz"] is None:
        return None
    lens_cov = payload.get("lens_cov")
    lens = {} if lens_cov is None else {"lens_cov": _numbers(lens_cov)}
    arrays = {name: _numbers(payload[name]) for name in _ARRAYS}
    return Pose(**arrays, **lens, time_std_s=number_or_nan(payload["time_std_s"]))


def _numbers(values: object) -> FloatArray:
    """An array, with NaN where JSON has null.

    Raises:
        ValueError: It is none.
    """
    return read_only(np.array(values, dtype=np.float64))


def _origin(payload: Json) -> GeoOrigin:
    lat_rad, lon_rad = math.radians(payload["lat_deg"]), math.radians(payload["lon_deg"])
    return GeoOrigin(lat_rad=lat_rad, lon_rad=lon_rad, alt_msl_m=payload["alt_msl_m"])


def std_of(payload: Json) -> PoseStd:
    """Standard deviations in metres, seconds and radians; those that a summary leaves out are 0."""
    angles = {f"{name}_rad": math.radians(number_or_nan(payload[f"{name}_deg"])) for name in _ANGLES}
    return PoseStd(
        height_agl_m=number_or_nan(payload["height_agl_m"]),
        horizontal_m=number_or_nan(payload.get("horizontal_m", 0.0)),
        time_s=number_or_nan(payload.get("time_s", 0.0)),
        **angles,
    )


def radians_or_none(angle_deg: float | None) -> float | None:
    """Degrees to radians; None stays None."""
    return None if angle_deg is None else math.radians(angle_deg)


def summary_payload(sample: PoseSample) -> Json:
    """Height, angles, position, age and their standard deviations, as a measurement shows them."""
    pose, std = sample.pose, sample.std
    tilt_deg = roll_deg = heading_deg = height_m = None
    if pose is not None:
        tilt_deg, roll_deg, heading_deg = camera_angles_deg(*pose.wxyz.tolist())
        height_m = float(pose.position_enu_m[2]) - sample.datum_enu_m
    return {
        "height_agl_m": height_m,
        "height_source": sample.height_source,
        "height_datum": sample.height_datum,
        "height_age_s": sample.height_age_s,
        "tilt_deg": tilt_deg,
        "roll_deg": roll_deg,
        "heading_deg": heading_deg,
        "lat_deg": degrees_or_none(sample.lat_rad),
        "lon_deg": degrees_or_none(sample.lon_rad),
        "telemetry_age_s": sample.telemetry_age_s,
        "std": {
            "height_agl_m": std.height_agl_m,
            "tilt_deg": math.degrees(std.tilt_rad),
            "pan_deg": math.degrees(std.pan_rad),
            "roll_deg": math.degrees(std.roll_rad),
            "heading_deg": math.degrees(std.heading_rad),
        },
    }


def summary_numbers(poses: PoseBatch) -> FloatArray:
    """The numbers ``(n, 13)`` of the poses' summaries in their order, NaN for what is not known."""
    angles_deg = np.array([camera_angles_deg(*wxyz) for wxyz in poses.pose.wxyz.tolist()]).reshape(-1, 3)
    height_m = poses.pose.position_enu_m[:, 2] - poses.datum_enu_m
    places_deg = np.degrees(poses.lat_lon_alt[:, :2])
    height_std_m, _, *stds_rad, _ = poses.std.T
    parts = (height_m, poses.height_age_s, *angles_deg.T, *places_deg.T, poses.telemetry_age_s)
    return np.stack([*parts, height_std_m, *np.degrees(stds_rad)], axis=1)


def camera_angles_deg(w: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Tilt, roll, heading in degrees of a unit quaternion ``enu_SO3_cam``, as ``geometry.rotation.camera_angles``.

    In plain floats: for a single attitude the array form costs twenty times as much.
    At nadir and zenith the roll is 0 and the heading is that of the image's up direction.
    """
    axis_east, axis_north = 2 * (x * z + w * y), 2 * (y * z - w * x)
    horizontal = math.hypot(axis_east, axis_north)
    tilt_rad = math.atan2(horizontal, 2 * (x * x + y * y) - 1)
    if horizontal > NADIR_TILT_RAD:
        ahead_east, ahead_north = axis_east, axis_north
    else:
        ahead_east, ahead_north = 2 * (w * z - x * y), 2 * (x * x + z * z) - 1
    heading_rad = math.atan2(ahead_east, ahead_north) % math.tau
    right_east, right_north = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z)
    right_up = 2 * (x * z - w * y)
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    along_right = right_east * cosine - right_north * sine
    ahead = right_east * sine + right_north * cosine
    along_down = -ahead * math.cos(tilt_rad) - right_up * math.sin(tilt_rad)
    return math.degrees(tilt_rad), math.degrees(math.atan2(along_down, along_right)), math.degrees(heading_rad)


def geo_payload(place: GeoOrigin | GeoPoint) -> Json:
    """A place on the map."""
    return {
        "lat_deg": math.degrees(place.lat_rad),
        "lon_deg": math.degrees(place.lon_rad),
        "alt_msl_m": place.alt_msl_m,
    }


HEIGHT_SWITCH_SCHEMA = "aerodft.height_switch/1"


def encode_height_switch(switch: HeightSwitch) -> bytes:
    """A switch as ``aerodft.height_switch/1``."""
    step = switch.step
    return dump_payload(
        {
            "schema": HEIGHT_SWITCH_SCHEMA,
            "stamp_ns": str(switch.stamp_ns),
            "before": switch.before,
            "after": switch.after,
            "step_m": None if step is None else step.step_m,
            "std_m": None if step is None else step.std_m,
            "before_m": None if step is None else step.height_m,
            "after_m": None if step is None else step.other_m,
            "compared_ns": None if step is None else str(step.stamp_ns),
            "software": SOFTWARE,
        }
    )
