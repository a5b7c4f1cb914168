"""What the pipeline asks of the world, as Protocols of one to three methods, and the outputs that it gives to sinks."""

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
    """Images with their poses and what was measured in them.

    Attributes:
        tick: ``(n,)`` on which of the step's ticks each was answered, not decreasing.
        order: ``(n,)`` ascending place of each among all outputs of the step.
        images: ``(n,)`` their running numbers, ``NO_IMAGE`` for a stamp alone; when they were taken, the poses say.
        poses: Their ``(n,)`` poses.
        measurements: Of all fixed probes in each image; None where there are no such probes.
    """

    tick: IntArray
    order: IntArray
    images: IntArray
    poses: PoseBatch
    measurements: MeasurementBatch | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObservationOutputs:
    """Observations of one probe with what was measured by them.

    Attributes:
        tick: ``(n,)`` as in ``ImageOutputs``.
        order: ``(n,)`` as in ``ImageOutputs``.
        observations: The observations, stamps in UTC, with the numbers of their images.
        measurements: One measurement for each observation.
    """

    tick: IntArray
    order: IntArray
    observations: Sequence[Observation]
    measurements: MeasurementBatch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SingleOutput:
    """An output that comes alone.

    Attributes:
        tick: On which of the step's ticks.
        order: Its place among all outputs of the step.
        content: An observation that was learned from or tracked, what a calibration knows after it, a change of the
            height's source, or the measurements of the objects that are tracked in one image.
    """

    tick: int
    order: int
    content: Observation | Estimate | HeightSwitch | MeasurementBatch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepOutputs:
    """The outputs of some ticks.

    Attributes:
        images: Blocks of images, first ticks not decreasing.
        observations: Blocks of observations.
        singles: All else, in order.
    """

    images: tuple[ImageOutputs, ...] = ()
    observations: tuple[ObservationOutputs, ...] = ()
    singles: tuple[SingleOutput, ...] = ()

    def measured(self) -> Iterator[tuple[IntArray, IntArray, MeasurementBatch]]:
        """All measurements, batch by batch, with the tick ``(n,)`` and the order ``(n,)`` of each of its entries."""
        blocks: tuple[ImageOutputs | ObservationOutputs, ...] = (*self.images, *self.observations)
        for block in blocks:
            if block.measurements is not None:
                yield block.tick, block.order, block.measurements
        for single in self.singles:
            if isinstance(single.content, MeasurementBatch):
                tick, order = np.full((2, len(single.content)), [[single.tick], [single.order]])
                yield tick, order, single.content


class Sink(Protocol):
    """Takes what was read and what was made of it; must not block (queues, sheds and counts instead)."""

    def take(self, batches: Batches, outputs: StepOutputs) -> None:
        """The input of some ticks (one, live) and their outputs; at the end outputs come with a tick without input."""
        ...

    def close(self) -> None:
        """Write out what is left; no calls after this."""
        ...


Known = TypeVar("Known")


class Clock(Protocol):
    """The only place where time is read: the wall's, or a virtual one in replay."""

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
    """Recorded input that has many images at once, too."""

    def gathered(self) -> Iterator[Arrival]:
        """The source's events, first arrivals not decreasing, images together where they can be."""
        ...


class Feed(Protocol):
    """Live or recorded input as batches of ticks: one, live, or many."""

    def batches(self) -> Iterator[Batches]:
        """Batches with increasing ticks, empty ones included where time alone matters, until the end."""
        ...


class TelemetryDecoder(Protocol):
    """Raw frames to tracks; stateful, and independent of how frames are cut into blocks."""

    @property
    def rejected(self) -> Mapping[str, int]:
        """Rows left out so far, by ``MESSAGE: reason``."""
        ...

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's frames; unknown or damaged frames are counted, never raised."""
        ...


class Calibrator(Protocol[Known]):
    """Turns the telemetry's poses into better ones."""

    def known(self) -> Known:
        """What is known by now, and stays as it is whatever is learned after it."""
        ...

    def refine(self, poses: PoseBatch, known: Sequence[Known], which: IntArray) -> PoseBatch:
        """The poses corrected by ``which (n,)`` of what was known; anything not ok passes unchanged.

        With the calibration's covariance and id.
        """
        ...


class ImageObserver(Protocol):
    """Finds in images what probes, landmarks or a ``Calibrator`` want to know the pixels of."""

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """What is seen in an image that has pixels, by its stamp, clock and index; called from one thread, in order.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        ...


class LandmarkObserver(Protocol):
    """Learns from landmarks in the images, most likely for a ``Calibrator``."""

    def observes(self, name: str) -> bool:
        """Whether observations of this name are of a landmark."""
        ...

    def fits(self, observation: Observation) -> bool:
        """Whether an observation of such a name has as many pixels as it must."""
        ...

    def observe(self, sample: PoseSample, observations: tuple[Observation, ...]) -> Estimate:
        """Learn from what fits, seen at the stamp of the unrefined ``sample``."""
        ...


class ObjectTracker(Protocol):
    """Follows what moves from image to image, by its outlines."""

    def follow(
        self, setup: Setup, sample: PoseSample, observations: tuple[Observation, ...], image: int | None
    ) -> MeasurementBatch | None:
        """What is known of all objects after the next image, seen from ``sample``; None where that is nothing new."""
        ...
