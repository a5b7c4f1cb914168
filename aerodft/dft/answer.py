"""Values, intervals and statuses of requests of one kind in many images: the one place where a status is decided.

Intervals are first order where that is enough, Monte-Carlo where it is not: where the slant range's relative standard
deviation is above 5 %; below that, where neither a bound of the second-order term is negligible nor a few draws agree
with first order (at a stationary point only second order is left). The mean change of a value by pixel noise, which
lengthens lines, is subtracted. The dft model has first order only. Whether a slant range is known well enough is
decided without draws, so that what is refused stays refused when an error grows; only over an elevation model may draws
miss all ground as well.

``n`` images, ``g`` requests of a kind with ``q`` pixels each, ``s`` shared errors as in ``projection``.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np

from aerodft.dft.covariance import (
    CHI2_2D_95,
    Z95,
    Share,
    elevation_jacobians,
    ellipses95,
    point_covariances,
    range_covariances,
    relative_range_halves,
    scalar_jacobians,
    shared_covariance,
    standard_deviations,
    variance_budgets,
)
from aerodft.dft.monte_carlo import (
    DrawInput,
    FirstOrder,
    Interval,
    draw,
    draw_biases,
    linearity_errors,
)
from aerodft.dft.probe_kinds import LEAN_STDS, MAX_RELATIVE_RANGE_STD, PROBE_KINDS, scalars
from aerodft.dft.projection import (
    ELEVATION,
    FOCAL,
    POSITION,
    PRINCIPAL_POINT,
    ROTATION,
    Codes,
    Directions,
    GroundPoints,
    PixelRays,
    pixel_directions,
    pixel_rays,
    project,
    scale_changes,
)
from aerodft.dft.quantities import Gradient, RayGeometry
from aerodft.dft.request import Setup
from aerodft.geometry import Ground, axis_focal_px, from_rotation_vector, matrix, rotate
from aerodft.model import (
    CODE_OF,
    CODES,
    STD_NAMES,
    BoolArray,
    FloatArray,
    IntArray,
    PoseBatch,
    PoseSample,
    ProbeKind,
    ProjectionModel,
    Status,
)

FIRST_ORDER_LIMIT: Final = 0.05
"""Relative standard deviation of a slant range above which errors are drawn."""

_NO_RAY_CODES: Final = (CODE_OF[Status.OUT_OF_IMAGE], CODE_OF[Status.BEYOND_LENS_MODEL])
"""Statuses of pixels without a ray: no kind of probe has a value then."""

_OK: Final = CODE_OF[Status.OK]
_STD_FIELDS: Final = {name: f"{name}_rad" for name in ("tilt", "pan", "roll", "heading")}
_MAX_WIDTH_CHANGE: Final = 0.25  # relative
_OFFSETS_RAD: Final = np.multiply.outer([1.0, -1.0], 1e-4 * 1.2 ** np.arange(57)).ravel()
"""Angles by which rays are off whose ground is looked for: from 0.006 to 160 degrees, to either side."""
_MAX_SCALE_CHANGE: Final = 0.1
"""Share of a lens's scale by which one std of its distortion may change it: rays are linear over these errors."""
_SECOND_ORDER_LIMIT: Final = 0.1
"""Standard deviations: a smaller bound of the second-order term is negligible."""
_NONLINEARITY_LIMIT: Final = 0.1
"""Standard deviations: largest root mean square of draws minus first order for which first order is enough."""
_BIAS_CORRECTION_LIMIT: Final = 0.2
"""Standard deviations: a smaller mean change of a value by pixel noise is not corrected."""
_MIN_ELLIPSE_RATIO: Final = 5e-3
"""Smallest ratio of an ellipse's axes when draws are compared with first order."""
_GRAZING_RAD: Final = math.radians(15)  # depression below which reasons name it: small angles become large errors
_NO_DIRECTIONS: Final = np.empty((0, 3))
_SHARED_AXES: Final = 2  # of pixels, and of rays, that all images share

ReasonsOf: TypeAlias = Callable[[IntArray, IntArray], Iterable[str]]
"""Function that gives a reason for each refused request, by indices ``(r,)`` of images and of requests."""


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedPixels:
    """``k`` pixels of each of ``n`` images, projected to the ground.

    Attributes:
        setup: Camera, model and ground.
        poses: The images' ``(n,)`` poses, all of which are ok.
        pixels_px: ``(k, 2)`` that all images share, or ``(n, k, 2)``.
        elevation_m: ``(n, k)`` of the measured surface.
        elevation_std_m: ``(k,)`` of errors that all points of a request share, beside that in ``shared_cov``.
        own_elevation_std_m: ``(k,)`` of errors of the pixels' own elevations.
        std_px: ``(k,)`` of each pixel coordinate.
        shared_cov: ``(n, s, s)``, see ``shared_covariance``.
        ground: The ``(n, k)`` points.
        rays: The pixels' rays.
        scale_change: ``(k,)`` or ``(n, k)``, see ``scale_changes``.
    """

    setup: Setup
    poses: PoseBatch
    pixels_px: FloatArray
    elevation_m: FloatArray
    elevation_std_m: FloatArray
    own_elevation_std_m: FloatArray
    std_px: FloatArray
    shared_cov: FloatArray
    ground: GroundPoints
    rays: PixelRays
    scale_change: FloatArray

    @property
    def focal_px(self) -> FloatArray:
        """Focal lengths fx, fy ``(n, 2)`` of the images, zoomed ones included."""
        magnification = np.where(np.isnan(self.poses.zoom[:, :1]), 1.0, self.poses.zoom[:, :1])
        return np.asarray(magnification * [self.setup.camera.fx_px, self.setup.camera.fy_px])

    @staticmethod
    def project(
        setup: Setup,
        poses: PoseBatch,
        pixels_px: FloatArray,
        elevation_m: FloatArray,
        stds: tuple[FloatArray, FloatArray, FloatArray],
        shared_cov: FloatArray | None = None,
    ) -> "ProjectedPixels":
        """Project pixels to the ground.

        Args:
            setup: Camera, model and ground.
            poses: The images' ``(n,)`` poses.
            pixels_px: ``(k, 2)`` or ``(n, k, 2)``.
            elevation_m: ``(k,)`` or ``(n, k)``.
            stds: ``(k,)`` of elevations by shared and by own errors (m), and of the pixels (px).
            shared_cov: ``(n, s, s)``; None for that of the poses and the camera.
        """
        is_unknown = np.isnan(poses.zoom)
        zoom = None if is_unknown.all() else np.where(is_unknown, [1.0, 0.0], poses.zoom)
        magnification = None if zoom is None else zoom[:, 0]
        if shared_cov is None:
            level_std_m = np.where(poses.has_own_height, 0.0, poses.level_std_m)
            shared_cov = shared_covariance(setup.camera, poses.pose, level_std_m, zoom)
        ground = project(setup.camera, poses.pose, pixels_px, elevation_m, setup.model, setup.ground, magnification)
        elevation_m = np.broadcast_to(elevation_m, ground.status.shape)
        rays = pixel_rays(setup.camera, pixels_px, magnification)
        change = scale_changes(setup.camera, pixels_px, magnification, rays)
        return ProjectedPixels(setup, poses, pixels_px, elevation_m, *stds, shared_cov, ground, rays, change)


class Answers:
    """Values, intervals and statuses of requests of one kind in all images of a view.

    Attributes:
        kind: The kind.
        code: ``(n, g)`` statuses as indices into ``CODES``.
        reasons: Of each request, by image, where they differ from those of the image's pose.
        is_undefined: ``(n, g)`` whether there is no value, however small the errors.
        value: ``(n, g)`` in SI units; NaN for a position.
        jac_shared: ``(n, g, s)`` derivatives of the values.
        jac_px: ``(n, g, q, 2)`` derivatives of the values by the pixels.
        jac_elevation: ``(n, g, e)`` derivatives of the values by the elevations with errors of their own.
        std_px: ``(g,)`` of each pixel coordinate.

    Args:
        view: The view.
        kind: What is measured.
        pixel_index: ``(g, q)`` indices of the view's pixels.
        elevations: How many elevations with errors of their own the pixels of a request have in turn; 0 for none.
    """

    def __init__(self, view: ProjectedPixels, kind: ProbeKind, pixel_index: IntArray, elevations: int = 0) -> None:
        self.kind = kind
        self._kind = PROBE_KINDS[kind]
        self._view, self._pixel_index = view, pixel_index
        first = pixel_index[:, 0]
        self._elevation_std_m, self.std_px = view.elevation_std_m[first], view.std_px[first]
        self._vars = np.square(self._elevation_std_m), np.square(self.std_px)
        self._own_std_m = view.own_elevation_std_m[pixel_index[:, :elevations]]
        self._point_elevation_var = self._vars[0][:, None] + np.square(view.own_elevation_std_m[pixel_index])
        self._ground = view.ground.take(pixel_index)
        self._camera_m = view.poses.pose.position_enu_m[:, None]
        count = pixel_index.shape[1]
        self.is_pinhole = view.setup.model is ProjectionModel.PINHOLE
        self._on_ground = self._kind.on_ground(count) if self.is_pinhole else count
        self.code = np.full(self._ground.status.shape[:2], _OK, dtype=np.int64)
        self.reasons: list[dict[int, tuple[str, ...]]] = [{} for _ in pixel_index]
        self._compute_ranges()
        self._refuse_undefined()
        self.is_undefined = self.code != _OK
        self._measure()
        self._refuse_bent_rays()
        self._refine_by_draws()
        for refusal in self._kind.refusals(self):
            self._refuse(refusal.where, refusal.status, _reason(refusal.sentence, refusal.number))

    @property
    def is_open(self) -> BoolArray:
        """Requests ``(n, g)`` not refused so far."""
        return np.asarray(self.code == _OK)

    @property
    def points_by_noise(self) -> FloatArray:
        """Changes ``(n, g, q, 3, e)`` of the points by one standard deviation of each of their own ``e`` errors."""
        by_px = self._ground.jac_px * self.std_px[:, None, None, None]
        by_elevation = (
            self._ground.jac_shared[..., ELEVATION] * self._view.own_elevation_std_m[self._pixel_index][..., None]
        )
        return np.concatenate([by_px, by_elevation[..., None]], axis=-1)

    @property
    def upper_limit(self) -> FloatArray:
        """Upper limits ``(n, g)`` of the 95 % intervals of the values."""
        return self._ends.high

    def std_of(self, by: Gradient, *, pixels_alone: bool = False) -> FloatArray:
        """First-order stds ``(n, g)`` of scalars from their gradients, by all errors or by those of the points' own."""
        jac_shared, jac_px = scalar_jacobians(by, self._ground, self._rays)
        own = elevation_jacobians(by, self._ground, self._own_std_m.shape[-1])
        return self._std(np.zeros_like(jac_shared) if pixels_alone else jac_shared, jac_px, own)

    def reported_points_enu_m(self) -> FloatArray:
        """Points ``(n, g, q, 3)`` in ENU reported with the values; none for the bearing of a ray."""
        return self._kind.reported_points(self._ground.points_enu_m, self.value)

    def numbers(self, places: dict[str, FloatArray]) -> dict[str, FloatArray]:
        """Numbers of a ``MeasurementColumn``, ``(n, g, ...)``, with those of ``reported_points_enu_m``."""
        numbers: dict[str, FloatArray] = {}
        if self._kind.scalar is not None:
            ends = np.stack([self._ends.low, self._ends.high], axis=-1)
            scale = self._kind.scale
            numbers |= {"value": scale * self.value, "std": scale * self.std, "ci95": scale * ends}
        else:
            numbers["ellipse95"] = ellipses95(self._cov)
        if places["enu_m"].shape[2]:
            numbers |= {**places, "cov_enu_m2": self._cov_over_station()}
        missing = ~self.is_open
        if missing.any():
            for name, values in numbers.items():
                numbers[name] = np.where(missing.reshape(*missing.shape, *[1] * (values.ndim - 2)), np.nan, values)
        return numbers

    def _cov_over_station(self) -> FloatArray:
        """Covariances of the points in the station's ENU ``(n, g, 3, 3)``.

        The level of the water is in a point's up, also where the camera's height was measured to the water itself.
        """
        poses = self._view.poses
        if not np.any(poses.has_own_height):
            return self._cov
        cov = self._cov.copy()
        cov[..., 2, 2] += np.where(poses.has_own_height, np.square(poses.level_std_m), 0.0)[:, None]
        return cov

    def variance_terms(self, request: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """One request's variance in each image as ``jac_shared``, the pixels' part, and the shared covariance."""
        pixel_var = self._vars[1][request] * np.sum(np.square(self.jac_px[:, request]), axis=(1, 2))
        images = np.arange(len(self.code))
        return self.jac_shared[:, request], pixel_var, self._cov_of(images, np.full(len(images), request))

    def own_elevation_var(self, request: int) -> FloatArray:
        """One request's variance ``(n,)`` in each image by errors of its points' own elevations."""
        return np.asarray(np.sum(np.square(self.jac_elevation[:, request] * self._own_std_m[request]), axis=-1))

    def base_elevation(self, request: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Height of a request's first point ``(n,)``; Jacobians by shared errors ``(n, s)``, its pixel ``(n, 2)``."""
        ground = self._ground
        return (
            ground.points_enu_m[:, request, 0, 2],
            ground.jac_shared[:, request, 0, 2],
            ground.jac_px[:, request, 0, 2],
        )

    def _compute_ranges(self) -> None:
        """Slant ranges ``(n, g, k)`` of points that must lie on the ground, and how well they are known."""
        ground = self._ground[:, :, : self._on_ground]
        away = ground.points_enu_m - self._camera_m[:, :, None]
        self._range_m = np.sqrt(away[..., 0] ** 2 + away[..., 1] ** 2 + away[..., 2] ** 2)
        unit = away / self._range_m[..., None]
        self._range_jac_shared = np.einsum("ngqi,ngqis->ngqs", unit, ground.jac_shared)
        self._range_jac_shared[..., POSITION] -= unit
        self._range_jac_px = np.einsum("ngqi,ngqij->ngqj", unit, ground.jac_px)
        by_errors = self._range_jac_shared, self._range_jac_px, self._view.shared_cov
        elevation_var = self._point_elevation_var[:, : self._on_ground]
        cov = range_covariances(self._range_m, *by_errors, elevation_var, self._vars[1])
        up_cam = matrix(self._view.poses.pose.wxyz)[:, 2]
        level = np.eye(3) - up_cam[:, :, None] * up_cam[:, None]
        self._tilt_cov = level @ self._view.shared_cov[:, ROTATION, ROTATION] @ level
        self._relative_range_std = np.sqrt(np.maximum(np.sum(cov, axis=(-2, -1)), 0.0))
        self._range_half_m = self._range_m * relative_range_halves(cov, self._tilt_cov[:, None, None])

    def _refuse_undefined(self) -> None:
        """Refuse requests that have no value however small the errors."""
        status = self._ground.status
        is_miss = np.logical_or.reduce([status == code for code in _NO_RAY_CODES])
        is_miss[..., : self._on_ground] |= status[..., : self._on_ground] != _OK
        if is_miss.any():
            first = np.argmax(is_miss, axis=-1)
            codes = np.take_along_axis(status, first[..., None], axis=-1)[..., 0]
            self._refuse(np.any(is_miss, axis=-1), codes, lambda *images: self._say_no_ground(first, *images))
        limit = self._view.setup.max_range_m
        if limit is not None:
            self._refuse(np.any(self._range_m > limit, axis=-1), Status.BEYOND_RANGE, self._say_beyond)
        is_open = self.is_open
        undefined = self._kind.undefined(self._ground.points_enu_m[is_open])
        if undefined is not None:
            is_undefined = np.zeros(self.code.shape, dtype=np.bool_)
            is_undefined[is_open], undefined_status, sentence = undefined
            self._refuse(is_undefined, undefined_status, _reason(sentence))

    def _measure(self) -> None:
        """Values, standard deviations and 95 % intervals by first order."""
        shape = self.code.shape
        self._rays: Directions | None = None
        self.geometry = RayGeometry(self._camera_m, _NO_DIRECTIONS, self._ground.points_enu_m)
        first = (slice(None), slice(None), 0)
        jac = self._ground.jac_shared[first], self._ground.jac_px[first]
        self._cov = point_covariances(*jac, self._view.shared_cov, self._point_elevation_var[:, 0], self._vars[1])
        if self._kind.scalar is None:
            self.value = self.std = self.linear_std = np.full(shape, np.nan)
            self._ends = Interval(self.value, self.value)
            return
        if self._kind.sees_rays and self.is_pinhole:
            self._rays = _directions(self._view.rays, self._pixel_index, self._view.poses)
            self.geometry = RayGeometry(self._camera_m, self._rays.directions_enu, self._ground.points_enu_m)
        elevation = self._view.elevation_m[:, self._pixel_index[:, 0]]
        self.value, by = scalars(self._kind, self._view.setup.model, self.geometry, self._view.poses.pose, elevation)
        self.jac_shared, self.jac_px = scalar_jacobians(by, self._ground, self._rays)
        self.jac_elevation = elevation_jacobians(by, self._ground, self._own_std_m.shape[-1])
        self.linear_std = self._std(self.jac_shared, self.jac_px, self.jac_elevation)
        self.std = self.linear_std.copy()
        low = self.value - Z95 * self.std
        self._ends = Interval(low if self._kind.is_signed else np.maximum(low, 0.0), self.value + Z95 * self.std)

    def _std(self, jac_shared: FloatArray, jac_px: FloatArray, jac_elevation: FloatArray) -> FloatArray:
        px = jac_px.reshape(*jac_px.shape[:2], -1)
        std = standard_deviations(jac_shared, px, self._view.shared_cov, *self._vars)
        if not self._own_std_m.size:
            return std
        return np.asarray(np.hypot(std, np.sqrt(np.sum(np.square(jac_elevation * self._own_std_m), axis=-1))))

    def _refuse_bent_rays(self) -> None:
        """Refuse requests with pixels where the lens bends so much that rays are not linear over its errors."""
        change = np.broadcast_to(np.max(self._view.scale_change[..., self._pixel_index], axis=-1), self.code.shape)
        cause = f"the lens's own errors change its scale at these pixels by more than {_MAX_SCALE_CHANGE:.0%}"
        remedy = "calibrate it with points as near to the image's edge"
        self._refuse(~(change <= _MAX_SCALE_CHANGE), Status.ILL_CONDITIONED, _reason(f"{cause}: {remedy}"))

    def _refine_by_draws(self) -> None:
        """Refuse requests whose ranges are too uncertain; replace first order by draws where it is not enough."""
        surface, differs = self._view.setup.ground, np.zeros(self.code.shape, dtype=np.bool_)
        if surface is not None and surface.has_edges:
            differs = self._differs_over_edges(surface)
        is_known = np.all(self._range_half_m <= Z95 * MAX_RELATIVE_RANGE_STD * self._range_m, axis=-1)
        self._refuse(~is_known, Status.ILL_CONDITIONED, self._say_range)
        if not self.is_pinhole:
            return
        needs_draws = np.max(self._relative_range_std, axis=-1, initial=0.0) > FIRST_ORDER_LIMIT
        may_be_biased = self._may_have_noise_bias() & self.is_open
        needs_draws = self.is_open & (needs_draws | differs | may_be_biased)
        needs_draws |= self._is_nonlinear(self.is_open & ~needs_draws)
        if needs_draws.any():
            self._draw_intervals(*np.nonzero(needs_draws))
        if may_be_biased.any():
            self._subtract_noise_bias(*np.nonzero(may_be_biased & self.is_open))

    def _draw_intervals(self, images: IntArray, requests: IntArray) -> None:
        """Intervals from Monte-Carlo draws; refuse requests of which too many draws have no value."""
        at, first = (images, requests), None
        if self._kind.scalar is not None:
            first = FirstOrder(
                value=self.value[at],
                jac=(self.jac_shared[at], self.jac_px[at], self.jac_elevation[at]),
                std=self.linear_std[at],
            )
        scalar, self._cov[at] = draw(self._draw_input(*at), first, self._ground.points_enu_m[images, requests, 0])
        if self._on_ground and not self._kind.may_be_unbounded:
            refused = np.zeros(self.code.shape, dtype=np.bool_)
            refused[at] = ~np.isfinite(self._cov[at][:, 0, 0] if first is None else scalar.high)
            self._range_half_m[refused] = np.inf
            self._refuse(refused, Status.ILL_CONDITIONED, self._say_range)
        if first is not None:
            low, high = scalar.low, scalar.high
            if not self._kind.is_signed:  # a value not significantly above 0 may be 0
                low = np.where(self.value[at] <= math.sqrt(CHI2_2D_95) * self.std[at], 0.0, low)
            self._ends.low[at], self._ends.high[at] = low, high
            self.std[at] = (high - low) / (2 * Z95)

    def _may_have_noise_bias(self) -> BoolArray:
        """Whether pixel noise may change the values by a significant mean."""
        if self._kind.scalar is None:
            return np.zeros(self.code.shape, dtype=np.bool_)
        self._noise_bias = self._kind.noise_bias(self)
        return np.asarray((self._noise_bias != 0.0) & ~(self._noise_bias <= _BIAS_CORRECTION_LIMIT * self.std))

    def _subtract_noise_bias(self, images: IntArray, requests: IntArray) -> None:
        """Subtract from values their mean change by pixel noise; where only draws tell it, if it is significant."""
        if not len(images):
            return
        view, pixel_index = self._view, self._pixel_index[requests]
        is_shared = view.pixels_px.ndim == _SHARED_AXES
        pixels = view.pixels_px[pixel_index] if is_shared else view.pixels_px[images[:, None], pixel_index]
        zoom = view.poses.zoom[images, 0]
        rays = pixel_rays(
            view.setup.camera, self._kind.denoised(pixels, self.std_px[requests]), np.where(np.isnan(zoom), 1.0, zoom)
        )
        result = draw_biases(replace(self._draw_input(images, requests), rays=rays))
        is_negligible = np.abs(result.bias) <= _BIAS_CORRECTION_LIMIT * self.std[images, requests]
        used = np.flatnonzero(np.isfinite(self._noise_bias[images, requests]) | ~is_negligible)
        at, bias = (images[used], requests[used]), result.bias[used]
        value = self.value[at] - bias
        low = value + np.minimum(result.interval.low[used], 0.0)
        high = value + np.maximum(result.interval.high[used], 0.0)
        if not self._kind.is_signed:
            value, low = np.maximum(value, 0.0), np.maximum(low, 0.0)
        self.value[at], self._ends.low[at], self._ends.high[at] = value, low, high
        self.std[at] = std = (high - low) / (2 * Z95)
        is_worth_saying = np.abs(bias) > std
        self._say_noise_bias(at[0][is_worth_saying], at[1][is_worth_saying], bias[is_worth_saying])

    def _say_noise_bias(self, images: IntArray, requests: IntArray, bias: FloatArray) -> None:
        """Add to the reasons of answered requests ``(r,)`` by how much pixel noise changed their values."""
        variants, variant_index = self._view.poses.variants, self._view.poses.variant_index
        for image, request, change in zip(images.tolist(), requests.tolist(), bias.tolist(), strict=True):
            amount = f"{abs(self._kind.scale * change):.2g} {self._kind.unit}"
            where = f"larger: {amount} are taken off" if change > 0 else f"smaller: {amount} are added"
            sentence = f"noise of the pixels made the {self.kind} {where}"
            self.reasons[request][image] = (sentence, *variants[variant_index[image]].reasons)

    def _is_nonlinear(self, candidates: BoolArray) -> BoolArray:
        """Whether values depend on the errors too nonlinearly for first order."""
        view, is_nonlinear = self._view, np.zeros(self.code.shape, dtype=np.bool_)
        if view.setup.ground is None:
            focal_px, rotation = axis_focal_px(view.setup.camera), view.shared_cov[:, ROTATION, ROTATION]
            tilt_var = np.trace(self._tilt_cov, axis1=1, axis2=2)
            lens = slice(FOCAL.start, PRINCIPAL_POINT.stop)
            lens_var = np.trace(view.shared_cov[:, lens, lens], axis1=1, axis2=2) / focal_px**2
            self.ray_std_rad = np.sqrt((tilt_var + lens_var)[:, None] + self._vars[1] / focal_px**2)
            ground_m = self._ground.points_enu_m[:, :, : self._on_ground, 2]
            slant = self._range_m / (self._camera_m[..., None, 2] - ground_m)
            self.slant = np.max(slant, axis=-1, initial=1.0)
            self.noise_m = np.max(self._range_m * slant, axis=-1, initial=0.0) * self.std_px / focal_px
            if self._own_std_m.size:
                self.noise_m = np.hypot(self.noise_m, self.slant * np.max(self._own_std_m, axis=-1))
            if self._kind.scalar is None:
                vertical_var = (np.trace(rotation, axis1=1, axis2=2) - tilt_var)[:, None]
                second = self._range_m[..., 0] * (np.square(self.ray_std_rad * self.slant) + vertical_var / 2)
                axes = ellipses95(self._cov) / math.sqrt(CHI2_2D_95)
                first = np.maximum(axes[..., 1], _MIN_ELLIPSE_RATIO * axes[..., 0])
            else:
                second, first = self._kind.second_order(self), self.std
            candidates = candidates & ~(second <= _SECOND_ORDER_LIMIT * first)
        images, requests = np.nonzero(candidates)
        if len(images):
            is_nonlinear[images, requests] = self._draws_differ(images, requests)
        return is_nonlinear

    def _draws_differ(self, images: IntArray, requests: IntArray) -> BoolArray:
        """Requests ``(p,)`` of which a few draws differ from first order."""
        at = images, requests
        uncertain = self._draw_input(images, requests)
        if self._kind.scalar is not None:
            by = self.jac_shared[at][:, None], self.jac_px[at][:, None], self.jac_elevation[at][:, None]
            errors = linearity_errors(uncertain, by, self.value[at][:, None])[:, 0]
            return np.asarray(~(np.sqrt(np.mean(np.square(errors), axis=-1)) <= _NONLINEARITY_LIMIT * self.std[at]))
        east_north = (*at, 0, slice(2))
        jac_shared, jac_px = self._ground.jac_shared[east_north], self._ground.jac_px[east_north][:, :, None]
        derivatives = jac_shared, jac_px, np.zeros((*jac_shared.shape[:2], 0))
        errors = linearity_errors(uncertain, derivatives, self._ground.points_enu_m[east_north])
        cov = self._cov[at][:, :2, :2]
        min_var = _MIN_ELLIPSE_RATIO**2 * np.trace(cov, axis1=1, axis2=2)
        bound_cov = _NONLINEARITY_LIMIT**2 * cov + min_var[:, None, None] * np.eye(2)
        bound_cov -= errors @ errors.swapaxes(-1, -2) / errors.shape[-1]
        det = bound_cov[:, 0, 0] * bound_cov[:, 1, 1] - bound_cov[:, 0, 1] * bound_cov[:, 1, 0]
        return np.asarray(~((bound_cov[:, 0, 0] >= 0) & (bound_cov[:, 1, 1] >= 0) & (det >= 0)))  # semidefinite

    def _differs_over_edges(self, surface: Ground) -> BoolArray:
        """Whether the actual ground gives other range intervals than its slope at the points; keeps those."""
        by_slope_m = self._range_half_m.copy()
        for point in range(self._on_ground):
            self._range_half_m[..., point] = self._range_half_over(surface, point)
        change_m = np.abs(self._range_half_m - by_slope_m)
        return np.asarray(np.any(~(change_m <= _MAX_WIDTH_CHANGE * self._range_half_m), axis=-1) & self.is_open)

    def _range_half_over(self, surface: Ground, point: int) -> FloatArray:
        """Half widths ``(n, g)`` of intervals of slant ranges of points by the ground around them.

        An interval spans all that a ray meets when it is off upwards, sideways or in heading, within 95 % of these
        errors, by angles that are always the same ones; it is infinite where a ray misses that is hardly farther off. A
        larger error has more of them within it and none less: what one of them refuses stays refused.
        """
        range_m, camera_m = self._range_m[..., point], self._view.poses.pose.position_enu_m
        away = (self._ground.points_enu_m[:, :, point] - self._camera_m) / range_m[..., None]
        near_m, far_m = range_m.copy(), range_m.copy()
        for axis, std_rad in self._ray_errors(point, away):
            offsets = np.abs(_OFFSETS_RAD) / std_rad[..., None]
            image, request, offset = np.nonzero(offsets <= LEAN_STDS)
            rotation_rad = _OFFSETS_RAD[offset, None] * axis[image, request]
            rays = rotate(matrix(from_rotation_vector(rotation_rad)), away[image, request])
            elevation_m = self._view.elevation_m[image, self._pixel_index[request, point]]
            found_m = surface.meet(camera_m[image], rays, elevation_m).range_m
            is_farther_off = offsets[image, request, offset] > Z95
            found_m = np.where(is_farther_off & np.isfinite(found_m), range_m[image, request], found_m)
            np.fmin.at(near_m, (image, request), found_m)
            np.maximum.at(far_m, (image, request), np.where(np.isnan(found_m), np.inf, found_m))
        return (far_m - near_m) / 2

    def _ray_errors(self, point: int, away: FloatArray) -> Iterable[tuple[FloatArray, FloatArray]]:
        """Axes ``(n, g, 3)`` in ENU about which rays turn upwards, sideways and in heading; stds of these angles."""
        range_m = self._range_m[..., point]
        level = np.hypot(away[..., 0], away[..., 1])
        sideways = np.stack([away[..., 1], -away[..., 0], np.zeros_like(level)], axis=-1) / level[..., None]
        sideways = np.where(level[..., None] > 0.0, sideways, [1.0, 0.0, 0.0])
        upwards = np.cross(sideways, away)
        up_std, side_std = (self._ray_std_m(point, move) / range_m for move in (upwards, sideways))
        heading_std = np.broadcast_to(self._view.poses.std[:, STD_NAMES.index("heading_rad"), None], level.shape)
        side_std = np.sqrt(np.maximum(side_std**2 - np.square(heading_std * level), 0.0))
        up = np.broadcast_to([0.0, 0.0, 1.0], away.shape)
        return (sideways, up_std), (upwards, side_std), (up, heading_std)

    def _ray_std_m(self, point: int, move: FloatArray) -> FloatArray:
        """Standard deviations ``(n, g)`` of where rays pass their points, along ``move (n, g, 3)`` across the rays."""
        ground = self._ground[:, :, point]
        jac_shared = np.einsum("ngi,ngis->ngs", move, ground.jac_shared)
        jac_shared[..., ELEVATION] = -move[..., 2]
        count = self._own_std_m.shape[-1]
        own = np.zeros((*move.shape[:2], count))
        own[..., point % max(count, 1) : point % max(count, 1) + 1] = -move[..., 2:]
        return self._std(jac_shared, np.einsum("ngi,ngij->ngj", move, ground.jac_px), own)

    def _draw_input(self, images: IntArray, requests: IntArray) -> DrawInput:
        view = self._view
        return DrawInput(
            kind=self.kind,
            pose=view.poses.pose,
            shared_cov=view.shared_cov,
            heading_std_rad=view.poses.std[:, STD_NAMES.index("heading_rad")],
            rays=_select_rays(view.rays, images[:, None], self._pixel_index[requests]),
            focal_px=view.focal_px,
            surface=view.setup.ground,
            image=images,
            elevation_m=view.elevation_m[images[:, None], self._pixel_index[requests]],
            elevation_std_m=self._elevation_std_m[requests],
            own_elevation_std_m=self._own_std_m[requests],
            std_px=self.std_px[requests],
        )

    def _refuse(self, selection: BoolArray, code: Status | Codes, reasons_of: ReasonsOf) -> None:
        """Set status and reasons of selected requests that are still open."""
        images, requests = np.nonzero(selection & self.is_open)
        if not len(images):
            return
        self.code[images, requests] = CODE_OF[code] if isinstance(code, Status) else code[images, requests]
        variants, variant_index = self._view.poses.variants, self._view.poses.variant_index
        for image, request, sentence in zip(
            images.tolist(), requests.tolist(), reasons_of(images, requests), strict=True
        ):
            self.reasons[request][image] = (sentence, *variants[variant_index[image]].reasons)

    def _say_no_ground(self, first: IntArray, images: IntArray, requests: IntArray) -> Iterable[str]:
        for image, request in zip(images.tolist(), requests.tolist(), strict=True):
            index = int(first[image, request])
            pixel = int(self._pixel_index[request, index])
            pixels = self._view.pixels_px
            u, v = pixels[pixel] if pixels.ndim == _SHARED_AXES else pixels[image, pixel]
            yield f"pixel {index} ({u:g}, {v:g}) {self._describe_miss(image, pixel)}"

    def _describe_miss(self, image: int, pixel: int) -> str:
        """Why a pixel shows no ground, as the end of a sentence."""
        view = self._view
        camera, surface, position = view.setup.camera, view.setup.ground, view.poses.pose.position_enu_m[image]
        status = CODES[view.ground.status[image, pixel]]
        if status is Status.ABOVE_HORIZON:
            below = math.degrees(float(view.ground.depression_rad[image, pixel]))
            if below > 0 and surface is not None:
                return f"looks {below:.1f} deg below the horizon, along ground that falls away as steeply"
            return f"looks {abs(below):.1f} deg above the horizon"
        if status is Status.BELOW_SURFACE:
            up_m, elevation_m = float(position[2]), float(view.elevation_m[image, pixel])
            if surface is not None:
                foot_m = float(surface.height_at(position[:2]))
                return f"is seen from {up_m - foot_m:.2f} m above the ground, measured is {elevation_m:.2f} m above it"
            return f"is seen from {up_m:.2f} m, measured is the plane at {elevation_m:.2f} m"
        return {
            Status.OUT_OF_IMAGE: f"is outside the image of {camera.width_px} x {camera.height_px} px",
            Status.BEYOND_TERRAIN: "looks past the border of the elevation model",
            Status.NO_ELEVATION: "looks over a hole in the elevation model",
        }.get(status, "is outside the valid radius of the lens model")

    def _say_beyond(self, images: IntArray, requests: IntArray) -> Iterable[str]:
        for ranges in self._range_m[images, requests]:
            farthest = int(np.argmax(ranges))
            limit = self._view.setup.max_range_m
            yield f"point {farthest} is {ranges[farthest]:.1f} m away, the limit is {limit:g} m"

    def _say_range(self, images: IntArray, requests: IntArray) -> Iterable[str]:
        """Reasons that name the most uncertain point, its range and the main cause."""
        index = np.argmax(self._range_half_m[images, requests] / self._range_m[images, requests], axis=-1)
        worst = images, requests, index
        pixel_var = self._vars[1][requests] * np.sum(np.square(self._range_jac_px[worst]), axis=-1)
        poses = self._view.poses.rows(images)
        own_std = self._view.own_elevation_std_m[self._pixel_index[requests, index]]
        elevation_var = np.square(self._range_jac_shared[worst][:, ELEVATION] * own_std)
        covs = self._cov_of(images, requests)
        budgets = variance_budgets(self._range_jac_shared[worst], (pixel_var, elevation_var), poses, covs, largest=1)
        numbers = (self._range_half_m[worst], self._ground.depression_rad[worst], self._range_m[worst])
        columns = [each.tolist() for each in (index, *numbers, poses.variant_index, poses.std)]
        for budget, point, half, below_rad, range_m, variant, stds in zip(budgets, *columns, strict=True):
            spread = f"+- {half:.0f} m (95 %)" if half < range_m else "and may be more than twice as far"
            where = f" is {math.degrees(below_rad):.1f} deg below the horizon" if below_rad < _GRAZING_RAD else ""
            cause = _main_cause(budget[0], poses.variants[variant], stds) if budget else "its error is not known"
            yield f"point {point}{where}, range {range_m:.0f} m {spread}: {cause}"

    def _cov_of(self, images: IntArray, requests: IntArray) -> FloatArray:
        """Covariances ``(r, s, s)`` of the errors that all points of a request share."""
        cov = self._view.shared_cov[images]
        cov[:, ELEVATION, ELEVATION] += self._vars[0][requests]
        return cov


def _reason(sentence: str, number: FloatArray | None = None) -> ReasonsOf:
    """Reasons by one sentence, formatted with a number ``(n, g)`` of each request if given."""
    if number is None:
        return lambda images, _: [sentence] * len(images)
    return lambda images, requests: [sentence.format(each) for each in number[images, requests].tolist()]


def _main_cause(first: Share, sample: PoseSample, stds: Sequence[float]) -> str:
    """Text on the largest part of the variance: its fraction, its input's standard deviation, and a remedy."""
    accuracy = ""
    if first.source in _STD_FIELDS:
        accuracy = f" (std {math.degrees(stds[STD_NAMES.index(_STD_FIELDS[first.source])]):.1f} deg)"
    elif first.source == "height":
        of = "" if sample.height_source is None else f" of {sample.height_source}"
        accuracy = f"{of} (std {stds[STD_NAMES.index('height_agl_m')]:.1f} m)"
    return f"{100 * first.share:.0f} % of the variance is from {first.source}{accuracy}; {first.remedy}"


def _select_rays(rays: PixelRays, images: IntArray | slice, pixel_index: IntArray) -> PixelRays:
    """Rays of pixels by their indices, in ``images`` where each image has pixels of its own."""
    parts = rays.rays_cam, rays.jac_px, rays.jac_intrinsics
    if rays.rays_cam.ndim == _SHARED_AXES:
        return PixelRays(*(part[pixel_index] for part in parts))
    return PixelRays(*(part[images, pixel_index] for part in parts))


def _directions(rays: PixelRays, pixel_index: IntArray, poses: PoseBatch) -> Directions:
    """Directions ``(n, g, q)`` in ENU of the rays of pixels by their indices."""
    directions = pixel_directions(_select_rays(rays, slice(None), pixel_index.ravel()), poses.pose)
    parts = (directions.directions_enu, directions.jac_shared, directions.jac_px)
    return Directions(*(part.reshape(len(poses), *pixel_index.shape, *part.shape[2:]) for part in parts))
