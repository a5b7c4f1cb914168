"""``aerodft.measurement/1``: one measurement, as ``--json``, zenoh and the query answers show it.

A recording has ``aerodft.measurements/1``: all of one image in one record, what they share only once. From it the
single payloads come back byte by byte.
"""

import math
from collections.abc import Hashable, Iterator, Sequence
from typing import Any, Final

import numpy as np

from aerodft.adapters.codec import wire
from aerodft.adapters.codec.pose_encoder import PoseEncoder, groups
from aerodft.adapters.codec.template import Alike, Same, Templates
from aerodft.adapters.texts import Texts
from aerodft.dft.answer_columns import AnswerBlock, AnswerRow, ImageColumns
from aerodft.dft.answers import Answer, ImageAnswers, answers_of
from aerodft.dft.request import Request
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.measurement import Measurement

SCHEMA = "aerodft.measurement/1"
IMAGE_SCHEMA = "aerodft.measurements/1"

_LIST = "measurements"
_MOST_SPLIT_BYTES: Final = 32 << 20  # what the measurements of an image share, once for each
_ANGLES: Final = {"ellipse95": slice(2, 3), "geo": slice(0, 2)}  # which of the numbers


class MeasurementEncoder:
    """Encodes measurements; the pose that one image's measurements share is turned into angles once.

    Not shared between threads.

    Args:
        poses: Whose summaries are made already.
    """

    def __init__(self, poses: PoseEncoder | None = None) -> None:
        self._poses = poses or PoseEncoder()
        self._templates = Templates(whole=("stamp_ns", "image"), fixed=("pixels", "std_px"))

    def payload(self, measurement: Measurement) -> wire.Json:
        """The measurement as ``aerodft.measurement/1``, before it is written out; not to be changed."""
        (payload,) = self._payloads(answers_of(measurement))
        return payload

    def encode(self, measurement: Measurement) -> bytes:
        """The measurement's payload."""
        return wire.dump(self.payload(measurement))

    def each(self, image: ImageAnswers) -> list[bytes]:
        """One payload of ``aerodft.measurement/1`` for each of an image's answers."""
        return [wire.dump(payload) for payload in self._payloads(image)]

    def image(self, image: ImageAnswers) -> bytes:
        """All of an image's answers as ``aerodft.measurements/1``."""
        return self.images([image]).text(0)

    def images(self, images: Sequence[ImageAnswers]) -> Texts:
        """The same of several images: numbers of those that are alike but for these are written in one go."""
        return self._templates.written(images, self._key, self._together, _whole, self._numbers)

    def columns(self, images: ImageColumns) -> Texts:
        """The same of images whose poses were made together."""
        known = np.array([index is not None for index in images.images])
        kind = (images.poses.which * 2 + images.is_plain) * 2 + known
        return self._templates.joined([self._alike(images, own) for own in groups(kind)])

    def _alike(self, images: ImageColumns, own: IntArray) -> Alike:
        """Some of the images, which are plain or not alike."""
        poses, columns = images.poses, self._poses.columns(images.poses.columns)

        def numbers() -> FloatArray:
            return _block_numbers(images.answers, images.first + own, columns.summary[poses.rows[own]])

        def whole() -> IntArray:
            return _stamps_and_indices(poses.stamp_ns[own], [images.images[row] for row in own.tolist()])

        key = self._key(images.row(int(own[0])))
        return Alike(own, key, lambda row: self._together(images.row(int(own[row]))), whole, numbers)

    def _together(self, image: ImageAnswers) -> wire.Json:
        answers = [_own(request, answer) for request, answer in zip(image.requests, image.answers, strict=True)]
        return {"schema": IMAGE_SCHEMA, **self._shared(image), _LIST: answers}

    def _numbers(self, images: Sequence[ImageAnswers]) -> FloatArray:
        """The numbers of images that are alike, as they stand in their payloads ``(n, m)``."""
        parts = [self._poses.summary_numbers([image.posed for image in images])]
        rows: dict[AnswerBlock, list[int]] = {}
        for image in images:
            assert isinstance(image.answers, AnswerRow)  # noqa: S101 - by their key, for the type checker
            rows.setdefault(image.answers.block, []).append(image.answers.row)
        parts.append(np.concatenate([_block_numbers(block, np.array(own)) for block, own in rows.items()]))
        return np.concatenate(parts, axis=1)

    def _key(self, image: ImageAnswers) -> Hashable | None:
        """What images have in common that are written with one template; None where an answer is not plain."""
        answers, pose = image.answers, self._poses.key(image.posed)
        if pose is None or not isinstance(answers, AnswerRow) or not answers.block.is_plain[answers.row]:
            return None
        own = (image.model, image.camera, image.calibration, image.config, image.image is None)
        return (pose, *own, Same(answers.block.shape), Same(image.requests))

    def _payloads(self, image: ImageAnswers) -> Iterator[wire.Json]:
        shared = self._shared(image)
        for request, answer in zip(image.requests, image.answers, strict=True):
            yield {"schema": SCHEMA, **_own(request, answer), **shared}

    def _shared(self, image: ImageAnswers) -> wire.Json:
        """What all measurements of an image have in common."""
        return {
            "stamp_ns": str(image.stamp_ns),
            "image": image.image,
            "model": image.model,
            "camera": image.camera,
            "calibration": image.calibration,
            "config": image.config,
            "software": wire.SOFTWARE,
            "pose": self._poses.summary(image.posed),
        }


def _whole(images: Sequence[ImageAnswers]) -> IntArray:
    return _stamps_and_indices(np.array([image.stamp_ns for image in images]), [image.image for image in images])


def _stamps_and_indices(stamps_ns: IntArray, images: Sequence[int | None]) -> IntArray:
    """Stamps ``(n,)``, and where images have one the index, as they stand in payloads ``(n, k)``."""
    return np.array([stamps_ns, images] if images[0] is not None else [stamps_ns], dtype=np.int64).T


def _block_numbers(block: AnswerBlock, rows: IntArray, *before: FloatArray) -> FloatArray:
    """The numbers of some images' answers, as they stand in their payloads ``(n, m)``, behind others ``(n, k)``."""
    parts = [*before]
    first, stop = int(rows[0]), int(rows[-1]) + 1
    which = slice(first, stop) if stop - first == len(rows) and np.all(np.diff(rows) == 1) else rows
    for column in block.columns:
        for name, values in column.numbers.items():
            own = values[which]
            if name in _ANGLES:
                own = own.copy()
                own[..., _ANGLES[name]] = np.degrees(own[..., _ANGLES[name]])
            parts.append(own.reshape(len(rows), -1))
    return np.concatenate(parts, axis=1)


def _own(request: Request, answer: Answer) -> wire.Json:
    """What is one measurement's own."""
    probe, ellipse = request.probe, answer.ellipse95
    return {
        "name": probe.name,
        "kind": probe.kind._value_,
        "value": answer.value,
        "unit": answer.unit,
        "std": answer.std,
        "ci95": answer.ci95,
        "ellipse95": None if ellipse is None else _ellipse_payload(*ellipse),
        "status": answer.status._value_,
        "reasons": answer.reasons,
        "pixels": request.pixels,
        "std_px": request.std_px,
        "ground_m": answer.ground_m,
        "enu_m": answer.enu_m,
        "cov_enu_m2": answer.cov_enu_m2,
        "geo": None if answer.geo is None else [_geo_payload(*point) for point in answer.geo],
        "range_m": answer.range_m,
    }


def encode_measurements(measurements: list[Measurement]) -> bytes:
    """A JSON list of ``aerodft.measurement/1``."""
    encoder = MeasurementEncoder()
    return b"[" + b",".join(map(encoder.encode, measurements)) + b"]"


def split_measurements(data: bytes) -> list[tuple[str, bytes]]:
    """``aerodft.measurements/1`` as the probes' names and payloads of ``aerodft.measurement/1``, byte by byte.

    Raises:
        InputError: The payload is not of that schema.
    """
    return wire.load(data, IMAGE_SCHEMA, _split)


def _split(payload: wire.Json) -> list[tuple[str, bytes]]:
    shared: dict[str, Any] = {key: value for key, value in payload.items() if key not in {"schema", _LIST}}
    if len(wire.dump(shared)) * len(payload[_LIST]) > _MOST_SPLIT_BYTES:
        raise ValueError(f"{len(payload[_LIST])} measurements that share too much")
    return [(own["name"], wire.dump({"schema": SCHEMA, **own, **shared})) for own in payload[_LIST]]


def _ellipse_payload(semi_major_m: float, semi_minor_m: float, azimuth_rad: float) -> wire.Json:
    return {"semi_major_m": semi_major_m, "semi_minor_m": semi_minor_m, "azimuth_deg": math.degrees(azimuth_rad)}


def _geo_payload(lat_rad: float, lon_rad: float, alt_msl_m: float) -> wire.Json:
    return {"lat": math.degrees(lat_rad), "lon": math.degrees(lon_rad), "alt_msl_m": alt_msl_m}
