"""Flights whose telemetry stands in their own videos, as subtitles or data, and cameras whose tilt is stated."""

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from aerodft.adapters.config.station import StationConfig, VideoFile, with_derived_settings
from aerodft.adapters.telemetry import (
    LOG_FORMATS,
    DataTrackLog,
    SubtitleLog,
    are_subtitles,
    carries_telemetry,
    open_log,
)
from aerodft.conventions import SECOND_NS
from aerodft.errors import UsageError
from aerodft.model import GimbalSource
from aerodft.service import AttitudeSettings, FixedMount, TelemetrySettings

_MAX_TILT_DEG = 180.0
_CUE_GAPS: Final = 1.5  # twice would interpolate angles over a lost cue; once loses all of cues that jitter by 1 ms

_log = logging.getLogger(__name__)


def subtitled_flight(logs: Sequence[Path]) -> SubtitleLog | None:
    """The subtitles of a flight, by its subtitles or videos; None for one log of another format.

    Raises:
        UsageError: Several files, one of which is no subtitle and no video.
        InputError: A file cannot be read, or is a video without subtitles.
    """
    for path in logs:
        if not are_subtitles(path) or (len(logs) == 1 and carries_telemetry(path)):
            if len(logs) == 1:
                return None
            titles = ", ".join(each.TITLE for each in LOG_FORMATS)
            expected = f"one log ({titles}), or the subtitles or videos of one flight"
            raise UsageError("several logs", got=str(path), expected=expected)
    return SubtitleLog(logs) if logs else None


def with_own_videos(station: StationConfig, flight: SubtitleLog) -> tuple[StationConfig, SubtitleLog]:
    """A station whose images are those of a flight's own videos, unless it names others; and the flight in its time.

    Images and subtitles have one time line. Where the station states when its video begins, the subtitles begin then.
    Intervals cover that a cue's values may be of any moment that the cue holds.

    Raises:
        InputError: The video that the station names is not the one of the subtitles.
    """
    if (telemetry := station.pipeline.telemetry) is not None:
        pipeline = replace(station.pipeline, telemetry=over_cues(telemetry, flight))
        station = with_derived_settings(replace(station, pipeline=pipeline))
    source, videos = station.images.source, flight.videos
    if source is None and videos:
        source = VideoFile(path=videos[0][0])
    if not isinstance(source, VideoFile):
        return station, flight
    if source.start_ns is not None:
        flight = flight.restarted(source.start_ns)
    is_own = bool(flight.videos) and flight.videos[0][0].resolve() == source.path.resolve()
    if not is_own:
        for sentence in flight.check_video(source.path):
            _log.warning("%s: %s", source.path, sentence)
    source = replace(source, start_ns=flight.start_ns, later=flight.videos[1:] if is_own else ())
    pipeline = replace(station.pipeline, time_std_s=max(station.pipeline.time_std_s, flight.time_std_s))
    images = replace(station.images, source=source, is_auto=False)
    return with_derived_settings(replace(station, images=images, pipeline=pipeline)), flight


def with_carrying_video(station: StationConfig, log: Path) -> StationConfig:
    """A station whose images are those of the video that carries its telemetry, unless it names others.

    Raises:
        InputError: The telemetry does not keep to the video's time line.
    """
    source = station.images.source
    is_own = source is None or (isinstance(source, VideoFile) and source.path.resolve() == log.resolve())
    if not is_own or not carries_telemetry(log):
        return station
    source = source if isinstance(source, VideoFile) else VideoFile(path=log)
    telemetry = open_log(log)
    if source.start_ns is not None or not isinstance(telemetry, DataTrackLog) or telemetry.start_ns is None:
        return station
    source = replace(source, start_ns=telemetry.start_ns)
    pipeline = replace(station.pipeline, time_std_s=max(station.pipeline.time_std_s, telemetry.time_std_s))
    images = replace(station.images, source=source, is_auto=False)
    return with_derived_settings(replace(station, images=images, pipeline=pipeline))


def over_cues(telemetry: TelemetrySettings, flight: SubtitleLog) -> TelemetrySettings:
    """Settings that interpolate angles from cue to cue, unless a station states its own longest gap.

    Cues of the slowest dialects are 1.000 to 1.001 s apart.
    """
    attitude, default_ns = telemetry.attitude, AttitudeSettings().max_gap_ns
    if attitude.max_gap_ns != default_ns:
        return telemetry
    gap_ns = max(default_ns, round(_CUE_GAPS * flight.interval_s * SECOND_NS))
    return replace(telemetry, attitude=replace(attitude, max_gap_ns=gap_ns))


def with_tilt(station: StationConfig, tilt_deg: float) -> StationConfig:
    """A station whose camera has a stated tilt where no gimbal reports its own.

    Args:
        station: The station.
        tilt_deg: From straight down; against the vehicle's body, which subtitles without angles take for level.

    Raises:
        UsageError: An impossible tilt, or a station without telemetry.
    """
    telemetry = station.pipeline.telemetry
    if not 0 <= tilt_deg < _MAX_TILT_DEG:
        raise UsageError("`tilt_deg`", got=f"{tilt_deg:g}", expected="from 0 (straight down) to below 180")
    if telemetry is None:
        raise UsageError("`tilt_deg` without telemetry", expected="a station with [telemetry]")
    mount = FixedMount(yaw_rad=0.0, pitch_rad=math.radians(tilt_deg - 90), roll_rad=0.0)
    order = tuple(dict.fromkeys((*telemetry.attitude.order, GimbalSource.FIXED_MOUNT)))
    attitude = replace(telemetry.attitude, order=order, fixed_mount=mount)
    return replace(station, pipeline=replace(station.pipeline, telemetry=replace(telemetry, attitude=attitude)))
