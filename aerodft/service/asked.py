"""What is to be measured, gathered over some ticks and then measured at once."""

from collections.abc import Hashable, Sequence
from typing import NamedTuple

from aerodft.dft.measure import measure_each, measure_images
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
