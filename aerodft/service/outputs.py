"""What a pipeline makes of some ticks: images and observations in batches, all else one by one."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from aerodft.dft import MeasurementBatch
from aerodft.model import CalibrationEstimate, CameraMotionEstimate, HeightSwitch, IntArray, Observation, PoseBatch
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
