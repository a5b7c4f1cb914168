"""Evidence of a scene, from which a calibration finds a camera's pose and lens; its results; and live estimates.

World coordinates are metres east, north and up in one local frame; the camera's height counts from its zero. A live
calibration estimates biases from an image's landmarks, or a fixed camera's rotation from fixed points.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, TypeAlias

from aerodft.model.arrays import FloatArray
from aerodft.model.pose import HeightSource, PoseStd

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
class KnownPoint:
    """A surveyed point to measure from or to: where it is seen, and its height.

    Attributes:
        pixel: ``(u, v)``; None where it changes from image to image.
        elevation_m: Above the measured plane.
        elevation_std_m: Its standard deviation.
    """

    pixel: Px | None
    elevation_m: float
    elevation_std_m: float = 0.0


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


BIASES: Final = ("height", "tilt", "roll", "heading", "pan", "east", "north", "time")
"""Biases of the telemetry in the order of covariances: in metres and radians, the last one in seconds."""
FIXED_POINTS: Final = "steady"
"""Name of observations whose pixels are pairs: a fixed point in the reference image, and where it is now."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasValues:
    """One number for each bias of the telemetry: an estimate (added to the telemetry), or a standard deviation.

    Attributes:
        height_m: Of the height source in use.
        east_m: Of the position, to the east.
        north_m: Of the position, to the north.
        tilt_rad: About the camera's x axis; raises the tilt.
        pan_rad: About its y axis.
        roll_rad: About its z axis.
        heading_rad: About the vertical, clockwise seen from above.
        time_s: Of images' stamps: the image's pose is that of the telemetry this much after its stamp.
    """

    height_m: float = 0.0
    east_m: float = 0.0
    north_m: float = 0.0
    tilt_rad: float = 0.0
    pan_rad: float = 0.0
    roll_rad: float = 0.0
    heading_rad: float = 0.0
    time_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """Biases, covariances and noise found by a calibration, as ``measure``, ``serve`` and ``recompute`` take them.

    Attributes:
        id: ``sha256:...`` of the file it came from.
        bias: Added to the telemetry, and to the images' stamps.
        bias_cov: ``(8, 8)`` covariance of the biases in the order of ``BIASES``; None where unknown.
        lens_cov: ``(8, m)`` covariance of the biases with the intrinsics, where one calibration found both; else no
            columns.
        noise: Standard deviations of errors that are independent from image to image.
    """

    id: str
    bias: BiasValues = field(default_factory=BiasValues)
    bias_cov: FloatArray | None = None
    lens_cov: FloatArray | None = None
    noise: PoseStd = field(default_factory=PoseStd)


@dataclass(frozen=True, slots=True, kw_only=True)
class Innovation:
    """An observed landmark minus its prediction.

    Attributes:
        name: The landmark.
        px: Observed minus predicted ``(u, v)``; None without a prediction.
        sigma_px: Standard deviation of each component, from all uncertainties.
        chi2: Squared Mahalanobis distance, of two degrees of freedom.
        reason: Why it was rejected, one sentence; None where it was used.
    """

    name: str
    px: tuple[float, float] | None = None
    sigma_px: tuple[float, float] | None = None
    chi2: float | None = None
    reason: str | None = None

    @property
    def accepted(self) -> bool:
        """Whether the estimate was updated with it."""
        return self.reason is None


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationEstimate:
    """The biases of the telemetry after the landmarks of one image.

    Attributes:
        stamp_ns: The image's stamp, UTC.
        calibration: Calibration id of the next images' measurements.
        height_source: Whose height ``bias.height_m`` is added to; None where there was no pose.
        bias: The estimate.
        std: Its standard deviations.
        innovations: Of the landmarks of this image, the smallest chi2 first.
        updates: Landmarks used since the start.
        refused: Landmarks rejected since the start.
        restarts: How often the filter was reset because nearly everything was rejected.
    """

    stamp_ns: int
    calibration: str | None
    height_source: HeightSource | None = None
    bias: BiasValues = field(default_factory=BiasValues)
    std: BiasValues = field(default_factory=BiasValues)
    innovations: tuple[Innovation, ...] = ()
    updates: int = 0
    refused: int = 0
    restarts: int = 0


class MotionState(StrEnum):
    """Whether a fixed camera has moved, by its last looks."""

    UNCHECKED = "unchecked"  # no fixed points recognised yet, or not for some looks: night, fog, a covered lens
    STEADY = "steady"  # rotated by less than the limit
    MOVED = "CAMERA_MOVED"  # rotated by more than the limit, by a known angle
    MOVING = "moving"  # rotated by more than the limit in the last look; not known yet whether it has come to rest
    UNKNOWN_VIEW = "unknown_view"  # no rotation of the camera explains the fixed points


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMotionEstimate:
    """A fixed camera's rotation after one look at its fixed points.

    Attributes:
        stamp_ns: The image's stamp, UTC.
        state: By this look and those before it.
        turn_rad: Rotation vector ``reference_SO3_now`` about the camera's axes x, y, z, with which poses are corrected.
        std_rad: Standard deviations of its components, with the scatter between images.
        look_turn_rad: Rotation vector of this look alone; None where the look gave none.
        since_ns: The first look in this state.
        moved_ns: The first look at which the camera was in its present attitude; None within the limit.
        points: Points found again.
        agreeing: Inliers of this look's rotation.
        std_px: Of one coordinate of an inlier; None where the look gave no rotation.
        calibration: Calibration id of the next images' measurements.
    """

    stamp_ns: int
    state: MotionState
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    look_turn_rad: tuple[float, float, float] | None = None
    since_ns: int
    moved_ns: int | None = None
    points: int = 0
    agreeing: int = 0
    std_px: float | None = None
    calibration: str | None = None
