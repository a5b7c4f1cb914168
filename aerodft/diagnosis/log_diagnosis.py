"""What a log or link is good for: its streams, the height and attitude sources in them, its clock and its faults."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np

from aerodft.adapters.telemetry import (
    PHOTOGRAPHS,
    USED_MESSAGES,
    CompositeDecoder,
    DataflashDecoder,
    SigningCounts,
    mavlink,
)
from aerodft.conventions import SECOND_NS
from aerodft.diagnosis.camera_pitch import too_large_sentence
from aerodft.diagnosis.flight_checks import HeightPairs, ImageCheck, PoseAvailability, PoseSampler
from aerodft.diagnosis.message_requests import MessageRequest, missing_camera_messages, missing_messages
from aerodft.diagnosis.streams import (
    Parameters,
    ParameterTable,
    Stream,
    StreamTable,
    gimbal_pitches_deg,
    rangefinder_readings_m,
)
from aerodft.diagnosis.vehicle_health import VehicleHealth
from aerodft.geometry import yaw_pitch_roll
from aerodft.model import (
    NO_BOOT_TIME,
    Camera,
    ClockTrack,
    FloatArray,
    GimbalTrack,
    HeightTrack,
    PositionTrack,
    RawBlock,
    Track,
    VehicleTrack,
    WireProtocol,
)
from aerodft.service import TelemetrySettings, is_own_statement
from aerodft.service.attitude import FrameEvidence
from aerodft.service.clocks import JUMP_NS, ClockHealth, Ticks
from aerodft.service.pose import PoseSource

USED: Final = (
    frozenset(map(mavlink.message_name, mavlink.OF_POSES))
    | {"ATT", "GPS", "MNT", "POS", "RFND", "TERR"}
    | USED_MESSAGES
)
"""Messages that poses are made of; only their gaps matter."""
_NO_UTC_YET: Final = frozenset({"SYSTEM_TIME: no UTC yet", "GPS: no UTC yet"})
_SLOW_PERIODS: Final = 3
_PART_NS: Final = 5 * SECOND_NS


@dataclass(slots=True)
class SourceSummary:
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
        """Take in values ``(n,)``; NaN is none."""
        values = values[np.isfinite(values)]
        if len(values):
            self.count += len(values)
            self.low, self.high = min(self.low, float(values.min())), max(self.high, float(values.max()))


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamGap:
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
    """Relation of the sender's UTC to the recording machine's.

    Attributes:
        known_after_s: First UTC, since the log's first frame; None where the sender never knew it.
        host_minus_utc_s: Median of arrival minus the sender's UTC; None where the sender never knew it.
        reboots_at_s: When the sender's time since boot was found to begin anew, since the log's first frame.
        jumps_at_s: When its UTC was found to have jumped, since the log's first frame.
    """

    known_after_s: float | None
    host_minus_utc_s: float | None
    reboots_at_s: tuple[float, ...] = ()
    jumps_at_s: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisReport:
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
        component: Its autopilot's component; None where no vehicle was heard, or in an on-board log.
        systems: Systems that report an attitude or a position of their own.
        rejected: Rows of used messages that hold no value, by ``MESSAGE: reason``.
        counts: What the framer met.
        rangefinder: RANGEFINDER as it came, used or not.
        warnings: What the reader says.
        signing: What became of the frames of a signed link; None without keys.
        health: What the vehicle says of itself.
        requests: What it should send more often.
        camera: What the vehicle's reports are held against; None for nothing.
        settings: What the configuration asks of the telemetry; None for no configuration.
        poses: What an import would make of it.
        pitch_faults: Sentences on sources of the camera's attitude with a wrong sign or unit.
        demands: Whether each source of the camera's attitude may be a demand, by its name.
        parameters: What the autopilot said of its parameters.
        unknown_ids: How often messages came that the dialect does not know, by id, as far as that was seen.
        signed_frames: Frames that carry a signature.
        gimbal: The gimbal that was asked for; None for the first one heard.
        is_silent_since: Whether the vehicle was not heard any more after it was asked for messages.
        photographs: What photographs that carry their poses are, a sentence each; empty for other logs.
    """

    target: str
    first_ns: int | None
    last_ns: int | None
    streams: tuple[Stream, ...]
    heights: tuple[SourceSummary, ...]
    attitudes: tuple[SourceSummary, ...]
    frames: dict[str, FrameEvidence]
    vehicle_attitude: SourceSummary | None
    clock: ClockSummary
    clock_health: ClockHealth
    height_pairs: HeightPairs
    gaps: tuple[StreamGap, ...]
    system: int | None
    component: int | None
    systems: tuple[int, ...]
    rejected: dict[str, int]
    counts: mavlink.FrameCounts
    rangefinder: SourceSummary | None = None
    warnings: tuple[str, ...] = ()
    signing: SigningCounts | None = None
    health: VehicleHealth = field(default_factory=VehicleHealth)
    requests: tuple[MessageRequest, ...] = ()
    camera: Camera | None = None
    settings: TelemetrySettings | None = None
    poses: PoseAvailability = field(default_factory=PoseAvailability)
    pitch_faults: tuple[str, ...] = ()
    demands: dict[str, bool] = field(default_factory=dict)
    parameters: Parameters = field(default_factory=Parameters)
    unknown_ids: Counter[int] = field(default_factory=Counter)
    signed_frames: int = 0
    gimbal: int | None = None
    is_silent_since: bool = False
    photographs: tuple[str, ...] = ()

    @property
    def usable(self) -> bool:
        """Whether any part of any image could be measured: as the configuration has it, or the defaults."""
        return self.poses.seen_s > 0

    @property
    def heard(self) -> tuple[int, ...]:
        """All systems that sent anything."""
        return tuple(sorted({each.system for each in self.streams if each.system is not None}))

    @property
    def is_heard(self) -> bool:
        """Whether the followed autopilot sent anything; also where there was none to follow."""
        vehicle_ids = (self.system, self.component)
        return any(
            all(
                want is None or want == got
                for want, got in zip(vehicle_ids, (each.system, each.component), strict=True)
            )
            for each in self.streams
        )

    @property
    def ready_s(self) -> float:
        """Time at which a vehicle that starts up in the log knew UTC, since the first frame; else 0."""
        after_s = self.clock.known_after_s
        return after_s if after_s is not None and after_s >= 1 and _NO_UTC_YET & self.rejected.keys() else 0.0

    @property
    def duration_s(self) -> float:
        """From the first frame to the last."""
        if self.first_ns is None or self.last_ns is None:
            return 0.0
        return (self.last_ns - self.first_ns) / SECOND_NS


@dataclass(slots=True)
class ClockStatistics:
    """Takes in tracks of UTC, and what becomes known of the clock's health."""

    _first_ns: int | None = None
    _offsets_ns: list[int] = field(default_factory=list)  # thinned
    _last: tuple[int, int] | None = None  # time since boot, UTC minus that
    _step_ns: int | None = None  # arrival of the last step of UTC
    _fall_ns: int | None = None  # arrival of the last time since boot that was less than the one before
    _reboots_ns: list[int] = field(default_factory=list)
    _jumps_ns: list[int] = field(default_factory=list)

    def add(self, track: ClockTrack) -> None:
        """Take in a track, n > 0."""
        if self._first_ns is None:
            self._first_ns = int(track.arrival_ns[0])
        self._offsets_ns.append(int(np.median(track.arrival_ns - track.unix_ns)))
        for arrival_ns, boot_ns, unix_ns in zip(
            track.arrival_ns.tolist(), track.boot_ns.tolist(), track.unix_ns.tolist(), strict=True
        ):
            if boot_ns == NO_BOOT_TIME:
                continue
            last_boot_ns, last_offset_ns = self._last or (boot_ns, unix_ns - boot_ns)
            if boot_ns < last_boot_ns - SECOND_NS:
                self._fall_ns = arrival_ns
            elif abs(unix_ns - boot_ns - last_offset_ns) > JUMP_NS:
                self._step_ns = arrival_ns
            self._last = boot_ns, unix_ns - boot_ns

    def note(self, health: ClockHealth, at_ns: int) -> None:
        """Take in restarts and jumps of the clock, which happened at this arrival at the latest."""
        if health.restarts > len(self._reboots_ns):
            self._reboots_ns.append(at_ns if self._fall_ns is None else self._fall_ns)
        if len(health.jumps_s) > len(self._jumps_ns):
            self._jumps_ns.append(at_ns if self._step_ns is None else self._step_ns)

    def summary(self, start_ns: int | None) -> ClockSummary:
        """Summary of the clocks so far; times since ``start_ns``."""
        first_ns, start_ns = self._first_ns, start_ns or 0
        return ClockSummary(
            known_after_s=None if first_ns is None else (first_ns - start_ns) / SECOND_NS,
            host_minus_utc_s=float(np.median(self._offsets_ns)) / SECOND_NS if self._offsets_ns else None,
            reboots_at_s=tuple((at_ns - start_ns) / SECOND_NS for at_ns in self._reboots_ns),
            jumps_at_s=tuple((at_ns - start_ns) / SECOND_NS for at_ns in self._jumps_ns),
        )


def unknown_ids(block: RawBlock) -> Counter[int]:
    """Counts of each unknown id between a stamped log's frames; links hand on good frames alone."""
    found: Counter[int] = Counter()
    if block.protocol != WireProtocol.MAVLINK or len(block.offset) < 2:  # noqa: PLR2004 - two frames have a gap
        return found
    data, table = np.frombuffer(block.data, dtype=np.uint8), mavlink.frame_table()
    ends, starts = (block.offset + block.length)[:-1], block.offset[1:] - mavlink.STAMP_SIZE
    for k in np.flatnonzero(starts > ends).tolist():
        at, stop = int(ends[k]) + mavlink.STAMP_SIZE, int(starts[k])
        while at < stop:
            verdict, size, _ = mavlink.measure(data, at, stop, table)
            if verdict != mavlink.UNKNOWN or at + size > stop:
                break
            head = data[at : at + 10].tolist()
            found[head[5] if head[0] == mavlink.V1 else head[7] | head[8] << 8 | head[9] << 16] += 1
            at += size + mavlink.STAMP_SIZE
    return found


class LogDiagnosis:
    """Takes in blocks of frames and reports on them.

    Args:
        target: The file or link, for the report.
        followed: The vehicle to follow; None for the first one heard.
        settings: What a station's configuration asks of the telemetry; None for no configuration.
        images: Measures at the poses as an import would; None for a usual camera.
    """

    def __init__(
        self,
        target: str,
        *,
        followed: mavlink.FollowedIds | None = None,
        settings: TelemetrySettings | None = None,
        images: ImageCheck | None = None,
    ) -> None:
        self._target = target
        self._settings = settings
        self._followed = followed or mavlink.FollowedIds()
        self._decoder = CompositeDecoder(followed)
        self._images = images or ImageCheck(telemetry=settings)
        self._mavlink = self._decoder.of_type(mavlink.MavlinkDecoder)
        self._formats = self._decoder.of_type(DataflashDecoder).formats
        self._table = StreamTable()
        self._parameters = ParameterTable()
        self._unknown: Counter[int] = Counter()
        self._signed = 0
        self._heights: dict[str, SourceSummary] = {}
        self._attitudes: dict[str, SourceSummary] = {}
        self._vehicle = SourceSummary("vehicle", "deg")
        height = (settings or TelemetrySettings()).height
        self._frames = PoseSource(TelemetrySettings(height=height), origin=None, time_std_s=0.0)
        judge = self._frames if self._images.telemetry is None else self._images.pose_source()
        self._sources = tuple(dict.fromkeys((self._frames, judge)))
        self._poses = PoseSampler(judge, self._images)
        self._pitches: dict[str, SourceSummary] = {}
        self._pairs = HeightPairs()
        self._rangefinder = SourceSummary("RANGEFINDER", "m")
        self._clock = ClockStatistics()
        self._health = VehicleHealth()
        self._first_ns: int | None = None
        self._last_ns: int | None = None

    @property
    def settings(self) -> TelemetrySettings | None:
        """What the configuration asks of the telemetry; None for no configuration."""
        return self._settings

    def add(self, block: RawBlock) -> None:
        """Take in one block; blocks of one sender in order of arrival."""
        if not len(block.arrival_ns):
            return
        first_ns, last_ns = int(block.arrival_ns[0]), int(block.arrival_ns[-1])
        self._first_ns = first_ns if self._first_ns is None else min(self._first_ns, first_ns)
        self._last_ns = last_ns if self._last_ns is None else max(self._last_ns, last_ns)
        self._health.start_ns = self._first_ns
        for rows in _history_parts(block):
            self._add_rows(rows)
        self._table.add(block, self._formats, self._decoder)
        self._parameters.add(block, self._formats)
        self._rangefinder.add(rangefinder_readings_m(block))
        for name, pitch_deg in gimbal_pitches_deg(block, self._formats).items():
            scale = self._followed.angle_scales.get(name)
            own = self._pitches.setdefault(name, SourceSummary(name, "deg"))
            own.add(pitch_deg if scale is None else pitch_deg * scale.pitch)
        self._unknown += unknown_ids(block)
        self._signed += _signed_count(block)

    def _add_rows(self, rows: RawBlock) -> None:
        tracks = self._decoder.decode(rows)
        for source in self._sources:
            source.append(Ticks.one(tracks))
        if rows.protocol == PHOTOGRAPHS:
            self._poses.add_stamps(rows.arrival_ns)
        else:
            self._poses.add(int(rows.arrival_ns[0]), int(rows.arrival_ns[-1]))
        self._pairs.add(self._frames.height_differences())
        for track in tracks:
            self._add_track(track)
        self._clock.note(self._frames.clock.health, int(rows.arrival_ns[-1]))

    def _add_track(self, track: Track) -> None:
        self._health.add(track)
        match track:
            case ClockTrack():
                self._clock.add(track)
            case VehicleTrack():
                self._vehicle.add(_pitch_deg(track.wxyz))
            case GimbalTrack():
                name = str(track.source)
                self._attitudes.setdefault(name, SourceSummary(name, "deg")).add(_pitch_deg(track.wxyz))
            case PositionTrack():
                self._heights.setdefault("home", SourceSummary("home", "m")).add(track.height_home_m)
            case HeightTrack():
                name = str(track.source)
                self._heights.setdefault(name, SourceSummary(name, "m")).add(track.value_m)

    def report(
        self, *, counts: mavlink.FrameCounts, warnings: tuple[str, ...] = (), signing: SigningCounts | None = None
    ) -> DiagnosisReport:
        """Report on the log so far.

        Args:
            counts: The framer's counters.
            warnings: The reader's own sentences.
            signing: The counters of a signed link.
        """
        streams = self._table.streams()
        vehicle = self._mavlink
        zoom = (self._settings or TelemetrySettings()).zoom
        vehicle_ids = {"system": vehicle.system, "component": vehicle.component, "autopilot": self._health.autopilot}
        parameters = self._parameters.of(vehicle.system, vehicle.component)
        systems = {s.system for s in streams if s.name in {"ATTITUDE", "GLOBAL_POSITION_INT"}}
        return DiagnosisReport(
            target=self._target,
            first_ns=self._first_ns,
            last_ns=self._last_ns,
            streams=tuple(streams),
            heights=_sources(self._heights),
            attitudes=_sources(self._attitudes),
            frames={
                str(source): evidence
                for source, evidence in self._frames.gimbal_frames().items()
                if not is_own_statement(source)
            },
            vehicle_attitude=self._vehicle if self._vehicle.count else None,
            clock=self._clock.summary(self._first_ns),
            clock_health=self._frames.clock.health,
            height_pairs=self._pairs,
            gaps=tuple(
                gap
                for stream in streams
                if stream.name in USED and stream.system == vehicle.system
                for gap in self._gaps(stream)
            ),
            system=vehicle.system,
            component=self._followed.component if vehicle.component is None else vehicle.component,
            systems=tuple(sorted(system for system in systems if system is not None)),
            rejected=dict(sorted(self._decoder.rejected.items())),
            rangefinder=self._rangefinder if self._rangefinder.count else None,
            counts=counts,
            warnings=warnings,
            signing=signing,
            health=self._health,
            settings=self._settings,
            requests=(
                *missing_messages(streams, **vehicle_ids, parameters=parameters),
                *missing_camera_messages(streams, **vehicle_ids, zoom=zoom),
            ),
            poses=self._poses.poses(),
            pitch_faults=self._pitch_faults(),
            demands={
                str(source): is_demand
                for source, is_demand in self._frames.gimbal_demands().items()
                if not is_own_statement(source)
            },
            parameters=parameters,
            unknown_ids=self._unknown,
            signed_frames=self._signed,
            gimbal=self._followed.gimbal,
        )

    def _pitch_faults(self) -> tuple[str, ...]:
        """Sentences on the sources whose angles have a wrong sign or unit, as far as that shows."""
        too_large = (too_large_sentence(each.name, each.low, each.high) for each in _sources(self._pitches))
        return (*filter(None, too_large), *self._images.pitches.sentences())

    def _gaps(self, stream: Stream) -> list[StreamGap]:
        """Silences of more than a second, for a slow stream of more than three periods."""
        if stream.rate_hz <= 0 or self._first_ns is None:
            return []
        limit_ns = max(SECOND_NS, int(_SLOW_PERIODS * SECOND_NS / stream.rate_hz))
        return [
            StreamGap(
                message=stream.name,
                start_s=(start_ns - self._first_ns) / SECOND_NS,
                duration_s=length_ns / SECOND_NS,
            )
            for start_ns, length_ns in stream.gaps_ns
            if length_ns > limit_ns
        ]


def _history_parts(block: RawBlock) -> Iterator[RawBlock]:
    """The block in parts that no history is too short for."""
    edges = np.flatnonzero(np.diff(block.arrival_ns // _PART_NS)) + 1
    for start, stop in pairwise([0, *edges.tolist(), len(block.arrival_ns)]):
        yield block.rows(slice(start, stop))


def _signed_count(block: RawBlock) -> int:
    """Number of frames with a signature."""
    if block.protocol != WireProtocol.MAVLINK:
        return 0
    data = np.frombuffer(block.data, dtype=np.uint8)
    return int(np.count_nonzero((data[block.offset] == mavlink.V2) & (data[block.offset + 2] & mavlink.SIGNED != 0)))


def _pitch_deg(wxyz: FloatArray) -> FloatArray:
    return np.degrees(yaw_pitch_roll(wxyz)[1])


def _sources(sources: dict[str, SourceSummary]) -> tuple[SourceSummary, ...]:
    return tuple(source for _, source in sorted(sources.items()) if source.count)
