"""``aerodft.measurement/1``: one measurement, as ``--json``, zenoh, MCAP and the query answers show it."""

import math

from aerodft.adapters.codec import wire
from aerodft.adapters.codec.pose import sample_of_summary, summary
from aerodft.model.measurement import Ellipse95, GeoPoint, Measurement, ProjectionModel
from aerodft.model.pose import PoseSample
from aerodft.model.probe import ProbeKind
from aerodft.model.status import Status

SCHEMA = "aerodft.measurement/1"


class MeasurementEncoder:
    """Encodes measurements; the pose that one image's measurements share is turned into angles once.

    Not shared between threads.
    """

    _sample: PoseSample | None
    _summary: wire.Json

    def __init__(self) -> None:
        self._sample = None
        self._summary = {}

    def payload(self, measurement: Measurement) -> wire.Json:
        """The measurement as ``aerodft.measurement/1``, before it is written out; not to be changed."""
        if measurement.pose is not self._sample:
            self._sample, self._summary = measurement.pose, summary(measurement.pose)
        ellipse = measurement.ellipse95
        return {
            "schema": SCHEMA,
            "name": measurement.name,
            "kind": measurement.kind,
            "value": measurement.value,
            "unit": measurement.unit,
            "std": measurement.std,
            "ci95": measurement.ci95,
            "ellipse95": None if ellipse is None else _ellipse_payload(ellipse),
            "status": measurement.status,
            "reasons": measurement.reasons,
            "pixels": measurement.pixels,
            "std_px": measurement.std_px,
            "ground_m": measurement.ground_m,
            "enu_m": measurement.enu_m,
            "cov_enu_m2": measurement.cov_enu_m2,
            "geo": None if measurement.geo is None else [_geo_payload(point) for point in measurement.geo],
            "range_m": measurement.range_m,
            "stamp_ns": str(measurement.stamp_ns),
            "image": measurement.image,
            "model": measurement.model,
            "camera": measurement.camera,
            "calibration": measurement.calibration,
            "config": measurement.config,
            "software": wire.SOFTWARE,
            "pose": self._summary,
        }

    def encode(self, measurement: Measurement) -> bytes:
        """The measurement's payload."""
        return wire.dump(self.payload(measurement))


def encode_measurement(measurement: Measurement) -> bytes:
    """One measurement as ``aerodft.measurement/1``."""
    return MeasurementEncoder().encode(measurement)


def encode_measurements(measurements: list[Measurement]) -> bytes:
    """A JSON list of ``aerodft.measurement/1``."""
    encoder = MeasurementEncoder()
    return b"[" + b",".join(map(encoder.encode, measurements)) + b"]"


def decode_measurement(data: bytes) -> Measurement:
    """``aerodft.measurement/1`` to a measurement.

    Exact but for degrees (``wire.DEGREES_RTOL``); its pose has height and attitude, no covariance.

    Raises:
        InputError: The payload is not of that schema.
    """
    return wire.load(data, SCHEMA, _measurement)


def _measurement(payload: wire.Json) -> Measurement:
    status = Status(payload["status"])
    stamp_ns = int(payload["stamp_ns"])
    ci95, geo, ranges_m = payload["ci95"], payload["geo"], payload["range_m"]
    return Measurement(
        name=payload["name"],
        kind=ProbeKind(payload["kind"]),
        status=status,
        reasons=tuple(payload["reasons"]),
        stamp_ns=stamp_ns,
        pixels=wire.pixel_pairs(payload["pixels"]),
        std_px=wire.number(payload["std_px"]),
        camera=payload["camera"],
        model=ProjectionModel(payload["model"]),
        pose=sample_of_summary(payload["pose"], stamp_ns, status),
        value=payload["value"],
        std=payload["std"],
        ci95=None if ci95 is None else (wire.number(ci95[0]), wire.number(ci95[1])),
        ellipse95=None if payload["ellipse95"] is None else _ellipse(payload["ellipse95"]),
        ground_m=wire.rows(payload["ground_m"]),
        enu_m=wire.rows(payload["enu_m"]),
        cov_enu_m2=wire.rows(payload["cov_enu_m2"]),
        geo=None if geo is None else tuple(map(_geo, geo)),
        range_m=None if ranges_m is None else wire.numbers(ranges_m),
        unit=payload["unit"],
        image=payload["image"],
        calibration=payload["calibration"],
        config=payload["config"],
    )


def _ellipse_payload(ellipse: Ellipse95) -> wire.Json:
    return {
        "semi_major_m": ellipse.semi_major_m,
        "semi_minor_m": ellipse.semi_minor_m,
        "azimuth_deg": math.degrees(ellipse.azimuth_rad),
    }


def _ellipse(payload: wire.Json) -> Ellipse95:
    return Ellipse95(
        semi_major_m=wire.number(payload["semi_major_m"]),
        semi_minor_m=wire.number(payload["semi_minor_m"]),
        azimuth_rad=math.radians(wire.number(payload["azimuth_deg"])),
    )


def _geo_payload(point: GeoPoint) -> wire.Json:
    return {
        "lat": math.degrees(point.lat_rad),
        "lon": math.degrees(point.lon_rad),
        "alt_msl_m": point.alt_msl_m,
    }


def _geo(payload: wire.Json) -> GeoPoint:
    return GeoPoint(
        lat_rad=math.radians(wire.number(payload["lat"])),
        lon_rad=math.radians(wire.number(payload["lon"])),
        alt_msl_m=payload["alt_msl_m"],
    )
