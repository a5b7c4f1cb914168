"""What cameras say of themselves over a whole log, and what speaks against the camera file."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from aerodft.model.camera import Camera
from aerodft.model.telemetry import CameraTrack
from aerodft.model.zoom import ZoomSource
from aerodft.service.zoom import LEVEL_SLACK, apart_std_rad
from aerodft.service.zoom_settings import ZoomSettings

_SAME_DEG: Final = 0.1


@dataclass(frozen=True, slots=True, order=True)
class _Reporter:
    """Who says something of a view: a camera, one of its video streams (0: of none), and in which message."""

    camera: int
    source: ZoomSource
    stream: int

    def __str__(self) -> str:
        return f"{self.source} of camera {self.camera}" + (f", stream {self.stream}" if self.stream else "")


@dataclass(slots=True)
class _View:
    """Extremes of what is said."""

    hfov_deg: tuple[float, float] = (math.inf, -math.inf)
    level: tuple[float, float] = (math.inf, -math.inf)
    sizes_px: set[tuple[int, int]] = field(default_factory=set)


@dataclass(slots=True)
class CameraSurvey:
    """Takes in tracks of cameras; sums up what each says of its view."""

    _views: dict[_Reporter, _View] = field(default_factory=dict)

    @property
    def numbers(self) -> tuple[int, ...]:
        """Cameras that say anything of their view."""
        return tuple(sorted({reporter.camera for reporter in self._views}))

    def add(self, track: CameraTrack) -> None:
        """Take in a track."""
        for camera, stream in np.unique(np.stack([track.device, track.stream], axis=-1), axis=0).tolist():
            own = (track.device == camera) & (track.stream == stream)
            view = self._views.setdefault(_Reporter(camera, track.source, stream), _View())
            view.hfov_deg = _wider(view.hfov_deg, np.degrees(track.hfov_rad[own]))
            view.level = _wider(view.level, track.level[own])
            view.sizes_px |= {(w, h) for w, h in np.unique(track.size_px[own], axis=0).tolist() if w and h}

    def sentences(self, camera: Camera | None, zoom: ZoomSettings) -> Iterator[str]:
        """What is to be known of the cameras, and what they say against a camera file.

        Args:
            camera: As its file has it; None where nothing is held against one.
            zoom: How a station reads them.
        """
        numbers = ", ".join(map(str, self.numbers))
        if zoom.camera is not None and self._views and zoom.camera not in self.numbers:
            yield f"telemetry.zoom.camera = {zoom.camera} is not heard, cameras {numbers} are: no zoom is followed"
        elif zoom.camera is None and len(self.numbers) > 1:
            yield (
                f"more than one camera reports its view ({numbers}): as soon as one of them is zoomed nothing is "
                "measured, unless telemetry.zoom.camera says which one makes the images"
            )
        counted = {
            reporter: view for reporter, view in sorted(self._views.items(), key=_reporter) if _counts(reporter, zoom)
        }
        for number in self.numbers:
            streams = [each.stream for each in counted if each.camera == number and each.stream]
            if len(streams) > 1:
                listed = ", ".join(map(str, streams))
                yield f"camera {number} has several streams ({listed}): set telemetry.zoom.stream, or the first counts"
        for reporter, view in counted.items():
            yield from _of_view(reporter, view, camera, zoom)

    def documents(self) -> list[dict[str, Any]]:
        """Plain JSON values, one document for each camera, message and stream; null for what was never said."""
        return [
            {
                "camera": reporter.camera,
                "message": str(reporter.source),
                "stream": reporter.stream or None,
                "hfov_deg": _span(view.hfov_deg),
                "zoom_percent": _span((100 * view.level[0], 100 * view.level[1])),
                "sizes_px": sorted(map(list, view.sizes_px)),
            }
            for reporter, view in sorted(self._views.items(), key=_reporter)
        ]


def _reporter(item: tuple[_Reporter, _View]) -> _Reporter:
    return item[0]


def _counts(reporter: _Reporter, zoom: ZoomSettings) -> bool:
    is_chosen = zoom.camera in {None, reporter.camera} and (
        not reporter.stream or zoom.stream in {None, reporter.stream}
    )
    return is_chosen and reporter.source in zoom.order


def _of_view(reporter: _Reporter, view: _View, camera: Camera | None, zoom: ZoomSettings) -> Iterator[str]:
    if not zoom.curve and any(abs(level - zoom.level) > LEVEL_SLACK for level in view.level if math.isfinite(level)):
        low, high = (100 * level for level in view.level)
        yield (
            f"{reporter}: the zoom is {low:.0f} to {high:.0f} %, the camera file is of {100 * zoom.level:g} % "
            "(telemetry.zoom.at_percent); set telemetry.zoom.curve to what that makes of the focal length, or "
            "images zoomed otherwise than the camera file have no answer"
        )
    if camera is not None:
        yield from _against(reporter, view, camera, zoom)


def _against(reporter: _Reporter, view: _View, camera: Camera, zoom: ZoomSettings) -> Iterator[str]:
    low, high = view.hfov_deg
    own_deg = math.degrees(camera.hfov_rad if zoom.reported_hfov_rad is None else zoom.reported_hfov_rad)
    std_deg = math.degrees(apart_std_rad(zoom, reporter.source, camera))
    if high - low > _SAME_DEG:
        yield f"{reporter}: the field of view moves between {low:.1f} and {high:.1f} deg, which is followed"
    elif math.isfinite(low) and abs(low - own_deg) > std_deg:
        yield (
            f"{reporter} says hfov {low:.1f} deg, the camera file {own_deg:.1f} deg (std of the two {std_deg:.1f} "
            "deg): correct the file, or the vehicle's parameter (CAM1_HFOV of ArduPilot), or state it in "
            "telemetry.zoom.reported_hfov_deg"
        )
    for width, height in sorted(view.sizes_px - {(camera.width_px, camera.height_px)}):
        yield f"{reporter} says {width} x {height} px, the camera file {camera.width_px} x {camera.height_px} px"


def _wider(span: tuple[float, float], values: np.ndarray) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return (min(span[0], float(known.min())), max(span[1], float(known.max()))) if len(known) else span


def _span(span: tuple[float, float]) -> list[float] | None:
    return [round(each, 3) for each in span] if math.isfinite(span[0]) else None
