"""One probe in one image: its answer by first order or by drawn errors, or why there is none."""

import math

import numpy as np

from aerodft.dft.answers import Answer
from aerodft.dft.limits import (
    FIRST_ORDER_LIMIT,
    LEANING_STDS,
    MAX_BEARING_STD_RAD,
    MAX_RELATIVE_RANGE_STD,
    NEAR_FOOT,
    NO_RAY_CODES,
)
from aerodft.dft.points import ProbePoints
from aerodft.dft.polygons import crosses_itself
from aerodft.dft.quantities import beside, foot_distance
from aerodft.dft.record import Record
from aerodft.dft.refusal import unknown_range
from aerodft.dft.seen import Seen
from aerodft.dft.uncertainty import Z95
from aerodft.dft.values import Value, drawn, first_order, has_edge, std_of
from aerodft.model.arrays import FloatArray
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import Pose
from aerodft.model.probe import ProbeKind
from aerodft.model.status import Status


def seen_in(record: Record, points: ProbePoints) -> Seen:
    """What the request's points are, for its value and uncertainty; the sample has a pose."""
    setup, request, pose = record.setup, record.request, record.sample.pose
    assert pose is not None  # noqa: S101 - the callers' own condition, for the type checker
    return Seen(
        kind=request.probe.kind,
        camera=setup.camera,
        pose=pose,
        model=setup.model,
        pixels_px=np.array(request.pixels, dtype=np.float64),
        elevation_m=request.probe.elevation_m,
        surface=setup.ground,
        ground=points.ground,
        shared_cov=points.shared_cov,
        std_px=request.std_px,
    )


def measure_one(record: Record, points: ProbePoints) -> Answer:
    """The answer to one request whose points are known."""
    seen = seen_in(record, points)
    pose, on_ground = seen.pose, points.first(seen.on_ground)
    refusal = blocked(record, pose, points, on_ground)
    if refusal is not None:
        return refusal
    stds, ranges = on_ground.range_std_m, on_ground.range_m
    worst = float(np.max(stds / ranges, initial=0.0))
    draws = record.setup.model is ProjectionModel.PINHOLE
    if draws and (worst > FIRST_ORDER_LIMIT or _is_bent(seen) or (len(ranges) and has_edge(seen, stds))):
        return _draw(record, seen, points)
    if worst > MAX_RELATIVE_RANGE_STD:
        return unknown_range(record, seen, on_ground, Z95 * stds)
    value = first_order(seen)
    if draws and seen.kind is ProbeKind.BEARING and value is not None and not value.std <= MAX_BEARING_STD_RAD / 3:
        return _draw(record, seen, points)
    return _checked(record, pose, points, value, points.cov_enu_m2[0])


def _is_bent(seen: Seen) -> bool:
    """Whether a height is seen from so nearly above that its base may be on either side of the camera's foot."""
    if seen.kind is not ProbeKind.HEIGHT:
        return False
    away, by = foot_distance(seen.sight)
    return std_of(seen, by) > NEAR_FOOT * float(away)


def _draw(record: Record, seen: Seen, points: ProbePoints) -> Answer:
    """The answer from drawn errors, or the refusal that they justify."""
    found = drawn(seen)
    on_ground = points.first(seen.on_ground)
    half = np.array([(spread.high - spread.low) / 2 for spread in found.range_spreads])
    if not np.all(half <= Z95 * MAX_RELATIVE_RANGE_STD * on_ground.range_m):
        return unknown_range(record, seen, on_ground, half)
    is_height = seen.kind is ProbeKind.HEIGHT  # may be infinite where its base is known: seen from above
    if len(half) and not is_height and found.value is not None and not math.isfinite(found.value.ci95[1]):
        return unknown_range(record, seen, on_ground, half)
    return _checked(record, seen.pose, points, found.value, found.cov_enu_m2)


def _checked(record: Record, pose: Pose, points: ProbePoints, value: Value | None, cov_enu_m2: FloatArray) -> Answer:
    kind = record.request.probe.kind
    if kind is ProbeKind.HEIGHT and value is not None:
        refusal = _no_object(record, pose, points, value)
        if refusal is not None:
            return refusal
    if kind is ProbeKind.BEARING and value is not None and not value.std <= MAX_BEARING_STD_RAD:
        return record.refuse_bearing(value)
    return record.answer(pose, points, value, cov_enu_m2)


def _no_object(record: Record, pose: Pose, points: ProbePoints, value: Value) -> Answer | None:
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
    seen = seen_in(record, points)
    aside, by = beside(seen.sight)
    off = float(aside)
    if abs(off) > max(abs(value.value), LEANING_STDS * std_of(seen, by)):
        sentence = f"the top is seen {abs(off):.2f} m beside the vertical through the base: base and top of one object?"
        return record.miss(Status.NOT_UPRIGHT, sentence)
    return None


def blocked(record: Record, pose: Pose, points: ProbePoints, on_ground: ProbePoints) -> Answer | None:
    """Why there can be no answer, whatever the uncertainty."""
    statuses = points.ground.status
    if statuses.any():
        has_no_ground = (statuses > 0) & (np.arange(len(statuses)) < len(on_ground.ground.status))
        bad = np.flatnonzero(has_no_ground | np.isin(statuses, NO_RAY_CODES))
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
