"""Ports of the pipeline: Protocols of one to three methods for inputs, sinks and estimators; and its outputs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np

from aerodft.dft import MeasurementBatch, Setup
from aerodft.model import (
    Arrival,
    CalibrationEstimate,
    CameraMotionEstimate,
    Event,
    HeightSwitch,
    Image,
    IntArray,
    Observation,
    PoseBatch,
    PoseSample,
    RawBlock,
    Track,
)
from aerodft.service.batches import Batches

Estimate: TypeAlias = CalibrationEstimate | CameraMotionEstimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageOutputs:
    """Poses of images and measurements in them.

    Attributes:
        tick: ``(n,)`` number of the tick, in the step, at which each was answered; not decreasing.
        order: ``(n,)`` ascending position of each among all outputs of the step.
        images: ``(n,)`` running numbers, ``NO_IMAGE`` for a stamp without an image; stamps are in ``poses``.
        poses: The ``(n,)`` poses.
        measurements: Of all fixed probes in each image; None without fixed probes.
    """

    tick: IntArray
    order: IntArray
    images: IntArray
    poses: PoseBatch
    measurements: MeasurementBatch | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObservationOutputs:
    """Observations of one probe and measurements by them.

    Attributes:
        tick: ``(n,)`` as in ``ImageOutputs``.
        order: ``(n,)`` as in ``ImageOutputs``.
        observations: The observations with stamps in UTC and the numbers of their images.
        measurements: One measurement for each observation.
    """

    tick: IntArray
    order: IntArray
    observations: Sequence[Observation]
    measurements: MeasurementBatch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SingleOutput:
    """An output that is no block: a tracked or learned observation, an estimate, a switch, object tracks.

    Attributes:
        tick: Number of the tick in the step.
        order: Position among all outputs of the step.
        content: An observation of a landmark or object, the calibration's estimate after it, a change of the height
            source, or the measurements of the objects tracked in one image.
    """

    tick: int
    order: int
    content: Observation | Estimate | HeightSwitch | MeasurementBatch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepOutputs:
    """Outputs of the pipeline for the ticks of one step.

    Attributes:
        images: Blocks of images, first ticks not decreasing.
        observations: Blocks of observations.
        singles: All other outputs, in order.
    """

    images: tuple[ImageOutputs, ...] = ()
    observations: tuple[ObservationOutputs, ...] = ()
    singles: tuple[SingleOutput, ...] = ()

    def measured(self) -> Iterator[tuple[IntArray, IntArray, MeasurementBatch]]:
        """All measurements, batch by batch, with the tick ``(n,)`` and the order ``(n,)`` of each entry."""
        blocks: tuple[ImageOutputs | ObservationOutputs, ...] = (*self.images, *self.observations)
        for block in blocks:
            if block.measurements is not None:
                yield block.tick, block.order, block.measurements
        for single in self.singles:
            if isinstance(single.content, MeasurementBatch):
                tick, order = np.full((2, len(single.content)), [[single.tick], [single.order]])
                yield tick, order, single.content


class Sink(Protocol):
    """Consumer of inputs and outputs; must not block (it queues, sheds and counts instead)."""

    def take(self, batches: Batches, outputs: StepOutputs) -> None:
        """Take the input of some ticks and their outputs; the last outputs come with a tick without input."""
        ...

    def close(self) -> None:
        """Write out what is buffered; the last call."""
        ...


Known = TypeVar("Known")


class Clock(Protocol):
    """Time: of the wall, or virtual in replay; the only place where time is read."""

    def now_ns(self) -> int:
        """Host UTC."""
        ...

    def sleep_until(self, when_ns: int) -> None:
        """Return at ``when_ns`` or later."""
        ...


class Source(Protocol):
    """Recorded input: a log, a video, a recording."""

    def events(self) -> Iterator[Event]:
        """All events, arrivals not decreasing."""
        ...


@runtime_checkable
class GatheredSource(Source, Protocol):
    """Recorded input that can give many images as one event."""

    def gathered(self) -> Iterator[Arrival]:
        """The source's events, first arrivals not decreasing, images as ``ImageRows`` where possible."""
        ...


class Feed(Protocol):
    """Live or recorded input as batches of ticks."""

    def batches(self) -> Iterator[Batches]:
        """Batches with increasing ticks, with empty ones where a deadline may be, until the end."""
        ...


class TelemetryDecoder(Protocol):
    """Stateful decoder of raw frames to tracks, independent of how frames are split into blocks."""

    @property
    def rejected(self) -> Mapping[str, int]:
        """Number of rows without a usable value so far, by ``MESSAGE: reason``."""
        ...

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """Tracks of a block's frames; unknown or damaged frames are counted, never raised."""
        ...


class Calibrator(Protocol[Known]):
    """Refines poses by estimated biases."""

    def known(self) -> Known:
        """The present state, unaffected by later updates."""
        ...

    def refine(self, poses: PoseBatch, known: Sequence[Known], which: IntArray) -> PoseBatch:
        """Poses corrected by the states ``known[which]``, ``which (n,)``; poses that are not ok pass unchanged.

        Corrected poses have the calibration's covariance and id.
        """
        ...


class ImageObserver(Protocol):
    """Detector that finds pixels of probes, landmarks or fixed points in images."""

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """Observations in an image, with its stamp, clock and index; called from one thread, in order.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        ...


class LandmarkObserver(Protocol):
    """Estimator that learns from observed landmarks, usually of a ``Calibrator``."""

    def observes(self, name: str) -> bool:
        """Whether observations of this name are of a landmark."""
        ...

    def fits(self, observation: Observation) -> bool:
        """Whether an observation of a landmark has the right number of pixels."""
        ...

    def observe(self, sample: PoseSample, observations: tuple[Observation, ...]) -> Estimate:
        """Update the estimate by observations at the stamp of the unrefined ``sample``."""
        ...


class ObjectTracker(Protocol):
    """Tracker of moving objects by their outlines."""

    def follow(
        self, setup: Setup, sample: PoseSample, observations: tuple[Observation, ...], image: int | None
    ) -> MeasurementBatch | None:
        """Tracks of all objects after the next image, whose pose is ``sample``; None if unchanged."""
        ...
