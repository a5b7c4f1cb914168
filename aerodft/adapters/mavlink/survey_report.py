"""What a survey of a log or link reports."""

from dataclasses import dataclass, field
from typing import Final

from aerodft.adapters.mavlink.contradictions import HeightPairs
from aerodft.adapters.mavlink.framing import FrameCounts
from aerodft.adapters.mavlink.health_survey import HealthSurvey
from aerodft.adapters.mavlink.requests import MessageRequest
from aerodft.adapters.mavlink.signing import SigningCounts
from aerodft.adapters.mavlink.streams import Stream
from aerodft.conventions import SECOND_NS
from aerodft.model.camera import Camera
from aerodft.service.gimbal_frame import FrameEvidence
from aerodft.service.settings import TelemetrySettings
from aerodft.service.timing import ClockHealth

# Messages that poses are made of; only their gaps matter.
USED: Final = frozenset(
    {
        "ALTITUDE",
        "ATTITUDE",
        "DISTANCE_SENSOR",
        "GIMBAL_DEVICE_ATTITUDE_STATUS",
        "GLOBAL_POSITION_INT",
        "MOUNT_ORIENTATION",
        "MOUNT_STATUS",
        "RANGEFINDER",
        "SYSTEM_TIME",
        "TERRAIN_REPORT",
        "ATT",
        "GPS",
        "MNT",
        "POS",
        "RFND",
        "TERR",
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueSource:
    """One source of heights or of attitudes.

    Attributes:
        name: As the configuration calls it.
        count: Usable rows.
        unit: Of the range.
        low: Smallest value (attitudes: of the pitch).
        high: Largest value.
    """

    name: str
    count: int
    unit: str
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """A silence in a stream that poses are made of.

    Attributes:
        message: The stream.
        start_s: Since the log's first frame.
        duration_s: How long.
    """

    message: str
    start_s: float
    duration_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockSummary:
    """How the sender's UTC relates to the recording machine's.

    Attributes:
        known_after_s: First UTC, since the log's first frame; None where the sender never knew it.
        host_minus_utc_s: Median of arrival minus the sender's UTC; None likewise.
    """

    known_after_s: float | None
    host_minus_utc_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyReport:
    """Everything that was found.

    Attributes:
        target: The file or link.
        first_ns: Arrival of the first frame; None where there was none.
        last_ns: Arrival of the last frame.
        streams: Every message of every sender.
        heights: Sources of the height.
        attitudes: Sources of the camera's attitude.
        frames: What each of those is against, told from its reports, by its name.
        vehicle_attitude: The vehicle's own attitude, enough for a camera that is fixed to it.
        clock: UTC.
        clock_health: Jumps, reboots and second clocks.
        height_pairs: Sources of the height against each other.
        gaps: Silences in used streams.
        system: The system that is followed; None where no vehicle was heard, or in an on-board log.
        component: Its autopilot's component, likewise.
        systems: Systems that report an attitude or a position of their own.
        rejected: Rows of used messages that hold no value, by ``MESSAGE: reason``.
        counts: What the framer met.
        rangefinder: RANGEFINDER as it came, used or not.
        warnings: What the reader says.
        signing: What became of the frames of a signed link; None without keys.
        health: What the vehicle says of itself.
        requests: What it should send more often.
        camera: What the vehicle's reports are held against; None for nothing.
        settings: What the configuration asks of the telemetry, likewise.
    """

    target: str
    first_ns: int | None
    last_ns: int | None
    streams: tuple[Stream, ...]
    heights: tuple[ValueSource, ...]
    attitudes: tuple[ValueSource, ...]
    frames: dict[str, FrameEvidence]
    vehicle_attitude: ValueSource | None
    clock: ClockSummary
    clock_health: ClockHealth
    height_pairs: HeightPairs
    gaps: tuple[Gap, ...]
    system: int | None
    component: int | None
    systems: tuple[int, ...]
    rejected: dict[str, int]
    counts: FrameCounts
    rangefinder: ValueSource | None = None
    warnings: tuple[str, ...] = ()
    signing: SigningCounts | None = None
    health: HealthSurvey = field(default_factory=HealthSurvey)
    requests: tuple[MessageRequest, ...] = ()
    camera: Camera | None = None
    settings: TelemetrySettings | None = None

    @property
    def usable(self) -> bool:
        """Whether a height and an attitude (a gimbal's, or the vehicle's for a fixed mount) could be had."""
        return bool(self.heights) and bool(self.attitudes or self.vehicle_attitude)

    @property
    def duration_s(self) -> float:
        """From the first frame to the last."""
        if self.first_ns is None or self.last_ns is None:
            return 0.0
        return (self.last_ns - self.first_ns) / SECOND_NS
