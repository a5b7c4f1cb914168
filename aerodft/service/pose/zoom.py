"""What one camera reports of its view at a stamp, held against the camera file."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import (
    CODE_OF,
    BoolArray,
    Camera,
    CameraTrack,
    FloatArray,
    IntArray,
    PoseBatch,
    PoseSample,
    Status,
    Track,
    Zoom,
    ZoomSource,
)
from aerodft.service.settings import ZoomSettings
from aerodft.service.streams import END_OF_TIME, Missing, Stream

_LATE: Final = 1.5  # periods that a report of a live source is waited for
_SAME: Final = 0.002  # focal lengths this close, as a share, are one: 32 bits bring them back with an error


@dataclass(frozen=True, slots=True, eq=False)
class ViewBatch:
    """What is reported of a focal length at ``n`` stamps; NaN where there is nothing.

    Attributes:
        value: ``(n,)`` the focal length, in the unit of the reports.
        step_std: ``(n,)`` standard deviation by not knowing when between two reports it changed.
        age_s: ``(n,)`` since the newest report that is not after the stamp.
        is_silent: ``(n,)`` whether reports that came regularly have stopped.
        missing: ``(n,)`` why there is none, as ``Missing``.
    """

    value: FloatArray
    step_std: FloatArray
    age_s: FloatArray
    is_silent: BoolArray
    missing: IntArray


class ViewReports:
    """Focal lengths as one source reports them, in a unit of its own.

    Attributes:
        is_live: Whether a report has differed from the first: a parameter that somebody typed in does not.
        size_px: Width and height of the images as last reported; None where they never were.
    """

    def __init__(self, max_gap_ns: int, stream: int | None) -> None:
        self.is_live = False
        self.size_px: tuple[int, int] | None = None
        self._number = stream
        self._first: float | None = None
        self.stream = Stream(max_gap_ns)

    def changes_nothing(self, track: CameraTrack, focal: FloatArray) -> bool:
        """Whether reports of several ticks may be appended at once: what is known for good stays as it is."""
        own = track.stream == self._number
        sizes = track.size_px[own & np.all(track.size_px > 0, axis=-1)]
        if self._number is None or self._first is None or np.any(sizes != self.size_px):
            return False
        return self.is_live or not self._has_changed(focal[own & np.isfinite(focal)])

    def append(
        self, track: CameraTrack, focal: FloatArray, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None
    ) -> None:
        """Take in the reports of a step: those of the stream that was heard first, or is asked for."""
        if self._number is None and len(track.stream):
            self._number = int(track.stream[0])
        own = track.stream == self._number
        sized = own & np.all(track.size_px > 0, axis=-1)
        if np.any(sized):
            width, height = track.size_px[np.flatnonzero(sized)[-1]].tolist()
            self.size_px = (width, height)
        known = own & np.isfinite(focal)
        if not np.any(known):
            return
        if self._first is None:
            self._first = float(focal[known][0])
        self.is_live = self.is_live or self._has_changed(focal[known])
        ends = None if row_end_by_tick is None else np.concatenate([[0], np.cumsum(known)])[row_end_by_tick]
        self.stream.append(stamps_ns[known], ends, focal=focal[known])

    def at(self, stamps_ns: IntArray, ticks: IntArray, watermark_ns: IntArray) -> ViewBatch:
        """Focal lengths at stamps ``(n,)``: between two reports where they are near, else as last reported.

        A change between two reports may have been at any time: the mean of that is the line between them, and the
        variance that of a coin that falls as often as the stamp is past the change. Arguments as in ``Stream.find``.
        """
        nothing = np.full(len(stamps_ns), np.nan)
        if self.stream.is_empty:
            never = np.full(len(stamps_ns), int(Missing.NEVER))
            return ViewBatch(nothing, nothing, nothing, np.full(len(stamps_ns), fill_value=False), never)
        samples_ns, focal = self.stream.stamps_ns, self.stream.column("focal")
        first, end = self.stream.rows_known_at(ticks)
        period_ns = self._period_ns(first, end)
        before = self.stream.last_before(stamps_ns, ticks)
        after = np.minimum(before + 1, np.maximum(end - 1, 0))
        is_last = before + 1 >= end
        gap_ns = samples_ns[after] - samples_ns[before]
        is_between = ~is_last & (before >= 0) & (gap_ns <= self.stream.max_gap_ns)
        weight = np.where(is_between, (stamps_ns - samples_ns[before]) / np.maximum(gap_ns, 1), 0.0)
        change = np.where(is_between, focal[after] - focal[before], 0.0)
        age_s = (stamps_ns - samples_ns[before]) / SECOND_NS
        is_regular = (period_ns > 0) & (period_ns <= self.stream.max_gap_ns)
        newest_ns = samples_ns[np.maximum(end, 1) - 1]
        waits = is_last & (newest_ns < stamps_ns) & is_regular & (watermark_ns - newest_ns <= _LATE * period_ns)
        missing = np.where(end == first, Missing.NEVER, np.where(waits, Missing.PENDING, Missing.NOTHING))
        missing = np.where((before < 0) & ~waits, Missing.NEVER, missing)
        is_silent = (period_ns > 0) & (age_s > np.maximum(self.stream.max_gap_ns, 3 * period_ns) / SECOND_NS)
        step_std = np.abs(change) * np.sqrt(weight * (1 - weight))
        return ViewBatch(focal[before] + weight * change, step_std, age_s, is_silent, missing)

    def _has_changed(self, focal: FloatArray) -> bool:
        return self._first is not None and bool(np.any(np.abs(focal - self._first) > _SAME * self._first))

    def _period_ns(self, first: IntArray, end: IntArray) -> IntArray:
        """Between the last two reports before rows ``end (n,)``; 0 before there are two."""
        samples_ns = self.stream.stamps_ns
        last, earlier = np.maximum(end - 1, 0), np.maximum(end - 2, 0)
        return np.where(end - first > 1, samples_ns[last] - samples_ns[earlier], 0)


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
            known = view.missing == Missing.NOTHING
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
        relative = np.hypot(np.hypot(grown, reported_std), view.step_std / view.value)
        is_file = (np.abs(magnification - 1) <= _MAGNIFIED) & (view.step_std == 0.0)
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
            std_rad = hfov_difference_std_rad(self._settings, source, self._camera)
            is_apart = (view.missing == Missing.NOTHING) & (np.abs(said_rad - expected_rad) > std_rad)
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


def hfov_difference_std_rad(settings: ZoomSettings, source: ZoomSource, camera: Camera) -> float:
    """Standard deviation of a reported horizontal field of view against the camera file's."""
    focal_px = math.sqrt(camera.covariance[0][0]) if camera.covariance else camera.std.focal_px
    return math.hypot(_hfov_std_rad(settings, source), math.sin(camera.hfov_rad) * focal_px / camera.fx_px)


def _hfov_std_rad(settings: ZoomSettings, source: ZoomSource) -> float:
    whole = source is ZoomSource.VIDEO_STREAM_INFORMATION
    return math.hypot(settings.hfov_std_rad, _ROUNDING_STD_RAD if whole else 0.0)


class ZoomSources:
    """All that a vehicle reports of its cameras.

    Args:
        settings: How it is read, and which camera makes the images.
        camera: As its file has it.
    """

    def __init__(self, settings: ZoomSettings, camera: Camera) -> None:
        self._settings = settings
        self._camera = camera
        self._cameras: dict[int, CameraReports] = {}

    def streams(self) -> tuple[Stream, ...]:
        """All streams, to be forgotten or moved when clocks jump."""
        return tuple(stream for camera in self._cameras.values() for stream in camera.streams())

    def may_append_ticks(self, track: Track) -> bool:
        """Whether a track of several ticks may be appended at once."""
        if not isinstance(track, CameraTrack) or track.source not in self._settings.order:
            return True
        numbers = [number for number in np.unique(track.device).tolist() if self._settings.camera in {None, number}]
        return all(
            number in self._cameras and self._cameras[number].may_append_ticks(_of_camera(track, number)[0])
            for number in numbers
        )

    def append(self, track: Track, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Take a track of a step in, if it is of a camera that counts; as ``Stream.append``."""
        if not isinstance(track, CameraTrack) or track.source not in self._settings.order:
            return
        for number in np.unique(track.device).tolist():
            if self._settings.camera in {None, number}:
                reports = self._cameras.setdefault(number, CameraReports(self._settings, self._camera))
                own, is_own = _of_camera(track, number)
                ends = None if row_end_by_tick is None else np.concatenate([[0], np.cumsum(is_own)])[row_end_by_tick]
                reports.append(own, stamps_ns[is_own], ends)

    def applied(self, poses: PoseBatch, ticks: IntArray, watermark_ns: IntArray) -> tuple[PoseBatch, BoolArray]:
        """Poses with the camera's zoom and what contradicts the camera's file.

        Args:
            poses: ``(n,)``.
            ticks: ``(n,)`` as in ``Stream.find``.
            watermark_ns: ``(n,)`` as in ``Stream.find``.

        Returns:
            The poses, and where a report that matters may still come.
        """
        is_ok = poses.status == CODE_OF[Status.OK]
        if not self._cameras or not np.any(is_ok):
            return poses, np.full(len(poses), fill_value=False)
        query = poses.stamp_ns, ticks, watermark_ns
        found = {number: camera.at(*query) for number, camera in sorted(self._cameras.items())}
        is_pending = np.logical_or.reduce([zoom.is_pending for zoom in found.values()]) & is_ok
        zoom = next(iter(found.values())) if len(found) == 1 else _of_several(found)
        keys = [
            (zoom.sources[k], zoom.reasons[k], bool(zoom.is_unknown[k])) if is_ok[k] else None
            for k in range(len(poses))
        ]
        zoomed = poses.with_variants(keys, _zoomed)
        is_zoomed = is_ok & ~zoom.is_unknown & ~np.isnan(zoom.magnification)
        numbers = np.where(is_zoomed[:, None], np.stack([zoom.magnification, zoom.std], axis=-1), poses.zoom)
        return replace(zoomed, zoom=numbers), is_pending


def _of_camera(track: CameraTrack, number: int) -> tuple[CameraTrack, BoolArray]:
    """The rows of one camera, and which rows these are."""
    own = track.device == number
    return track.rows(own, boot_ns=track.boot_ns), own


def _zoomed(sample: PoseSample, key: tuple[ZoomSource | None, tuple[str, ...], bool]) -> PoseSample:
    """A sample without its numbers, with a zoom of that source, reasons, and whether the focal length is unknown."""
    source, reasons, is_unknown = key
    if is_unknown:
        return replace(sample, status=Status.CAMERA_ZOOMED, reasons=(*reasons, *sample.reasons))
    zoom = None if source is None else Zoom(magnification=math.nan, std=math.nan, source=source)
    return replace(sample, zoom=zoom, reasons=(*sample.reasons, *reasons))


def _of_several(cameras: dict[int, ZoomBatch]) -> ZoomBatch:
    """What cameras say of which none is chosen: whose images these are matters as soon as one of them is zoomed."""
    numbers = ", ".join(map(str, cameras))
    choose = f"several cameras report ({numbers}), and not the same zoom: set telemetry.zoom.camera to one of them"
    found = ZoomBatch.of_file(len(next(iter(cameras.values())).reasons))
    for row in range(len(found.reasons)):
        said = tuple(f"camera {number}: {why}" for number, zoom in cameras.items() for why in _reasons(zoom, row))
        matters = any(zoom.sources[row] is not None or zoom.is_unknown[row] for zoom in cameras.values())
        found.is_unknown[row] = matters
        found.reasons[row] = (choose, *said) if matters else said
    return found


def _reasons(zoom: ZoomBatch, row: int) -> tuple[str, ...]:
    source = zoom.sources[row]
    own = () if source is None else (f"{source} says zoom x {zoom.magnification[row]:.2f}",)
    return (*own, *zoom.reasons[row])
