"""The camera at a stamp: as its file has it, or as it is reported to be zoomed; of several cameras the one chosen."""

import math
from collections.abc import Hashable
from dataclasses import replace
from typing import cast

import numpy as np

from aerodft.model.arrays import BoolArray, IntArray
from aerodft.model.camera import Camera, Zoom, ZoomSource
from aerodft.model.pose import PoseSample
from aerodft.model.pose_batch import PoseBatch
from aerodft.model.status import CODE_OF, Status
from aerodft.model.telemetry import CameraTrack, Track
from aerodft.service.streams import Stream
from aerodft.service.zoom import CameraReports, ZoomBatch
from aerodft.service.zoom_settings import ZoomSettings


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

    @property
    def has_begun(self) -> bool:
        """Whether any camera that counts has said something."""
        return bool(self._cameras)

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

    def commit(self) -> None:
        """The ticks so far are over."""
        for stream in self.streams():
            stream.commit()

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
        asked = poses.stamp_ns, ticks, watermark_ns
        found = {number: camera.at(*asked) for number, camera in sorted(self._cameras.items())}
        is_pending = np.logical_or.reduce([zoom.is_pending for zoom in found.values()]) & is_ok
        zoom = next(iter(found.values())) if len(found) == 1 else _of_several(found)
        keys = [
            (zoom.sources[k], zoom.reasons[k], bool(zoom.is_unknown[k])) if is_ok[k] else (None, (), False)
            for k in range(len(poses))
        ]
        varied = poses.varied(keys, _varied)
        is_zoomed = is_ok & ~zoom.is_unknown & ~np.isnan(zoom.magnification)
        numbers = np.where(is_zoomed[:, None], np.stack([zoom.magnification, zoom.std], axis=-1), poses.zoom)
        return replace(varied, zoom=numbers), is_pending


def _of_camera(track: CameraTrack, number: int) -> tuple[CameraTrack, BoolArray]:
    """The rows of one camera, and which rows these are."""
    own = track.device == number
    return track.rows(own, boot_ns=track.boot_ns), own


def _varied(sample: PoseSample, key: Hashable) -> PoseSample:
    """A sample without its numbers, with a zoom of that source, reasons, and whether the focal length is unknown."""
    source, reasons, is_unknown = cast("tuple[ZoomSource | None, tuple[str, ...], bool]", key)
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
