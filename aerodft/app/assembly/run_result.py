"""What a run recorded and measured: counted while it goes on, and all of it at the end."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from operator import itemgetter
from pathlib import Path

import numpy as np

from aerodft.adapters.recording.write import RecordingTotals
from aerodft.diagnosis import CameraPitches
from aerodft.model import CODE_OF, CODES, CalibrationEstimate, CameraMotionEstimate, IntArray, Measurement, Status
from aerodft.service import Batches, Counts, ImageOutputs, StepOutputs
from replay.recordings import LeftOut


@dataclass(slots=True)
class RunStatistics:
    """A sink that counts; statuses stand in the order in which they came first.

    Attributes:
        images: Number of images (or stamps) that were evaluated.
        poses: Number of poses by status.
        measurements: Number of measurements by status.
        reasons: Why poses cannot be measured with: the first sentence of each status.
        estimate: The last one of a live calibration; None without landmarks.
        camera_motion: The last one of a fixed camera that is watched for bumps; None of others.
        pitches: Where a vehicle's camera looked, by the sources of its attitude.
    """

    images: int = 0
    poses: Counter[str] = field(default_factory=Counter)
    measurements: Counter[str] = field(default_factory=Counter)
    reasons: dict[str, str] = field(default_factory=dict)
    estimate: CalibrationEstimate | None = None
    camera_motion: CameraMotionEstimate | None = None
    pitches: CameraPitches = field(default_factory=CameraPitches)

    def take(self, batches: Batches, outputs: StepOutputs) -> None:  # noqa: ARG002 - what was read is not counted
        """Count the outputs of some ticks."""
        self.images += sum(len(block.images) for block in outputs.images)
        _count(self.poses, [(block.order, block.poses.status[:, None]) for block in outputs.images])
        measured = [(order, [column.status for column in batch.columns]) for _, order, batch in outputs.measured()]
        _count(self.measurements, [(order, np.stack(codes, axis=1)) for order, codes in measured if codes])
        self._keep_reasons(outputs.images)
        self._keep_pitches(outputs.images)
        for single in outputs.singles:
            if isinstance(single.content, CalibrationEstimate):
                self.estimate = single.content
            elif isinstance(single.content, CameraMotionEstimate):
                self.camera_motion = single.content

    def close(self) -> None:
        """Nothing to write out."""

    def _keep_pitches(self, blocks: Sequence[ImageOutputs]) -> None:
        for block in blocks:
            if block.measurements is not None and block.measurements.columns:
                statuses = np.stack([column.status for column in block.measurements.columns])
                self.pitches.add(block.poses, np.any(statuses == CODE_OF[Status.OK], axis=0))

    def _keep_reasons(self, blocks: Sequence[ImageOutputs]) -> None:
        found = []
        for block in blocks:
            variants, first_rows = np.unique(block.poses.variant_index, return_index=True)
            for variant, order in zip(variants.tolist(), block.order[first_rows].tolist(), strict=True):
                sample = block.poses.variants[variant]
                if sample.status is not Status.OK and sample.reasons:
                    found.append((order, sample.status.value, "; ".join(sample.reasons)))
        for _, status, reasons in sorted(found):
            self.reasons.setdefault(status, reasons)


def _count(counter: Counter[str], parts: Sequence[tuple[IntArray, IntArray]]) -> None:
    """Add codes of statuses ``(n, k)``, each part's rows by their order ``(n,)`` among the rows of all parts."""
    if not parts:
        return
    order = np.concatenate([np.repeat(order, codes.shape[1]) for order, codes in parts])
    codes = np.concatenate([codes.ravel() for _, codes in parts])[np.argsort(order, kind="stable")]
    found, first, counts = np.unique(codes, return_index=True, return_counts=True)
    for row in np.argsort(first).tolist():
        counter[CODES[found[row]].value] += int(counts[row])


class MeasurementSink:
    """A sink that hands measurements on, in their order.

    Args:
        on_measurement: Called with each.
    """

    def __init__(self, on_measurement: Callable[[Measurement], None]) -> None:
        self._on_measurement = on_measurement

    def take(self, batches: Batches, outputs: StepOutputs) -> None:  # noqa: ARG002 - what was read is not measured
        """Hand on the measurements of some ticks."""
        parts = [zip(order.tolist(), batch, strict=True) for _, order, batch in outputs.measured()]
        for _, measurements in sorted(chain.from_iterable(parts), key=itemgetter(0)):
            for measurement in measurements:
                self._on_measurement(measurement)

    def close(self) -> None:
        """Nothing to write out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """Totals of a run: recorded, measured and lost.

    Attributes:
        totals: What became of the messages and images that were to be recorded.
        statistics: Images, poses and measurements by status.
        counts: Observations that came, and those that could not be used.
        observers: What became of looking at the images, by the table that asks for it; empty where nobody looked.
        unmeasured: Images that came and were never measured, by cause: ``dropped``, as they came faster than they were
            measured, and what the stream left out, as in ``StreamStatus``; of a file those that are ``damaged``.
        warnings: What is wrong with the input, one sentence each.
        left_out: What the recording that it was made of lacks.
    """

    totals: RecordingTotals
    statistics: RunStatistics
    counts: Counts
    observers: Mapping[str, object] = field(default_factory=dict)
    unmeasured: Mapping[str, int] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    left_out: LeftOut = field(default_factory=LeftOut)

    @property
    def recording(self) -> Path:
        """The folder of the recording."""
        return self.totals.folder

    @property
    def lost(self) -> int:
        """Messages and images that are not in the recording: the disk was full, failed or was too slow."""
        return self.totals.lost + self.totals.shed_messages
