"""``aerodft.pose/1``: a pose sample with its full covariance."""

import math
from collections.abc import Hashable, Sequence
from typing import Final, NamedTuple

import numpy as np

from aerodft.adapters.codec import wire
from aerodft.adapters.codec.pose_summary import height_source_of, std_of, summary_key, summary_of, summary_values
from aerodft.adapters.codec.template import Templates
from aerodft.adapters.texts import Texts
from aerodft.model.arrays import FloatArray, read_only
from aerodft.model.pose import GeoOrigin, GimbalSource, Pose, PoseSample
from aerodft.model.status import Status
from aerodft.model.zoom import Zoom, ZoomSource

SCHEMA = "aerodft.pose/1"

_REMEMBERED: Final = 1024  # summaries


class PoseEncoder:
    """Encodes poses, of which many are alike but for their numbers; their summaries are made once.

    Not shared between threads.
    """

    def __init__(self) -> None:
        self._templates = Templates(words=("stamp_ns",))
        self._summaries: dict[int, _Summary] = {}

    def encode(self, samples: Sequence[PoseSample]) -> Texts:
        """Pose samples as ``aerodft.pose/1``."""
        return self._templates.written(
            samples, _key, self._payload, lambda sample: (stamp_word(sample),), self._numbers
        )

    def summary(self, sample: PoseSample) -> wire.Json:
        """As a measurement shows the pose; not to be changed."""
        return summary_of(sample, self._summary(sample).values)

    def summary_numbers(self, sample: PoseSample) -> Sequence[float | None]:
        """Those of a summary, in its order; not to be changed."""
        values = self._summary(sample).values
        return values if None not in values else [value for value in values if value is not None]

    def _summary(self, sample: PoseSample) -> "_Summary":
        known = self._summaries.get(id(sample))
        if known is not None and known.sample is sample:
            return known
        if len(self._summaries) >= _REMEMBERED:
            self._summaries.clear()
        self._summaries[id(sample)] = known = _Summary(sample, summary_values(sample))
        return known

    def _payload(self, sample: PoseSample) -> wire.Json:
        return _payload(sample, self.summary(sample))

    def _numbers(self, samples: Sequence[PoseSample]) -> FloatArray:
        poses = [sample.pose for sample in samples if sample.pose is not None]
        first = samples[0]
        scalars = [
            [
                *self.summary_numbers(sample),
                sample.std.horizontal_m,
                sample.std.time_s,
                *(() if sample.alt_msl_m is None else (sample.alt_msl_m,)),
            ]
            for sample in samples
        ]
        fields = ("position_enu_m", "wxyz", "cov", "velocity_enu_mps", "rate_cam_radps", "time_std_s")
        arrays = [np.array([getattr(pose, name) for pose in poses]).reshape(len(poses), -1) for name in fields]
        origin = (
            []
            if first.origin is None
            else [each for each in _origin_payload(first.origin).values() if each is not None]
        )
        return np.concatenate([np.array(scalars), *arrays, np.tile(origin, (len(samples), 1))], axis=1)


class _Summary(NamedTuple):
    sample: PoseSample
    values: list[float | None]


def stamp_word(sample: PoseSample) -> bytes:
    """A sample's stamp, as it stands in a payload."""
    return b'"%d"' % sample.stamp_ns


def _key(sample: PoseSample) -> Hashable | None:
    """What samples have in common that are written with one template."""
    if sample.pose is None or sample.zoom is not None:
        return None
    own = (sample.status, sample.reasons, sample.alt_msl_m is None, sample.attitude_source, sample.calibration)
    origin = sample.origin
    place = None if origin is None else (origin.lat_rad, origin.lon_rad, origin.alt_msl_m)
    return (*summary_key(sample), *own, place)


def encode_pose(sample: PoseSample) -> bytes:
    """A pose sample as ``aerodft.pose/1``."""
    return wire.dump(_payload(sample, summary_of(sample, summary_values(sample))))


def _payload(sample: PoseSample, own: wire.Json) -> wire.Json:
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
    payload["origin"] = None if origin is None else _origin_payload(origin)
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


def _origin_payload(origin: GeoOrigin) -> wire.Json:
    return {
        "lat": math.degrees(origin.lat_rad),
        "lon": math.degrees(origin.lon_rad),
        "alt_msl_m": origin.alt_msl_m,
    }


def _origin(payload: wire.Json) -> GeoOrigin:
    return GeoOrigin(
        lat_rad=math.radians(payload["lat"]), lon_rad=math.radians(payload["lon"]), alt_msl_m=payload["alt_msl_m"]
    )
