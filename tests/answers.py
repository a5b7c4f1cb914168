"""What a pipeline answers, one by one in the order of its answers; and batches of many ticks cut into others."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter

from aerodft.dft import MeasurementBatch
from aerodft.model import HeightSwitch, Measurement, Observation, PoseSample
from aerodft.service import Batches, Pipeline, StepOutputs
from aerodft.service.ports import Estimate


@dataclass(frozen=True)
class ImageAnswer:
    """An image by its running number (``NO_IMAGE`` for a stamp alone), its pose, and what was measured in it."""

    image: int
    sample: PoseSample
    measurements: list[Measurement]


@dataclass(frozen=True)
class ObservationAnswer:
    """An observation, and what was measured by it."""

    observation: Observation
    measurements: list[Measurement]


Answer = ImageAnswer | ObservationAnswer | Observation | Estimate | HeightSwitch | list[Measurement]


def in_order(outputs: StepOutputs) -> list[tuple[int, Answer]]:
    """All outputs of a step, each with the tick of the step on which it came."""
    placed: list[tuple[int, int, Answer]] = []
    for images in outputs.images:
        measured: Sequence[list[Measurement]] = images.measurements or [[]] * len(images.tick)
        rows = zip(images.images.tolist(), images.poses, measured, strict=True)
        answers = (ImageAnswer(*row) for row in rows)
        placed += zip(images.order.tolist(), images.tick.tolist(), answers, strict=True)
    for seen in outputs.observations:
        pairs = zip(seen.observations, seen.measurements, strict=True)
        placed += zip(
            seen.order.tolist(), seen.tick.tolist(), (ObservationAnswer(*pair) for pair in pairs), strict=True
        )
    for single in outputs.singles:
        content = single.content
        placed.append((single.order, single.tick, content[0] if isinstance(content, MeasurementBatch) else content))
    orders = [order for order, _, _ in placed]
    assert len(set(orders)) == len(orders)
    placed.sort(key=itemgetter(0))
    ticks = [tick for _, tick, _ in placed]
    assert ticks == sorted(ticks)
    return [(tick, answer) for _, tick, answer in placed]


def timed(pipeline: Pipeline, steps: Iterable[Batches]) -> Iterator[tuple[int | None, Answer]]:
    """All answers to some steps, with the times of their ticks; None for what comes at the end."""
    for batches in steps:
        for tick, answer in in_order(pipeline.advance(batches)):
            yield int(batches.now_ns[tick]), answer
    for _, answer in in_order(pipeline.finish()):
        yield None, answer


def answers_of(pipeline: Pipeline, steps: Iterable[Batches]) -> list[Answer]:
    """All answers to some steps, to the end."""
    return [answer for _, answer in timed(pipeline, steps)]


def measurements_of(answers: Iterable[Answer]) -> list[Measurement]:
    """All measurements in the order of the answers."""
    found: list[Measurement] = []
    for answer in answers:
        if isinstance(answer, ImageAnswer | ObservationAnswer):
            found += answer.measurements
        elif isinstance(answer, list):
            found += answer
    return found


def one_by_one(batches: Batches) -> list[Batches]:
    """The ticks, each for itself."""
    return [batches[tick : tick + 1] for tick in range(len(batches))]


def cut_at(batches: Batches, ticks: Iterable[int]) -> list[Batches]:
    """The ticks in parts that begin at some of them."""
    edges = sorted({0, len(batches), *ticks})
    return [batches[first:stop] for first, stop in pairwise(edges)]
