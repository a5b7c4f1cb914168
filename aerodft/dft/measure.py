"""Probes to measurements: one pose, any number of probes, one projection."""

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from aerodft.dft.budget import Share, variance_budget
from aerodft.dft.points import ImagePoints, image_points
from aerodft.dft.projection import GroundPoints, project
from aerodft.dft.quantities import crosses_itself
from aerodft.dft.uncertainty import Z95, ellipse95, shared_covariance
from aerodft.dft.values import FIRST_ORDER_LIMIT, Seen, Value, drawn, first_order
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.measurement import Measurement, ProjectionModel, Vector
from aerodft.model.pose import Pose, PoseSample
from aerodft.model.probe import Probe, ProbeKind
from aerodft.model.status import CODES, Status

MAX_RELATIVE_RANGE_STD = 0.3
"""A point whose slant range is less certain than this is ``ILL_CONDITIONED``."""

UNITS = {ProbeKind.AREA: "m2"}
"""Units of what is not in metres."""

_Refusal: TypeAlias = tuple[Status, tuple[str, ...]]
_NO_RAY = [CODES.index(status) for status in (Status.OUT_OF_IMAGE, Status.BEYOND_LENS_MODEL)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """What all measurements of a station share.

    Attributes:
        camera: The camera.
        model: Projection model.
        max_range_m: Farther points are ``BEYOND_RANGE``; None for no limit.
        config_id: Named in every measurement.
    """

    camera: Camera
    model: ProjectionModel = ProjectionModel.PINHOLE
    max_range_m: float | None = None
    config_id: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """One probe with the pixels that it has in this image."""

    probe: Probe
    pixels: tuple[tuple[float, float], ...]
    std_px: float


def measure(
    setup: Setup, sample: PoseSample, requests: tuple[Request, ...], image: int | None = None
) -> list[Measurement]:
    """Measure every request at one pose.

    Returns:
        One measurement a request, in order; without a value, but with a status and its reasons, where there is none.
    """
    pose = sample.pose
    if pose is None or sample.status is not Status.OK:
        return [_Record(setup, sample, request, image).miss(sample.status, sample.reasons) for request in requests]
    counts = [len(request.pixels) for request in requests]
    pixels = np.array([pixel for request in requests for pixel in request.pixels], dtype=np.float64).reshape(-1, 2)
    elevation = np.repeat([request.probe.elevation_m for request in requests], counts)
    ground = project(setup.camera, pose, pixels, elevation, setup.model)
    elevation_std = np.repeat([request.probe.elevation_std_m for request in requests], counts)
    std_px = np.repeat([request.std_px for request in requests], counts)
    points = image_points(ground, sample.origin, pose, shared_covariance(setup.camera, pose, elevation_std), std_px)
    return [
        _measure_one(_Record(setup, sample, request, image), pose, points[end - count : end])
        for request, count, end in zip(requests, counts, np.cumsum(counts).tolist(), strict=True)
    ]


def explain(setup: Setup, sample: PoseSample, request: Request) -> tuple[Share, ...]:
    """Where one request's uncertainty comes from, the largest part first; empty where it has no scalar or no ground."""
    pose = sample.pose
    if pose is None:
        return ()
    pixels = np.array(request.pixels, dtype=np.float64)
    ground = project(setup.camera, pose, pixels, request.probe.elevation_m, setup.model)
    if ground.status[0] or (request.probe.kind is not ProbeKind.HEIGHT and np.any(ground.status)):
        return ()
    shared_cov = shared_covariance(setup.camera, pose, request.probe.elevation_std_m)
    return variance_budget(_seen(setup, pose, request, ground, shared_cov), sample.std)


def _seen(setup: Setup, pose: Pose, request: Request, ground: GroundPoints, shared_cov: FloatArray) -> Seen:
    return Seen(
        kind=request.probe.kind,
        camera=setup.camera,
        pose=pose,
        model=setup.model,
        pixels_px=np.array(request.pixels, dtype=np.float64),
        elevation_m=request.probe.elevation_m,
        ground=ground,
        shared_cov=shared_cov,
        std_px=request.std_px,
    )


@dataclass(frozen=True, slots=True)
class _Record:
    """What a measurement says of its circumstances, whether it has an answer or not."""

    setup: Setup
    sample: PoseSample
    request: Request
    image: int | None

    def miss(self, status: Status, reasons: tuple[str, ...]) -> Measurement:
        return Measurement(
            name=self.request.probe.name,
            kind=self.request.probe.kind,
            status=status,
            reasons=reasons,
            stamp_ns=self.sample.stamp_ns,
            pixels=self.request.pixels,
            std_px=self.request.std_px,
            camera=self.setup.camera.name,
            model=self.setup.model,
            pose=self.sample,
            image=self.image,
            calibration=self.sample.calibration,
            config=self.setup.config_id,
        )

    def answer(self, pose: Pose, points: ImagePoints, value: Value | None, cov_enu_m2: FloatArray) -> Measurement:
        kind = self.request.probe.kind
        if kind is ProbeKind.HEIGHT and value is not None:
            points = points.upright(self.sample.origin, pose, value.value)
        return replace(
            self.miss(Status.OK, self.sample.reasons),
            unit=UNITS.get(kind, "m"),
            value=None if value is None else value.value,
            std=None if value is None else value.std,
            ci95=None if value is None else value.ci95,
            ellipse95=ellipse95(cov_enu_m2) if kind is ProbeKind.POSITION else None,
            ground_m=_tuples(points.ground_m),
            enu_m=_tuples(points.ground.points_enu_m),
            cov_enu_m2=_tuples(cov_enu_m2),
            geo=points.geo,
            range_m=tuple(points.range_m.tolist()),
        )

    def seen(self, pose: Pose, points: ImagePoints) -> Seen:
        return _seen(self.setup, pose, self.request, points.ground, points.shared_cov[0])


def _measure_one(record: _Record, pose: Pose, points: ImagePoints) -> Measurement:
    kind, model = record.request.probe.kind, record.setup.model
    is_height = kind is ProbeKind.HEIGHT
    # An object's top is measured against the vertical through its base: it may be seen above the horizon.
    on_ground = points[:1] if is_height and model is ProjectionModel.PINHOLE else points
    refusal = _blocked(record, pose, points, on_ground)
    if refusal is not None:
        return record.miss(*refusal)
    ranges, stds = on_ground.range_m, on_ground.range_std_m
    worst = float(np.max(stds / ranges))
    if worst > FIRST_ORDER_LIMIT and model is ProjectionModel.PINHOLE:
        return _draw(record, record.seen(pose, points), points)
    if worst > MAX_RELATIVE_RANGE_STD:
        return _refuse(record, on_ground, Z95 * stds)
    if kind is ProbeKind.RANGE:
        range_m, std_m = float(ranges[0]), float(stds[0])
        value = Value(range_m, std_m, (range_m - Z95 * std_m, range_m + Z95 * std_m))
        return record.answer(pose, points, value, points.cov_enu_m2[0])
    return _checked(record, pose, points, first_order(record.seen(pose, points)), points.cov_enu_m2[0])


def _draw(record: _Record, seen: Seen, points: ImagePoints) -> Measurement:
    """The answer from drawn errors, or the refusal that they justify."""
    found = drawn(seen)
    on_ground = points[: len(found.range_spreads)]
    half = np.array([(spread.high - spread.low) / 2 for spread in found.range_spreads])
    if not np.all(half <= Z95 * MAX_RELATIVE_RANGE_STD * on_ground.range_m):
        return _refuse(record, on_ground, half)
    if found.value is not None and not math.isfinite(found.value.ci95[1]):
        return _refuse(record, on_ground, half)
    return _checked(record, seen.pose, points, found.value, found.cov_enu_m2)


def _checked(
    record: _Record, pose: Pose, points: ImagePoints, value: Value | None, cov_enu_m2: FloatArray
) -> Measurement:
    if record.request.probe.kind is ProbeKind.HEIGHT and value is not None and not value.ci95[1] >= 0:
        sentence = f"the top is seen {-value.value:.2f} m below the base; the base comes first, then the top"
        return record.miss(Status.NOT_UPRIGHT, (sentence,))
    return record.answer(pose, points, value, cov_enu_m2)


def _blocked(record: _Record, pose: Pose, points: ImagePoints, on_ground: ImagePoints) -> _Refusal | None:
    """Why there can be no answer, whatever the uncertainty."""
    statuses = points.ground.status
    if statuses.any():
        has_no_ground = (statuses > 0) & (np.arange(len(statuses)) < len(on_ground.ground.status))
        bad = np.flatnonzero(has_no_ground | np.isin(statuses, _NO_RAY))
        if len(bad):
            status = CODES[statuses[bad[0]]]
            return status, (_why(record, pose, status, points.ground, int(bad[0])),)
    limit, farthest = record.setup.max_range_m, int(np.argmax(on_ground.range_m))
    if limit is not None and on_ground.range_m[farthest] > limit:
        sentence = f"point {farthest} is {on_ground.range_m[farthest]:.1f} m away, the limit is {limit:g} m"
        return Status.BEYOND_RANGE, (sentence,)
    if record.request.probe.kind is ProbeKind.AREA and crosses_itself(points.ground.points_enu_m):
        return Status.SELF_CROSSING, ("two sides of the polygon cross; name its corners in order",)
    return None


def _refuse(record: _Record, on_ground: ImagePoints, half_m: FloatArray) -> Measurement:
    """Say how badly the worst point is known; ``half_m (k,)`` is half of its range's 95 % interval."""
    index = int(np.argmax(half_m / on_ground.range_m))
    below, range_m = math.degrees(float(on_ground.ground.depression_rad[index])), float(on_ground.range_m[index])
    spread = f"+- {half_m[index]:.0f} m (95 %)" if math.isfinite(half_m[index]) else "and may be above the horizon"
    sentence = f"point {index} is {below:.1f} deg below the horizon, range {range_m:.0f} m {spread}"
    return record.miss(Status.ILL_CONDITIONED, (sentence,))


def _tuples(rows: FloatArray) -> tuple[Vector, ...]:
    return tuple(tuple(row) for row in rows.tolist())


def _why(record: _Record, pose: Pose, status: Status, ground: GroundPoints, index: int) -> str:
    u, v = record.request.pixels[index]
    camera = record.setup.camera
    if status is Status.OUT_OF_IMAGE:
        return f"pixel {index} ({u:g}, {v:g}) is outside the image of {camera.width_px} x {camera.height_px} px"
    if status is Status.BELOW_SURFACE:
        return f"camera {pose.position_enu_m[2]:.2f} m, measured plane {record.request.probe.elevation_m:.2f} m high"
    if status is Status.ABOVE_HORIZON:
        above = -math.degrees(float(ground.depression_rad[index]))
        return f"pixel {index} ({u:g}, {v:g}) looks {above:.1f} deg above the horizon"
    return f"pixel {index} ({u:g}, {v:g}) is outside the valid radius of the lens model"
