"""What some ticks come to: images that come alone, with poses made together, as columns; all else tick by tick."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, overload, runtime_checkable

import numpy as np

from aerodft.dft.answer_columns import ImageColumns
from aerodft.model.arrays import IntArray
from aerodft.model.image import Image
from aerodft.model.pose_columns import PoseRows
from aerodft.service.batches import Batches
from aerodft.service.ports import Output, Sink


@dataclass(frozen=True, slots=True, eq=False)
class AnsweredImages:
    """Images that are answered on ticks on which nothing else is, in their order.

    Attributes:
        tick: ``(n,)`` number of the tick on which each is, not decreasing.
        images: Them, as they came.
        poses: Theirs.
        answers: What is asked in every image; None where nothing is.
    """

    tick: IntArray
    images: Sequence[Image]
    poses: PoseRows
    answers: ImageColumns | None

    def outputs(self, row: int) -> tuple[Output, ...]:
        """One image's: as if it had been answered alone."""
        posed = self.poses[row]
        answers = () if self.answers is None else (self.answers.row(row),)
        return self.images[row].known_at(posed.stamp_ns), posed, *answers

    def between(self, first: int, stop: int) -> "AnsweredImages":
        """Those of the ticks from ``first`` and before ``stop``, which are counted from there."""
        a, b = np.searchsorted(self.tick, (first, stop)).tolist()
        answers = None if self.answers is None else self.answers.rows(a, b)
        return AnsweredImages(self.tick[a:b] - first, self.images[a:b], self.poses[a:b], answers)


class Made(Sequence[tuple[Output, ...]]):
    """What some ticks come to: a tuple of outputs for each.

    Attributes:
        together: Images that are answered on ticks with nothing else, tick after tick.
        apart: The outputs of the other ticks, by their numbers.

    Args:
        count: How many ticks.
    """

    def __init__(self, count: int, together: Sequence[AnsweredImages], apart: dict[int, tuple[Output, ...]]) -> None:
        self.together = together
        self.apart = apart
        self._count = count

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> tuple[Output, ...]: ...

    @overload
    def __getitem__(self, index: slice) -> list[tuple[Output, ...]]: ...

    def __getitem__(self, index: int | slice) -> tuple[Output, ...] | list[tuple[Output, ...]]:
        if isinstance(index, slice):
            return list(self)[index]
        tick = range(self._count)[index]
        own = (block.between(tick, tick + 1) for block in self.together)
        found = [output for block in own for row in range(len(block.images)) for output in block.outputs(row)]
        return self.apart.get(tick) or tuple(found)

    def __iter__(self) -> Iterator[tuple[Output, ...]]:
        found: list[tuple[Output, ...]] = [self.apart.get(tick, ()) for tick in range(self._count)]
        for block in self.together:
            for row, tick in enumerate(block.tick.tolist()):
                found[tick] += block.outputs(row)
        return iter(found)

    def between(self, first: int, stop: int) -> "Made":
        """What the ticks from ``first`` and before ``stop`` come to."""
        together = [block.between(first, stop) for block in self.together]
        apart = {tick - first: outputs for tick, outputs in self.apart.items() if first <= tick < stop}
        return Made(stop - first, [block for block in together if block.images], apart)


@runtime_checkable
class SpanSink(Sink, Protocol):
    """A sink that takes some ticks at once, too."""

    def span(self, batches: Batches, made: Made) -> None:
        """As ``inputs`` and ``outputs`` of one tick after the other."""
        ...
