"""What the same requests came to in many images, as columns of numbers; single answers are made when they are asked."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final, overload

import numpy as np

from aerodft.dft.answers import Answer, ImageAnswers
from aerodft.dft.request import Request, Setup
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.model.pose_columns import Posed, PoseRows
from aerodft.model.status import Status

NUMBERS: Final = ("value", "std", "ci95", "ellipse95", "ground_m", "enu_m", "cov_enu_m2", "geo", "range_m")
"""The fields of an ``Answer`` that hold numbers, in their order."""


@dataclass(frozen=True, slots=True, eq=False)
class AnswerColumn:
    """What one request came to in ``n`` images.

    Attributes:
        unit: Of its value.
        is_plain: ``(n,)`` where the numbers are the answer, and the status is ok.
        numbers: ``(n, ...)`` by the fields of ``Answer``, in the order of ``NUMBERS``; what it has none of is left out.
        others: The answers of the other images, by row.
    """

    unit: str
    is_plain: BoolArray
    numbers: Mapping[str, FloatArray]
    others: Mapping[int, Answer]

    def answer(self, row: int, reasons: tuple[str, ...]) -> Answer:
        """What it came to in one image; reasons are those of the image's pose."""
        if not self.is_plain[row]:
            return self.others[row]
        numbers = {name: values[row].tolist() for name, values in self.numbers.items()}
        if "ci95" in numbers:
            numbers["ci95"] = tuple(numbers["ci95"])
        return Answer(Status.OK, reasons, self.unit, **numbers)


@dataclass(frozen=True, eq=False)
class AnswerBlock:
    """What some requests came to in ``n`` images.

    Attributes:
        columns: One for each request.
        poses: The images'.
    """

    columns: tuple[AnswerColumn, ...]
    poses: Sequence[Posed]

    def rows(self) -> "list[AnswerRow]":
        """The answers of each image."""
        return [AnswerRow(self, row) for row in range(len(self.poses))]

    @cached_property
    def is_plain(self) -> BoolArray:
        """``(n,)`` where all answers are plain."""
        return np.asarray(np.all([column.is_plain for column in self.columns], axis=0))

    @cached_property
    def shape(self) -> tuple[tuple[object, ...], ...]:
        """Which numbers there are, and how many: of blocks that differ in numbers only it is the very same."""
        return _the_same(
            tuple(
                (column.unit, *((name, values.shape[1:]) for name, values in column.numbers.items()))
                for column in self.columns
            )
        )

    @cached_property
    def all_ok(self) -> tuple[Status, ...]:
        """The statuses of an image whose answers are all plain."""
        return (Status.OK,) * len(self.columns)


@lru_cache(maxsize=256)
def _the_same(shape: tuple[tuple[object, ...], ...]) -> tuple[tuple[object, ...], ...]:
    return shape


class AnswerRow(Sequence[Answer]):
    """The answers of one image of a block.

    Attributes:
        block: The block.
        row: Which of its images.
    """

    __slots__ = ("block", "row")

    def __init__(self, block: AnswerBlock, row: int) -> None:
        self.block = block
        self.row = row

    @property
    def statuses(self) -> tuple[Status, ...]:
        """Of all answers, which need not be made for that."""
        if self.block.is_plain[self.row]:
            return self.block.all_ok
        return tuple(answer.status for answer in self)

    def __len__(self) -> int:
        return len(self.block.columns)

    @overload
    def __getitem__(self, index: int) -> Answer: ...

    @overload
    def __getitem__(self, index: slice) -> list[Answer]: ...

    def __getitem__(self, index: int | slice) -> Answer | list[Answer]:
        if isinstance(index, slice):
            return list(self)[index]
        return self.block.columns[index].answer(self.row, self.block.poses[self.row].reasons)

    def __iter__(self) -> Iterator[Answer]:
        reasons = self.block.poses[self.row].reasons
        return (column.answer(self.row, reasons) for column in self.block.columns)


@dataclass(frozen=True, slots=True, eq=False)
class ImageColumns:
    """What the same requests came to in ``n`` images whose poses were made together.

    Attributes:
        setup: What all share.
        requests: The requests.
        poses: The images'.
        images: Their indices, where they have one.
        answers: Of a block with these poses.
        first: The first of the block's images that is meant.
    """

    setup: Setup
    requests: tuple[Request, ...]
    poses: PoseRows
    images: Sequence[int | None]
    answers: AnswerBlock
    first: int = 0

    def __len__(self) -> int:
        return len(self.images)

    @property
    def is_plain(self) -> BoolArray:
        """``(n,)`` where all answers are plain."""
        return self.answers.is_plain[self.first : self.first + len(self.images)]

    def statuses(self) -> Counter[tuple[Status, ...]]:
        """How many images have answers of such statuses; plain ones need not be made for that."""
        odd = np.flatnonzero(~self.is_plain).tolist()
        found = Counter(AnswerRow(self.answers, self.first + row).statuses for row in odd)
        if len(odd) < len(self):
            found[self.answers.all_ok] += len(self) - len(odd)
        return found

    def row(self, row: int) -> ImageAnswers:
        """One of the images."""
        answers = AnswerRow(self.answers, self.first + row)
        return ImageAnswers.of(self.setup, self.poses[row], self.images[row], self.requests, answers)

    def rows(self, first: int, stop: int) -> "ImageColumns":
        """Some of the images."""
        own = slice(first, stop)
        return ImageColumns(
            self.setup, self.requests, self.poses[own], self.images[own], self.answers, self.first + first
        )
