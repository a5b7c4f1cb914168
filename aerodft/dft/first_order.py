"""Answers by linear propagation, of many images and all probes of a kind at once; what needs more is left out.

Left out is what misses the ground, is too far away, too uncertain, or must be drawn: ``measure`` looks at these one by
one, and says why.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aerodft.dft.answer_columns import NUMBERS, AnswerColumn
from aerodft.dft.limits import (
    FIRST_ORDER_LIMIT,
    LEANING_STDS,
    MAX_BEARING_STD_RAD,
    MAX_RELATIVE_RANGE_STD,
    NEAR_FOOT,
    NO_RAY_CODES,
)
from aerodft.dft.loops import SharedErrors, joint_variances
from aerodft.dft.points import ImagePoints, lat_lon_alt, to_ground_frame
from aerodft.dft.polygons import crosses_itself
from aerodft.dft.projection import Codes
from aerodft.dft.quantities import SCALARS, Gradient, Sight, beside, foot_distance, gradient
from aerodft.dft.record import UNITS
from aerodft.dft.request import Request, Setup
from aerodft.dft.seen import BY_DIRECTION, Directions, directions_with_jacobians, on_ground_count
from aerodft.dft.uncertainty import Z95, ellipses95
from aerodft.dft.values import SIGNED
from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.model.measurement import ProjectionModel
from aerodft.model.probe import ProbeKind


@dataclass(frozen=True, slots=True)
class _Group:
    """Requests of one kind with as many pixels each.

    Attributes:
        kind: The kind.
        members: Which of the requests.
        columns: ``(g, q)`` which of the points.
    """

    kind: ProbeKind
    members: tuple[int, ...]
    columns: IntArray


@dataclass(frozen=True, slots=True)
class _Scalars:
    """Values and standard deviations ``(n, g)``."""

    value: FloatArray
    std: FloatArray

    @property
    def high(self) -> FloatArray:
        return self.value + Z95 * self.std


def first_order_answers(
    setup: Setup, count: int, requests: tuple[Request, ...], points: ImagePoints
) -> list[AnswerColumn]:
    """A column for each of the requests, without other answers.

    Args:
        setup: What all share.
        count: Number of images.
        requests: What is asked in each.
        points: Theirs, in order, in these images.
    """
    nothing = np.zeros(count, dtype=np.bool_)
    columns = [AnswerColumn("m", nothing, {}, {})] * len(requests)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # misses
        errors = SharedErrors.of(points.shared_cov)
        found = [_Answers(setup, group, points, errors) for group in _groups(setup, requests)]
        places = _places(points, [answers.shown_m for answers in found])
        for answers, shown in zip(found, places, strict=True):
            for member, column in zip(answers.members, answers.columns(shown), strict=True):
                columns[member] = column
    return columns


def _places(points: ImagePoints, shown_m: Sequence[FloatArray]) -> Iterator[dict[str, FloatArray]]:
    """The numbers of an ``Answer`` that say where points ``(n, g, q, 3)`` in ENU are, of several groups in one go."""
    count = len(points.pose.wxyz)
    enu_m = np.concatenate([each.reshape(count, -1, 3) for each in shown_m] or [np.empty((count, 0, 3))], axis=1)
    away = enu_m - points.pose.position_enu_m[:, None]
    numbers = {
        "ground_m": to_ground_frame(points.pose, enu_m),
        "enu_m": enu_m,
        **({} if points.origin is None else {"geo": lat_lon_alt(points.origin, enu_m)}),
        "range_m": np.sqrt(away[..., 0] ** 2 + away[..., 1] ** 2 + away[..., 2] ** 2),
    }
    first = 0
    for each in shown_m:
        stop = first + each.shape[1] * each.shape[2]
        own = {name: values[:, first:stop] for name, values in numbers.items()}
        yield {name: values.reshape(*each.shape[:3], *values.shape[2:]) for name, values in own.items()}
        first = stop


def _groups(setup: Setup, requests: tuple[Request, ...]) -> Iterator[_Group]:
    alike: dict[tuple[ProbeKind, int], list[tuple[int, int]]] = {}
    first = 0
    for member, request in enumerate(requests):
        alike.setdefault((request.probe.kind, len(request.pixels)), []).append((member, first))
        first += len(request.pixels)
    for (kind, count), found in alike.items():
        if setup.model is ProjectionModel.DFT and kind in BY_DIRECTION:
            continue  # the paper's own equations
        members = tuple(member for member, _ in found)
        yield _Group(
            kind,
            members,
            np.array([start for _, start in found])[:, None] + np.arange(count),
        )


class _Answers:
    """What a group comes to in all images.

    Attributes:
        members: Which of the requests.
        shown_m: ``(n, g, q, 3)`` the points in ENU that it is shown with; none of a ray's bearing.
    """

    def __init__(self, setup: Setup, group: _Group, points: ImagePoints, errors: SharedErrors) -> None:
        self.members = group.members
        self._setup, self._group, self._points, self._errors = setup, group, points, errors
        self._status = points.ground.status[:, group.columns]
        self._enu_m = points.ground.points_enu_m[:, group.columns]
        self._cov = points.spread.cov_enu_m2[:, group.columns[:, 0]]
        self._camera_m = points.pose.position_enu_m[:, None]
        count = on_ground_count(group.kind, group.columns.shape[1], setup.model)
        self._on_ground = group.columns[:, :count]
        self._range_m = points.spread.range_m[:, self._on_ground]
        self._is_open = self._reachable()
        self._scalars = None if group.kind is ProbeKind.POSITION else self._with_std()
        self.shown_m = self._shown_m()

    def columns(self, places: Mapping[str, FloatArray]) -> list[AnswerColumn]:
        """A column for each of the group's requests, where its points are as they are in an ``Answer``."""
        numbers = self._numbers(places)
        unit, _ = UNITS.get(self._group.kind, ("m", 1.0))
        return [
            AnswerColumn(unit, self._is_open[:, g], {name: values[:, g] for name, values in numbers.items()}, {})
            for g in range(len(self.members))
        ]

    def _reachable(self) -> BoolArray:
        """Where all that must be on the ground is, near enough and well enough known for first order; ``(n, g)``."""
        count = self._on_ground.shape[1]
        misses = np.any(self._status[..., :count] > 0, axis=-1) | np.any(
            _is_one_of(self._status, NO_RAY_CODES), axis=-1
        )
        is_open: BoolArray = ~misses
        if self._setup.max_range_m is not None:
            is_open &= ~np.any(self._range_m > self._setup.max_range_m, axis=-1)
        limit = FIRST_ORDER_LIMIT if self._setup.model is ProjectionModel.PINHOLE else MAX_RELATIVE_RANGE_STD
        relative = self._points.spread.range_std_m[:, self._on_ground] / self._range_m
        is_open &= ~np.any(relative > limit, axis=-1)
        if count and self._setup.ground is not None and self._setup.ground.has_edges:
            is_open[:] = False
        if self._group.kind is ProbeKind.AREA:
            for n, g in np.argwhere(is_open).tolist():
                is_open[n, g] = not crosses_itself(self._enu_m[n, g])
        return is_open

    def _with_std(self) -> _Scalars:
        """Values with standard deviations; closes what they show to be no first order, or no answer."""
        kind = self._group.kind
        if kind in BY_DIRECTION:
            pixels_px = self._points.pixels_px[..., self._group.columns, :]
            of_each = pixels_px.ndim > self._group.columns.ndim + 1
            rays = directions_with_jacobians(self._setup.camera, self._points.pose, pixels_px, of_each=of_each)
            sight = Sight(self._camera_m, rays.directions_enu, self._enu_m)
        else:
            rays, sight = None, Sight(self._camera_m, np.zeros_like(self._enu_m), self._enu_m)
        value = SCALARS[kind](sight)
        scalars = _Scalars(value, self._std(gradient(kind, sight), rays))
        if kind is ProbeKind.BEARING:
            self._is_open &= scalars.std <= MAX_BEARING_STD_RAD / 3
        elif kind is ProbeKind.HEIGHT:
            aside, by = beside(sight)
            self._close_heights(scalars, np.abs(aside), self._std(by, rays))
            away, by = foot_distance(sight)
            self._is_open &= self._std(by, rays) <= NEAR_FOOT * away
        return scalars

    def _close_heights(self, scalars: _Scalars, aside_m: FloatArray, aside_std_m: FloatArray) -> None:
        """Heights that are of no upright object."""
        size = np.maximum((self._camera_m - self._enu_m[..., 0, :])[..., 2], np.abs(scalars.value))
        self._is_open &= (scalars.std <= MAX_RELATIVE_RANGE_STD * size) & np.isfinite(scalars.value)
        self._is_open &= (scalars.high >= 0) & (
            aside_m <= np.maximum(np.abs(scalars.value), LEANING_STDS * aside_std_m)
        )

    def _std(self, by: Gradient, rays: Directions | None) -> FloatArray:
        """Standard deviations ``(n, g)`` of scalars with such derivatives, those by directions of rays."""
        points, columns = self._points, self._group.columns
        of_points = points.ground.jac_shared, points.ground.jac_px, columns
        of_rays = of_points if rays is None else _one_behind_the_other(rays)
        first = columns[:, 0]
        own_var = np.square(np.stack([points.elevation_std_m[first], points.std_px[first]], axis=-1))
        variance = np.empty(by.by_camera.shape[:-1])
        gradients = by.by_camera, by.by_directions, by.by_points
        joint_variances(gradients, of_points, of_rays, self._errors, own_var, variance)
        return np.sqrt(np.maximum(variance, 0.0))

    def _shown_m(self) -> FloatArray:
        kind, enu_m = self._group.kind, self._enu_m
        if kind is ProbeKind.BEARING and enu_m.shape[2] == 1:
            return enu_m[:, :, :0]
        if kind is ProbeKind.HEIGHT and self._scalars is not None:
            enu_m = np.stack([enu_m[..., 0, :]] * 2, axis=-2)  # the top above the base
            enu_m[..., 1, 2] += self._scalars.value
        return enu_m

    def _numbers(self, places: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """The numbers of an ``Answer``, ``(n, g, ...)``."""
        kind, scalars = self._group.kind, self._scalars
        numbers: dict[str, FloatArray] = {}
        if scalars is not None:
            _, scale = UNITS.get(kind, ("m", 1.0))
            low = scalars.value - Z95 * scalars.std
            low = low if kind in SIGNED else np.maximum(low, 0.0)
            ends = np.stack([scale * low, scale * scalars.high], axis=-1)
            numbers = {"value": scale * scalars.value, "std": scale * scalars.std, "ci95": ends}
        if not self.shown_m.shape[2]:
            return numbers
        ellipse = {"ellipse95": ellipses95(self._cov)} if kind is ProbeKind.POSITION else {}
        numbers |= {**ellipse, **places, "cov_enu_m2": self._cov}
        return {name: numbers[name] for name in NUMBERS if name in numbers}


def _one_behind_the_other(rays: Directions) -> tuple[FloatArray, FloatArray, IntArray]:
    """The derivatives of rays ``(n, g, q)`` as those of ``(n, k)``, and where in these each is ``(g, q)``."""
    count, *shape = rays.directions_enu.shape[:-1]
    size = math.prod(shape)
    shared, own = (each.reshape(count, size, *each.shape[-2:]) for each in (rays.jac_shared, rays.jac_px))
    return shared, own, np.arange(size).reshape(shape)


def _is_one_of(codes: Codes, wanted: Sequence[int]) -> BoolArray:
    return np.asarray(np.logical_or.reduce([codes == each for each in wanted]))
