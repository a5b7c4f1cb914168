"""Surveyed landmarks and markers (ArUco, AprilTag), and where markers are seen in an image."""

from dataclasses import dataclass

from aerodft.model.evidence import Px

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
