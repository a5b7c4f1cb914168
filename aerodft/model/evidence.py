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


Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyedLandmark:
    """A point whose place is known; an observation of one pixel that bears its name is of it.

    Attributes:
        name: Unique; the last part of its observations' key expression.
        position_enu_m: East, north, up of the station's origin.
        std_m: Of each of the three. The same error is in every observation of it, however many there are.
        std_px: Of each pixel coordinate, unless the observation brings its own.
    """

    name: str
    position_enu_m: tuple[float, float, float]
    std_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std_px: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyedMarker:
    """A marker whose place is known.

    Attributes:
        id: In its dictionary.
        points_m: East, north, up of its centre, or of its four corners: top left, top right, bottom right and bottom
            left, as it is printed.
        std_m: Of each component of each point.
        side_m: Length of the black square's sides; None where nobody has measured it.
    """

    id: int
    points_m: tuple[Place, ...]
    std_m: Place = (0.0, 0.0, 0.0)
    side_m: float | None = None

    def __post_init__(self) -> None:
        if len(self.points_m) not in (1, 4):
            raise ValueError(f"{len(self.points_m)} points of marker {self.id}, must be its centre or four corners")

    @property
    def point_names(self) -> tuple[str, ...]:
        """What each of ``points_m`` is called as a landmark: ``marker-3``, or ``marker-3-corner-1`` to 4."""
        name = marker_name(self.id)
        return (name,) if len(self.points_m) == 1 else tuple(f"{name}-corner-{n + 1}" for n in range(4))


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerSurvey:
    """Markers of one dictionary.

    Attributes:
        dictionary: As OpenCV names it, without ``DICT_``: ``4X4_50``, ``APRILTAG_36h11``.
        markers: Each id once.
    """

    dictionary: str
    markers: tuple[SurveyedMarker, ...]

    @property
    def by_id(self) -> dict[int, SurveyedMarker]:
        """The markers by their ids."""
        return {marker.id: marker for marker in self.markers}


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerSighting:
    """A marker as an image shows it.

    Attributes:
        id: As decoded; it may be false.
        pixel: Of its centre: where its diagonals meet, which no slant of the view moves.
        std_px: Of each of ``pixel``'s coordinates.
        corners: In the order of ``SurveyedMarker.points_m``.
        corner_std_px: Of each of their coordinates.
    """

    id: int
    pixel: Px
    std_px: float
    corners: tuple[Px, Px, Px, Px]
    corner_std_px: float


def marker_name(marker: int) -> str:
    """What messages and observations call a marker."""
    return f"marker-{marker}"
