"""What is to be measured, gathered over some ticks and then measured at once."""

from collections.abc import Hashable, Sequence
from typing import NamedTuple

from aerodft.dft.measure import measure_each, measure_images, measure_rows
from aerodft.dft.request import Request, Setup
from aerodft.model.arrays import IntArray
from aerodft.model.image import Image
from aerodft.model.image_rows import ImageRows
from aerodft.model.pose_columns import Posed, PoseRows
from aerodft.service.made import AnsweredImages, Made
from aerodft.service.ports import Output


class Asked(NamedTuple):
    """What is to be measured at a pose."""

    posed: Posed
    requests: tuple[Request, ...]
    image: int | None


class AskedImages(NamedTuple):
    """Images ``(n,)`` of ticks on which nothing else is answered, by the tick of each."""

    tick: IntArray
    images: Sequence[Image]
    poses: PoseRows


class Work:
    """What is done in some ticks, one after the other.

    Attributes:
        count: Number of ticks so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self._together: list[AskedImages] = []
        self._apart: dict[int, list[Output | Asked]] = {}

    def add_tick(self, outputs: list[Output | Asked]) -> None:
        """Add one tick."""
        if outputs:
            self._apart[self.count] = outputs
        self.count += 1

    def add_ticks(self, count: int, images: AskedImages) -> None:
        """Add some, in which nothing but images is answered; ticks are counted from the first of these."""
        if images.images:
            self._together.append(images._replace(tick=images.tick + self.count))
        self.count += count

    def measured(self, setup: Setup, fixed: tuple[Request, ...]) -> Made:
        """What it comes to.

        Args:
            setup: What all measurements share.
            fixed: What is asked in every image.
        """
        together = [block for images in self._together for block in _answered(setup, fixed, images)]
        apart = measured(setup, fixed, list(self._apart.values()))
        return Made(self.count, together, dict(zip(self._apart, apart, strict=True)))


def _answered(setup: Setup, fixed: tuple[Request, ...], asked: AskedImages) -> Sequence[AnsweredImages]:
    """Images as they are measured at once."""
    if not fixed:
        return [AnsweredImages(*asked, None)]
    indices = _indices(asked.images)
    blocks: list[AnsweredImages] = []
    first = 0
    for answers in measure_rows(setup, asked.poses, fixed, indices):
        own = slice(first, first + len(answers))
        blocks.append(AnsweredImages(asked.tick[own], asked.images[own], answers.poses, answers))
        first = own.stop
    return blocks


def _indices(images: Sequence[Image]) -> list[int | None]:
    """The numbers of images; None of a stamp alone."""
    if not isinstance(images, ImageRows):
        return [None if image.width_px is None else image.index for image in images]
    return [None] * len(images) if images.width_px is None else list(images.indices.tolist())


def measured(
    setup: Setup, fixed: tuple[Request, ...], work: Sequence[list[Output | Asked]]
) -> list[tuple[Output, ...]]:
    """Outputs with the answers to what is asked among them.

    Args:
        setup: What all measurements share.
        fixed: What is asked in every image: these are measured all at once, others with those that are alike.
        work: For each tick.
    """
    asked = [item for items in work for item in items if isinstance(item, Asked)]
    alike: dict[Hashable, list[int]] = {}
    for number, item in enumerate(asked):
        alike.setdefault(None if item.requests is fixed else _kind(item, number), []).append(number)
    answers: dict[int, Output] = {}
    for kind, numbers in alike.items():
        own = [asked[number] for number in numbers]
        poses, images = [item.posed for item in own], [item.image for item in own]
        if kind is None or len(own) == 1:
            found = measure_images(setup, poses, own[0].requests, images)
        else:
            found = measure_each(setup, poses, [item.requests[0] for item in own], images)
        answers.update(zip(numbers, found, strict=True))
    found_in_order = (answers[number] for number in range(len(asked)))
    return [tuple([next(found_in_order) if isinstance(item, Asked) else item for item in items]) for items in work]


def _kind(item: Asked, number: int) -> Hashable:
    """What is the same of things asked that can be measured together."""
    request = item.requests[0]
    if len(item.requests) > 1 or request.on_top_of is not None:
        return number
    return (request.probe, len(request.pixels), request.std_px, type(item.posed))
