"""Evidence of a scene, from which a calibration finds a camera's pose and lens.

World coordinates are metres east, north and up in one local frame; the camera's height counts from its zero.
"""

from dataclasses import dataclass, field
from typing import TypeAlias

Px = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Observed:
    """An observation.

    Attributes:
        name: For messages.
        std_px: Of each pixel coordinate; of a horizon's pixels across it.
    """

    name: str
    std_px: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Landmark(_Observed):
    """A ground control point: a pixel and its surveyed position.

    Attributes:
        pixel: ``(u, v)``.
        position_m: East, north, up; None for an unknown component (one at most).
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
    """A pixel on the ground, and its position right and ahead of the camera's foot."""

    pixel: Px
    xy_m: tuple[float, float]
    std_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownLength(_Observed):
    """Two pixels and their horizontal distance, ``elevation_m`` above the ground."""

    pixels: tuple[Px, Px]
    length_m: float
    elevation_m: float = 0.0
    std_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownHeight(_Observed):
    """Base and top of an upright object on the ground, and the object's height."""

    base: Px
    top: Px
    height_m: float
    std_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Vertical(_Observed):
    """Two pixels of a vertical line."""

    pixels: tuple[Px, Px]


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundLines(_Observed):
    """Two level lines, two pixels each, parallel or perpendicular to each other."""

    first: tuple[Px, Px]
    second: tuple[Px, Px]
    at_right_angle: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Horizon(_Observed):
    """Pixels on the horizon: of a flat earth, or of the sea.

    Attributes:
        pixels: Two or more.
        is_sea: Of the sea: below a flat earth's by the dip, which grows with the camera's height.
    """

    pixels: tuple[Px, ...]
    is_sea: bool = False


Evidence: TypeAlias = Landmark | SlantRange | GroundPoint | KnownLength | KnownHeight | Vertical | GroundLines | Horizon


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """Prior of an unknown; the value where it is not estimated."""

    value: float
    std: float


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceSet:
    """Evidence and priors of one image's camera.

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
    """A landmark with a surveyed position, observed as one pixel under its name.

    Attributes:
        name: Unique; the last part of its observations' key expression.
        position_enu_m: East, north, up of the station's origin.
        std_m: Of each component; one error, common to all observations of the landmark.
        std_px: Of each pixel coordinate, unless the observation has its own.
    """

    name: str
    position_enu_m: tuple[float, float, float]
    std_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std_px: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyedMarker:
    """A marker with a surveyed position.

    Attributes:
        id: In its dictionary.
        points_m: East, north, up of its centre, or of its four corners: top left, top right, bottom right and bottom
            left, as printed.
        std_m: Of each component of each point.
        side_m: Length of the black square's sides; None where unknown.
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
        """Landmark names of ``points_m``: ``marker-3``, or ``marker-3-corner-1`` to 4."""
        name = marker_name(self.id)
        return (name,) if len(self.points_m) == 1 else tuple(f"{name}-corner-{n + 1}" for n in range(4))


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerSurvey:
    """Surveyed markers of one dictionary.

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
    """A marker detected in an image.

    Attributes:
        id: As decoded, possibly wrong.
        pixel: Of its centre: the intersection of the diagonals, which is invariant under perspective.
        std_px: Of each coordinate of ``pixel``.
        corners: In the order of ``SurveyedMarker.points_m``.
        corner_std_px: Of each coordinate of a corner.
    """

    id: int
    pixel: Px
    std_px: float
    corners: tuple[Px, Px, Px, Px]
    corner_std_px: float


def marker_name(marker: int) -> str:
    """Name of a marker in messages and observations."""
    return f"marker-{marker}"
