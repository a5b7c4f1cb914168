"""``aerodft.measurement/1``: one measurement, as ``--json``, zenoh and the query answers show it.

A recording has ``aerodft.measurements/1``: all of one image in one record, what they share only once. From it the
single payloads come back byte by byte.
"""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from aerodft.adapters.wire.packed_json import PackedBytes, encode_payloads, flat
from aerodft.adapters.wire.payload import (
    INTEGER,
    NUMBER,
    PIXELS,
    STAMP,
    TEXT,
    TEXT_OR_NULL,
    Json,
    Payload,
    Schema,
    doc,
    dump_payload,
    list_of,
    load_payload,
    object_of,
    one_of,
    or_null,
    payload_of,
)
from aerodft.adapters.wire.pose import GEO, SUMMARY, summary_numbers, summary_payload
from aerodft.dft import NO_IMAGE, PROBE_KINDS, MeasurementBatch, MeasurementColumn
from aerodft.model import FloatArray, Measurement, ProbeKind, ProjectionModel, Status

MEASUREMENT_SCHEMA = "aerodft.measurement/1"
MEASUREMENTS_SCHEMA = "aerodft.measurements/1"

_LIST = "measurements"
_MOST_SPLIT_BYTES: Final = 32 << 20  # what the measurements of an image share, once for each
_BEFORE_PIXELS: Final = ("value", "std", "ci95", "ellipse95")
_BEHIND_PIXELS: Final = ("ground_m", "enu_m", "cov_enu_m2", "geo", "range_m")
_OWN_AXES: Final = 3  # of pixels that each image has of its own: image, pixel, coordinate
_ANGLES: Final = {"ellipse95": slice(2, 3), "geo": slice(0, 2)}  # which of the numbers


_KINDS: Final = (*PROBE_KINDS, ProbeKind.TRACK)

_POINTS = or_null(list_of(list_of(NUMBER, length=3)))
_OWN: Final[Schema] = {
    "name": doc(TEXT, "The probe"),
    "kind": one_of(_KINDS),
    "value": doc(NUMBER, "Null unless the status is ok"),
    "unit": TEXT,
    "std": NUMBER,
    "ci95": or_null(list_of(NUMBER, length=2)),
    "ellipse95": or_null(object_of({"semi_major_m": NUMBER, "semi_minor_m": NUMBER, "azimuth_deg": NUMBER})),
    "status": one_of(Status),
    "reasons": list_of(TEXT),
    "pixels": PIXELS,
    "std_px": NUMBER,
    "ground_m": doc(_POINTS, "X right, Y ahead, Z up of the point below the camera"),
    "enu_m": doc(_POINTS, "East, north, up of the station's origin"),
    "cov_enu_m2": doc(or_null(list_of(list_of(NUMBER, length=3), length=3)), "Of the first point"),
    "geo": or_null(list_of(object_of(GEO))),
    "range_m": or_null(list_of(NUMBER)),
}
_OF_IMAGE: Final[Schema] = {
    "stamp_ns": STAMP,
    "image": INTEGER,
    "model": one_of(ProjectionModel),
    "camera": TEXT,
    "calibration": TEXT_OR_NULL,
    "config": TEXT_OR_NULL,
    "software": TEXT,
    "pose": SUMMARY,
}
_OWN_OBJECT: Final = object_of(_OWN)

MEASUREMENT: Final = Payload(MEASUREMENT_SCHEMA, "One measurement, or why there is none", {**_OWN, **_OF_IMAGE})

MEASUREMENTS: Final = Payload(
    MEASUREMENTS_SCHEMA,
    "All measurements of one image, as a recording has them: what they share, and a list",
    {**_OF_IMAGE, _LIST: list_of(_OWN_OBJECT)},
)


def encode_batch(batch: MeasurementBatch) -> PackedBytes:
    """Each image's measurements as ``aerodft.measurements/1``."""
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
        _texts(batch),
        fixed={"std_px"} if has_own_pixels else {"std_px", "pixels"},
    )


def _texts(batch: MeasurementBatch) -> list[list[str | tuple[str, ...] | None]]:
    """Of each image its calibration and the reasons of its measurements."""
    like = [[each.calibration, *[each.reasons] * len(batch.columns)] for each in batch.poses.variants]
    texts = [like[index] for index in batch.poses.variant_index.tolist()]
    for member, column in enumerate(batch.columns):
        for row, reasons in column.reasons.items():
            texts[row] = [*texts[row][: member + 1], reasons, *texts[row][member + 2 :]]
    return texts


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
    return MEASUREMENTS.to_json(
        batch,
        stamp_ns=str(sample.stamp_ns),
        image=None if image == NO_IMAGE else image,
        calibration=sample.calibration,
        pose=summary_payload(sample),
        measurements=[payload_of(_OWN_OBJECT, each) for each in batch[row]],
    )


def encode_measurements(measurements: Sequence[Measurement]) -> bytes:
    """A JSON list of ``aerodft.measurement/1``."""
    return b"[" + b",".join(map(encode_measurement, measurements)) + b"]"


def encode_measurement(measurement: Measurement) -> bytes:
    """One measurement as ``aerodft.measurement/1``."""
    return dump_payload(measurement_payload(measurement))


def measurement_payload(measurement: Measurement) -> Json:
    """One measurement as ``aerodft.measurement/1``, before it is written out."""
    return MEASUREMENT.to_json(measurement, pose=summary_payload(measurement.pose))


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
