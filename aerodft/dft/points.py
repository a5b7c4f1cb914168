"""Where points of the ground are: in the ground frame, on earth, and how far away."""

from collections.abc import Sequence

import numpy as np

from aerodft.geometry.geodesy import lat_lon
from aerodft.geometry.rotation import camera_angles
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import GeoOrigin, Pose
from aerodft.model.pose_batch import PoseBatch


def to_ground_frame(pose: Pose, points_enu_m: FloatArray) -> FloatArray:
    """ENU points ``(..., 3)`` in the camera's ground frame: X right, Y ahead, Z up, origin at its foot.

    Of several poses ``(n,)`` each has its own points ``(n, k, 3)``.
    """
    _, _, heading = camera_angles(pose.wxyz)
    foot = pose.position_enu_m[..., :2]
    if heading.ndim:
        heading, foot = heading[..., None], foot[..., None, :]
    sin, cos = np.sin(heading), np.cos(heading)
    east, north = points_enu_m[..., 0] - foot[..., 0], points_enu_m[..., 1] - foot[..., 1]
    return np.stack([east * cos - north * sin, east * sin + north * cos, points_enu_m[..., 2]], axis=-1)


def lat_lon_alt(origin: GeoOrigin, points_enu_m: FloatArray) -> FloatArray:
    """Latitude, longitude (rad) and altitude (m MSL) of ENU points, ``(..., 3)``; NaN where the plane's is unknown."""
    plane = np.nan if origin.alt_msl_m is None else origin.alt_msl_m
    places = lat_lon(origin, points_enu_m[..., :2])
    return np.concatenate([places, (plane + points_enu_m[..., 2])[..., None]], axis=-1)


def places(poses: PoseBatch, groups: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
    """The numbers of a ``MeasurementColumn`` that say where points are, those of several groups in one go.

    Args:
        poses: The ``(n,)`` poses that points are seen from.
        groups: ENU points ``(n, g, q, 3)``.
    """
    count = len(poses)
    enu_m = np.concatenate([each.reshape(count, -1, 3) for each in groups], axis=1)
    away = enu_m - poses.pose.position_enu_m[:, None]
    numbers = {"ground_m": to_ground_frame(poses.pose, enu_m), "enu_m": enu_m}
    origins = [variant.origin for variant in poses.variants]
    if any(origin is not None for origin in origins):
        numbers["geo"] = _geo(poses, origins, enu_m)
    numbers["range_m"] = np.sqrt(away[..., 0] ** 2 + away[..., 1] ** 2 + away[..., 2] ** 2)
    ends = np.cumsum([each.shape[1] * each.shape[2] for each in groups])[:-1]
    split = {name: np.split(values, ends, axis=1) for name, values in numbers.items()}
    return [
        {name: own[at].reshape(*each.shape[:3], *own[at].shape[2:]) for name, own in split.items()}
        for at, each in enumerate(groups)
    ]


def _geo(poses: PoseBatch, origins: Sequence[GeoOrigin | None], enu_m: FloatArray) -> FloatArray:
    """``(n, k, 3)``; NaN where the origin of an image's ENU is not known."""
    alike: dict[GeoOrigin, list[int]] = {}
    for index, origin in enumerate(origins):
        if origin is not None:
            alike.setdefault(origin, []).append(index)
    found = np.full(enu_m.shape, np.nan)
    for origin, variants in alike.items():
        rows = np.isin(poses.variant_index, variants)
        found[rows] = lat_lon_alt(origin, enu_m[rows])
    return found
