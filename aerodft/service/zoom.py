"""What one camera reports of its view at a stamp, held against the camera file."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.model.camera import Camera, ZoomSource
from aerodft.model.telemetry import CameraTrack
from aerodft.service.streams import END_OF_TIME, Missing, Stream
from aerodft.service.zoom_reports import ViewBatch, ViewReports
from aerodft.service.zoom_settings import ZoomSettings

LEVEL_SLACK: Final = 0.005
"""Zooms this close, as shares of their range, are the same."""
_ROUNDING_STD_RAD: Final = math.radians(1) / math.sqrt(12)  # of whole degrees
_MAGNIFIED: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class ZoomBatch:
    """A camera's focal length at ``n`` stamps.

    Attributes:
        magnification: ``(n,)`` against the camera's file; NaN where the file's holds.
        std: ``(n,)`` its standard deviation.
        sources: Where each is known from; None where the file's holds.
        reasons: What is to be said of each.
        is_unknown: ``(n,)`` whether the zoom is known, but not what that makes of the focal length.
        is_pending: ``(n,)`` whether a report that matters may still come.
    """

    magnification: FloatArray
    std: FloatArray
    sources: list[ZoomSource | None]
    reasons: list[tuple[str, ...]]
    is_unknown: BoolArray
    is_pending: BoolArray

    @staticmethod
    def of_file(count: int) -> "ZoomBatch":
        """The camera as its file has it, at ``count`` stamps."""
        nothing = np.full(count, np.nan)
        is_unknown, is_pending = np.full(count, fill_value=False), np.full(count, fill_value=False)
        return ZoomBatch(nothing, nothing.copy(), [None] * count, [()] * count, is_unknown, is_pending)


class CameraReports:
    """All that is reported of one camera.

    Args:
        settings: How it is read.
        camera: As its file has it.
    """

    def __init__(self, settings: ZoomSettings, camera: Camera) -> None:
        self._settings = settings
        self._camera = camera
        streams = {ZoomSource.VIDEO_STREAM_INFORMATION: settings.stream}
        self._reports = {source: ViewReports(settings.max_gap_ns, streams.get(source)) for source in settings.order}
        self._levels = np.array([level for level, _ in settings.curve])
        self._times = np.array([times for _, times in settings.curve])
        hfov_rad = camera.hfov_rad if settings.reported_hfov_rad is None else settings.reported_hfov_rad
        self._reported_focal = 1 / math.tan(hfov_rad / 2)

    def streams(self) -> tuple[Stream, ...]:
        """All streams, to be forgotten or moved when clocks jump."""
        return tuple(reports.stream for reports in self._reports.values())

    def may_append_ticks(self, track: CameraTrack) -> bool:
        """Whether a track of several ticks may be appended at once."""
        return self._reports[track.source].changes_nothing(track, self._focal(track))

    def append(self, track: CameraTrack, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Take in a track of a step of this camera, of a source that is in the order; as ``Stream.append``."""
        self._reports[track.source].append(track, self._focal(track), stamps_ns, row_end_by_tick)

    def at(self, stamps_ns: IntArray, ticks: IntArray, watermark_ns: IntArray) -> ZoomBatch:
        """The camera at stamps ``(n,)``; arguments as in ``Stream.find``."""
        found = ZoomBatch.of_file(len(stamps_ns))
        left = np.arange(len(stamps_ns))
        for source, reports in self._reports.items():
            if not self._is_followed(source, reports) or not len(left):
                continue
            view = reports.at(stamps_ns[left], ticks[left], watermark_ns[left])
            found.is_pending[left] |= view.missing == Missing.PENDING
            known = view.missing == Missing.NO
            if source is not ZoomSource.CAMERA_SETTINGS or len(self._levels):
                self._follow(found, left, known, source, view)
                left = left[view.missing == Missing.NEVER]
                continue
            for k in np.flatnonzero(known & (np.abs(view.value - self._settings.level) > LEVEL_SLACK)).tolist():
                found.reasons[left[k]] = (self._unknown_zoom(float(view.value[k])),)
                found.is_unknown[left[k]] = True
            left = left[view.missing != Missing.PENDING]
        left = left[~found.is_unknown[left]]
        for row, reasons in zip(left.tolist(), self._contradictions(stamps_ns[left], ticks[left]), strict=True):
            found.reasons[row] = reasons
        return found

    def _is_followed(self, source: ZoomSource, reports: ViewReports) -> bool:
        return source is ZoomSource.CAMERA_SETTINGS or reports.is_live

    def _focal(self, track: CameraTrack) -> FloatArray:
        """Focal lengths in the unit of their source: half the image's width, or that at the curve's level 0."""
        if track.source is not ZoomSource.CAMERA_SETTINGS:
            return 1 / np.tan(track.hfov_rad / 2)
        return np.interp(track.level, self._levels, self._times) if len(self._levels) else track.level

    def _follow(self, found: ZoomBatch, left: IntArray, known: BoolArray, source: ZoomSource, view: ViewBatch) -> None:
        """Write what a source reports at those of the rows ``left`` that are ``known``."""
        settings = self._settings
        if source is ZoomSource.CAMERA_SETTINGS:
            reference = float(np.interp(settings.level, self._levels, self._times))
            reported_std = np.zeros(len(left))
        else:
            reference = self._reported_focal
            reported_std = _hfov_std_rad(settings, source) / np.sin(2 * np.arctan(1 / view.value))
        magnification = view.value / reference
        grown = settings.std_per_doubling * np.abs(np.log2(magnification))
        relative = np.hypot(np.hypot(grown, reported_std), view.jump_std / view.value)
        is_file = (np.abs(magnification - 1) <= _MAGNIFIED) & (view.jump_std == 0.0)
        is_file &= source is ZoomSource.CAMERA_SETTINGS
        silent, sizes = (f"{source} is silent: the zoom is that of its last report",), self._size_contradictions()
        for k in np.flatnonzero(known).tolist():
            row = int(left[k])
            found.reasons[row] = (*(silent if view.is_silent[k] else ()), *sizes)
            if not is_file[k]:
                found.sources[row] = source
        found.is_unknown[left[known]] = False
        zooms = known & ~is_file
        found.magnification[left[zooms]] = magnification[zooms]
        found.std[left[zooms]] = (magnification * relative)[zooms]

    def _unknown_zoom(self, level: float) -> str:
        return (
            f"{ZoomSource.CAMERA_SETTINGS} says zoom {100 * level:.1f} %, the camera file is of "
            f"{100 * self._settings.level:g} %: set telemetry.zoom.curve to what that makes of the focal length"
        )

    def _contradictions(self, stamps_ns: IntArray, ticks: IntArray) -> list[tuple[str, ...]]:
        """What the vehicle says of a camera that is not zoomed at stamps ``(n,)``, and its file says otherwise."""
        found: list[tuple[str, ...]] = [()] * len(stamps_ns)
        expected_rad = 2 * math.atan(1 / self._reported_focal)
        end_ns = np.full(len(stamps_ns), END_OF_TIME)
        for source, reports in self._reports.items():
            if source is ZoomSource.CAMERA_SETTINGS:
                continue
            view = reports.at(stamps_ns, ticks, end_ns)
            said_rad = 2 * np.arctan(1 / view.value)
            std_rad = apart_std_rad(self._settings, source, self._camera)
            is_apart = (view.missing == Missing.NO) & (np.abs(said_rad - expected_rad) > std_rad)
            for k in np.flatnonzero(is_apart).tolist():
                sentence = (
                    f"{source} says hfov {math.degrees(said_rad[k]):.1f} deg, the camera file "
                    f"{math.degrees(expected_rad):.1f} deg (std of the two {math.degrees(std_rad):.1f} deg): "
                    "the file is taken"
                )
                found[k] = (*found[k], sentence)
        sizes = self._size_contradictions()
        return [(*each, *sizes) for each in found] if sizes else found

    def _size_contradictions(self) -> tuple[str, ...]:
        size = self._camera.width_px, self._camera.height_px
        return tuple(
            f"{source} says {reports.size_px[0]} x {reports.size_px[1]} px, the camera file {size[0]} x {size[1]} px"
            for source, reports in self._reports.items()
            if reports.size_px is not None and reports.size_px != size
        )


def apart_std_rad(settings: ZoomSettings, source: ZoomSource, camera: Camera) -> float:
    """Standard deviation of a reported horizontal field of view against the camera file's."""
    focal_px = math.sqrt(camera.covariance[0][0]) if camera.covariance else camera.std.focal_px
    return math.hypot(_hfov_std_rad(settings, source), math.sin(camera.hfov_rad) * focal_px / camera.fx_px)


def _hfov_std_rad(settings: ZoomSettings, source: ZoomSource) -> float:
    whole = source is ZoomSource.VIDEO_STREAM_INFORMATION
    return math.hypot(settings.hfov_std_rad, _ROUNDING_STD_RAD if whole else 0.0)
