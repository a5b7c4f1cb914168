"""``aerodft.pose/1``: a pose sample with its full covariance; and the shorter pose that stands in a measurement."""

import math
from typing import Final

import numpy as np

from aerodft.adapters.wire.packed_json import PackedBytes, encode_payloads, flat
from aerodft.adapters.wire.payload import (
    NUMBER,
    STAMP,
    STAMP_OR_NULL,
    TEXT,
    TEXT_OR_NULL,
    Json,
    Payload,
    doc,
    list_of,
    load_payload,
    number_or_nan,
    object_of,
    one_of,
    or_null,
    payload_of,
)
from aerodft.geometry import camera_angles
from aerodft.model import (
    HORIZONTAL,
    TIME,
    FloatArray,
    GeoOrigin,
    GimbalSource,
    HeightSource,
    HeightSwitch,
    Pose,
    PoseBatch,
    PoseSample,
    PoseStd,
    Status,
    WaterLevel,
    Zoom,
    ZoomSource,
    read_only,
)
from aerodft.service import GIMBAL_SOURCES, HEIGHT_SOURCES

POSE_SCHEMA = "aerodft.pose/1"

HEIGHTS: Final = (*HEIGHT_SOURCES, HeightSource.CALIBRATION)
"""Names of all sources of heights."""

GEO = {"lat_deg": NUMBER, "lon_deg": NUMBER, "alt_msl_m": NUMBER}
_SUMMARY_STD = dict.fromkeys(("height_agl_m", "tilt_deg", "pan_deg", "roll_deg", "heading_deg"), NUMBER)
_SUMMARY_KEYS = {
    "height_agl_m": doc(
        NUMBER, "Above what height_datum says: the measured plane, or the ground right below the camera"
    ),
    "height_source": or_null(one_of(HEIGHTS)),
    "height_datum": TEXT_OR_NULL,
    "height_age_s": doc(NUMBER, "From the stamp to the nearest sample of that source"),
    "tilt_deg": doc(NUMBER, "Optical axis against straight down: 0 nadir, 90 horizon"),
    "roll_deg": doc(NUMBER, "About the optical axis; above 0 with the camera's right side down"),
    "heading_deg": doc(NUMBER, "Clockwise from true north"),
    "lat_deg": NUMBER,
    "lon_deg": NUMBER,
    "telemetry_age_s": NUMBER,
    "level": doc(
        object_of(
            {
                "level_m": doc(NUMBER, "Of the water at the stamp, in its datum"),
                "std_m": NUMBER,
                "elevation_m": doc(NUMBER, "Of the water above the station's elevation 0"),
                "datum": TEXT,
                "source": TEXT,
                "in_height": doc({"type": "boolean"}, "Whether the height was measured to the water itself"),
            }
        ),
        "The water that height_agl_m counts from; absent where the measured plane is always the same",
    ),
}
_OPTIONAL: Final = ("level",)  # so stations without a level have the bytes that they had before there were any
SUMMARY: Final = object_of({**_SUMMARY_KEYS, "std": object_of(_SUMMARY_STD)}, _OPTIONAL)
"""A pose as it stands in a measurement."""

POSE: Final = Payload(
    POSE_SCHEMA,
    "The camera's pose at one stamp, or why there is none",
    {
        "stamp_ns": STAMP,
        "status": one_of(Status),
        "reasons": list_of(TEXT),
        **_SUMMARY_KEYS,
        "std": object_of({**_SUMMARY_STD, "horizontal_m": NUMBER, "time_s": NUMBER}),
        "alt_msl_m": NUMBER,
        "attitude_source": or_null(one_of(GIMBAL_SOURCES)),
        "calibration": TEXT_OR_NULL,
        "zoom": doc(
            or_null(object_of({"magnification": NUMBER, "std": NUMBER, "source": one_of(ZoomSource)})),
            "Focal length over that of the camera file, where the vehicle's reports are followed",
        ),
        "position_enu_m": or_null(list_of(NUMBER, length=3)),
        "wxyz": doc(or_null(list_of(NUMBER, length=4)), "enu_SO3_cam: camera axes x right, y down, z forward"),
        "cov": doc(
            or_null(list_of(list_of(NUMBER, length=6), length=6)),
            "Position (ENU, m^2), then a small rotation in camera axes (rad^2)",
        ),
        "velocity_enu_mps": or_null(list_of(NUMBER, length=3)),
        "rate_cam_radps": or_null(list_of(NUMBER, length=3)),
        "time_std_s": NUMBER,
        "lens_cov": doc(
            or_null(list_of(list_of(NUMBER), length=6)),
            "Of the errors of `cov` with those of the intrinsics, where one calibration found both",
        ),
        "origin": or_null(object_of(GEO)),
    },
    _OPTIONAL,
)

_ARRAYS: Final = ("position_enu_m", "wxyz", "cov", "velocity_enu_mps", "rate_cam_radps")
_ANGLES: Final = ("tilt", "pan", "roll", "heading")


def encode_poses(poses: PoseBatch) -> PackedBytes:
    """Each of some poses as ``aerodft.pose/1``."""
    pose = poses.pose
    parts = [flat(getattr(pose, name)) for name in _ARRAYS]
    parts.append(np.broadcast_to(pose.time_std_s, len(poses))[:, None])
    parts.append(flat(np.broadcast_to(pose.lens_cov, (len(poses), *pose.lens_cov.shape[-2:]))))
    arrays = np.where(poses.has_pose[:, None], np.concatenate(parts, axis=1), np.nan)
    arrays[:, 2] += poses.plane_elevation_m
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
    pose = sample.pose
    arrays = {name: getattr(pose, name) if pose else None for name in (*_ARRAYS, "time_std_s", "lens_cov")}
    if pose is not None:
        arrays["position_enu_m"] = pose.position_enu_m + [0.0, 0.0, sample.plane_elevation_m]
    arrays["lens_cov"] = arrays["lens_cov"] if pose and pose.lens_cov.size else None
    return POSE.to_json(sample, **_view(sample), **arrays)


def decode_pose(data: bytes) -> PoseSample:
    """``aerodft.pose/1`` to a pose sample: position, attitude and covariance exact, angles of ``std`` to an ulp.

    Raises:
        InputError: The payload is not of that schema.
    """
    return load_payload(data, POSE_SCHEMA, _sample)


def _sample(payload: Json) -> PoseSample:
    origin, zoom = payload["origin"], payload.get("zoom")  # recordings of old have no zoom, and no level
    level = _level(payload.get("level"))
    pose = _pose(payload, 0.0 if level is None else level.elevation_m)
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
        level=level,
    )


def _level(payload: Json | None) -> WaterLevel | None:
    if payload is None:
        return None
    level_m = number_or_nan(payload["level_m"])
    return WaterLevel(
        level_m=level_m,
        std_m=number_or_nan(payload["std_m"]),
        zero_m=level_m - number_or_nan(payload["elevation_m"]),
        datum=payload["datum"],
        source=payload["source"],
        is_height_own=payload["in_height"],
    )


def _pose(payload: Json, plane_m: float) -> Pose | None:
    """The pose above the measured plane, which is ``plane_m`` above the station's elevation 0."""
    if payload["wxyz"] is None:
        return None
    lens_cov = payload.get("lens_cov")
    lens = {} if lens_cov is None else {"lens_cov": _numbers(lens_cov)}
    arrays = {name: _numbers(payload[name]) for name in _ARRAYS}
    arrays["position_enu_m"] = read_only(arrays["position_enu_m"] - [0.0, 0.0, plane_m])
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
    return payload_of(SUMMARY, sample, **_view(sample))


def _view(sample: PoseSample) -> Json:
    """Height and angles, and the level of the water."""
    pose = sample.pose
    height_m = None if pose is None else float(pose.position_enu_m[2]) - sample.datum_enu_m
    angles_deg = (None,) * 3 if pose is None else np.degrees(camera_angles(pose.wxyz)).tolist()
    names = ("height_agl_m", "tilt_deg", "roll_deg", "heading_deg")
    return {**dict(zip(names, (height_m, *angles_deg), strict=True)), "level": _level_payload(sample.level)}


def _level_payload(level: WaterLevel | None) -> Json | None:
    if level is None:
        return None
    numbers = {"level_m": level.level_m, "std_m": level.std_m, "elevation_m": level.elevation_m}
    return {**numbers, "datum": level.datum, "source": level.source, "in_height": level.is_height_own}


def summary_numbers(poses: PoseBatch) -> FloatArray:
    """The numbers ``(n, 16)`` of the poses' summaries in their order, NaN for what is not known."""
    angles_deg = np.degrees(camera_angles(poses.pose.wxyz))
    height_m = poses.pose.position_enu_m[:, 2] - poses.datum_enu_m
    places_deg = np.degrees(poses.lat_lon_alt[:, :2])
    height_std_m, _, *stds_rad, _ = poses.std.T
    elevation_m = np.where(np.isnan(poses.level[:, 0]), np.nan, poses.plane_elevation_m)
    level = (*poses.level.T, elevation_m)
    parts = (height_m, poses.height_age_s, *angles_deg, *places_deg.T, poses.telemetry_age_s, *level)
    return np.stack([*parts, height_std_m, *np.degrees(stds_rad)], axis=1)


HEIGHT_SWITCH_SCHEMA = "aerodft.height_switch/1"

HEIGHT_SWITCH: Final = Payload(
    HEIGHT_SWITCH_SCHEMA,
    "From this stamp on heights are of another source",
    {
        "stamp_ns": doc(STAMP, "Of the first pose with the new source"),
        "before": one_of(HEIGHTS),
        "after": one_of(HEIGHTS),
        "step_m": doc(NUMBER, "The new source minus the old one; null where they never spoke at one time"),
        "std_m": doc(NUMBER, "Of the step, by what is stated of the two"),
        "before_m": doc(NUMBER, "What the old source said then"),
        "after_m": doc(NUMBER, "What the new source said then"),
        "compared_ns": doc(STAMP_OR_NULL, "When the two were compared: the last time that the old one spoke"),
    },
)


def encode_height_switch(switch: HeightSwitch) -> bytes:
    """A switch as ``aerodft.height_switch/1``."""
    step = switch.step
    return HEIGHT_SWITCH.dump(
        switch,
        step_m=step and step.step_m,
        std_m=step and step.std_m,
        before_m=step and step.height_m,
        after_m=step and step.other_m,
        compared_ns=step and str(step.stamp_ns),
    )
