"""Probes to measurements: any number of poses, any number of probes, one projection."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from aerodft.dft.answer_columns import AnswerBlock, AnswerColumn, ImageColumns
from aerodft.dft.answers import Answer, ImageAnswers
from aerodft.dft.budget import Share, variance_budget
from aerodft.dft.first_order import first_order_answers
from aerodft.dft.object_top import ObjectTop, object_top
from aerodft.dft.one_answer import blocked, measure_one, seen_in
from aerodft.dft.points import ImagePoints, ProbePoints, image_points
from aerodft.dft.projection import project
from aerodft.dft.record import UNITS, Record, no_answer
from aerodft.dft.request import Request, Setup
from aerodft.dft.uncertainty import point_spread, shared_covariance
from aerodft.dft.zoomed import zoomed
from aerodft.model.arrays import FloatArray
from aerodft.model.measurement import Measurement, ProjectionModel
from aerodft.model.pose import GeoOrigin, Pose, PoseSample
from aerodft.model.pose_columns import Posed, PoseRow, PoseRows, by_columns, sample_of
from aerodft.model.status import Status

__all__ = ["Request", "Setup", "explain", "measure", "measure_each", "measure_images", "measure_rows"]

_AT_ONCE = 512  # images: their derivatives stay in the cache


def measure(
    setup: Setup, sample: PoseSample, requests: tuple[Request, ...], image: int | None = None
) -> list[Measurement]:
    """Measure every request at one pose.

    Returns:
        One measurement a request, in order; without a value, but with a status and its reasons, where there is none.
    """
    (found,) = measure_images(setup, (sample,), requests, (image,))
    return list(found)


def measure_images(
    setup: Setup, poses: Sequence[Posed], requests: tuple[Request, ...], images: Sequence[int | None]
) -> list[ImageAnswers]:
    """Measure the same requests in several images; an image's answers do not depend on the others.

    Args:
        setup: What all share.
        poses: The images'.
        requests: What is measured in each.
        images: Their indices, where they have one.
    """
    return _measured(setup, poses, [requests] * len(poses), images)


def measure_each(
    setup: Setup, poses: Sequence[Posed], requests: Sequence[Request], images: Sequence[int | None]
) -> list[ImageAnswers]:
    """The same where each image has a request of its own.

    Args:
        setup: What all share.
        poses: The images'.
        requests: Theirs, which differ in where their pixels are only; none lies on top of something.
        images: The images' indices, where they have one.
    """
    return _measured(setup, poses, [(request,) for request in requests], images)


def _measured(
    setup: Setup, poses: Sequence[Posed], requests: Sequence[tuple[Request, ...]], images: Sequence[int | None]
) -> list[ImageAnswers]:
    found: list[Sequence[Answer]] = [() for _ in poses]
    for rows, seen_with in _alike(setup, poses):
        answers = _answered(seen_with, [poses[row] for row in rows], [requests[row] for row in rows])
        for row, own in zip(rows, answers.rows(), strict=True):
            found[row] = own
    return [
        ImageAnswers.of(setup, posed, image, own, answers or _missed(posed, own))
        for answers, posed, own, image in zip(found, poses, requests, images, strict=True)
    ]


def measure_rows(
    setup: Setup, poses: PoseRows, requests: tuple[Request, ...], images: Sequence[int | None]
) -> Iterator[ImageColumns]:
    """The same of images whose poses were made together, some images after the other."""
    most = 1 if _is_one_by_one(setup) else _AT_ONCE
    for first in range(0, len(poses), most):
        own = slice(first, first + most)
        answers = _answered(setup, poses[own], [requests] * len(poses[own]))
        yield ImageColumns(setup, requests, poses[own], images[own], answers)


def _is_one_by_one(setup: Setup) -> bool:
    """Whether images can be measured alone only."""
    return setup.model is not ProjectionModel.PINHOLE or setup.ground is not None


def _missed(posed: Posed, requests: tuple[Request, ...]) -> list[Answer]:
    return [no_answer(request.probe, posed.status, posed.reasons) for request in requests]


def _alike(setup: Setup, poses: Sequence[Posed]) -> Iterator[tuple[list[int], Setup]]:
    """Images with a pose that can be measured at once: seen with one camera, on level ground, from one origin."""
    one_by_one = _is_one_by_one(setup)
    waiting: list[int] = []
    for row, posed in enumerate(poses):
        if posed.status is not Status.OK or (isinstance(posed, PoseSample) and posed.pose is None):
            continue
        apart = one_by_one or (waiting and not _may_be_together(poses[waiting[0]], posed))
        if waiting and (apart or len(waiting) == _AT_ONCE):
            yield waiting, _seen_with(setup, poses[waiting[0]])
            waiting = []
        waiting.append(row)
    if waiting:
        yield waiting, _seen_with(setup, poses[waiting[0]])


def _may_be_together(first: Posed, posed: Posed) -> bool:
    if isinstance(first, PoseRow) or isinstance(posed, PoseRow):
        return isinstance(first, PoseRow) and isinstance(posed, PoseRow) and first.columns is posed.columns
    return first.zoom is None and posed.zoom is None and first.origin is posed.origin


def _seen_with(setup: Setup, posed: Posed) -> Setup:
    return setup if isinstance(posed, PoseRow) else zoomed(setup, posed)[0]


def _answered(setup: Setup, poses: Sequence[Posed], each: Sequence[tuple[Request, ...]]) -> AnswerBlock:
    """The answers of images that are alike, to the same requests or to such as differ in where their pixels are."""
    requests = each[0]
    if not requests:
        return AnswerBlock((), poses)
    if not isinstance(poses, PoseRows):
        poses = [posed if isinstance(posed, PoseRow) else zoomed(setup, posed)[1] for posed in poses]
    on_ground = tuple(request for request in requests if request.on_top_of is None)
    points = _points(setup, poses, on_ground, None if each[-1] is requests else _pixels(each))
    plain = iter(first_order_answers(setup, len(poses), on_ground, points))
    none = AnswerColumn("m", np.zeros(len(poses), dtype=np.bool_), {}, {})
    columns = [none if request.on_top_of is not None else next(plain) for request in requests]
    counts = [0 if request.on_top_of is not None else len(request.pixels) for request in requests]
    others: list[dict[int, Answer]] = [{} for _ in requests]
    is_plain = np.array([column.is_plain for column in columns])
    not_plain = np.argwhere(~is_plain.T).tolist()  # image after image: what its probes draw is shared
    samples = {row: sample_of(poses[row]) for row in dict.fromkeys(row for row, _ in not_plain)}
    for row, member in not_plain:
        record, first = Record(setup, samples[row], each[row][member]), sum(counts[:member])
        if counts[member]:
            others[member][row] = measure_one(record, points.probe(row, first, first + counts[member]))
        else:
            others[member][row] = _on_top(record)
    columns = [replace(column, others=own) for column, own in zip(columns, others, strict=True)]
    return AnswerBlock(tuple(columns), poses)


def _pixels(each: Sequence[tuple[Request, ...]]) -> FloatArray:
    """``(n, k, 2)`` pixels of images that have their own."""
    return np.array([[pixel for request in own for pixel in request.pixels] for own in each], dtype=np.float64)


def _points(
    setup: Setup, poses: Sequence[Posed], requests: tuple[Request, ...], pixels_px: FloatArray | None = None
) -> ImagePoints:
    """The points of all requests in all images; uneven ground and the dft model take one image only.

    Args:
        setup: What all share.
        poses: The images'.
        requests: Theirs.
        pixels_px: ``(n, k, 2)`` where each image has its own; None for those of the requests.
    """
    pose, origin = _together(poses)
    counts = [len(request.pixels) for request in requests]
    of_each = pixels_px is not None
    if pixels_px is None:
        pixels_px = _pixels([requests]).reshape(-1, 2)
    elevation = np.repeat([request.probe.elevation_m for request in requests], counts)
    if setup.model is ProjectionModel.PINHOLE and setup.ground is None:
        ground = project(setup.camera, pose, pixels_px, elevation, setup.model, of_each=of_each)
    else:
        alone_px = pixels_px[0] if of_each else pixels_px
        ground = project(setup.camera, pose.row(0), alone_px, elevation, setup.model, setup.ground)[None]
    elevation_std = np.repeat([request.probe.elevation_std_m for request in requests], counts)
    std_px = np.repeat([request.std_px for request in requests], counts)
    shared_cov = shared_covariance(setup.camera, pose, np.zeros(len(poses)))
    return image_points(pixels_px, ground, origin, pose, shared_cov, elevation_std, std_px)


def _together(poses: Sequence[Posed]) -> tuple[Pose, GeoOrigin | None]:
    """The ``(n,)`` poses, all of which are rows of the same columns or none is, and their origin."""
    rows = [] if isinstance(poses, PoseRows) else [posed for posed in poses if isinstance(posed, PoseRow)]
    if rows:
        poses = PoseRows(*next(by_columns(rows)))
    if isinstance(poses, PoseRows):
        return poses.columns.pose.rows(poses.rows), poses[0].alike.origin
    samples = [posed for posed in poses if isinstance(posed, PoseSample)]
    return Pose.stacked([sample.pose for sample in samples if sample.pose is not None]), samples[0].origin


def _probe_points(record: Record) -> ProbePoints:
    """The points of one request in one image."""
    return _points(record.setup, [record.sample], (record.request,)).probe(0, 0, len(record.request.pixels))


def _on_top(record: Record) -> Answer:
    """Measure in the level plane through an object's top, of which base and top are seen in the same image."""
    top = _top(record)
    if isinstance(top, Answer):
        name = record.request.probe.on_top_of
        return record.miss(top.status, *(f"it lies on top of {name}: {reason}" for reason in top.reasons))
    level = top.levelled(record)
    points = _probe_points(level)
    return measure_one(level, _known(level, points, top.covariance(points.shared_cov)))


def _known(record: Record, points: ProbePoints, shared_cov: FloatArray) -> ProbePoints:
    """The points under another covariance ``(s, s)`` of what they share."""
    assert record.sample.pose is not None  # noqa: S101 - the callers' own condition, for the type checker
    count = len(points.range_m)
    std_px, none = np.full(count, record.request.std_px), np.zeros(count)
    spread = point_spread(points.ground[None], record.sample.pose.position_enu_m[None], shared_cov[None], none, std_px)
    return replace(points, shared_cov=shared_cov, cov_enu_m2=spread.cov_enu_m2[0], range_std_m=spread.range_std_m[0])


def _top(record: Record) -> ObjectTop | Answer:
    """The elevation of the top that a record lies on, or why there is none."""
    assert record.request.on_top_of is not None  # noqa: S101 - the callers' own condition, for the type checker
    under = replace(record, request=record.request.on_top_of)
    points = _probe_points(under)
    answer = measure_one(under, points)
    return object_top(seen_in(under, points)) if answer.status is Status.OK else answer


def explain(setup: Setup, sample: PoseSample, request: Request) -> tuple[Share, ...]:
    """Where one request's uncertainty comes from, the largest part first; empty where it has no scalar or no ground."""
    setup, sample = zoomed(setup, sample)
    record = Record(setup, sample, request)
    if sample.pose is None:
        return ()
    top = None if request.on_top_of is None else _top(record)
    if isinstance(top, Answer):
        return ()
    if top is not None:
        record = top.levelled(record)
    points = _probe_points(record)
    seen = seen_in(record, points)
    if blocked(record, seen.pose, points, points.first(seen.on_ground)) is not None:
        return ()
    _, scale = UNITS.get(seen.kind, ("m", 1.0))
    return tuple(replace(share, std=scale * share.std) for share in variance_budget(seen, sample.std, top))
