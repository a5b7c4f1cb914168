"""Measurements of the same requests in many images, as columns of arrays."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, overload

import numpy as np

from aerodft.dft.request import Request, Setup
from aerodft.model import (
    CODE_OF,
    CODES,
    Ellipse95,
    FloatArray,
    GeoPoint,
    IntArray,
    Measurement,
    PoseBatch,
    PoseSample,
    ProjectionModel,
    Status,
)

NUMBERS: Final[tuple[str, ...]] = (
    "value",
    "std",
    "ci95",
    "ellipse95",
    "ground_m",
    "enu_m",
    "cov_enu_m2",
    "geo",
    "range_m",
)
"""The fields of a ``Measurement`` that hold numbers, in their order."""

NO_IMAGE: Final = -1
"""Running number of a stamp without an image."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasurementColumn:
    """Measurements of one request in ``n`` images.

    Attributes:
        unit: Unit of the values.
        status: ``(n,)`` indices into ``CODES``.
        reasons: Reasons by row, where they differ from those of the image's pose.
        numbers: ``(n, ...)`` by the names of ``NUMBERS``, in that order, without names that no image has; an all-NaN
            row is none. ``ellipse95`` is semi-major, semi-minor axis (m) and azimuth (rad), ``geo (n, q, 3)``
            latitude, longitude (rad) and altitude (m MSL, NaN where unknown).
    """

    unit: str
    status: IntArray
    reasons: Mapping[int, tuple[str, ...]]
    numbers: Mapping[str, FloatArray]

    @staticmethod
    def single(
        unit: str, status: Status, reasons: tuple[str, ...], numbers: Mapping[str, FloatArray] | None = None
    ) -> "MeasurementColumn":
        """The column of a single image, from numbers without the axis of images."""
        in_order = {name: numbers[name][None] for name in NUMBERS if name in numbers} if numbers else {}
        return MeasurementColumn(unit, np.array([CODE_OF[status]]), {0: reasons}, in_order)

    def rows(self, rows: IntArray) -> "MeasurementColumn":
        """Images ``(m,)`` by their indices."""
        reasons = {new: self.reasons[old] for new, old in enumerate(rows.tolist()) if old in self.reasons}
        numbers = {name: values[rows] for name, values in self.numbers.items()}
        return MeasurementColumn(self.unit, self.status[rows], reasons, numbers)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasurementBatch(Sequence[list[Measurement]]):
    """Measurements of ``k`` requests in ``n`` images; as a sequence, the ``k`` measurements of each image.

    Attributes:
        requests: The requests, with pixels ``(q, 2)`` that all images share, or ``(n, q, 2)``.
        poses: The images' ``(n,)`` poses.
        images: ``(n,)`` running numbers of the images, ``NO_IMAGE`` for a stamp without one.
        columns: One for each request.
        model: Projection model.
        camera: Name of the camera.
        config: Id of the station's configuration.
    """

    requests: tuple[Request, ...]
    poses: PoseBatch
    images: IntArray
    columns: tuple[MeasurementColumn, ...]
    model: ProjectionModel
    camera: str
    config: str | None

    def __len__(self) -> int:
        return len(self.images)

    @overload
    def __getitem__(self, index: int) -> list[Measurement]: ...

    @overload
    def __getitem__(self, index: slice) -> "MeasurementBatch": ...

    def __getitem__(self, index: int | slice) -> "list[Measurement] | MeasurementBatch":
        if isinstance(index, slice):
            return self.rows(np.arange(len(self))[index])
        row = range(len(self))[index]
        sample = self.poses[row]
        pairs = zip(self.requests, self.columns, strict=True)
        return [self._measurement(row, sample, request, column) for request, column in pairs]

    def rows(self, rows: IntArray) -> "MeasurementBatch":
        """Images ``(m,)`` by their indices."""
        return MeasurementBatch(
            requests=tuple(request.rows(rows) for request in self.requests),
            poses=self.poses.rows(rows),
            images=self.images[rows],
            columns=tuple(column.rows(rows) for column in self.columns),
            model=self.model,
            camera=self.camera,
            config=self.config,
        )

    def _measurement(self, row: int, sample: PoseSample, request: Request, column: MeasurementColumn) -> Measurement:
        numbers = {name: _none_if_nan(values[row]) for name, values in column.numbers.items()}
        value, std, ci95 = (numbers.get(name) for name in ("value", "std", "ci95"))
        ellipse, geo, range_m = (numbers.get(name) for name in ("ellipse95", "geo", "range_m"))
        return Measurement(
            name=request.probe.name,
            kind=request.probe.kind,
            status=CODES[column.status[row]],
            reasons=column.reasons.get(row, sample.reasons),
            stamp_ns=sample.stamp_ns,
            pixels=request.pixels_of(row),
            std_px=request.std_px,
            camera=self.camera,
            model=self.model,
            pose=sample,
            value=None if value is None else float(value),
            std=None if std is None else float(std),
            ci95=None if ci95 is None else (float(ci95[0]), float(ci95[1])),
            ellipse95=None if ellipse is None else _ellipse(*ellipse.tolist()),
            ground_m=_tuples(numbers.get("ground_m")),
            enu_m=_tuples(numbers.get("enu_m")),
            cov_enu_m2=_tuples(numbers.get("cov_enu_m2")),
            geo=None if geo is None else tuple(_geo(*point) for point in geo.tolist()),
            range_m=None if range_m is None else tuple(range_m.tolist()),
            unit=column.unit,
            image=None if self.images[row] == NO_IMAGE else int(self.images[row]),
            calibration=sample.calibration,
            config=self.config,
        )


def single_image_batch(
    setup: Setup,
    sample: PoseSample,
    image: int | None,
    requests: tuple[Request, ...],
    columns: tuple[MeasurementColumn, ...],
) -> MeasurementBatch:
    """The batch of a single image, of columns found elsewhere than in the engine."""
    return MeasurementBatch(
        requests=requests,
        poses=PoseBatch.from_samples([sample]),
        images=np.array([NO_IMAGE if image is None else image]),
        columns=columns,
        model=setup.model,
        camera=setup.camera.name,
        config=setup.config_id,
    )


def _none_if_nan(values: FloatArray) -> FloatArray | None:
    return None if np.isnan(values).all() else values


def _tuples(rows: FloatArray | None) -> tuple[tuple[float, ...], ...] | None:
    return None if rows is None else tuple(map(tuple, rows.tolist()))


def _ellipse(major_m: float, minor_m: float, azimuth_rad: float) -> Ellipse95:
    return Ellipse95(semi_major_m=major_m, semi_minor_m=minor_m, azimuth_rad=azimuth_rad)


def _geo(lat_rad: float, lon_rad: float, alt_msl_m: float) -> GeoPoint:
    return GeoPoint(lat_rad=lat_rad, lon_rad=lon_rad, alt_msl_m=None if math.isnan(alt_msl_m) else alt_msl_m)
