"""What is to be measured, gathered over some ticks and then measured at once."""

from collections.abc import Sequence
from typing import NamedTuple

from aerodft.dft.measure import measure_images
from aerodft.dft.request import Request, Setup
from aerodft.model.pose_columns import Posed
from aerodft.service.ports import Output


class Asked(NamedTuple):
    """What is to be measured at a pose."""

    posed: Posed
    requests: tuple[Request, ...]
    image: int | None


def measured(
    setup: Setup, fixed: tuple[Request, ...], work: Sequence[list[Output | Asked]]
) -> list[tuple[Output, ...]]:
    """Outputs with the answers to what is asked among them.

    Args:
        setup: What all measurements share.
        fixed: What is asked in every image: these are measured all at once, others one by one.
        work: For each tick.
    """
    in_images = [item for items in work for item in items if isinstance(item, Asked) and item.requests is fixed]
    poses, indices = [item.posed for item in in_images], [item.image for item in in_images]
    answers = iter(measure_images(setup, poses, fixed, indices))

    def answered(item: Asked) -> Output:
        if item.requests is fixed:
            return next(answers)
        return measure_images(setup, (item.posed,), item.requests, (item.image,))[0]

    return [tuple([answered(item) if isinstance(item, Asked) else item for item in items]) for items in work]
