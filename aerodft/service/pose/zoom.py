"""Zoom of the camera at stamps, from the vehicle's reports, relative to the camera file."""

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
from aerodft.service.streams import Missing, Query, Stream, TelemetryPart

_WAIT_PERIODS: Final = 1.5  # periods to wait for a report of a live source
_ROUNDING_FRACTION: Final = 0.002  # relative rounding error of a focal length sent in 32 bits


@dataclass(frozen=True, slots=True, eq=False)
class FocalBatch:
    """Reported focal lengths at ``n`` stamps; NaN where missing.

    Attributes:
        value: ``(n,)`` focal length in the unit of the reports.
        step_std: ``(n,)`` standard deviation from the unknown time of a change between two reports.
        age_s: ``(n,)`` since the newest report that is not after the stamp.
        is_silent: ``(n,)`` whether regular reports have stopped.
        missing: ``(n,)`` as ``Missing``.
    """

    value: FloatArray
    step_std: FloatArray
    age_s: FloatArray
    is_silent: BoolArray
    missing: IntArray


class FocalReports:
    """Focal lengths reported by one source, in its own unit.

    Attributes:
        is_live: Whether a report has differed from the first one: a configured parameter never does.
        size_px: Last reported width and height of the images; None if never reported.
    """

    def __init__(self, max_gap_ns: int, stream: int | None) -> None:
        self.is_live = False
        self.size_px: tuple[int, int] | None = None
        self._number = stream
        self._first: float | None = None
        self.stream = Stream(max_gap_ns)

    def may_append_ticks(self, track: CameraTrack, focal: FloatArray) -> bool:
        """Whether reports of several ticks may be appended at once: stream, size and liveness do not change."""
        is_own_stream = track.stream == self._number
        sizes = track.size_px[is_own_stream & np.all(track.size_px > 0, axis=-1)]
        if self._number is None or self._first is None or np.any(sizes != self.size_px):
            return False
        return self.is_live or not self._has_changed(focal[is_own_stream & np.isfinite(focal)])

    def append(
        self, track: CameraTrack, focal: FloatArray, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None
    ) -> None:
        """Append the reports of a step, of the configured stream or else of the first one heard."""
        if self._number is None and len(track.stream):
            self._number = int(track.stream[0])
        is_own_stream = track.stream == self._number
        sized = is_own_stream & np.all(track.size_px > 0, axis=-1)
        if np.any(sized):
            width, height = track.size_px[np.flatnonzero(sized)[-1]].tolist()
            self.size_px = (width, height)
        is_usable = is_own_stream & np.isfinite(focal)
        if not np.any(is_usable):
            return
        if self._first is None:
            self._first = float(focal[is_usable][0])
        self.is_live = self.is_live or self._has_changed(focal[is_usable])
        ends = None if row_end_by_tick is None else np.concatenate([[0], np.cumsum(is_usable)])[row_end_by_tick]
        self.stream.append(stamps_ns[is_usable], ends, focal=focal[is_usable])

    def at(self, query: Query) -> FocalBatch:
        """Focal lengths ``(n,)``: interpolated between near reports, else the last reported.

        A change happens at a uniformly distributed time between two reports: the mean is the line between them, the
        variance that of a Bernoulli variable.
        """
        stamps_ns, ticks, watermark_ns = query.stamps_ns, query.ticks, query.watermark_ns
        nan = np.full(len(stamps_ns), np.nan)
        if self.stream.is_empty:
            never = np.full(len(stamps_ns), int(Missing.NEVER))
            return FocalBatch(nan, nan, nan, np.full(len(stamps_ns), fill_value=False), never)
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
        waits = is_last & (newest_ns < stamps_ns) & is_regular & (watermark_ns - newest_ns <= _WAIT_PERIODS * period_ns)
        missing = np.where(end == first, Missing.NEVER, np.where(waits, Missing.PENDING, Missing.NOTHING))
        missing = np.where((before < 0) & ~waits, Missing.NEVER, missing)
        is_silent = (period_ns > 0) & (age_s > np.maximum(self.stream.max_gap_ns, 3 * period_ns) / SECOND_NS)
        step_std = np.abs(change) * np.sqrt(weight * (1 - weight))
        return FocalBatch(focal[before] + weight * change, step_std, age_s, is_silent, missing)

    def _has_changed(self, focal: FloatArray) -> bool:
        return self._first is not None and bool(np.any(np.abs(focal - self._first) > _ROUNDING_FRACTION * self._first))

    def _period_ns(self, first: IntArray, end: IntArray) -> IntArray:
        """Interval between the last two reports before rows ``end (n,)``; 0 before there are two."""
        samples_ns = self.stream.stamps_ns
        last, earlier = np.maximum(end - 1, 0), np.maximum(end - 2, 0)
        return np.where(end - first > 1, samples_ns[last] - samples_ns[earlier], 0)


LEVEL_SLACK: Final = 0.005
"""Tolerance of zoom levels, as a fraction of their range."""
_ROUNDING_STD_RAD: Final = math.radians(1) / math.sqrt(12)  # of whole degrees
_SOURCE_STD_RAD: Final = {
    ZoomSource.VIDEO_STREAM_INFORMATION: _ROUNDING_STD_RAD,
    # A focal length "equivalent to 35 mm" leaves open which part of the sensor a video shows: 8 % between 4:3 and 16:9.
    ZoomSource.SUBTITLES: math.radians(4),
}
_MAGNIFICATION_TOLERANCE: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class ZoomBatch:
    """Zoom of a camera at ``n`` stamps.

    Attributes:
        magnification: ``(n,)`` relative to the camera file; NaN where the file applies.
        std: ``(n,)`` standard deviation of the magnification.
        sources: Source of each; None where the file applies.
        reasons: Remarks on each.
        is_unknown: ``(n,)`` whether the zoom level is known, but not the focal length.
        is_pending: ``(n,)`` whether a relevant report is pending.
    """

    magnification: FloatArray
    std: FloatArray
    sources: list[ZoomSource | None]
    reasons: list[tuple[str, ...]]
    is_unknown: BoolArray
    is_pending: BoolArray

    @staticmethod
    def of_file(count: int) -> "ZoomBatch":
        """The camera file's zoom at ``count`` stamps."""
        nan = np.full(count, np.nan)
        is_unknown, is_pending = np.full(count, fill_value=False), np.full(count, fill_value=False)
        return ZoomBatch(nan, nan.copy(), [None] * count, [()] * count, is_unknown, is_pending)


class CameraReports:
    """All reports of one camera.

    Args:
        settings: Settings of the zoom.
        camera: The camera file.
    """

    def __init__(self, settings: ZoomSettings, camera: Camera) -> None:
        self._settings = settings
        self._camera = camera
        streams = {ZoomSource.VIDEO_STREAM_INFORMATION: settings.stream}
        self._reports = {source: FocalReports(settings.max_gap_ns, streams.get(source)) for source in settings.order}
        self._levels = np.array([level for level, _ in settings.curve])
        self._magnifications = np.array([magnification for _, magnification in settings.curve])
        hfov_rad = camera.hfov_rad if settings.reported_hfov_rad is None else settings.reported_hfov_rad
        self._reported_focal = 1 / math.tan(hfov_rad / 2)

    def streams(self) -> tuple[Stream, ...]:
        """All streams, to be cleared or shifted with the clocks."""
        return tuple(reports.stream for reports in self._reports.values())

    def may_append_ticks(self, track: CameraTrack) -> bool:
        """Whether a track of several ticks may be appended at once."""
        return self._reports[track.source].may_append_ticks(track, self._focal(track))

    def append(self, track: CameraTrack, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append a track of this camera from a source in the order, as ``Stream.append``."""
        self._reports[track.source].append(track, self._focal(track), stamps_ns, row_end_by_tick)

    def at(self, query: Query) -> ZoomBatch:
        """The camera's zoom ``(n,)``."""
        found = ZoomBatch.of_file(len(query))
        left = np.arange(len(query))
        for source, reports in self._reports.items():
            if not self._is_followed(source, reports) or not len(left):
                continue
            view = reports.at(query.rows(left))
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
        for row, reasons in zip(
            left.tolist(), self._contradictions(query.stamps_ns[left], query.ticks[left]), strict=True
        ):
            found.reasons[row] = reasons
        return found

    def _is_followed(self, source: ZoomSource, reports: FocalReports) -> bool:
        return source is ZoomSource.CAMERA_SETTINGS or reports.is_live

    def _focal(self, track: CameraTrack) -> FloatArray:
        """Focal lengths in the source's unit: half the image's width, or the focal length at the curve's level 0."""
        if track.source is not ZoomSource.CAMERA_SETTINGS:
            return 1 / np.tan(track.hfov_rad / 2)
        return np.interp(track.level, self._levels, self._magnifications) if len(self._levels) else track.level

    def _follow(self, found: ZoomBatch, rows: IntArray, known: BoolArray, source: ZoomSource, view: FocalBatch) -> None:
        """Write the zoom by a source at those of ``rows`` that are ``known``."""
        settings = self._settings
        if source is ZoomSource.CAMERA_SETTINGS:
            reference = float(np.interp(settings.level, self._levels, self._magnifications))
            reported_std = np.zeros(len(rows))
        else:
            reference = self._reported_focal
            reported_std = _hfov_std_rad(settings, source) / np.sin(2 * np.arctan(1 / view.value))
        magnification = view.value / reference
        doubling_std = settings.std_per_doubling * np.abs(np.log2(magnification))
        relative = np.hypot(np.hypot(doubling_std, reported_std), view.step_std / view.value)
        is_file = (np.abs(magnification - 1) <= _MAGNIFICATION_TOLERANCE) & (view.step_std == 0.0)
        is_file &= source is ZoomSource.CAMERA_SETTINGS
        silence, sizes = (f"{source} is silent: the zoom is that of its last report",), self._size_contradictions()
        for k in np.flatnonzero(known).tolist():
            row = int(rows[k])
            found.reasons[row] = (*(silence if view.is_silent[k] else ()), *sizes)
            if not is_file[k]:
                found.sources[row] = source
        found.is_unknown[rows[known]] = False
        is_zoomed = known & ~is_file
        found.magnification[rows[is_zoomed]] = magnification[is_zoomed]
        found.std[rows[is_zoomed]] = (magnification * relative)[is_zoomed]

    def _unknown_zoom(self, level: float) -> str:
        return (
            f"{ZoomSource.CAMERA_SETTINGS} says zoom {100 * level:.1f} %, the camera file is of "
            f"{100 * self._settings.level:g} %: set telemetry.zoom.curve to what that makes of the focal length"
        )

    def _contradictions(self, stamps_ns: IntArray, ticks: IntArray) -> list[tuple[str, ...]]:
        """Remarks where reports contradict the camera file, for a camera that is not zoomed at stamps ``(n,)``."""
        found: list[tuple[str, ...]] = [()] * len(stamps_ns)
        expected_rad = 2 * math.atan(1 / self._reported_focal)
        for source, reports in self._reports.items():
            if source is ZoomSource.CAMERA_SETTINGS:
                continue
            view = reports.at(Query.final(stamps_ns, ticks))
            reported_rad = 2 * np.arctan(1 / view.value)
            std_rad = hfov_difference_std_rad(self._settings, source, self._camera)
            differs = (view.missing == Missing.NOTHING) & (np.abs(reported_rad - expected_rad) > std_rad)
            for k in np.flatnonzero(differs).tolist():
                sentence = (
                    f"{source} says hfov {math.degrees(reported_rad[k]):.1f} deg, the camera file "
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
    """Standard deviation of a reported horizontal field of view minus the camera file's."""
    focal_px = math.sqrt(camera.covariance[0][0]) if camera.covariance else camera.std.focal_px
    return math.hypot(_hfov_std_rad(settings, source), math.sin(camera.hfov_rad) * focal_px / camera.fx_px)


def _hfov_std_rad(settings: ZoomSettings, source: ZoomSource) -> float:
    return math.hypot(settings.hfov_std_rad, _SOURCE_STD_RAD.get(source, 0.0))


class ZoomSources(TelemetryPart):
    """Zoom reports of all cameras of a vehicle.

    Args:
        settings: Settings of the zoom, and the camera that takes the images.
        camera: The camera file.
    """

    def __init__(self, settings: ZoomSettings, camera: Camera) -> None:
        self._settings = settings
        self._camera = camera
        self._cameras: dict[int, CameraReports] = {}

    def streams(self) -> tuple[Stream, ...]:
        """All streams, to be cleared or shifted with the clocks."""
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
        """Append a track of a camera that is followed, as ``Stream.append``; other tracks are ignored."""
        if not isinstance(track, CameraTrack) or track.source not in self._settings.order:
            return
        for number in np.unique(track.device).tolist():
            if self._settings.camera in {None, number}:
                reports = self._cameras.setdefault(number, CameraReports(self._settings, self._camera))
                rows, mask = _of_camera(track, number)
                ends = None if row_end_by_tick is None else np.concatenate([[0], np.cumsum(mask)])[row_end_by_tick]
                reports.append(rows, stamps_ns[mask], ends)

    def with_zoom(self, poses: PoseBatch, query: Query) -> tuple[PoseBatch, BoolArray]:
        """Poses with the camera's zoom, and with remarks where reports contradict the camera file.

        Args:
            poses: ``(n,)``.
            query: Stamps of the poses, in their order.

        Returns:
            The poses, and where a relevant report is pending.
        """
        is_ok = poses.status == CODE_OF[Status.OK]
        if not self._cameras or not np.any(is_ok):
            return poses, np.full(len(poses), fill_value=False)
        found = {number: camera.at(query) for number, camera in sorted(self._cameras.items())}
        is_pending = np.logical_or.reduce([zoom.is_pending for zoom in found.values()]) & is_ok
        zoom = next(iter(found.values())) if len(found) == 1 else _ambiguous_zoom(found)
        keys = [
            (zoom.sources[k], zoom.reasons[k], bool(zoom.is_unknown[k])) if is_ok[k] else None
            for k in range(len(poses))
        ]
        zoomed = poses.with_variants(keys, _with_zoom)
        is_zoomed = is_ok & ~zoom.is_unknown & ~np.isnan(zoom.magnification)
        numbers = np.where(is_zoomed[:, None], np.stack([zoom.magnification, zoom.std], axis=-1), poses.zoom)
        return replace(zoomed, zoom=numbers), is_pending


def _of_camera(track: CameraTrack, number: int) -> tuple[CameraTrack, BoolArray]:
    """The rows of one camera, and their mask."""
    mask = track.device == number
    return track.rows(mask), mask


def _with_zoom(sample: PoseSample, key: tuple[ZoomSource | None, tuple[str, ...], bool]) -> PoseSample:
    """The sample's variant with the source of its zoom and remarks, or refused where the focal length is unknown."""
    source, reasons, is_unknown = key
    if is_unknown:
        return replace(sample, status=Status.CAMERA_ZOOMED, reasons=(*reasons, *sample.reasons))
    zoom = None if source is None else Zoom(magnification=math.nan, std=math.nan, source=source)
    return replace(sample, zoom=zoom, reasons=(*sample.reasons, *reasons))


def _ambiguous_zoom(cameras: dict[int, ZoomBatch]) -> ZoomBatch:
    """Zoom where several cameras report and none is configured: unknown as soon as one of them is zoomed."""
    numbers = ", ".join(map(str, cameras))
    choose = f"several cameras report ({numbers}), and not the same zoom: set telemetry.zoom.camera to one of them"
    found = ZoomBatch.of_file(len(next(iter(cameras.values())).reasons))
    for row in range(len(found.reasons)):
        remarks = tuple(f"camera {number}: {why}" for number, zoom in cameras.items() for why in _reasons(zoom, row))
        is_ambiguous = any(zoom.sources[row] is not None or zoom.is_unknown[row] for zoom in cameras.values())
        found.is_unknown[row] = is_ambiguous
        found.reasons[row] = (choose, *remarks) if is_ambiguous else remarks
    return found


def _reasons(zoom: ZoomBatch, row: int) -> tuple[str, ...]:
    source = zoom.sources[row]
    zoom_reason = () if source is None else (f"{source} says zoom x {zoom.magnification[row]:.2f}",)
    return (*zoom_reason, *zoom.reasons[row])
