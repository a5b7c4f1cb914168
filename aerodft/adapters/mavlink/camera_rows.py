"""Payload rows of what cameras say of their view."""

from collections import Counter
from typing import Final

import numpy as np
import numpy.typing as npt

from aerodft.adapters.mavlink.rows import Rows
from aerodft.model.arrays import IntArray
from aerodft.model.telemetry import CameraTrack, Track
from aerodft.model.zoom import ZoomSource

_NUMBER: Final = "camera_device_id"
MOST_ATTACHED: Final = 6  # cameras that an autopilot speaks for
_MIN_FOV_DEG, _MAX_FOV_DEG = 0.1, 180.0  # a lens of ten metres sees a tenth of a degree
_FULL_LEVEL: Final = 100.0


def number(payload: npt.NDArray[np.void], component: IntArray) -> None:
    """Number the cameras ``(n,)`` as MAVLink's missions do, in place of what the messages say.

    A camera that an autopilot speaks for has a number from 1 to 6 in the message; any other one is a component of its
    own, and says 0: its number is its component's.
    """
    said = payload[_NUMBER]
    payload[_NUMBER] = np.where((said > 0) & (said <= MOST_ATTACHED), said, component)


def fov_track(rows: Rows, rejected: Counter[str]) -> Track | None:
    """CAMERA_FOV_STATUS, degrees."""
    return _fov_track(ZoomSource.CAMERA_FOV_STATUS, rows, rejected)


def video_stream_track(rows: Rows, rejected: Counter[str]) -> Track | None:
    """VIDEO_STREAM_INFORMATION: whole degrees, 0 where not known; and the size of the images."""
    return _fov_track(
        ZoomSource.VIDEO_STREAM_INFORMATION, rows, rejected, ("resolution_h", "resolution_v"), stream="stream_id"
    )


def _fov_track(
    source: ZoomSource, rows: Rows, rejected: Counter[str], size: tuple[str, ...] = (), *, stream: str | None = None
) -> Track | None:
    hfov_deg = rows.column("hfov")
    known = np.logical_or.reduce([rows.payload[field] > 0 for field in size]) if size else False
    impossible = ~((hfov_deg == 0) | ((hfov_deg >= _MIN_FOV_DEG) & (hfov_deg < _MAX_FOV_DEG)))
    good = rows.kept(
        rejected, {"impossible hfov": impossible, "hfov is not known": (hfov_deg == 0) & ~np.asarray(known)}
    )
    if good is None:
        return None
    hfov_deg = good.column("hfov")
    sizes = [good.payload[field].astype(np.int64) for field in size] or [_zeros(good)] * 2
    return CameraTrack(
        source=source,
        device=good.payload[_NUMBER].astype(np.int64),
        stream=_zeros(good) if stream is None else good.payload[stream].astype(np.int64),
        hfov_rad=np.where(hfov_deg > 0, np.radians(hfov_deg), np.nan),
        level=np.full(len(hfov_deg), np.nan),
        size_px=np.stack(sizes, axis=-1),
        **good.stamps(),
    )


def settings_track(rows: Rows, rejected: Counter[str]) -> Track | None:
    """CAMERA_SETTINGS: the zoom in percent of its range, NaN of a camera that cannot zoom."""
    percent = rows.column("zoomLevel")
    outside = ~((percent >= 0) & (percent <= _FULL_LEVEL))
    good = rows.kept(rejected, {"zoomLevel is not known": np.isnan(percent), "impossible zoomLevel": outside})
    if good is None:
        return None
    count = len(good.arrival_ns)
    return CameraTrack(
        source=ZoomSource.CAMERA_SETTINGS,
        device=good.payload[_NUMBER].astype(np.int64),
        stream=_zeros(good),
        hfov_rad=np.full(count, np.nan),
        level=good.column("zoomLevel") / _FULL_LEVEL,
        size_px=np.zeros((count, 2), dtype=np.int64),
        **good.stamps(),
    )


def _zeros(rows: Rows) -> IntArray:
    return np.zeros(len(rows.arrival_ns), dtype=np.int64)
