"""Requests to measurements: any number of images, any number of probes, one projection."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aerodft.dft import equations
from aerodft.dft.answer import Answers, ProbedPixels
from aerodft.dft.covariance import Share, variance_budgets
from aerodft.dft.measurement_batch import NO_IMAGE, NUMBERS, MeasurementBatch, MeasurementColumn
from aerodft.dft.probe_kinds import PROBE_KINDS
from aerodft.dft.projection import ELEVATION, place_columns
from aerodft.dft.request import Request, Setup
from aerodft.geometry import camera_angles
from aerodft.model import (
    Camera,
    FloatArray,
    FloatLike,
    IntArray,
    Measurement,
    Pose,
    PoseBatch,
    PoseSample,
    ProbeKind,
    ProjectionModel,
)

__all__ = ["Request", "Setup", "explain", "measure"]

_AT_ONCE = 512  # images: their derivatives stay in the cache

_Part = tuple[IntArray, MeasurementColumn]
"""What a request came to in some of the images ``(m,)``, by their indices."""


def measure(
    setup: Setup, poses: PoseBatch, requests: tuple[Request, ...], images: IntArray | None = None
) -> MeasurementBatch:
    """Measure the same requests in every image; what an image's come to does not depend on the other images.

    Args:
        setup: What all share.
        poses: The images' ``(n,)`` poses.
        requests: What is measured in each.
        images: ``(n,)`` their running numbers; None where no image has one.

    Returns:
        A column for each request; without a number, but with a status and its reasons, where there is none.
    """
    for request in requests:
        kind = PROBE_KINDS[request.probe.kind]
        if not kind.takes_pixels(request.count):
            wanted = f"{kind.name} needs {kind.pixels_wanted}"
            raise ValueError(f"probe {request.probe.name}: {request.count} pixels, {wanted}")
    rows = np.flatnonzero(poses.is_ok)
    parts: list[list[_Part]] = [[] for _ in requests]
    for first in range(0, len(rows), _AT_ONCE):
        own = rows[first : first + _AT_ONCE]
        for found, column in zip(parts, _columns_of_rows(setup, poses, requests, own), strict=True):
            found.append((own, column))
    return MeasurementBatch(
        requests=requests,
        poses=poses,
        images=np.full(len(poses), NO_IMAGE) if images is None else images,
        columns=tuple(
            _join_parts(MeasurementColumn(PROBE_KINDS[request.probe.kind].unit, poses.status, {}, {}), found)
            for request, found in zip(requests, parts, strict=True)
        ),
        model=setup.model,
        camera=setup.camera.name,
        config=setup.config_id,
    )


def explain(setup: Setup, sample: PoseSample, request: Request) -> tuple[Share, ...]:
    """Where one request's uncertainty comes from, the largest part first; empty where it has no scalar or no ground."""
    kind = PROBE_KINDS[request.probe.kind]
    if sample.pose is None or kind.scalar is None:
        return ()
    poses, top = PoseBatch.of([sample]), None
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        if request.on_top_of is not None:
            support = _supporting_object(setup, poses, request.on_top_of)
            if not support.is_open[0, 0]:
                return ()
            top = _Top.from_object(support)
            view = top.view(setup, poses, (request,))
        else:
            view = _view(setup, poses, (request,))
        answers = Answers(view, request.probe.kind, np.arange(request.count)[None])
        if answers.is_blocked[0, 0]:
            return ()
        by_shared, pixel_var, cov = answers.variance_terms(0)
        if top is not None:
            pixel_var = pixel_var + np.square(by_shared[:, ELEVATION] * top.own_std_m)
            by_shared, cov = (by_shared[:, None] @ top.top_from_ground)[:, 0], top.ground_cov
        (budget,) = variance_budgets(by_shared, pixel_var, poses, cov)
    return tuple(replace(share, std=kind.scale * share.std) for share in budget)


@dataclass(frozen=True, slots=True, eq=False)
class _Top:
    """The tops of an upright object in ``n`` images (the paper's Section 5.4), and what their elevations depend on.

    Attributes:
        elevation_m: ``(n,)``.
        follows: ``(n, s, s)`` from the ground's errors to those that have the top's elevation in place of the ground's.
        own_std_m: ``(n,)`` what the pixels of base and top alone make of the elevations' standard deviations.
        ground_cov: ``(n, s, s)`` of the errors of the ground that the object stands on.
    """

    elevation_m: FloatArray
    top_from_ground: FloatArray
    own_std_m: FloatArray
    ground_cov: FloatArray

    @staticmethod
    def from_object(support: Answers) -> "_Top":
        """The tops of the one object that was judged."""
        base_m, shared, own = support.base_elevation(0)
        by_shared, _, cov = support.variance_terms(0)
        by_px = support.by_px[:, 0].copy()
        by_px[:, 0] += own
        top_from_ground = np.zeros(cov.shape)
        top_from_ground[:] = np.eye(cov.shape[-1])
        top_from_ground[:, ELEVATION] = by_shared + shared
        own_std = support.std_px[0] * np.sqrt(np.sum(np.square(by_px), axis=(1, 2)))
        return _Top(base_m + support.value[:, 0], top_from_ground, own_std, cov)

    def view(self, setup: Setup, poses: PoseBatch, requests: Sequence[Request]) -> ProbedPixels:
        """What is seen in the level planes through the tops, instead of on the ground."""
        cov = self.top_from_ground @ self.ground_cov @ self.top_from_ground.swapaxes(-1, -2)
        cov[:, ELEVATION, ELEVATION] += np.square(self.own_std_m)
        counts = [request.count for request in requests]
        elevation = np.repeat(self.elevation_m[:, None], sum(counts), axis=1)
        stds = np.zeros(sum(counts)), np.repeat([request.std_px for request in requests], counts)
        return ProbedPixels.project(
            replace(setup, ground=None), poses, _pixels(requests, len(poses)), elevation, stds, cov
        )

    def rows(self, rows: IntArray) -> "_Top":
        """Those in some images."""
        return _Top(self.elevation_m[rows], self.top_from_ground[rows], self.own_std_m[rows], self.ground_cov[rows])


def _columns_of_rows(
    setup: Setup, poses: PoseBatch, requests: tuple[Request, ...], rows: IntArray
) -> list[MeasurementColumn]:
    """What requests come to in some images, all of whose poses are ok."""
    own = tuple(request.rows(rows) for request in requests)
    poses = poses.rows(rows) if len(rows) < len(poses) else poses
    on_ground = [member for member, request in enumerate(requests) if request.on_top_of is None]
    on_top: dict[int, list[int]] = {}
    for member, request in enumerate(requests):
        if request.on_top_of is not None:
            on_top.setdefault(id(request.on_top_of), []).append(member)
    columns: dict[int, MeasurementColumn] = {}
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # misses
        if on_ground:
            standing = [own[member] for member in on_ground]
            columns |= zip(on_ground, _columns(_view(setup, poses, standing), standing), strict=True)
        for members in on_top.values():
            lying = [own[member] for member in members]
            columns |= zip(members, _measure_on_top(setup, poses, lying), strict=True)
    return [columns[member] for member in range(len(requests))]


def _measure_on_top(setup: Setup, poses: PoseBatch, requests: Sequence[Request]) -> list[MeasurementColumn]:
    """What requests come to that all lie on top of one object, of which base and top are seen in the same image."""
    under = requests[0].on_top_of
    assert under is not None  # noqa: S101 - the caller's own condition, for the type checker
    support = _supporting_object(setup, poses, under)
    rows = np.flatnonzero(support.is_open[:, 0])
    found: list[MeasurementColumn] = []
    if len(rows):
        own = [request.rows(rows) for request in requests]
        found = _columns(_Top.from_object(support).rows(rows).view(setup, poses.rows(rows), own), own)
    columns = []
    for member, request in enumerate(requests):
        prefix = f"it lies on top of {request.probe.on_top_of}: "
        reasons = {row: tuple(prefix + reason for reason in why) for row, why in support.reasons[0].items()}
        missed = MeasurementColumn(PROBE_KINDS[request.probe.kind].unit, support.code[:, 0], reasons, {})
        columns.append(_join_parts(missed, [(rows, found[member])] if found else []))
    return columns


def _supporting_object(setup: Setup, poses: PoseBatch, under: Request) -> Answers:
    """An object that something lies on top of."""
    return Answers(_view(setup, poses, (under,)), ProbeKind.HEIGHT, np.arange(under.count)[None])


def _columns(view: ProbedPixels, requests: Sequence[Request]) -> list[MeasurementColumn]:
    """A column for each of the requests that have a view's pixels, one after the other."""
    members_by_kind: dict[tuple[ProbeKind, int], list[int]] = {}
    for member, request in enumerate(requests):
        members_by_kind.setdefault((request.probe.kind, request.count), []).append(member)
    starts = np.cumsum([0, *(request.count for request in requests)])
    answers = [
        Answers(view, kind, starts[members][:, None] + np.arange(count))
        for (kind, count), members in members_by_kind.items()
    ]
    columns: dict[int, MeasurementColumn] = {}
    where = place_columns(view.poses, [each.shown_enu_m() for each in answers])
    for each, members, own in zip(answers, members_by_kind.values(), where, strict=True):
        numbers = each.numbers(own)
        ordered = {name: numbers[name] for name in NUMBERS if name in numbers}
        for at, member in enumerate(members):
            of_request = {name: values[:, at] for name, values in ordered.items()}
            unit = PROBE_KINDS[each.kind].unit
            columns[member] = MeasurementColumn(unit, each.code[:, at], each.reasons[at], of_request)
    return [columns[member] for member in range(len(requests))]


def _view(setup: Setup, poses: PoseBatch, requests: Sequence[Request]) -> ProbedPixels:
    """What requests see on the ground."""
    counts = [request.count for request in requests]
    elevation, elevation_std, std_px = (
        np.repeat([each(request) for request in requests], counts) for each in (_elevation_m, _elevation_std_m, _std_px)
    )
    return ProbedPixels.project(setup, poses, _pixels(requests, len(poses)), elevation, (elevation_std, std_px))


def _elevation_m(request: Request) -> float:
    return request.probe.elevation_m


def _elevation_std_m(request: Request) -> float:
    return request.probe.elevation_std_m


def _std_px(request: Request) -> float:
    return request.std_px


def _pixels(requests: Sequence[Request], count: int) -> FloatArray:
    """``(k, 2)`` of all requests one after the other, or ``(n, k, 2)`` where images have their own."""
    pixels = [request.pixels_px for request in requests]
    if all(each.ndim == 2 for each in pixels):  # noqa: PLR2004
        return np.concatenate(pixels)
    return np.concatenate([np.broadcast_to(each, (count, *each.shape[-2:])) for each in pixels], axis=1)


def _join_parts(elsewhere: MeasurementColumn, parts: Sequence[_Part]) -> MeasurementColumn:
    """A column whose rows stand in parts, with the status and the reasons of ``elsewhere`` in all others."""
    count = len(elsewhere.status)
    if len(parts) == 1 and len(parts[0][0]) == count:
        return parts[0][1]
    status, reasons = elsewhere.status.copy(), dict(elsewhere.reasons)
    shapes = {name: values.shape[1:] for _, column in parts for name, values in column.numbers.items()}
    numbers = {name: np.full((count, *shapes[name]), np.nan) for name in NUMBERS if name in shapes}
    for rows, column in parts:
        status[rows] = column.status
        reasons |= {int(rows[row]): why for row, why in column.reasons.items()}
        for name, values in column.numbers.items():
            numbers[name][rows] = values
    return MeasurementColumn(elsewhere.unit, status, reasons, numbers)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelDifference:
    """One probe under both models; differences are ``dft`` minus ``pinhole``, None where either has no answer.

    Attributes:
        pinhole: The measurement with intrinsics, lens and any attitude.
        dft: The paper's.
        value: Difference of the values; None also for kinds without a value.
        percent: That in percent of the pinhole's value; None also where that is 0.
        ground_m: ``(n, 2)`` difference of X and Y of every ground point, in the ground frame.
        equation_5_m: ``(n,)`` the part of X that Eq. 5 makes; None also where not every point is on the probe's plane.
        angles_m: ``(n, 2)`` the rest of X, and all of Y: angles linear in pixels instead of a pinhole's (and with that
            lens distortion, an off-centre principal point and roll, of which the paper knows nothing).
    """

    pinhole: Measurement
    dft: Measurement
    value: float | None = None
    percent: float | None = None
    ground_m: FloatArray | None = None
    equation_5_m: FloatArray | None = None
    angles_m: FloatArray | None = None


def right_by_geometry(height_m: FloatLike, tilt_rad: FloatLike, psi_rad: FloatLike, phi_rad: FloatLike) -> FloatArray:
    """X (m) that the angles of Eq. 2 and 3 mean for a camera at ``tilt_rad``, where Eq. 5 puts ``Y tan(phi)``.

    A ray at ``phi`` from the image's middle column, seen from the optical axis, leaves it at
    ``h cos(psi - theta) / cos(psi)`` of distance along the axis: ``X = h tan(phi) cos(psi - theta) / cos(psi)``. Eq. 5
    gives ``sin(psi) / cos(psi - theta)`` of that: nothing at nadir, half at 30 degrees, nearly all at the horizon.

    Returns:
        X, broadcast over the arguments; NaN at and above the horizon.
    """
    psi = np.asarray(psi_rad, dtype=np.float64)
    ahead = equations.ground_ahead(height_m, psi)  # for its NaN
    along_axis = height_m * np.cos(psi - tilt_rad) / np.cos(psi)
    return np.asarray(np.where(np.isnan(ahead), np.nan, along_axis * np.tan(phi_rad)))


def compare_models(setup: Setup, sample: PoseSample, requests: tuple[Request, ...]) -> list[ModelDifference]:
    """Measure every request at one pose under both models; the model of ``setup`` does not matter."""
    poses = PoseBatch.of([sample])
    pinhole, dft = (
        measure(replace(setup, model=model), poses, requests)[0]
        for model in (ProjectionModel.PINHOLE, ProjectionModel.DFT)
    )
    return [_difference(setup, sample, *each) for each in zip(requests, pinhole, dft, strict=True)]


def _difference(
    setup: Setup, sample: PoseSample, request: Request, pinhole: Measurement, dft: Measurement
) -> ModelDifference:
    if sample.pose is None or pinhole.ground_m is None or dft.ground_m is None:
        return ModelDifference(pinhole=pinhole, dft=dft)
    there, here = np.array(pinhole.ground_m), np.array(dft.ground_m)
    value = None if pinhole.value is None or dft.value is None else dft.value - pinhole.value
    found = ModelDifference(
        pinhole=pinhole,
        dft=dft,
        value=value,
        percent=None if value is None or not pinhole.value else 100 * value / pinhole.value,
        ground_m=here[:, :2] - there[:, :2],
    )
    on_plane = [
        len(points) == request.count and np.allclose(points[:, 2], request.probe.elevation_m)
        for points in (there, here)
    ]
    return _split(found, setup.camera, sample.pose, request) if all(on_plane) else found


def _split(found: ModelDifference, camera: Camera, pose: Pose, request: Request) -> ModelDifference:
    pixels = request.pixels_px
    tilt, _, _ = camera_angles(pose.wxyz)
    height = float(pose.position_enu_m[2]) - request.probe.elevation_m
    psi = equations.vertical_angle(pixels[:, 1], tilt, camera.height_px, camera.vfov_rad)
    phi = equations.rotation_angle(pixels[:, 0], camera.width_px, camera.hfov_rad)
    by_equation_5 = equations.ground_right(equations.ground_ahead(height, psi), phi)
    equation_5 = by_equation_5 - right_by_geometry(height, tilt, psi, phi)
    angles = np.asarray(found.ground_m) - np.stack([equation_5, np.zeros_like(equation_5)], axis=-1)
    return replace(found, equation_5_m=equation_5, angles_m=angles)
