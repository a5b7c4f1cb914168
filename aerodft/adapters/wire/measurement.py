"""``aerodft.measurement/1``: one measurement, as ``--json``, zenoh and the query answers show it.

A recording has ``aerodft.measurements/1``: all of one image in one record, what they share only once. From it the
single payloads come back byte by byte.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from aerodft.adapters.wire.packed_json import PackedBytes, encode_payloads, flat
from aerodft.adapters.wire.payload import Json, dump_payload, load_payload
from aerodft.adapters.wire.pose import geo_payload, summary_numbers, summary_payload
from aerodft.dft import NO_IMAGE, MeasurementBatch, MeasurementColumn
from aerodft.model import Ellipse95, FloatArray, Measurement, PoseSample, ProjectionModel
from aerodft.version import SOFTWARE

MEASUREMENT_SCHEMA = "aerodft.measurement/1"
MEASUREMENTS_SCHEMA = "aerodft.measurements/1"

_LIST = "measurements"
_MOST_SPLIT_BYTES: Final = 32 << 20  # what the measurements of an image share, once for each
_BEFORE_PIXELS: Final = ("value", "std", "ci95", "ellipse95")
_BEHIND_PIXELS: Final = ("ground_m", "enu_m", "cov_enu_m2", "geo", "range_m")
_OWN_AXES: Final = 3  # of pixels that each image has of its own: image, pixel, coordinate
_ANGLES: Final = {"ellipse95": slice(2, 3), "geo": slice(0, 2)}  # which of the numbers


def encode_batch(batch: MeasurementBatch) -> PackedBytes:
    """What was measured in each image as ``aerodft.measurements/1``."""
    kinds = [batch.poses.kind_index, batch.images == NO_IMAGE]
    numbers = [summary_numbers(batch.poses)]
    has_own_pixels = any(
        isinstance(each.pixels, np.ndarray) and each.pixels.ndim == _OWN_AXES for each in batch.requests
    )
    for request, column in zip(batch.requests, batch.columns, strict=True):
        kinds.append(column.status)
        numbers += _numbers(column, _BEFORE_PIXELS)
        if has_own_pixels:
            pixels = np.asarray(request.pixels, dtype=np.float64)
            numbers.append(flat(np.broadcast_to(pixels, (len(batch), *pixels.shape[-2:]))))
        numbers += _numbers(column, _BEHIND_PIXELS)
    return encode_payloads(
        np.stack(kinds, axis=1),
        lambda row: _image_payload(batch, row),
        {"stamp_ns": batch.poses.stamp_ns, "image": batch.images},
        np.concatenate(numbers, axis=1),
        [
            [like.calibration, *(column.reasons.get(row, like.reasons) for column in batch.columns)]
            for row, like in enumerate(batch.poses.variant_of_each)
        ],
        fixed={"std_px"} if has_own_pixels else {"std_px", "pixels"},
    )


def _numbers(column: MeasurementColumn, names: Sequence[str]) -> list[FloatArray]:
    """Numbers of a column ``(n, m)`` as they stand in its payloads, by their names."""
    found = []
    for name in names:
        if name in column.numbers:
            values = column.numbers[name]
            if name in _ANGLES:
                values = values.copy()
                values[..., _ANGLES[name]] = np.degrees(values[..., _ANGLES[name]])
            found.append(flat(values))
    return found


def _image_payload(batch: MeasurementBatch, row: int) -> Json:
    sample, image = batch.poses[row], int(batch.images[row])
    shared = _shared_payload(
        sample,
        stamp_ns=sample.stamp_ns,
        image=None if image == NO_IMAGE else image,
        model=batch.model,
        camera=batch.camera,
        calibration=sample.calibration,
        config=batch.config,
    )
    return {"schema": MEASUREMENTS_SCHEMA, **shared, _LIST: list(map(_own_payload, batch[row]))}


def encode_measurements(measurements: Sequence[Measurement]) -> bytes:
    """A JSON list of ``aerodft.measurement/1``."""
    return b"[" + b",".join(map(encode_measurement, measurements)) + b"]"


def encode_measurement(measurement: Measurement) -> bytes:
    """One measurement as ``aerodft.measurement/1``."""
    return dump_payload(measurement_payload(measurement))


def measurement_payload(measurement: Measurement) -> Json:
    """One measurement as ``aerodft.measurement/1``, before it is written out."""
    shared = _shared_payload(
        measurement.pose,
        stamp_ns=measurement.stamp_ns,
        image=measurement.image,
        model=measurement.model,
        camera=measurement.camera,
        calibration=measurement.calibration,
        config=measurement.config,
    )
    return {"schema": MEASUREMENT_SCHEMA, **_own_payload(measurement), **shared}


def _shared_payload(
    pose: PoseSample,
    *,
    stamp_ns: int,
    image: int | None,
    model: ProjectionModel,
    camera: str,
    calibration: str | None,
    config: str | None,
) -> Json:
    """What all measurements of an image have in common."""
    return {
        "stamp_ns": str(stamp_ns),
        "image": image,
        "model": model,
        "camera": camera,
        "calibration": calibration,
        "config": config,
        "software": SOFTWARE,
        "pose": summary_payload(pose),
    }


def _own_payload(measurement: Measurement) -> Json:
    """What is one measurement's own."""
    ellipse, geo = measurement.ellipse95, measurement.geo
    return {
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
        "geo": None if geo is None else list(map(geo_payload, geo)),
        "range_m": measurement.range_m,
    }


def split_measurements(data: bytes) -> list[tuple[str, bytes]]:
    """``aerodft.measurements/1`` as the probes' names and payloads of ``aerodft.measurement/1``, byte by byte.

    Raises:
        InputError: The payload is not of that schema.
    """
    return load_payload(data, MEASUREMENTS_SCHEMA, _split)


def _split(payload: Json) -> list[tuple[str, bytes]]:
    shared: dict[str, Any] = {key: value for key, value in payload.items() if key not in {"schema", _LIST}}
    if len(dump_payload(shared)) * len(payload[_LIST]) > _MOST_SPLIT_BYTES:
        raise ValueError(f"{len(payload[_LIST])} measurements that share too much")
    return [(own["name"], dump_payload({"schema": MEASUREMENT_SCHEMA, **own, **shared})) for own in payload[_LIST]]


def _ellipse_payload(ellipse: Ellipse95) -> Json:
    return {
        "semi_major_m": ellipse.semi_major_m,
        "semi_minor_m": ellipse.semi_minor_m,
        "azimuth_deg": math.degrees(ellipse.azimuth_rad),
    }
