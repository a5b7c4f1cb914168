"""What a survey of a log or link reports."""

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Final

from aerodft.adapters.mavlink.contradictions import HeightPairs
from aerodft.adapters.mavlink.framing import FrameCounts
from aerodft.adapters.mavlink.health_survey import HealthSurvey
from aerodft.adapters.mavlink.pose_survey import Poses
from aerodft.adapters.mavlink.requests import MessageRequest
from aerodft.adapters.mavlink.signing import SigningCounts
from aerodft.adapters.mavlink.streams import Parameters, Stream
from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import FloatArray
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
_NO_UTC_YET: Final = frozenset({"SYSTEM_TIME: no UTC yet", "GPS: no UTC yet"})


@dataclass(slots=True)
class ValueSource:
    """One source of heights or of attitudes.

    Attributes:
        name: As the configuration calls it.
        unit: Of the range.
        count: Usable rows.
        low: Smallest value (attitudes: of the pitch).
        high: Largest value.
    """

    name: str
    unit: str
    count: int = 0
    low: float = math.inf
    high: float = -math.inf

    def add(self, values: FloatArray) -> None:
        """Take in values ``(n,)``."""
        if len(values):
            self.count += len(values)
            self.low, self.high = min(self.low, float(values.min())), max(self.high, float(values.max()))


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
        reboots_at_s: When the sender's time since boot was found to begin anew, since the log's first frame.
        jumps_at_s: When its UTC was found to have jumped, likewise.
    """

    known_after_s: float | None
    host_minus_utc_s: float | None
    reboots_at_s: tuple[float, ...] = ()
    jumps_at_s: tuple[float, ...] = ()


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
        poses: What an import would make of it.
        demands: Whether each source of the camera's attitude may be a demand, by its name.
        parameters: What the autopilot said of its parameters.
        unknown_ids: How often messages came that the dialect does not know, by id, as far as that was seen.
        signed_frames: Frames that carry a signature.
        gimbal: The gimbal that was asked for; None for the first one heard.
        is_silent_since: Whether the vehicle was not heard any more after it was asked for messages.
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
    poses: Poses = field(default_factory=Poses)
    demands: dict[str, bool] = field(default_factory=dict)
    parameters: Parameters = field(default_factory=Parameters)
    unknown_ids: Counter[int] = field(default_factory=Counter)
    signed_frames: int = 0
    gimbal: int | None = None
    is_silent_since: bool = False

    @property
    def usable(self) -> bool:
        """Whether any image could be measured: as the configuration has it, or the defaults."""
        return self.poses.ok_s > 0

    @property
    def heard(self) -> tuple[int, ...]:
        """All systems that sent anything."""
        return tuple(sorted({each.system for each in self.streams if each.system is not None}))

    @property
    def is_heard(self) -> bool:
        """Whether the followed autopilot sent anything; also where there was none to follow."""
        asked = (self.system, self.component)
        return any(
            all(want is None or want == got for want, got in zip(asked, (each.system, each.component), strict=True))
            for each in self.streams
        )

    @property
    def ready_s(self) -> float:
        """When a vehicle that starts up in this log knew UTC, since the first frame; 0 where it does not start up."""
        after_s = self.clock.known_after_s
        return after_s if after_s is not None and after_s >= 1 and _NO_UTC_YET & self.rejected.keys() else 0.0

    @property
    def duration_s(self) -> float:
        """From the first frame to the last."""
        if self.first_ns is None or self.last_ns is None:
            return 0.0
        return (self.last_ns - self.first_ns) / SECOND_NS
