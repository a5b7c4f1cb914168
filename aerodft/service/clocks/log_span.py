"""Survey of a whole log before it is processed: its span in UTC, lateness of its samples, and its sources."""

from dataclasses import dataclass, field

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import (
    NO_BOOT_TIME,
    GimbalSource,
    GimbalTrack,
    HeightSource,
    Track,
    TriggerSource,
    TriggerTrack,
    VehicleTrack,
)
from aerodft.service.clocks.clock_map import ClockMap
from aerodft.service.clocks.tracks_by_tick import Ticks
from aerodft.service.feed import MergedFeed
from aerodft.service.height_sources import HEIGHT_SOURCES, HeightSettings
from aerodft.service.ports import Source, TelemetryDecoder
from aerodft.service.streams import LAST

PAUSE_NS = 600 * SECOND_NS
"""Longest gap within a flight; in a longer one the machine slept, or its clock was set from 1970 to today."""


@dataclass(slots=True)
class LogSpan:
    """Span, lateness and sources of a log.

    Attributes:
        arrivals_ns: Host UTC of the first and last frame of each stretch without a pause of ``PAUSE_NS``.
        first_ns: Vehicle's UTC of the first sample; None for a log without samples.
        last_ns: Vehicle's UTC of the last sample.
        lateness_ns: Longest time from a sample's UTC to its arrival since the last jump of the clocks. An image must
            arrive this much after its stamp to meet its telemetry.
        stretches: First UTC, first arrival and lateness (ns) of samples between jumps of the clocks.
        jitter_ns: Range of lateness. Stamps on the host's clock are matched to the earliest samples, and must wait this
            long.
        heights: Height sources with at least one sample.
        attitudes: Attitude sources with at least one sample.
        triggers: UTC (ns) of the camera's triggers by message, in order of arrival.
    """

    arrivals_ns: list[tuple[int, int]] = field(default_factory=list)
    first_ns: int | None = None
    last_ns: int | None = None
    lateness_ns: int = 0
    stretches: list[tuple[int, int, int]] = field(default_factory=list)
    jitter_ns: int = 0
    heights: set[HeightSource] = field(default_factory=set)
    attitudes: set[GimbalSource] = field(default_factory=set)
    triggers: dict[TriggerSource, list[int]] = field(default_factory=dict)

    def lateness_at(self, stamp_ns: int) -> int:
        """Time (ns) after its UTC at which an image must arrive to meet its telemetry.

        Before a jump of the vehicle's clock it is that of the stretch before it; a repeated UTC is taken for the later.
        """
        for first_ns, arrival_ns, lateness_ns in reversed(self.stretches):
            if stamp_ns >= first_ns:
                return max(lateness_ns, arrival_ns - stamp_ns)
        return self.stretches[0][2] if self.stretches else self.lateness_ns

    @property
    def first_arrival_ns(self) -> int | None:
        """Host UTC of the first frame; None for a log without frames."""
        return self.arrivals_ns[0][0] if self.arrivals_ns else None

    @property
    def last_arrival_ns(self) -> int | None:
        """Host UTC of the last frame; None for a log without frames."""
        return self.arrivals_ns[-1][1] if self.arrivals_ns else None


def survey_span(log: Source, decoder: TelemetryDecoder) -> LogSpan:
    """Read a log once, decoding without measuring."""
    span, clock = LogSpan(), ClockMap()
    lateness_ns: list[int] = []
    for batch in MergedFeed([log], SECOND_NS, idle_ticks_ns=0, longest_ns=0).batches():
        for block in batch.raw:
            _add_arrivals(span, int(block.arrival_ns[0]), int(block.arrival_ns[-1]))
        tracks = tuple(track for block in batch.raw for track in decoder.decode(block) if len(track.arrival_ns))
        was_known, update = clock.is_utc_known, clock.update(Ticks.one(tracks))
        if update is None:
            continue
        if (update.restarted or update.shift_ns) and lateness_ns:
            _close_stretch(span, lateness_ns)
            lateness_ns.clear()
            if not was_known:
                span.stretches.clear()  # not in UTC
        for track in update.ticks.tracks:
            _add_source(span, track)
            stamps = clock.to_utc(track, LAST)
            if isinstance(track, TriggerTrack):
                stated = (track.boot_ns == NO_BOOT_TIME) & (track.unix_ns > 0)
                span.triggers.setdefault(track.source, []).extend(np.where(stated, track.unix_ns, stamps).tolist())
                continue  # what is late about them holds nothing up
            if not lateness_ns:
                since_ns = int(track.arrival_ns.min()) if span.stretches else 0
                span.stretches.append((int(stamps.min()), since_ns, 0))
            lateness_ns += [int((track.arrival_ns - stamps).min()), int((track.arrival_ns - stamps).max())]
            _extend(span, int(stamps.min()), int(stamps.max()))
    _close_stretch(span, lateness_ns)
    span.lateness_ns = max(lateness_ns, default=0)
    span.jitter_ns = span.lateness_ns - min(lateness_ns, default=0)
    return span


def _close_stretch(span: LogSpan, lateness_ns: list[int]) -> None:
    if lateness_ns:
        span.stretches[-1] = (*span.stretches[-1][:2], max(lateness_ns))


def _add_arrivals(span: LogSpan, first_ns: int, last_ns: int) -> None:
    if span.arrivals_ns and first_ns - span.arrivals_ns[-1][1] < PAUSE_NS:
        start_ns, stop_ns = span.arrivals_ns[-1]
        span.arrivals_ns[-1] = (start_ns, max(stop_ns, last_ns))
    else:
        span.arrivals_ns.append((first_ns, last_ns))


def _extend(span: LogSpan, low_ns: int, high_ns: int) -> None:
    span.first_ns = low_ns if span.first_ns is None else min(span.first_ns, low_ns)
    span.last_ns = high_ns if span.last_ns is None else max(span.last_ns, high_ns)


def _add_source(span: LogSpan, track: Track) -> None:
    settings = HeightSettings()
    for name, reader in HEIGHT_SOURCES.items():
        samples = reader.samples(track, settings)
        if samples is not None and np.any(np.isfinite(samples.value_m)):
            span.heights.add(name)
    if isinstance(track, GimbalTrack):
        span.attitudes.add(track.source)
    elif isinstance(track, VehicleTrack):
        span.attitudes.add(GimbalSource.FIXED_MOUNT)
