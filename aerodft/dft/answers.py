"""Answers as rows of plain numbers: many images' are made at once, and become measurements when somebody asks."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from aerodft.dft.request import Request, Setup
from aerodft.model.measurement import Ellipse95, GeoPoint, Measurement, ProjectionModel
from aerodft.model.pose import PoseSample
from aerodft.model.pose_columns import Posed, sample_of
from aerodft.model.probe import PixelSource, Probe
from aerodft.model.status import Status

Row = Sequence[float]


class Answer(NamedTuple):
    """What one request came to, as in ``Measurement``; geodetic points are latitude, longitude (rad) and altitude (m).

    An ellipse is its semi-major and semi-minor axis (m) and its azimuth (rad); an unknown altitude is NaN.
    """

    status: Status
    reasons: tuple[str, ...]
    unit: str = "m"
    value: float | None = None
    std: float | None = None
    ci95: tuple[float, float] | None = None
    ellipse95: Row | None = None
    ground_m: Sequence[Row] | None = None
    enu_m: Sequence[Row] | None = None
    cov_enu_m2: Sequence[Row] | None = None
    geo: Sequence[Row] | None = None
    range_m: Row | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageAnswers:
    """What all requests came to in one image; as measurements when iterated over.

    Attributes:
        requests: The requests.
        answers: Theirs, in the same order.
        posed: The image's pose.
        stamp_ns: Its stamp.
        image: Its index, where it has one.
        model: Projection model.
        camera: Name of the camera.
        calibration: Of the pose.
        config: Of the station.
    """

    requests: tuple[Request, ...]
    answers: Sequence[Answer]
    posed: Posed
    stamp_ns: int
    image: int | None
    model: ProjectionModel
    camera: str
    calibration: str | None
    config: str | None

    @staticmethod
    def of(
        setup: Setup, posed: Posed, image: int | None, requests: tuple[Request, ...], answers: Sequence[Answer]
    ) -> "ImageAnswers":
        """The answers in one image, with what they share."""
        return ImageAnswers(
            requests=requests,
            answers=answers,
            posed=posed,
            stamp_ns=posed.stamp_ns,
            image=image,
            model=setup.model,
            camera=setup.camera.name,
            calibration=posed.calibration,
            config=setup.config_id,
        )

    @property
    def sample(self) -> PoseSample:
        """The image's pose alone."""
        return sample_of(self.posed)

    @property
    def statuses(self) -> tuple[Status, ...]:
        """Of the answers, which are not made for that where they are columns yet."""
        statuses: tuple[Status, ...] | None = getattr(self.answers, "statuses", None)
        return tuple(answer.status for answer in self.answers) if statuses is None else statuses

    def __len__(self) -> int:
        return len(self.answers)

    def __iter__(self) -> Iterator[Measurement]:
        sample = self.sample
        for request, answer in zip(self.requests, self.answers, strict=True):
            yield self._measurement(request, answer, sample)

    def _measurement(self, request: Request, answer: Answer, sample: PoseSample) -> Measurement:
        return Measurement(
            name=request.probe.name,
            kind=request.probe.kind,
            status=answer.status,
            reasons=answer.reasons,
            stamp_ns=self.stamp_ns,
            pixels=request.pixels_of(0),
            std_px=request.std_px,
            camera=self.camera,
            model=self.model,
            pose=sample,
            value=answer.value,
            std=answer.std,
            ci95=answer.ci95,
            ellipse95=None if answer.ellipse95 is None else _ellipse(*answer.ellipse95),
            ground_m=_tuples(answer.ground_m),
            enu_m=_tuples(answer.enu_m),
            cov_enu_m2=_tuples(answer.cov_enu_m2),
            geo=None if answer.geo is None else tuple(_geo(*point) for point in answer.geo),
            range_m=None if answer.range_m is None else tuple(answer.range_m),
            unit=answer.unit,
            image=self.image,
            calibration=self.calibration,
            config=self.config,
        )


def _tuples(rows: Sequence[Row] | None) -> tuple[tuple[float, ...], ...] | None:
    return None if rows is None else tuple(map(tuple, rows))


def _ellipse(major_m: float, minor_m: float, azimuth_rad: float) -> Ellipse95:
    return Ellipse95(semi_major_m=major_m, semi_minor_m=minor_m, azimuth_rad=azimuth_rad)


def _geo(lat_rad: float, lon_rad: float, alt_msl_m: float) -> GeoPoint:
    return GeoPoint(lat_rad=lat_rad, lon_rad=lon_rad, alt_msl_m=None if math.isnan(alt_msl_m) else alt_msl_m)


def answers_of(measurement: Measurement) -> ImageAnswers:
    """One measurement as the answers of an image of which nothing else was asked: the way back."""
    probe = Probe(name=measurement.name, kind=measurement.kind, source=PixelSource.OBSERVED)
    ellipse, geo = measurement.ellipse95, measurement.geo
    answer = Answer(
        status=measurement.status,
        reasons=measurement.reasons,
        unit=measurement.unit,
        value=measurement.value,
        std=measurement.std,
        ci95=measurement.ci95,
        ellipse95=None if ellipse is None else (ellipse.semi_major_m, ellipse.semi_minor_m, ellipse.azimuth_rad),
        ground_m=measurement.ground_m,
        enu_m=measurement.enu_m,
        cov_enu_m2=measurement.cov_enu_m2,
        geo=None if geo is None else tuple(map(_place, geo)),
        range_m=measurement.range_m,
    )
    return ImageAnswers(
        requests=(Request(probe=probe, pixels=measurement.pixels, std_px=measurement.std_px),),
        answers=(answer,),
        posed=measurement.pose,
        stamp_ns=measurement.stamp_ns,
        image=measurement.image,
        model=measurement.model,
        camera=measurement.camera,
        calibration=measurement.calibration,
        config=measurement.config,
    )


def _place(point: GeoPoint) -> Row:
    return point.lat_rad, point.lon_rad, math.nan if point.alt_msl_m is None else point.alt_msl_m
