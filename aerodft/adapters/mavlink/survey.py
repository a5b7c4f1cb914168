"""What a log or link is good for: its streams, the height and attitude sources in them, its clock and its faults."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np

from aerodft.adapters.mavlink.composite import CompositeDecoder
from aerodft.adapters.mavlink.framing import FrameCounts
from aerodft.adapters.mavlink.streams import Stream, StreamTable, rangefinder_readings_m
from aerodft.conventions import SECOND_NS
from aerodft.geometry.rotation import yaw_pitch_roll
from aerodft.model.arrays import FloatArray
from aerodft.model.telemetry import (
    ClockTrack,
    GimbalTrack,
    HeightTrack,
    PositionTrack,
    RawBlock,
    Track,
    VehicleTrack,
)
from aerodft.service.gimbal_frame import FrameEvidence
from aerodft.service.poses import PoseSource
from aerodft.service.settings import TelemetrySettings

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
_SLOW_PERIODS: Final = 3
_PART_NS: Final = 5 * SECOND_NS


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
        gaps: Silences in used streams.
        systems: Systems that report an attitude or a position of their own.
        rejected: Rows of used messages that hold no value, by ``MESSAGE: reason``.
        counts: What the framer met.
        rangefinder: RANGEFINDER as it came, used or not.
        warnings: What the reader says.
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
    gaps: tuple[Gap, ...]
    systems: tuple[int, ...]
    rejected: dict[str, int]
    counts: FrameCounts
    rangefinder: ValueSource | None = None
    warnings: tuple[str, ...] = ()

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


@dataclass(slots=True)
class _Range:
    """Extremes and number of values."""

    unit: str
    count: int = 0
    low: float = math.inf
    high: float = -math.inf

    def add(self, values: FloatArray) -> None:
        if not len(values):
            return
        self.count += len(values)
        self.low = min(self.low, float(values.min()))
        self.high = max(self.high, float(values.max()))


@dataclass(slots=True)
class _Clock:
    """First UTC and the offsets of the host's clock, thinned."""

    first_ns: int | None = None
    offsets_ns: list[int] = field(default_factory=list)


class Survey:
    """Takes in blocks of frames and reports on them.

    Args:
        target: The file or link, for the report.
        system: MAVLink system to follow; None for the first vehicle heard.
    """

    def __init__(self, target: str, *, system: int | None = None) -> None:
        self._target = target
        self._decoder = CompositeDecoder(system)
        self._table = StreamTable()
        self._heights: dict[str, _Range] = {}
        self._attitudes: dict[str, _Range] = {}
        self._vehicle = _Range("deg")
        self._frames = PoseSource(TelemetrySettings(), origin=None, time_std_s=0.0)
        self._rangefinder = _Range("m")
        self._clock = _Clock()
        self._first_ns: int | None = None
        self._last_ns: int | None = None

    def add(self, block: RawBlock) -> None:
        """Take in one block; blocks of one sender in order of arrival."""
        if not len(block.arrival_ns):
            return
        first_ns, last_ns = int(block.arrival_ns[0]), int(block.arrival_ns[-1])
        self._first_ns = first_ns if self._first_ns is None else min(self._first_ns, first_ns)
        self._last_ns = last_ns if self._last_ns is None else max(self._last_ns, last_ns)
        for rows in _short(block):
            tracks = self._decoder.decode(rows)
            self._frames.append(tracks)
            for track in tracks:
                self._add_track(track)
        self._table.add(block, self._decoder.dataflash.formats)
        self._rangefinder.add(rangefinder_readings_m(block))

    def _add_track(self, track: Track) -> None:
        match track:
            case ClockTrack():
                if self._clock.first_ns is None:
                    self._clock.first_ns = int(track.arrival_ns[0])
                self._clock.offsets_ns.append(int(np.median(track.arrival_ns - track.unix_ns)))
            case VehicleTrack():
                self._vehicle.add(_pitch_deg(track.wxyz))
            case GimbalTrack():
                self._attitudes.setdefault(str(track.source), _Range("deg")).add(_pitch_deg(track.wxyz))
            case PositionTrack():
                self._heights.setdefault("home", _Range("m")).add(track.height_home_m)
            case HeightTrack():
                self._heights.setdefault(str(track.source), _Range("m")).add(track.value_m)

    def report(self, *, counts: FrameCounts, warnings: tuple[str, ...] = ()) -> SurveyReport:
        """What was found so far.

        Args:
            counts: The framer's counters.
            warnings: The reader's own sentences.
        """
        streams = self._table.streams()
        systems = {s.system for s in streams if s.name in {"ATTITUDE", "GLOBAL_POSITION_INT"}}
        return SurveyReport(
            target=self._target,
            first_ns=self._first_ns,
            last_ns=self._last_ns,
            streams=tuple(streams),
            heights=_sources(self._heights),
            attitudes=_sources(self._attitudes),
            frames={str(source): evidence for source, evidence in self._frames.gimbal_frames().items()},
            vehicle_attitude=next(iter(_sources({"vehicle": self._vehicle})), None),
            clock=self._clock_summary(),
            gaps=tuple(gap for stream in streams if stream.name in USED for gap in self._gaps(stream)),
            systems=tuple(sorted(system for system in systems if system is not None)),
            rejected=dict(sorted(self._decoder.rejected.items())),
            rangefinder=next(iter(_sources({"RANGEFINDER": self._rangefinder})), None),
            counts=counts,
            warnings=warnings,
        )

    def _clock_summary(self) -> ClockSummary:
        if self._clock.first_ns is None or self._first_ns is None:
            return ClockSummary(known_after_s=None, host_minus_utc_s=None)
        return ClockSummary(
            known_after_s=(self._clock.first_ns - self._first_ns) / SECOND_NS,
            host_minus_utc_s=float(np.median(self._clock.offsets_ns)) / SECOND_NS,
        )

    def _gaps(self, stream: Stream) -> list[Gap]:
        """Silences of more than a second, for a slow stream of more than three periods."""
        if stream.rate_hz <= 0 or self._first_ns is None:
            return []
        limit_ns = max(SECOND_NS, int(_SLOW_PERIODS * SECOND_NS / stream.rate_hz))
        return [
            Gap(
                message=stream.name,
                start_s=(start_ns - self._first_ns) / SECOND_NS,
                duration_s=length_ns / SECOND_NS,
            )
            for start_ns, length_ns in stream.gaps_ns
            if length_ns > limit_ns
        ]


def _short(block: RawBlock) -> Iterator[RawBlock]:
    """The block in parts that no history is too short for."""
    edges = np.flatnonzero(np.diff(block.arrival_ns // _PART_NS)) + 1
    for start, stop in pairwise([0, *edges.tolist(), len(block.arrival_ns)]):
        yield block.rows(start, stop)


def _pitch_deg(wxyz: FloatArray) -> FloatArray:
    return np.degrees(yaw_pitch_roll(wxyz)[1])


def _sources(ranges: dict[str, _Range]) -> tuple[ValueSource, ...]:
    return tuple(
        ValueSource(name=name, count=r.count, unit=r.unit, low=r.low, high=r.high)
        for name, r in sorted(ranges.items())
        if r.count
    )
