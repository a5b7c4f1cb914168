"""What one camera reports of its view at a stamp, held against the camera file."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.camera import Camera, Zoom, ZoomSource
from aerodft.model.telemetry import CameraTrack
from aerodft.service.streams import END_OF_TIME, Missing, Stream
from aerodft.service.zoom_reports import View, ViewReports
from aerodft.service.zoom_settings import ZoomSettings

LEVEL_SLACK: Final = 0.005
"""Zooms this close, as shares of their range, are the same."""
_ROUNDING_STD_RAD: Final = math.radians(1) / math.sqrt(12)  # of whole degrees
_MAGNIFIED: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Seen:
    """A camera at a stamp.

    Attributes:
        zoom: Its focal length; None for that of the file.
        reasons: What is to be said of it.
        is_unknown: Whether its zoom is known, but not what that makes of its focal length.
    """

    zoom: Zoom | None = None
    reasons: tuple[str, ...] = ()
    is_unknown: bool = False


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

    def append(self, track: CameraTrack, stamps_ns: IntArray) -> None:
        """Take in a track of this camera, of a source that is in the order."""
        self._reports[track.source].append(track, self._focal(track), stamps_ns)

    def at(self, stamp_ns: int, watermark_ns: int) -> Seen | None:
        """The camera at a stamp.

        Args:
            stamp_ns: UTC.
            watermark_ns: Newest stamp of any telemetry; ``END_OF_TIME`` where no more will be waited for.

        Returns:
            None as long as a report that matters may still come.
        """
        unknown: tuple[str, ...] = ()
        for source, reports in self._reports.items():
            if not self._is_followed(source, reports):
                continue
            view = reports.at(stamp_ns, watermark_ns)
            if view is Missing.PENDING:
                return None
            if not isinstance(view, View):
                continue
            if source is not ZoomSource.CAMERA_SETTINGS or len(self._levels):
                return self._followed(source, reports, view)
            if abs(view.value - self._settings.level) > LEVEL_SLACK:
                unknown = (self._unknown_zoom(view.value),)
        if unknown:
            return Seen(reasons=unknown, is_unknown=True)
        return Seen(reasons=self._contradictions(stamp_ns))

    def _is_followed(self, source: ZoomSource, reports: ViewReports) -> bool:
        return source is ZoomSource.CAMERA_SETTINGS or reports.is_live

    def _focal(self, track: CameraTrack) -> FloatArray:
        """Focal lengths in the unit of their source: half the image's width, or that at the curve's level 0."""
        if track.source is not ZoomSource.CAMERA_SETTINGS:
            return 1 / np.tan(track.hfov_rad / 2)
        return np.interp(track.level, self._levels, self._times) if len(self._levels) else track.level

    def _followed(self, source: ZoomSource, reports: ViewReports, view: View) -> Seen:
        settings = self._settings
        if source is ZoomSource.CAMERA_SETTINGS:
            reference = float(np.interp(settings.level, self._levels, self._times))
            reported_std = 0.0
        else:
            reference = self._reported_focal
            reported_std = _hfov_std_rad(settings, source) / math.sin(2 * math.atan(1 / view.value))
        magnification = view.value / reference
        grown = settings.std_per_doubling * abs(math.log2(magnification))
        relative = math.hypot(grown, reported_std, view.jump_std / view.value)
        reasons = (f"{source} is silent: the zoom is that of its last report",) if reports.silent(view.age_s) else ()
        if abs(magnification - 1) <= _MAGNIFIED and view.jump_std == 0.0 and source is ZoomSource.CAMERA_SETTINGS:
            return Seen(reasons=(*reasons, *self._size_contradictions()))
        zoom = Zoom(magnification=magnification, std=magnification * relative, source=source)
        return Seen(zoom, (*reasons, *self._size_contradictions()))

    def _unknown_zoom(self, level: float) -> str:
        return (
            f"{ZoomSource.CAMERA_SETTINGS} says zoom {100 * level:.1f} %, the camera file is of "
            f"{100 * self._settings.level:g} %: set telemetry.zoom.curve to what that makes of the focal length"
        )

    def _contradictions(self, stamp_ns: int) -> tuple[str, ...]:
        """What the vehicle says of a camera that is not zoomed, and its file says otherwise."""
        found = []
        expected_rad = 2 * math.atan(1 / self._reported_focal)
        for source, reports in self._reports.items():
            if source is ZoomSource.CAMERA_SETTINGS:
                continue
            view = reports.at(stamp_ns, END_OF_TIME)
            if not isinstance(view, View):
                continue
            said_rad = 2 * math.atan(1 / view.value)
            std_rad = apart_std_rad(self._settings, source, self._camera)
            if abs(said_rad - expected_rad) > std_rad:
                found.append(
                    f"{source} says hfov {math.degrees(said_rad):.1f} deg, the camera file "
                    f"{math.degrees(expected_rad):.1f} deg (std of the two {math.degrees(std_rad):.1f} deg): "
                    "the file is taken"
                )
        return (*found, *self._size_contradictions())

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
