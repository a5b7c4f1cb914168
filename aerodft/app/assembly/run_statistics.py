"""What a run came to, counted while it goes on."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from aerodft.model import CODES, CalibrationEstimate, CameraMotionEstimate, IntArray, Status
from aerodft.service import Batches, ImageOutputs, StepOutputs


@dataclass(slots=True)
class RunStatistics:
    """A sink that counts; statuses stand in the order in which they came first.

    Attributes:
        images: Number of images (or stamps) that were evaluated.
        poses: Number of poses by status.
        measurements: Number of measurements by status.
        reasons: Why poses cannot be measured with: the first sentence of each status.
        estimate: The last one of a live calibration; None without landmarks.
        steadiness: The last one of a watched camera; None of others.
    """

    images: int = 0
    poses: Counter[str] = field(default_factory=Counter)
    measurements: Counter[str] = field(default_factory=Counter)
    reasons: dict[str, str] = field(default_factory=dict)
    estimate: CalibrationEstimate | None = None
    steadiness: CameraMotionEstimate | None = None

    def take(self, batches: Batches, outputs: StepOutputs) -> None:  # noqa: ARG002 - what was read is not counted
        """Count the outputs of some ticks."""
        self.images += sum(len(block.images) for block in outputs.images)
        _count(self.poses, [(block.order, block.poses.status[:, None]) for block in outputs.images])
        measured = [(order, [column.status for column in batch.columns]) for _, order, batch in outputs.measured()]
        _count(self.measurements, [(order, np.stack(codes, axis=1)) for order, codes in measured if codes])
        self._keep_reasons(outputs.images)
        for single in outputs.singles:
            if isinstance(single.content, CalibrationEstimate):
                self.estimate = single.content
            elif isinstance(single.content, CameraMotionEstimate):
                self.steadiness = single.content

    def close(self) -> None:
        """Nothing to write out."""

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
