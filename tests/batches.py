"""Outputs of a pipeline made by hand: poses and measurements as batches, and as the outputs of one tick."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from aerodft.dft import NO_IMAGE, MeasurementBatch, MeasurementColumn, Request
from aerodft.dft.measurement_batch import NUMBERS
from aerodft.model import (
    CODE_OF,
    CalibrationEstimate,
    CameraMotionEstimate,
    Ellipse95,
    Event,
    FloatArray,
    GeoPoint,
    HeightSwitch,
    Measurement,
    Observation,
    PixelSource,
    PoseBatch,
    PoseSample,
    Probe,
)
from aerodft.service import Batches, ImageOutputs, Sink, StepOutputs
from aerodft.service.ports import SingleOutput

Content = PoseSample | Measurement | Observation | CalibrationEstimate | CameraMotionEstimate | HeightSwitch


def one_tick(now_ns: int, events: Iterable[Event]) -> Batches:
    """The events of one tick."""
    return Batches.from_events(np.array([now_ns]), events)


def take(sink: Sink, tick: Batches, *contents: Content) -> None:
    """Hand a sink one tick with its outputs in this order."""
    sink.take(tick, step_outputs([contents]))


def step_outputs(ticks: Sequence[Sequence[Content]]) -> StepOutputs:
    """The outputs of some ticks, all of them in this order; a pose is that of an image in which nothing is measured."""
    placed = [(tick, content) for tick, contents in enumerate(ticks) for content in contents]
    images: list[ImageOutputs] = []
    singles: list[SingleOutput] = []
    for order, (tick, content) in enumerate(placed):
        if isinstance(content, PoseSample):
            images.append(_image_outputs(tick, order, content))
        else:
            own = measurement_batch([[content]]) if isinstance(content, Measurement) else content
            singles.append(SingleOutput(tick=tick, order=order, content=own))
    return StepOutputs(images=tuple(images), singles=tuple(singles))


def _image_outputs(tick: int, order: int, sample: PoseSample) -> ImageOutputs:
    return ImageOutputs(
        tick=np.array([tick]),
        order=np.array([order]),
        images=np.array([NO_IMAGE]),
        poses=PoseBatch.from_samples([sample]),
        measurements=None,
    )


def measurement_batch(images: Sequence[Sequence[Measurement]]) -> MeasurementBatch:
    """Measurements of the same probes in ``n`` images as a batch."""
    firsts = [image[0] for image in images]
    samples = [replace(each.pose, stamp_ns=each.stamp_ns, calibration=each.calibration) for each in firsts]
    return MeasurementBatch(
        requests=tuple(map(_request, zip(*images, strict=True))),
        poses=PoseBatch.from_samples(samples),
        images=np.array([NO_IMAGE if each.image is None else each.image for each in firsts], dtype=np.int64),
        columns=tuple(map(_column, zip(*images, strict=True))),
        model=firsts[0].model,
        camera=firsts[0].camera,
        config=firsts[0].config,
    )


def _request(values: Sequence[Measurement]) -> Request:
    first = values[0]
    probe = Probe(name=first.name, kind=first.kind, source=PixelSource.OBSERVED)
    is_shared = len({each.pixels for each in values}) == 1
    pixels = first.pixels if is_shared else np.array([each.pixels for each in values])
    return Request(probe=probe, pixels=pixels, std_px=first.std_px)


def _column(values: Sequence[Measurement]) -> MeasurementColumn:
    found = {name: _stacked([_plain(getattr(each, name)) for each in values]) for name in NUMBERS}
    return MeasurementColumn(
        unit=values[0].unit,
        status=np.array([CODE_OF[each.status] for each in values], dtype=np.int64),
        reasons={row: each.reasons for row, each in enumerate(values) if each.reasons != each.pose.reasons},
        numbers={name: numbers for name, numbers in found.items() if numbers is not None},
    )


def _plain(value: object) -> object:
    """Ellipses and places as the numbers that a batch holds of them."""
    if isinstance(value, Ellipse95):
        return value.semi_major_m, value.semi_minor_m, value.azimuth_rad
    if isinstance(value, GeoPoint):
        return value.lat_rad, value.lon_rad, np.nan if value.alt_msl_m is None else value.alt_msl_m
    return tuple(map(_plain, value)) if isinstance(value, tuple) else value


def _stacked(values: Sequence[object]) -> FloatArray | None:
    """Values ``(n, ...)`` with NaN for each that is None; None where all are."""
    known = [np.array(value, dtype=np.float64) for value in values if value is not None]
    if not known:
        return None
    none = np.full(known[0].shape, np.nan)
    return np.array([none if value is None else np.array(value, dtype=np.float64) for value in values])
