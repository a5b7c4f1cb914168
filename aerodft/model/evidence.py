"""What people know about a scene, from which a camera's pose and lens are found: the input of a calibration.

World coordinates are metres east, north and up in one local frame; the camera's height counts from its zero.
"""

from dataclasses import dataclass, field
from typing import TypeAlias

Px = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Observed:
    """One observation.

    Attributes:
        name: For messages.
        std_px: Of each pixel coordinate; of a horizon's pixels across it.
    """

    name: str
    std_px: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Landmark(_Observed):
    """A pixel and its place in the world.

    Attributes:
        pixel: ``(u, v)``.
        position_m: East, north, up; None for a component that is not known (one at most).
        std_m: Of each component.
    """

    pixel: Px
    position_m: tuple[float | None, float | None, float | None]
    std_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SlantRange(_Observed):
    """A pixel on the ground and its distance from the camera, as from a laser rangefinder."""

    pixel: Px
    range_m: float
    std_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundPoint(_Observed):
    """A pixel on the ground and its place to the right and ahead of the camera's foot."""

    pixel: Px
    xy_m: tuple[float, float]
    std_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownLength(_Observed):
    """Two pixels and their distance on the map, ``elevation_m`` above the ground."""

    pixels: tuple[Px, Px]
    length_m: float
    elevation_m: float = 0.0
    std_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownHeight(_Observed):
    """Base and top of an upright object on the ground, and its height."""

    base: Px
    top: Px
    height_m: float
    std_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Vertical(_Observed):
    """Two pixels of one vertical line."""

    pixels: tuple[Px, Px]


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundLines(_Observed):
    """Two level lines, two pixels each, that are parallel, or at a right angle to each other."""

    first: tuple[Px, Px]
    second: tuple[Px, Px]
    at_right_angle: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Horizon(_Observed):
    """Pixels on the horizon: where level ground would end infinitely far away, or on the sea's.

    Attributes:
        pixels: Two or more.
        is_sea: The horizon is the sea's, which the earth's curvature lowers as the camera rises.
    """

    pixels: tuple[Px, ...]
    is_sea: bool = False


Evidence: TypeAlias = Landmark | SlantRange | GroundPoint | KnownLength | KnownHeight | Vertical | GroundLines | Horizon


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """What is known of an unknown beforehand; where it is not asked for, it has this value."""

    value: float
    std: float


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceSet:
    """All that is known about one image's camera.

    Attributes:
        evidence: Observations, in the order of the file.
        priors: By unknown's name (SI units, radians): ``height``, ``tilt``, ``roll``, ``heading``, ``east``, ``north``,
            ``focal``, ``elevation``.
    """

    evidence: tuple[Evidence, ...]
    priors: dict[str, Prior] = field(default_factory=dict)
