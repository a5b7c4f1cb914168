"""The engine's interface: measure requests in images, explain an uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aerodft.dft.answer import Answers, ProjectedPixels
from aerodft.dft.covariance import Share, variance_budgets
from aerodft.dft.measurement_batch import NO_IMAGE, NUMBERS, MeasurementBatch, MeasurementColumn
from aerodft.dft.probe_kinds import PROBE_KINDS
from aerodft.dft.projection import ELEVATION, position_columns
from aerodft.dft.request import Request, Setup
from aerodft.model import (
    Batch,
    FloatArray,
    IntArray,
    PoseBatch,
    PoseSample,
    ProbeKind,
)

__all__ = ["Request", "Setup", "explain", "measure"]

_IMAGES_PER_CHUNK = 512  # keeps their derivatives in the cache

_PartialColumn = tuple[IntArray, MeasurementColumn]
"""Indices ``(m,)`` of some images, and a request's measurements in them."""


def measure(
    setup: Setup, poses: PoseBatch, requests: tuple[Request, ...], images: IntArray | None = None
) -> MeasurementBatch:
    """Measure the same requests in every image, each image independently of the others.

    Args:
        setup: Camera, model and ground.
        poses: The images' ``(n,)`` poses.
        requests: Probes with pixels.
        images: ``(n,)`` running numbers of the images; None where they have none.

    Returns:
        A column for each request; NaN with a status and reasons where there is no value.
    """
    for request in requests:
        kind = PROBE_KINDS[request.probe.kind]
        if not kind.takes_pixels(request.count):
            wanted = f"{kind.name} needs {kind.pixels_wanted}"
            raise ValueError(f"probe {request.probe.name}: {request.count} pixels, {wanted}")
        if not kind.takes_elevations(request.probe.elevation_count, request.count):
            wanted = f"{kind.name} needs {kind.elevations_wanted(request.count)}"
            raise ValueError(f"probe {request.probe.name}: {request.probe.elevation_count} elevations, {wanted}")
    rows = np.flatnonzero(poses.is_ok)
    parts: list[list[_PartialColumn]] = [[] for _ in requests]
    for first in range(0, len(rows), _IMAGES_PER_CHUNK):
        chunk = rows[first : first + _IMAGES_PER_CHUNK]
        for pieces, column in zip(parts, _measure_rows(setup, poses, requests, chunk), strict=True):
            pieces.append((chunk, column))
    return MeasurementBatch(
        requests=requests,
        poses=poses,
        images=np.full(len(poses), NO_IMAGE) if images is None else images,
        columns=tuple(
            _merge_parts(MeasurementColumn(PROBE_KINDS[request.probe.kind].unit, poses.status, {}, {}), pieces)
            for request, pieces in zip(requests, parts, strict=True)
        ),
        model=setup.model,
        camera=setup.camera.name,
        config=setup.config_id,
    )


def explain(setup: Setup, sample: PoseSample, request: Request) -> tuple[Share, ...]:
    """Variance budget of one request, largest part first; empty where it has no scalar or no ground."""
    kind = PROBE_KINDS[request.probe.kind]
    if sample.pose is None or kind.scalar is None:
        return ()
    poses, top = PoseBatch.from_samples([sample]), None
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        if request.on_top_of is not None:
            support = _supporting_object(setup, poses, request.on_top_of)
            if not support.is_open[0, 0]:
                return ()
            top = _Tops.from_object(support)
            view = top.project(setup, poses, (request,))
        else:
            view = _project(setup, poses, (request,))
        elevations = 0 if top is not None else request.probe.elevation_count
        answers = Answers(view, request.probe.kind, np.arange(request.count)[None], elevations)
        if answers.is_undefined[0, 0]:
            return ()
        jac_shared, pixel_var, cov = answers.variance_terms(0)
        if top is not None:
            pixel_var = pixel_var + np.square(jac_shared[:, ELEVATION] * top.own_std_m)
            jac_shared, cov = (jac_shared[:, None] @ top.top_from_ground)[:, 0], top.ground_cov
        (budget,) = variance_budgets(jac_shared, (pixel_var, answers.own_elevation_var(0)), poses, cov)
    return tuple(replace(share, std=kind.scale * share.std) for share in budget)


@dataclass(frozen=True, slots=True, eq=False)
class _Tops(Batch):
    """Tops of an upright object in ``n`` images (the paper's Section 5.4), and the errors of their elevations.

    Attributes:
        elevation_m: ``(n,)``.
        top_from_ground: ``(n, s, s)`` shared errors with the ground's elevation to those with the top's elevation.
        own_std_m: ``(n,)`` standard deviations of the elevations by the pixels of base and top.
        ground_cov: ``(n, s, s)`` covariance of the shared errors with the ground's elevation.
    """

    elevation_m: FloatArray
    top_from_ground: FloatArray
    own_std_m: FloatArray
    ground_cov: FloatArray

    @staticmethod
    def from_object(support: Answers) -> "_Tops":
        """Tops of the one object measured in ``support``."""
        base_m, shared, own = support.base_elevation(0)
        jac_shared, _, cov = support.variance_terms(0)
        jac_px = support.jac_px[:, 0].copy()
        jac_px[:, 0] += own
        top_from_ground = np.zeros(cov.shape)
        top_from_ground[:] = np.eye(cov.shape[-1])
        top_from_ground[:, ELEVATION] = jac_shared + shared
        own_std = support.std_px[0] * np.sqrt(np.sum(np.square(jac_px), axis=(1, 2)))
        return _Tops(base_m + support.value[:, 0], top_from_ground, own_std, cov)

    def project(self, setup: Setup, poses: PoseBatch, requests: Sequence[Request]) -> ProjectedPixels:
        """Project requests to the level planes through the tops."""
        cov = self.top_from_ground @ self.ground_cov @ self.top_from_ground.swapaxes(-1, -2)
        cov[:, ELEVATION, ELEVATION] += np.square(self.own_std_m)
        counts = [request.count for request in requests]
        elevation = np.repeat(self.elevation_m[:, None], sum(counts), axis=1)
        none = np.zeros(sum(counts))
        stds = none, none, np.repeat([request.std_px for request in requests], counts)
        return ProjectedPixels.project(
            replace(setup, ground=None), poses, _pixels(requests, len(poses)), elevation, stds, cov
        )


def _measure_rows(
    setup: Setup, poses: PoseBatch, requests: tuple[Request, ...], rows: IntArray
) -> list[MeasurementColumn]:
    """Columns of requests in the images ``rows``, all of whose poses are ok."""
    selected = tuple(request.rows(rows) for request in requests)
    poses = poses.rows(rows) if len(rows) < len(poses) else poses
    on_ground = [member for member, request in enumerate(requests) if request.on_top_of is None]
    by_support: dict[int, list[int]] = {}
    for member, request in enumerate(requests):
        if request.on_top_of is not None:
            by_support.setdefault(id(request.on_top_of), []).append(member)
    columns: dict[int, MeasurementColumn] = {}
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # misses
        if on_ground:
            grounded = [selected[member] for member in on_ground]
            columns |= zip(on_ground, _columns(_project(setup, poses, grounded), grounded), strict=True)
        for members in by_support.values():
            on_top = [selected[member] for member in members]
            columns |= zip(members, _measure_on_top(setup, poses, on_top), strict=True)
    return [columns[member] for member in range(len(requests))]


def _measure_on_top(setup: Setup, poses: PoseBatch, requests: Sequence[Request]) -> list[MeasurementColumn]:
    """Columns of requests that all lie on top of one object, whose base and top are in the same image."""
    height = requests[0].on_top_of
    assert height is not None  # noqa: S101 - the caller's own condition, for the type checker
    support = _supporting_object(setup, poses, height)
    rows = np.flatnonzero(support.is_open[:, 0])
    measured: list[MeasurementColumn] = []
    if len(rows):
        selected = [request.rows(rows) for request in requests]
        measured = _columns(_Tops.from_object(support).rows(rows).project(setup, poses.rows(rows), selected), selected)
    columns = []
    for member, request in enumerate(requests):
        prefix = f"it lies on top of {request.probe.on_top_of}: "
        reasons = {row: tuple(prefix + reason for reason in why) for row, why in support.reasons[0].items()}
        refused = MeasurementColumn(PROBE_KINDS[request.probe.kind].unit, support.code[:, 0], reasons, {})
        columns.append(_merge_parts(refused, [(rows, measured[member])] if measured else []))
    return columns


def _supporting_object(setup: Setup, poses: PoseBatch, height: Request) -> Answers:
    """The object, measured by a ``height`` request, that other requests lie on top of."""
    return Answers(_project(setup, poses, (height,)), ProbeKind.HEIGHT, np.arange(height.count)[None])


def _columns(view: ProjectedPixels, requests: Sequence[Request]) -> list[MeasurementColumn]:
    """Columns of requests whose pixels are those of the view, in order."""
    members_by_kind: dict[tuple[ProbeKind, int, int], list[int]] = {}
    for member, request in enumerate(requests):
        elevations = 0 if request.on_top_of is not None else request.probe.elevation_count
        members_by_kind.setdefault((request.probe.kind, request.count, elevations), []).append(member)
    starts = np.cumsum([0, *(request.count for request in requests)])
    answers = [
        Answers(view, kind, starts[members][:, None] + np.arange(count), elevations)
        for (kind, count, elevations), members in members_by_kind.items()
    ]
    columns: dict[int, MeasurementColumn] = {}
    positions = position_columns(view.poses, [each.reported_points_enu_m() for each in answers])
    for each, members, own in zip(answers, members_by_kind.values(), positions, strict=True):
        numbers = each.numbers(own)
        ordered = {name: numbers[name] for name in NUMBERS if name in numbers}
        for at, member in enumerate(members):
            of_request = {name: values[:, at] for name, values in ordered.items()}
            unit = PROBE_KINDS[each.kind].unit
            columns[member] = MeasurementColumn(unit, each.code[:, at], each.reasons[at], of_request)
    return [columns[member] for member in range(len(requests))]


def _project(setup: Setup, poses: PoseBatch, requests: Sequence[Request]) -> ProjectedPixels:
    """Requests' pixels projected to the ground."""
    is_own = np.concatenate([np.full(request.count, request.probe.elevation_count > 0) for request in requests])
    elevation = np.concatenate([request.probe.elevations_m(request.count) for request in requests])
    elevation_std = np.concatenate([request.probe.elevation_stds_m(request.count) for request in requests])
    std_px = np.repeat([request.std_px for request in requests], [request.count for request in requests])
    stds = np.where(is_own, 0.0, elevation_std), np.where(is_own, elevation_std, 0.0), std_px
    return ProjectedPixels.project(setup, poses, _pixels(requests, len(poses)), elevation, stds)


def _pixels(requests: Sequence[Request], count: int) -> FloatArray:
    """Pixels ``(k, 2)`` of all requests in order, or ``(n, k, 2)`` where images have their own."""
    pixels = [request.pixels_px for request in requests]
    if all(each.ndim == 2 for each in pixels):  # noqa: PLR2004
        return np.concatenate(pixels)
    return np.concatenate([np.broadcast_to(each, (count, *each.shape[-2:])) for each in pixels], axis=1)


def _merge_parts(default: MeasurementColumn, parts: Sequence[_PartialColumn]) -> MeasurementColumn:
    """Column with the rows of partial columns, and status and reasons of ``default`` in the other rows."""
    count = len(default.status)
    if len(parts) == 1 and len(parts[0][0]) == count:
        return parts[0][1]
    status, reasons = default.status.copy(), dict(default.reasons)
    shapes = {name: values.shape[1:] for _, column in parts for name, values in column.numbers.items()}
    numbers = {name: np.full((count, *shapes[name]), np.nan) for name in NUMBERS if name in shapes}
    for rows, column in parts:
        status[rows] = column.status
        reasons |= {int(rows[row]): why for row, why in column.reasons.items()}
        for name, values in column.numbers.items():
            numbers[name][rows] = values
    return MeasurementColumn(default.unit, status, reasons, numbers)
