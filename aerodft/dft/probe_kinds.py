"""The registry of probe kinds: ``PROBE_KINDS``.

A kind is an entry, with a class where it has rules of its own: number of pixels, scalar with gradient, unit and
refusals. Configuration, requests, options and schemas follow from it.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, Protocol, TypeAlias

import numpy as np

from aerodft.dft.covariance import Z95
from aerodft.dft.quantities import (
    Gradient,
    RayGeometry,
    area_gradient,
    bearing,
    bearing_gradient,
    crosses_itself,
    ground_distance,
    height_gradient,
    lateral_offset,
    length_gradient,
    median_gradient,
    median_width,
    paper_bearing,
    paper_height,
    polygon_area,
    polyline_length,
    range_gradient,
    slant_range,
    smooth_lines,
    upright_height,
)
from aerodft.dft.silhouette import ObjectPoints
from aerodft.geometry import camera_angles
from aerodft.model import BoolArray, FloatArray, Pose, ProbeKind, ProjectionModel, Status

MAX_RELATIVE_RANGE_STD: Final = 0.3
"""Relative standard deviation of a slant range above which a point is ``ILL_CONDITIONED``."""

MAX_BEARING_STD_RAD: Final = 0.3
"""Standard deviation above which a bearing is ``ILL_CONDITIONED``."""

LEAN_STDS: Final = 2.6
"""Tilt error of the camera towards an object that must leave its height defined: more than the draws' 1.96."""

LEANING_STDS: Final = 6.0
"""An object that leans by more than 45 degrees has no height; by more than so many stds it is not upright either."""

_MAX_PIXELS: Final = 256

Elevations: TypeAlias = float | tuple[float, ...]
"""One value for all points, or several, which the points have in turn."""


@dataclass(frozen=True, slots=True, eq=False)
class Refusal:
    """Requests ``(n, g)`` to refuse, with status and reason.

    Attributes:
        where: ``(n, g)`` mask of the requests.
        status: Their status.
        sentence: Reason, with a format field for ``number`` if there is one.
        number: ``(n, g)`` number in the reason of each request.
    """

    where: BoolArray
    status: Status
    sentence: str
    number: FloatArray | None = None


class FirstOrder(Protocol):
    """First-order values of requests ``(n, g)`` of one kind, by which the kind refuses some.

    Attributes:
        geometry: Camera, rays and points of each request.
        value: ``(n, g)`` in SI units.
        std: ``(n, g)`` standard deviations of the values, by draws where these are needed.
        linear_std: ``(n, g)`` standard deviations of the values by first order alone.
        is_pinhole: Whether the model has rays; the paper's has none.
        ray_std_rad: ``(n, g)`` of the rays' angles to the vertical, by attitude, lens and pixels.
        slant: ``(n, g)`` largest ratio of slant range to height over the points that must lie on the ground.
        noise_m: ``(n, g)`` bound of the points' standard deviations by errors of their own.
    """

    geometry: RayGeometry
    value: FloatArray
    std: FloatArray
    linear_std: FloatArray
    is_pinhole: bool
    ray_std_rad: FloatArray
    slant: FloatArray
    noise_m: FloatArray

    @property
    def points_by_noise(self) -> FloatArray:
        """Changes ``(n, g, q, 3, e)`` of the points by one standard deviation of each of their own ``e`` errors."""
        ...

    @property
    def upper_limit(self) -> FloatArray:
        """Upper limits ``(n, g)`` of the 95 % intervals of the values."""
        ...

    def std_of(self, by: Gradient, *, pixels_alone: bool = False) -> FloatArray:
        """First-order standard deviations ``(n, g)`` of scalars from their gradients, by all errors or the pixels'."""
        ...


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Rules of one kind of probe.

    A kind that states scalar and gradient alone is measured rightly: what it does not say of second order and of the
    bias by pixel noise is taken from draws.

    Attributes:
        name: In configurations, requests and messages.
        pixels: Smallest and largest number of pixels.
        scalar: The value ``(...)`` in SI units; None for a position, which is not a scalar.
        gradient: Gradient of the scalar.
        in_pairs: Whether pixels come in pairs, each a line of its own.
        is_closed: Whether a line leads from the last pixel to the first.
        object_points: Points of an outlined object that it is measured at; None where an outline has no such points.
        quantity: What the value is, where the name does not say it.
        unit: Unit of the reported value.
        scale: Reported value over SI value.
        is_signed: Whether values may be negative; intervals of other kinds end at 0.
        is_angle: Whether values are equal modulo a whole turn.
        sees_rays: Whether the scalar depends on directions of rays, not on points alone.
        may_be_unbounded: Whether an interval may be infinite where the points are known.
    """

    name: ProbeKind
    pixels: tuple[int, int]
    scalar: Callable[[RayGeometry], FloatArray] | None
    gradient: Callable[[RayGeometry], Gradient] | None
    in_pairs: bool = False
    is_closed: bool = False
    object_points: ObjectPoints | None = None
    quantity: str = ""
    unit: str = "m"
    scale: float = 1.0
    is_signed: bool = False
    is_angle: bool = False
    sees_rays: bool = False
    may_be_unbounded: bool = False

    @property
    def pixels_wanted(self) -> str:
        """Number of pixels of a probe of this kind, as text."""
        least, most = self.pixels
        return (str(least) if least == most else f"{least} to {most}") + (", an even number" if self.in_pairs else "")

    def takes_pixels(self, count: int) -> bool:
        """Whether a probe of this kind can have ``count`` pixels."""
        return self.pixels[0] <= count <= self.pixels[1] and not (self.in_pairs and count % 2)

    def takes_elevations(self, elevations: int, count: int) -> bool:
        """Whether a probe of this kind with ``count`` pixels can have so many elevations; 0 is one for all points."""
        return elevations in {0, self.on_ground(count), *((2,) if self.in_pairs else ())}

    def elevations_wanted(self, count: int) -> str:
        """Numbers of elevations of a probe of this kind with ``count`` pixels, as text."""
        points = self.on_ground(count)
        several = f"{'2 (left, right) or ' * (self.in_pairs and points > 2)}{points}, one for each point"  # noqa: PLR2004
        return f"one elevation, or {several}" if points > 1 else "one elevation"

    def wrong_elevations(self, elevation_m: Elevations, std_m: Elevations, count: int) -> str:
        """What is wrong with the elevations of a probe with ``count`` pixels, as text; empty where nothing is."""
        lengths = [len(each) for each in (elevation_m, std_m) if isinstance(each, tuple)]
        if len(set(lengths)) > 1:
            return f"{lengths[0]} elevations and {lengths[1]} standard deviations"
        stated = max(lengths, default=1)
        is_right = stated > 0 and self.takes_elevations(stated if stated > 1 else 0, count)
        return "" if is_right else f"{stated} elevations"

    def on_ground(self, count: int) -> int:
        """Number of points, of ``count`` from the first on, that must lie on the ground."""
        return count

    def lines(self, count: int) -> list[slice]:
        """Which of ``count`` points each line leads through, without its way back to the first."""
        return [slice(first, first + 2) for first in range(0, count - 1, 2)] if self.in_pairs else [slice(count)]

    def reported_points(self, points_enu_m: FloatArray, value: FloatArray) -> FloatArray:  # noqa: ARG002 - for others
        """Points ``(n, g, q, 3)`` reported with the values, from the ground points of the pixels."""
        return points_enu_m

    def undefined(self, points_enu_m: FloatArray) -> tuple[BoolArray, Status, str] | None:  # noqa: ARG002 - as above
        """Requests whose points ``(..., k, 3)`` have no value, whatever the errors; their status and the reason."""
        return None

    def second_order(self, first: FirstOrder) -> FloatArray:
        """Bound ``(n, g)`` of the second-order term of the values over level ground; infinite where unknown.

        An angle error ``a`` moves a point at the slant range ``r`` below the height ``h`` by the fraction ``a r / h``
        of the range to first order, and by its square to second order.
        """
        return np.full(first.value.shape, np.inf)

    def noise_bias(self, first: FirstOrder) -> FloatArray:
        """Bound ``(n, g)`` of the mean change of the values by pixel noise; where it matters, draws say the change.

        Infinite where unknown. Noise lengthens lines, because offsets across a segment to either side do.
        """
        return np.full(first.value.shape, np.inf)

    def denoised(self, pixels_px: FloatArray, std_px: FloatArray) -> FloatArray:
        """Pixels ``(p, q, 2)`` nearer to the true ones, about which the mean change by noise ``(p,)`` is drawn."""
        return smooth_lines(pixels_px, std_px)

    def refusals(self, first: FirstOrder) -> Iterator[Refusal]:  # noqa: ARG002 - as above
        """Refusals of requests whose points are known well enough, in order of precedence."""
        yield from ()

    def by_paper(
        self,
        geometry: RayGeometry,
        heading_rad: FloatArray,  # noqa: ARG002 - for others
        elevation_m: FloatArray,  # noqa: ARG002
    ) -> tuple[FloatArray, Gradient]:
        """Values and gradients by the paper's equations, for kinds that depend on rays.

        Args:
            geometry: Camera and points.
            heading_rad: ``(...)`` of the camera.
            elevation_m: ``(...)`` of the ground.
        """
        return self.values(geometry)

    def values(self, geometry: RayGeometry) -> tuple[FloatArray, Gradient]:
        """Values ``(...)`` in SI units and gradients, of a kind that has a scalar."""
        assert self.scalar is not None  # noqa: S101 - the callers' own condition, for the type checker
        assert self.gradient is not None  # noqa: S101
        return self.scalar(geometry), self.gradient(geometry)


class _UnbiasedKind(Kind):
    """A kind whose values pixel noise changes by a negligible mean, or by one that its interval holds."""

    def noise_bias(self, first: FirstOrder) -> FloatArray:
        return np.zeros(first.value.shape)


class _Range(_UnbiasedKind):
    def second_order(self, first: FirstOrder) -> FloatArray:
        return np.asarray(first.value * np.square(first.ray_std_rad * first.slant))


class _Length(Kind):
    """A length of one or more segments: noise across a segment makes it longer."""

    def noise_bias(self, first: FirstOrder) -> FloatArray:
        points_m = first.geometry.points_enu_m
        if points_m.shape[-2] <= 2:  # noqa: PLR2004 - the interval of one segment holds its bias
            return np.zeros(first.value.shape)
        return _lengthening(points_m, first.points_by_noise)

    def second_order(self, first: FirstOrder) -> FloatArray:
        steps = first.geometry.points_enu_m.shape[-2] - 1
        noise_bias_m = np.square(steps * first.noise_m) / first.value
        return np.asarray(2 * first.value * np.square(first.ray_std_rad * first.slant) + noise_bias_m)


class _Area(_UnbiasedKind):
    def second_order(self, first: FirstOrder) -> FloatArray:
        corners = first.geometry.points_enu_m.shape[-2]
        nonlinear = 4 * first.value * np.square(first.ray_std_rad * first.slant)
        return np.asarray(nonlinear + corners * np.square(first.noise_m))

    def undefined(self, points_enu_m: FloatArray) -> tuple[BoolArray, Status, str]:
        sentence = "the polygon crosses or touches itself; name its corners in order, each once"
        return crosses_itself(points_enu_m), Status.SELF_CROSSING, sentence


class _UprightHeight(_UnbiasedKind):
    """Base, then top; the top is measured on the vertical through the base and may be above the horizon."""

    def on_ground(self, count: int) -> int:  # noqa: ARG002 - for others
        return 1

    def reported_points(self, points_enu_m: FloatArray, value: FloatArray) -> FloatArray:
        points_m = np.stack([points_enu_m[..., 0, :]] * 2, axis=-2)  # the top above the base
        points_m[..., 1, 2] += value
        return points_m

    def second_order(self, first: FirstOrder) -> FloatArray:
        # The nearer base and top are to the camera's foot, the larger the errors of their azimuths.
        relative = first.ray_std_rad * np.maximum(first.slant, _max_cosecant(first.geometry))
        return np.asarray((3 * np.abs(first.value) * relative + first.std) * relative)

    def refusals(self, first: FirstOrder) -> Iterator[Refusal]:
        """Uncertain heights, tops below the base, and tops beside the vertical through the base."""
        value, geometry = np.abs(first.value), first.geometry
        size = geometry.camera_enu_m[..., 2] - geometry.points_enu_m[..., 0, 2]
        limit = MAX_RELATIVE_RANGE_STD * np.fmax(size, value)
        uncertain = ~(first.linear_std <= limit) | ~np.isfinite(first.value + first.std)
        if first.is_pinhole:
            uncertain |= _std_by_lean(first) > limit
        sentence = "the object is seen from above: its height may be anything"
        yield Refusal(uncertain, Status.ILL_CONDITIONED, sentence)
        # Whether base and top fit together is decided without the errors, which say the status alone: what is refused
        # stays refused when an error grows.
        below, below_m = ~(first.value >= 0), -first.value
        sentence = "the top is seen {:.2f} m below the base; the base comes first, then the top"
        yield Refusal(below & ~(first.upper_limit >= 0), Status.NOT_UPRIGHT, sentence, below_m)
        sentence = "the top is seen {:.2f} m below the base, within the errors: mark a taller object, or more precisely"
        yield Refusal(below, Status.ILL_CONDITIONED, sentence, below_m)
        if first.is_pinhole:  # Eq. 8 does not look at columns
            offset_m, by = lateral_offset(geometry)
            offset_m = np.abs(offset_m)
            leans = offset_m > value
            sentence = "the top is seen {:.2f} m beside the vertical through the base: base and top of one object?"
            yield Refusal(leans & (offset_m > LEANING_STDS * first.std_of(by)), Status.NOT_UPRIGHT, sentence, offset_m)
            sentence = "the top is seen {:.2f} m beside the base and less above it, by the errors: mark a taller object"
            yield Refusal(leans, Status.ILL_CONDITIONED, sentence, offset_m)

    def by_paper(
        self, geometry: RayGeometry, heading_rad: FloatArray, elevation_m: FloatArray
    ) -> tuple[FloatArray, Gradient]:
        return paper_height(geometry, heading_rad, elevation_m)


class _Bearing(_UnbiasedKind):
    """Azimuth of one pixel's ray, whether or not it meets the ground, or from the first point to the second."""

    def on_ground(self, count: int) -> int:
        return 0 if count == 1 else count

    def reported_points(self, points_enu_m: FloatArray, value: FloatArray) -> FloatArray:  # noqa: ARG002 - for others
        return points_enu_m[:, :, :0] if points_enu_m.shape[2] == 1 else points_enu_m

    def second_order(self, first: FirstOrder) -> FloatArray:
        if first.geometry.points_enu_m.shape[-2] == 1:
            return np.square(first.ray_std_rad * _max_cosecant(first.geometry))
        distance_m = ground_distance(first.geometry)
        return np.asarray(2 * np.square(first.ray_std_rad * first.slant) + np.square(first.noise_m / distance_m))

    def refusals(self, first: FirstOrder) -> Iterator[Refusal]:
        half_rad = Z95 * first.linear_std
        if first.is_pinhole:
            half_rad = np.fmax(half_rad, _half_by_length(first))
        uncertain = ~(half_rad <= Z95 * MAX_BEARING_STD_RAD) | ~np.isfinite(first.std)
        half_deg = np.where(np.isfinite(half_rad), np.minimum(np.degrees(half_rad), 180.0), 180.0)
        sentence = "the direction is known to +- {:.0f} deg (95 %)"
        yield Refusal(uncertain, Status.ILL_CONDITIONED, sentence, half_deg)

    def by_paper(
        self,
        geometry: RayGeometry,
        heading_rad: FloatArray,  # noqa: ARG002 - for others
        elevation_m: FloatArray,  # noqa: ARG002
    ) -> tuple[FloatArray, Gradient]:
        return paper_bearing(geometry)


def _lengthening(points_m: FloatArray, points_by_noise: FloatArray) -> FloatArray:
    """Mean change ``(n, g)`` by noise of the lengths of lines, to second order.

    Offsets of variance ``v`` across a segment of length ``s`` make it longer by ``v / (2 s)``.

    Args:
        points_m: ``(n, g, q, 3)`` vertices.
        points_by_noise: ``(n, g, q, 3, e)`` their changes by one standard deviation of each of their own errors.
    """
    steps = np.diff(points_m[..., :2], axis=2)
    length = np.hypot(steps[..., 0], steps[..., 1])
    across = np.stack([-steps[..., 1], steps[..., 0]], axis=-1) / length[..., None]
    noise = points_by_noise[..., :2, :]
    ends = [np.einsum("ngsi,ngsij->ngsj", across, each) for each in (noise[:, :, :-1], noise[:, :, 1:])]
    across_var = np.sum(np.square(ends), axis=(0, -1))
    return np.asarray(np.sum(across_var / (2 * length), axis=-1))


def _half_by_length(first: FirstOrder) -> FloatArray:
    """Half widths ``(n, g)`` of 95 % intervals of bearings whose horizontal length is uncertain too.

    Between the tangents to the 95 % ellipse of its end, taken upright; half a turn where it may reach the beginning:
    that of two points by errors of their pixels alone, what they share moves both. It grows with every error, which
    drawn intervals do not near a limit.
    """
    by = bearing_gradient(first.geometry)
    parts = (by.by_camera, by.by_directions, by.by_points)  # the logarithm of the length grows a quarter turn beside
    length = Gradient(*(np.stack([-each[..., 1], each[..., 0], each[..., 2]], axis=-1) for each in parts))
    is_pair = first.geometry.points_enu_m.shape[-2] > 1
    rest = 1 - np.square(Z95 * first.std_of(length, pixels_alone=is_pair))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(rest > 0, np.arctan(Z95 * first.linear_std / np.sqrt(rest)), np.pi)


def _std_by_lean(first: FirstOrder) -> FloatArray:
    """Standard deviations ``(n, g)`` of heights of upright objects by tilt errors towards the object alone.

    Sideways errors move the camera's foot away from the object, which makes heights look more certain; tilt errors
    towards it do not. Infinite where such an error may put the foot under base or top.
    """
    geometry = first.geometry
    sight, ray = geometry.points_enu_m[..., 0, :] - geometry.camera_enu_m, geometry.directions_enu[..., 1, :]
    horizontal_m, down_m = np.hypot(sight[..., 0], sight[..., 1]), -sight[..., 2]
    none, level = np.zeros(geometry.directions_enu.shape), [1.0, 1.0, 0.0]
    with np.errstate(divide="ignore", invalid="ignore"):
        outwards = sight * level / horizontal_m[..., None]
        ray_outwards = np.sum(ray * outwards, axis=-1)
        by_base, by_top, by_directions = none.copy(), none.copy(), none.copy()
        by_base[..., 0, :] = outwards
        by_top[..., 0, :] = (ray * level - ray_outwards[..., None] * outwards) / horizontal_m[..., None]
        by_directions[..., 1, :] = outwards
        std_rad = first.std_of(Gradient(-outwards, none, by_base)) * down_m / np.sum(np.square(sight), axis=-1)
        may_cross = ray_outwards <= LEAN_STDS * first.std_of(Gradient(-by_top[..., 0, :], by_directions, by_top))
        base_rad, top_rad = np.arctan2(horizontal_m, down_m), np.arctan2(ray_outwards, -ray[..., 2])
        ends_m = [
            down_m * (1 - np.tan(base_rad + lean) / np.tan(top_rad + lean))
            for lean in (-LEAN_STDS * std_rad, LEAN_STDS * std_rad)
        ]
        std = np.abs(ends_m[1] - ends_m[0]) / (2 * LEAN_STDS)
        return np.where((np.minimum(base_rad, top_rad) <= LEAN_STDS * std_rad) | may_cross, np.inf, std)


def _max_cosecant(geometry: RayGeometry) -> FloatArray:
    """Largest cosecant ``(n, g)`` of the rays' angles to the vertical; infinite straight down."""
    directions = geometry.directions_enu
    level = np.square(directions[..., 0]) + np.square(directions[..., 1])
    return np.asarray(np.sqrt(1 + np.max(np.square(directions[..., 2]) / level, axis=-1)))


_ONE, _TWO = (1, 1), (2, 2)

# To first order only pixel errors along the vertical change ranges and heights, and only errors across it bearings.
PROBE_KINDS: Final[dict[ProbeKind, Kind]] = {
    kind.name: kind
    for kind in (
        Kind(
            name=ProbeKind.POSITION,
            pixels=_ONE,
            scalar=None,
            gradient=None,
            object_points=ObjectPoints(foot=True, errs_in_depth=True, errs_sideways=True),
        ),
        _Range(
            name=ProbeKind.RANGE,
            pixels=_ONE,
            scalar=slant_range,
            gradient=range_gradient,
            object_points=ObjectPoints(foot=True, errs_in_depth=True),
        ),
        _Length(name=ProbeKind.DISTANCE, pixels=_TWO, scalar=ground_distance, gradient=length_gradient),
        _Length(
            name=ProbeKind.WIDTH,
            pixels=_TWO,
            scalar=ground_distance,
            gradient=length_gradient,
            object_points=ObjectPoints(sides=True, errs_in_depth=True),
        ),
        _Length(name=ProbeKind.LENGTH, pixels=(2, _MAX_PIXELS), scalar=polyline_length, gradient=length_gradient),
        _Area(
            name=ProbeKind.AREA,
            pixels=(3, _MAX_PIXELS),
            scalar=polygon_area,
            gradient=area_gradient,
            is_closed=True,
            object_points=ObjectPoints(contour=True),
            unit="m2",
        ),
        _UprightHeight(
            name=ProbeKind.HEIGHT,
            pixels=_TWO,
            scalar=upright_height,
            gradient=height_gradient,
            object_points=ObjectPoints(foot=True, top=True, errs_in_depth=True),
            is_signed=True,
            sees_rays=True,
            may_be_unbounded=True,  # its base is known: from above
        ),
        _Bearing(
            name=ProbeKind.BEARING,
            pixels=(1, 2),
            scalar=bearing,
            gradient=bearing_gradient,
            object_points=ObjectPoints(foot=True, errs_sideways=True),
            unit="deg",
            scale=math.degrees(1.0),
            is_signed=True,
            is_angle=True,
            sees_rays=True,
        ),
        _UnbiasedKind(  # pairs as near as some pixels are no banks
            name=ProbeKind.RIVER,
            pixels=(2, _MAX_PIXELS),
            scalar=median_width,
            gradient=median_gradient,
            in_pairs=True,
            quantity="width",
        ),
    )
}
"""Every kind of probe by name."""

_UNKNOWN_KIND: Final = Kind(name=ProbeKind(""), pixels=(0, _MAX_PIXELS), scalar=None, gradient=None, unit="")


def recorded_kind(name: str) -> Kind:
    """The kind of a recorded measurement; one of single points or an open line where nobody here knows its name."""
    return PROBE_KINDS.get(ProbeKind(name), _UNKNOWN_KIND)


def scalars(
    kind: Kind, model: ProjectionModel, geometry: RayGeometry, pose: Pose, elevation_m: FloatArray
) -> tuple[FloatArray, Gradient]:
    """Values ``(...)`` of probes in SI units and gradients, of a kind that has a scalar, under either model.

    Args:
        kind: Kind of the probes.
        model: Projection model; the paper has equations of its own for kinds that depend on rays.
        geometry: Of each probe; directions only for kinds that see rays under the pinhole model.
        pose: One pose, or ``(n,)`` for geometry ``(n, g)``.
        elevation_m: ``(...)`` of the measured surfaces.
    """
    if model is not ProjectionModel.DFT:
        return kind.values(geometry)
    _, _, heading = camera_angles(pose.wxyz)
    return kind.by_paper(geometry, heading[:, None] if heading.ndim else heading, elevation_m)
