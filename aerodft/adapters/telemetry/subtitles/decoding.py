"""Cues of subtitles to telemetry tracks."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from aerodft.adapters.telemetry.subtitles.cues import AGAINST_WAY_HOME, Cue, read_cue
from aerodft.geometry import from_yaw_pitch_roll
from aerodft.model import (
    BoolArray,
    CameraTrack,
    ClockTrack,
    GimbalSource,
    GimbalTrack,
    HeightSource,
    HeightTrack,
    IntArray,
    PositionTrack,
    RawBlock,
    Track,
    VehicleTrack,
    ZoomSource,
)

PROTOCOL: Final = "srt"
_MESSAGE: Final = "SRT"
_BOOT_NS: Final = 10**15  # a steady count: of UTC what is left of eleven days
_FULL_FRAME_WIDTH_MM: Final = 34.61  # of a 4:3 picture whose diagonal is that of 35 mm film: 43.27 mm * 4 / 5


def hfov_deg(focal_mm: float) -> float:
    """Horizontal field of view (degrees) of a 35 mm-equivalent focal length, of a 4:3 picture in full width."""
    return 2 * math.degrees(math.atan(_FULL_FRAME_WIDTH_MM / 2 / focal_mm))


class SubtitleDecoder:
    """Decodes cues, each on its own. A ``service.ports.TelemetryDecoder``.

    A cue's arrival is its UTC: the source makes it of the video's time line and of the drone's clock. A camera whose
    angles are not stated hangs level on its gimbal: the vehicle's attitude is level then, and a ``fixed_mount`` states
    the camera's own angles; where not even the drone's yaw is stated, its heading is unknown.

    Args:
        gps_lon_first: Whether ``GPS(a, b)`` has the longitude first; None to tell it by each cue.

    Attributes:
        rejected: Values left out, by ``SRT: reason``.
    """

    def __init__(self, *, gps_lon_first: bool | None = None) -> None:
        self._gps_lon_first = gps_lon_first
        self._is_order_wrong = False
        self.rejected: Counter[str] = Counter()

    def frame_names(self, block: RawBlock) -> tuple[IntArray, Mapping[int, str]]:
        """All cues are of one name."""
        return np.zeros(len(block.offset), dtype=np.int64), {0: _MESSAGE}

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's cues; no cue is an error.

        Raises:
            ValueError: The block is not of subtitles.
        """
        if block.protocol != PROTOCOL:
            raise ValueError(f"got a block of {block.protocol}, must be {PROTOCOL}")
        cues = [
            read_cue(block.data[at : at + size], gps_lon_first=self._gps_lon_first)
            for at, size in zip(block.offset.tolist(), block.length.tolist(), strict=True)
        ]
        cues = self._without_misread_places(cues)
        for cue in cues:
            self.rejected.update(f"{_MESSAGE}: {fault}" for fault in cue.faults)
        if not cues:
            return ()
        stamps = {"arrival_ns": block.arrival_ns, "boot_ns": block.arrival_ns % _BOOT_NS}
        clock = ClockTrack(unix_ns=block.arrival_ns, **stamps)
        tracks = [
            clock,
            *_heights(cues, stamps),
            *_places(cues, stamps),
            *_attitudes(cues, stamps),
            *_zooms(cues, stamps),
        ]
        return tuple(track for track in tracks if len(track.arrival_ns))

    def _without_misread_places(self, cues: list[Cue]) -> list[Cue]:
        """The cues without places from where one contradicts the order of coordinates: near HOME no other could."""
        self._is_order_wrong |= any(AGAINST_WAY_HOME in cue.faults for cue in cues)
        if not self._is_order_wrong:
            return cues
        return [
            replace(cue, lat_lon_deg=None, faults=(*cue.faults, AGAINST_WAY_HOME)) if cue.lat_lon_deg else cue
            for cue in cues
        ]


def _chosen(stamps: Mapping[str, Any], chosen: BoolArray) -> dict[str, Any]:
    return {name: values[chosen] for name, values in stamps.items()}


def _heights(cues: list[Cue], stamps: Mapping[str, Any]) -> Iterable[Track]:
    """Heights above the take-off point."""
    value_m = np.array([math.nan if cue.height_home_m is None else cue.height_home_m for cue in cues])
    known = np.isfinite(value_m)
    yield HeightTrack(
        source=HeightSource.HOME,
        value_m=value_m[known],
        slant=False,
        std_m=np.full(int(known.sum()), math.nan),
        **_chosen(stamps, known),
    )


def _places(cues: list[Cue], stamps: Mapping[str, Any]) -> Iterable[Track]:
    """Places; absolute heights are of no stated datum, and are left out."""
    known = np.array([cue.lat_lon_deg is not None for cue in cues])
    lat_lon_rad = np.radians([cue.lat_lon_deg for cue in cues if cue.lat_lon_deg is not None]).reshape(-1, 2)
    nothing = np.full(len(lat_lon_rad), math.nan)
    yield PositionTrack(
        lat_rad=lat_lon_rad[:, 0],
        lon_rad=lat_lon_rad[:, 1],
        alt_msl_m=nothing,
        height_home_m=nothing,
        **_chosen(stamps, known),
    )


def _attitudes(cues: list[Cue], stamps: Mapping[str, Any]) -> Iterable[Track]:
    """The camera's angles where they are stated, else the level that its gimbal keeps."""
    has_angles = np.array([cue.gimbal_deg is not None for cue in cues])
    angles_rad = np.radians([cue.gimbal_deg for cue in cues if cue.gimbal_deg is not None]).reshape(-1, 3)
    yield GimbalTrack(
        source=GimbalSource.SUBTITLES,
        wxyz=from_yaw_pitch_roll(*angles_rad.T),
        yaw_in_earth=np.ones(len(angles_rad), dtype=np.bool_),
        **_chosen(stamps, has_angles),
    )
    yaw_rad = np.radians([math.nan if cue.body_yaw_deg is None else cue.body_yaw_deg for cue in cues])[~has_angles]
    level = np.zeros(len(yaw_rad))
    yield VehicleTrack(
        wxyz=from_yaw_pitch_roll(np.nan_to_num(yaw_rad), level, level),
        heading_std_rad=np.where(np.isnan(yaw_rad), math.pi, math.nan),
        **_chosen(stamps, ~has_angles),
    )


def _zooms(cues: list[Cue], stamps: Mapping[str, Any]) -> Iterable[Track]:
    """Fields of view by the 35 mm-equivalent focal length and the digital zoom: they count by their changes."""
    known = np.array([cue.focal_mm is not None for cue in cues])
    focal_mm = np.array([cue.focal_mm * (cue.zoom or 1.0) for cue in cues if cue.focal_mm is not None])
    count = len(focal_mm)
    none = np.zeros(count, dtype=np.int64)
    yield CameraTrack(
        source=ZoomSource.SUBTITLES,
        device=none + 1,
        stream=none,
        hfov_rad=2 * np.arctan(_FULL_FRAME_WIDTH_MM / 2 / focal_mm) if count else focal_mm,
        level=np.full(count, math.nan),
        size_px=np.zeros((count, 2), dtype=np.int64),
        **_chosen(stamps, known),
    )
