"""What can be asked of pixels: one entry of ``PROBE_KINDS`` for each kind of probe.

A new kind is an entry, or a class where it has a rule of its own: how many pixels it takes, what its points amount to
and how that depends on them, its unit, and what it refuses. Configuration, requests, options and schemas follow.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, Protocol

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
    upright_height,
)
from aerodft.geometry import camera_angles
from aerodft.model import BoolArray, FloatArray, Pose, ProbeKind, ProjectionModel, Status

MAX_RELATIVE_RANGE_STD: Final = 0.3
"""A point whose slant range is less certain than this is ``ILL_CONDITIONED``."""

MAX_BEARING_STD_RAD: Final = 0.3
"""A direction that is less certain than this is ``ILL_CONDITIONED``."""

LEAN_STDS: Final = 2.2
"""By which a camera may lean to an object: a little more than 1.96, so that this decides before draws do."""

LEANING_STDS: Final = 6.0
"""What leans by more than 45 degrees, and by more than so many standard deviations, is no upright object."""

_MOST_PIXELS: Final = 256


@dataclass(frozen=True, slots=True, eq=False)
class Refusal:
    """Requests ``(n, g)`` that have no answer.

    Attributes:
        where: ``(n, g)`` which.
        status: Their status.
        sentence: Why, with a place for ``number`` where there is one.
        number: ``(n, g)`` what the sentence says of each.
    """

    where: BoolArray
    status: Status
    sentence: str
    number: FloatArray | None = None


class FirstOrder(Protocol):
    """What requests ``(n, g)`` of one kind come to: what a kind decides by whether that is an answer.

    Attributes:
        geometry: Camera, rays and points of each.
        value: ``(n, g)`` in SI units.
        std: ``(n, g)`` standard deviations of the values.
        is_pinhole: Whether rays are known; the paper's model has none.
        ray_std_rad: ``(n, g)`` of the rays against the vertical, by lean, lens and pixels.
        slant: ``(n, g)`` the largest slant range over height of the points that have to lie on the ground.
        noise_m: ``(n, g)`` no point's pixel moves it by a larger standard deviation.
    """

    geometry: RayGeometry
    value: FloatArray
    std: FloatArray
    is_pinhole: bool
    ray_std_rad: FloatArray
    slant: FloatArray
    noise_m: FloatArray

    @property
    def highest(self) -> FloatArray:
        """Upper ends ``(n, g)`` of the 95 % intervals of the values."""
        ...

    def std_of(self, by: Gradient) -> FloatArray:
        """Standard deviations ``(n, g)`` of scalars with these derivatives."""
        ...


@dataclass(frozen=True, kw_only=True)
class Kind:
    """How probes of one kind are measured.

    Attributes:
        name: In configurations, requests and messages.
        pixels: The least and the most pixels.
        scalar: The number ``(...)`` that is asked for, in SI units; None for a position, which is no one number.
        gradient: Its derivatives.
        in_pairs: Whether pixels come in pairs.
        unit: Of the number as it is said.
        scale: What an SI value is multiplied with for that.
        is_signed: Whether values may be negative; no other interval reaches below 0.
        is_angle: Whether values a whole turn apart are one.
        sees_rays: Whether the number depends on directions of rays, not on points alone.
        may_be_unbounded: Whether an interval that reaches to infinity is no reason to refuse points that are known.
    """

    name: ProbeKind
    pixels: tuple[int, int]
    scalar: Callable[[RayGeometry], FloatArray] | None
    gradient: Callable[[RayGeometry], Gradient] | None
    in_pairs: bool = False
    unit: str = "m"
    scale: float = 1.0
    is_signed: bool = False
    is_angle: bool = False
    sees_rays: bool = False
    may_be_unbounded: bool = False

    @property
    def pixels_wanted(self) -> str:
        """How many pixels a probe of this kind has, for people."""
        least, most = self.pixels
        return (str(least) if least == most else f"{least} to {most}") + (", an even number" if self.in_pairs else "")

    def takes_pixels(self, count: int) -> bool:
        """Whether a probe of this kind can have so many pixels."""
        return self.pixels[0] <= count <= self.pixels[1] and not (self.in_pairs and count % 2)

    def on_ground(self, count: int) -> int:
        """How many of so many points, from the first, have to lie on the ground."""
        return count

    def shown(self, points_enu_m: FloatArray, value: FloatArray) -> FloatArray:  # noqa: ARG002 - others need it
        """``(n, g, q, 3)`` the points that come with the values, of those where the pixels meet the ground."""
        return points_enu_m

    def blocked(self, points_enu_m: FloatArray) -> tuple[BoolArray, Status, str] | None:  # noqa: ARG002 - as above
        """Which points ``(..., k, 3)`` can have no answer, however small the errors, its status, and why; or None."""
        return None

    def second_order(self, found: FirstOrder) -> FloatArray:
        """``(n, g)`` what second order adds to the values at most, over level ground; infinite where that is not known.

        An angle that is off by ``a`` moves a point at the slant range ``r``, seen from the height ``h``, by ``a r / h``
        of its range, and by the square of that beyond first order.
        """
        return np.full(found.value.shape, np.inf)

    def refusals(self, found: FirstOrder) -> Iterator[Refusal]:  # noqa: ARG002 - as above
        """What has no answer although its points are known well enough, in the order in which it is said."""
        yield from ()

    def by_paper(
        self,
        geometry: RayGeometry,
        heading_rad: FloatArray,  # noqa: ARG002 - others need it
        elevation_m: FloatArray,  # noqa: ARG002
    ) -> tuple[FloatArray, Gradient]:
        """Values and derivatives by the paper's equations, where these look at more than points.

        Args:
            geometry: Camera and points.
            heading_rad: ``(...)`` of the camera.
            elevation_m: ``(...)`` of the ground.
        """
        return self.values(geometry)

    def values(self, geometry: RayGeometry) -> tuple[FloatArray, Gradient]:
        """Values ``(...)`` in SI units, without errors, and their derivatives; of a kind that has a scalar."""
        assert self.scalar is not None  # noqa: S101 - the callers' own condition, for the type checker
        assert self.gradient is not None  # noqa: S101
        return self.scalar(geometry), self.gradient(geometry)


class _Range(Kind):
    def second_order(self, found: FirstOrder) -> FloatArray:
        return np.asarray(found.value * np.square(found.ray_std_rad * found.slant))


class _Length(Kind):
    """Of one step or of several: across each, noise makes it longer."""

    def second_order(self, found: FirstOrder) -> FloatArray:
        steps = found.geometry.points_enu_m.shape[-2] - 1
        longer_m = np.square(steps * found.noise_m) / found.value
        return np.asarray(2 * found.value * np.square(found.ray_std_rad * found.slant) + longer_m)


class _Area(Kind):
    def second_order(self, found: FirstOrder) -> FloatArray:
        corners = found.geometry.points_enu_m.shape[-2]
        bent = 4 * found.value * np.square(found.ray_std_rad * found.slant)
        return np.asarray(bent + corners * np.square(found.noise_m))

    def blocked(self, points_enu_m: FloatArray) -> tuple[BoolArray, Status, str]:
        sentence = "the polygon crosses or touches itself; name its corners in order, each once"
        return crosses_itself(points_enu_m), Status.SELF_CROSSING, sentence


class _UprightHeight(Kind):
    """Base, then top: the top is measured against the vertical through the base, and may be above the horizon."""

    def on_ground(self, count: int) -> int:  # noqa: ARG002 - other kinds need it
        return 1

    def shown(self, points_enu_m: FloatArray, value: FloatArray) -> FloatArray:
        shown_m = np.stack([points_enu_m[..., 0, :]] * 2, axis=-2)  # the top above the base
        shown_m[..., 1, 2] += value
        return shown_m

    def second_order(self, found: FirstOrder) -> FloatArray:
        # The nearer base and top are to the camera's foot, the more their directions turn.
        share = found.ray_std_rad * np.maximum(found.slant, _outwards(found.geometry))
        return np.asarray((3 * np.abs(found.value) * share + found.std) * share)

    def refusals(self, found: FirstOrder) -> Iterator[Refusal]:
        """What is not base and top of an upright object whose height can be told."""
        value, geometry = np.abs(found.value), found.geometry
        size = geometry.camera_enu_m[..., 2] - geometry.points_enu_m[..., 0, 2]
        limit = MAX_RELATIVE_RANGE_STD * np.fmax(size, value)
        uncertain = ~(found.std <= limit) | ~np.isfinite(found.value)
        if found.is_pinhole:
            uncertain |= _leaning_std(found) > limit
        sentence = "the object is seen from above: its height may be anything"
        yield Refusal(uncertain, Status.ILL_CONDITIONED, sentence)
        sentence = "the top is seen {:.2f} m below the base; the base comes first, then the top"
        yield Refusal(~(found.highest >= 0), Status.NOT_UPRIGHT, sentence, -found.value)
        if found.is_pinhole:  # Eq. 8 does not look at columns
            aside_m, by = lateral_offset(geometry)
            most_m = np.maximum(value, LEANING_STDS * found.std_of(by))
            sentence = "the top is seen {:.2f} m beside the vertical through the base: base and top of one object?"
            yield Refusal(np.abs(aside_m) > most_m, Status.NOT_UPRIGHT, sentence, np.abs(aside_m))

    def by_paper(
        self, geometry: RayGeometry, heading_rad: FloatArray, elevation_m: FloatArray
    ) -> tuple[FloatArray, Gradient]:
        return paper_height(geometry, heading_rad, elevation_m)


class _Bearing(Kind):
    """Of one pixel's ray, whether it meets the ground or not, or from the first point to the second."""

    def on_ground(self, count: int) -> int:
        return 0 if count == 1 else count

    def shown(self, points_enu_m: FloatArray, value: FloatArray) -> FloatArray:  # noqa: ARG002 - other kinds need it
        return points_enu_m[:, :, :0] if points_enu_m.shape[2] == 1 else points_enu_m

    def second_order(self, found: FirstOrder) -> FloatArray:
        if found.geometry.points_enu_m.shape[-2] == 1:
            return np.square(found.ray_std_rad * _outwards(found.geometry))
        apart_m = ground_distance(found.geometry)
        return np.asarray(2 * np.square(found.ray_std_rad * found.slant) + np.square(found.noise_m / apart_m))

    def refusals(self, found: FirstOrder) -> Iterator[Refusal]:
        half_deg = np.where(np.isfinite(found.std), np.minimum(np.degrees(Z95 * found.std), 180.0), 180.0)
        sentence = "the direction is known to +- {:.0f} deg (95 %)"
        yield Refusal(~(found.std <= MAX_BEARING_STD_RAD), Status.ILL_CONDITIONED, sentence, half_deg)

    def by_paper(
        self,
        geometry: RayGeometry,
        heading_rad: FloatArray,  # noqa: ARG002 - others need it
        elevation_m: FloatArray,  # noqa: ARG002
    ) -> tuple[FloatArray, Gradient]:
        return paper_bearing(geometry)


def _leaning_std(found: FirstOrder) -> FloatArray:
    """Standard deviations ``(n, g)`` of heights of upright objects by leans towards them and back alone.

    Errors to the side take the camera's foot away from the object, which makes heights look better known; these leave
    it where it is. Infinite where such a lean may put the foot under base or top.
    """
    geometry = found.geometry
    away = geometry.points_enu_m[..., 0, :] - geometry.camera_enu_m
    off_m, down_m = np.hypot(away[..., 0], away[..., 1]), -away[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        outwards = away * [1.0, 1.0, 0.0] / off_m[..., None]
        by_points = np.zeros(geometry.points_enu_m.shape)
        by_points[..., 0, :] = outwards
        std_m = found.std_of(Gradient(-outwards, np.zeros(geometry.directions_enu.shape), by_points))
        std_rad = std_m * down_m / (np.square(down_m) + np.square(off_m))
        ray = geometry.directions_enu[..., 1, :]
        base_rad = np.arctan2(off_m, down_m)
        top_rad = np.arctan2(np.sum(ray * outwards, axis=-1), -ray[..., 2])
        ends_m = [
            down_m * (1 - np.tan(base_rad + lean) / np.tan(top_rad + lean))
            for lean in (-LEAN_STDS * std_rad, LEAN_STDS * std_rad)
        ]
        spread = np.abs(ends_m[1] - ends_m[0]) / (2 * LEAN_STDS)
        return np.where(np.minimum(base_rad, top_rad) <= LEAN_STDS * std_rad, np.inf, spread)


def _outwards(geometry: RayGeometry) -> FloatArray:
    """``(n, g)`` the largest of the rays' lengths over their horizontal parts: infinite straight down."""
    away = geometry.directions_enu
    level = np.square(away[..., 0]) + np.square(away[..., 1])
    return np.asarray(np.sqrt(1 + np.max(np.square(away[..., 2]) / level, axis=-1)))


_ONE, _TWO = (1, 1), (2, 2)

PROBE_KINDS: Final[dict[ProbeKind, Kind]] = {
    kind.name: kind
    for kind in (
        Kind(name=ProbeKind.POSITION, pixels=_ONE, scalar=None, gradient=None),
        _Range(name=ProbeKind.RANGE, pixels=_ONE, scalar=slant_range, gradient=range_gradient),
        _Length(name=ProbeKind.DISTANCE, pixels=_TWO, scalar=ground_distance, gradient=length_gradient),
        _Length(name=ProbeKind.WIDTH, pixels=_TWO, scalar=ground_distance, gradient=length_gradient),
        _Length(name=ProbeKind.LENGTH, pixels=(2, _MOST_PIXELS), scalar=polyline_length, gradient=length_gradient),
        _Area(name=ProbeKind.AREA, pixels=(3, _MOST_PIXELS), scalar=polygon_area, gradient=area_gradient, unit="m2"),
        _UprightHeight(
            name=ProbeKind.HEIGHT,
            pixels=_TWO,
            scalar=upright_height,
            gradient=height_gradient,
            is_signed=True,
            sees_rays=True,
            may_be_unbounded=True,  # its base is known: from above
        ),
        _Bearing(
            name=ProbeKind.BEARING,
            pixels=(1, 2),
            scalar=bearing,
            gradient=bearing_gradient,
            unit="deg",
            scale=math.degrees(1.0),
            is_signed=True,
            is_angle=True,
            sees_rays=True,
        ),
        Kind(
            name=ProbeKind.RIVER,
            pixels=(2, _MOST_PIXELS),
            scalar=median_width,
            gradient=median_gradient,
            in_pairs=True,
        ),
    )
}
"""Every kind that can be asked for, by name."""


def scalars(
    kind: Kind, model: ProjectionModel, geometry: RayGeometry, pose: Pose, elevation_m: FloatArray
) -> tuple[FloatArray, Gradient]:
    """Values ``(...)`` of probes of a kind that has a scalar, in SI units and without errors, and their derivatives.

    Args:
        kind: What is measured.
        model: The paper's has equations of its own for what looks at rays.
        geometry: What is seen of each; directions only for kinds that see rays under the pinhole model.
        pose: One pose, or ``(n,)`` of sights ``(n, g)``.
        elevation_m: ``(...)`` of the measured surfaces.
    """
    if model is not ProjectionModel.DFT:
        return kind.values(geometry)
    _, _, heading = camera_angles(pose.wxyz)
    return kind.by_paper(geometry, heading[:, None] if heading.ndim else heading, elevation_m)
