"""Probes to measurements: one pose, any number of probes, one projection."""

import math
from dataclasses import replace

import numpy as np

from aerodft.dft.budget import Share, variance_budget
from aerodft.dft.object_top import ObjectTop, object_top
from aerodft.dft.points import ImagePoints, image_points
from aerodft.dft.polygons import crosses_itself
from aerodft.dft.projection import project
from aerodft.dft.quantities import beside
from aerodft.dft.record import UNITS, Record
from aerodft.dft.request import Request, Setup
from aerodft.dft.seen import Seen
from aerodft.dft.uncertainty import Z95, shared_covariance
from aerodft.dft.values import FIRST_ORDER_LIMIT, Value, drawn, first_order, has_edge, std_of
from aerodft.dft.zoomed import zoomed
from aerodft.model.arrays import FloatArray
from aerodft.model.measurement import Measurement, ProjectionModel
from aerodft.model.pose import Pose, PoseSample
from aerodft.model.probe import ProbeKind
from aerodft.model.status import CODES, Status

__all__ = ["Request", "Setup", "explain", "measure"]

MAX_RELATIVE_RANGE_STD = 0.3
"""A point whose slant range is less certain than this is ``ILL_CONDITIONED``."""

MAX_BEARING_STD_RAD = 0.3
"""So is a direction that is less certain than this; over a third of it, errors are drawn."""

NEAR_FOOT = 0.1
"""An object's height is drawn where its base is less certain than this share of its distance from the camera's foot."""

LEANING_STDS = 6.0
"""What leans by more than 45 degrees, and by more than so many standard deviations, is no upright object."""

_NO_RAY = [CODES.index(status) for status in (Status.OUT_OF_IMAGE, Status.BEYOND_LENS_MODEL)]


def measure(
    setup: Setup, sample: PoseSample, requests: tuple[Request, ...], image: int | None = None
) -> list[Measurement]:
    """Measure every request at one pose.

    Returns:
        One measurement a request, in order; without a value, but with a status and its reasons, where there is none.
    """
    setup, sample = zoomed(setup, sample)
    pose = sample.pose
    records = [Record(setup, sample, request, image) for request in requests]
    if pose is None or sample.status is not Status.OK:
        return [record.miss(sample.status, *sample.reasons) for record in records]
    on_ground = iter(_on_ground(pose, [record for record in records if record.request.on_top_of is None]))
    return [next(on_ground) if record.request.on_top_of is None else _on_top(pose, record) for record in records]


def _on_ground(pose: Pose, records: list[Record]) -> list[Measurement]:
    if not records:
        return []
    points = _points(pose, records)
    counts = [len(record.request.pixels) for record in records]
    return [
        _measure_one(record, pose, points[end - count : end])
        for record, count, end in zip(records, counts, np.cumsum(counts).tolist(), strict=True)
    ]


def _points(pose: Pose, records: list[Record]) -> ImagePoints:
    """The points of all records, which share setup and sample."""
    setup, sample = records[0].setup, records[0].sample
    requests = [record.request for record in records]
    counts = [len(request.pixels) for request in requests]
    pixels = np.array([pixel for request in requests for pixel in request.pixels], dtype=np.float64).reshape(-1, 2)
    elevation = np.repeat([request.probe.elevation_m for request in requests], counts)
    ground = project(setup.camera, pose, pixels, elevation, setup.model, setup.ground)
    elevation_std = np.repeat([request.probe.elevation_std_m for request in requests], counts)
    std_px = np.repeat([request.std_px for request in requests], counts)
    return image_points(ground, sample.origin, pose, shared_covariance(setup.camera, pose, elevation_std), std_px)


def _on_top(pose: Pose, record: Record) -> Measurement:
    """Measure in the level plane through an object's top, of which base and top are seen in the same image."""
    top = _top(pose, record)
    if isinstance(top, Measurement):
        return record.miss(top.status, *(f"it lies on top of {top.name}: {reason}" for reason in top.reasons))
    level = top.levelled(record)
    points = _points(pose, [level])
    cov = np.broadcast_to(top.covariance(points.shared_cov[0]), points.shared_cov.shape)
    std_px = np.full(len(cov), record.request.std_px)
    return _measure_one(level, pose, image_points(points.ground, record.sample.origin, pose, cov, std_px))


def _top(pose: Pose, record: Record) -> ObjectTop | Measurement:
    """The elevation of the top that a record lies on, or why there is none."""
    assert record.request.on_top_of is not None  # noqa: S101 - the callers' own condition, for the type checker
    under = replace(record, request=record.request.on_top_of)
    points = _points(pose, [under])
    answer = _measure_one(under, pose, points)
    return object_top(_seen(under, pose, points)) if answer.status is Status.OK else answer


def explain(setup: Setup, sample: PoseSample, request: Request) -> tuple[Share, ...]:
    """Where one request's uncertainty comes from, the largest part first; empty where it has no scalar or no ground."""
    setup, sample = zoomed(setup, sample)
    pose, record = sample.pose, Record(setup, sample, request, None)
    if pose is None:
        return ()
    top = None if request.on_top_of is None else _top(pose, record)
    if isinstance(top, Measurement):
        return ()
    if top is not None:
        record = top.levelled(record)
    points = _points(pose, [record])
    seen = _seen(record, pose, points)
    blocked = _blocked(record, pose, points, points[: seen.on_ground])
    if blocked is not None:
        return ()
    _, scale = UNITS.get(seen.kind, ("m", 1.0))
    return tuple(replace(share, std=scale * share.std) for share in variance_budget(seen, sample.std, top))


def _seen(record: Record, pose: Pose, points: ImagePoints) -> Seen:
    setup, request = record.setup, record.request
    return Seen(
        kind=request.probe.kind,
        camera=setup.camera,
        pose=pose,
        model=setup.model,
        pixels_px=np.array(request.pixels, dtype=np.float64),
        elevation_m=request.probe.elevation_m,
        surface=setup.ground,
        ground=points.ground,
        shared_cov=points.shared_cov[0],
        std_px=request.std_px,
    )


def _measure_one(record: Record, pose: Pose, points: ImagePoints) -> Measurement:
    seen = _seen(record, pose, points)
    on_ground = points[: seen.on_ground]
    refusal = _blocked(record, pose, points, on_ground)
    if refusal is not None:
        return refusal
    stds, ranges = on_ground.range_std_m, on_ground.range_m
    worst = float(np.max(stds / ranges, initial=0.0))
    draws = record.setup.model is ProjectionModel.PINHOLE
    if draws and (worst > FIRST_ORDER_LIMIT or _is_bent(seen, points) or (len(ranges) and has_edge(seen, stds))):
        return _draw(record, seen, points)
    if worst > MAX_RELATIVE_RANGE_STD:
        return record.refuse(on_ground, Z95 * stds)
    value = first_order(seen)
    if draws and seen.kind is ProbeKind.BEARING and value is not None and not value.std <= MAX_BEARING_STD_RAD / 3:
        return _draw(record, seen, points)
    return _checked(record, pose, points, value, points.cov_enu_m2[0])


def _is_bent(seen: Seen, points: ImagePoints) -> bool:
    """Whether a height is seen from so nearly above that its base may be on either side of the camera's foot."""
    if seen.kind is not ProbeKind.HEIGHT:
        return False
    away = float(np.linalg.norm((points.ground.points_enu_m[0] - seen.pose.position_enu_m)[:2]))
    return float(np.linalg.norm(points.cov_enu_m2[0, :2, :2], 2)) > (NEAR_FOOT * away) ** 2


def _draw(record: Record, seen: Seen, points: ImagePoints) -> Measurement:
    """The answer from drawn errors, or the refusal that they justify."""
    found = drawn(seen)
    on_ground = points[: seen.on_ground]
    half = np.array([(spread.high - spread.low) / 2 for spread in found.range_spreads])
    if not np.all(half <= Z95 * MAX_RELATIVE_RANGE_STD * on_ground.range_m):
        return record.refuse(on_ground, half)
    is_height = seen.kind is ProbeKind.HEIGHT  # may be infinite where its base is known: seen from above
    if len(half) and not is_height and found.value is not None and not math.isfinite(found.value.ci95[1]):
        return record.refuse(on_ground, half)
    return _checked(record, seen.pose, points, found.value, found.cov_enu_m2)


def _checked(
    record: Record, pose: Pose, points: ImagePoints, value: Value | None, cov_enu_m2: FloatArray
) -> Measurement:
    kind = record.request.probe.kind
    if kind is ProbeKind.HEIGHT and value is not None:
        refusal = _no_object(record, pose, points, value)
        if refusal is not None:
            return refusal
    if kind is ProbeKind.BEARING and value is not None and not value.std <= MAX_BEARING_STD_RAD:
        return record.refuse_bearing(value)
    return record.answer(pose, points, value, cov_enu_m2)


def _no_object(record: Record, pose: Pose, points: ImagePoints, value: Value) -> Measurement | None:
    """Why base and top are not those of an upright object whose height can be told."""
    above_base = float(pose.position_enu_m[2] - points.ground.points_enu_m[0, 2])
    size = max(above_base, abs(value.value))
    if not value.std <= MAX_RELATIVE_RANGE_STD * size or not math.isfinite(value.value):
        return record.miss(Status.ILL_CONDITIONED, "the object is seen from above: its height may be anything")
    if not value.ci95[1] >= 0:
        sentence = f"the top is seen {-value.value:.2f} m below the base; the base comes first, then the top"
        return record.miss(Status.NOT_UPRIGHT, sentence)
    if record.setup.model is ProjectionModel.DFT:
        return None  # Eq. 8 does not look at columns
    seen = _seen(record, pose, points)
    off, by = beside(seen.sight)
    if abs(off) > max(abs(value.value), LEANING_STDS * std_of(seen, by)):
        sentence = f"the top is seen {abs(off):.2f} m beside the vertical through the base: base and top of one object?"
        return record.miss(Status.NOT_UPRIGHT, sentence)
    return None


def _blocked(record: Record, pose: Pose, points: ImagePoints, on_ground: ImagePoints) -> Measurement | None:
    """Why there can be no answer, whatever the uncertainty."""
    statuses = points.ground.status
    if statuses.any():
        has_no_ground = (statuses > 0) & (np.arange(len(statuses)) < len(on_ground.ground.status))
        bad = np.flatnonzero(has_no_ground | np.isin(statuses, _NO_RAY))
        if len(bad):
            return record.no_ground(pose, points.ground, int(bad[0]))
    limit = record.setup.max_range_m
    if limit is not None and np.any(on_ground.range_m > limit):
        farthest = int(np.argmax(on_ground.range_m))
        sentence = f"point {farthest} is {on_ground.range_m[farthest]:.1f} m away, the limit is {limit:g} m"
        return record.miss(Status.BEYOND_RANGE, sentence)
    if record.request.probe.kind is ProbeKind.AREA and crosses_itself(points.ground.points_enu_m):
        return record.miss(
            Status.SELF_CROSSING, "the polygon crosses or touches itself; name its corners in order, each once"
        )
    return None
