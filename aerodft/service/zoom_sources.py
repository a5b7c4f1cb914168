"""The camera at a stamp: as its file has it, or as it is reported to be zoomed; of several cameras the one chosen."""

from dataclasses import replace

import numpy as np

from aerodft.model.arrays import IntArray
from aerodft.model.camera import Camera
from aerodft.model.pose import PoseSample
from aerodft.model.status import Status
from aerodft.model.telemetry import CameraTrack, Track
from aerodft.service.streams import Stream
from aerodft.service.zoom import CameraReports, Seen
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

    def append(self, track: Track, stamps_ns: IntArray) -> None:
        """Take a track in, if it is of a camera that counts."""
        if not isinstance(track, CameraTrack) or track.source not in self._settings.order:
            return
        for number in np.unique(track.device).tolist():
            if self._settings.camera in {None, number}:
                own = track.device == number
                reports = self._cameras.setdefault(number, CameraReports(self._settings, self._camera))
                reports.append(track.rows(own, boot_ns=track.boot_ns), stamps_ns[own])

    def seen(self, sample: PoseSample, watermark_ns: int) -> PoseSample | None:
        """A pose with the camera's zoom and what contradicts the camera's file.

        Args:
            sample: The pose.
            watermark_ns: Newest stamp of any telemetry; ``END_OF_TIME`` where no more will be waited for.

        Returns:
            None as long as a report that matters may still come.
        """
        if sample.status is not Status.OK:
            return sample
        found = {number: camera.at(sample.stamp_ns, watermark_ns) for number, camera in self._cameras.items()}
        known = {number: seen for number, seen in sorted(found.items()) if seen is not None}
        if len(known) < len(found):
            return None
        seen = next(iter(known.values()), Seen()) if len(known) < 2 else _of_several(known)  # noqa: PLR2004
        if seen.is_unknown:
            return replace(sample, status=Status.CAMERA_ZOOMED, reasons=(*seen.reasons, *sample.reasons))
        if seen.zoom is None and not seen.reasons:
            return sample
        return replace(sample, zoom=seen.zoom, reasons=(*sample.reasons, *seen.reasons))


def _of_several(cameras: dict[int, Seen]) -> Seen:
    """What cameras say of which none is chosen: whose images these are matters as soon as one of them is zoomed."""
    numbers = ", ".join(map(str, cameras))
    said = tuple(f"camera {number}: {reason}" for number, seen in cameras.items() for reason in _reasons(seen))
    if any(seen.zoom is not None or seen.is_unknown for seen in cameras.values()):
        choose = f"several cameras report ({numbers}), and not the same zoom: set telemetry.zoom.camera to one of them"
        return Seen(reasons=(choose, *said), is_unknown=True)
    return Seen(reasons=said)


def _reasons(seen: Seen) -> tuple[str, ...]:
    zoom = () if seen.zoom is None else (f"{seen.zoom.source} says zoom x {seen.zoom.magnification:.2f}",)
    return (*zoom, *seen.reasons)
