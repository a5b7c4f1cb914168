"""Pixels that are converted when somebody asks, and stay valid afterwards."""

import threading
from typing import TYPE_CHECKING

import numpy as np

from aerodft.errors import InputError
from aerodft.model.arrays import ImageArray

if TYPE_CHECKING:
    import av


class FramePixels:
    """A decoded frame's pixels, converted once; may be called from several threads."""

    def __init__(self, frame: "av.VideoFrame") -> None:
        self._lock = threading.Lock()
        self._frame: av.VideoFrame | None = frame
        self._pixels: ImageArray | None = None

    def __call__(self) -> ImageArray:
        """``(height, width, 3)`` uint8 BGR, read-only, as stored (a rotation flag is not applied)."""
        with self._lock:
            if self._frame is not None:
                self._pixels = np.asarray(self._frame.to_ndarray(format="bgr24"), dtype=np.uint8)
                self._pixels.setflags(write=False)
                self._frame = None
            if self._pixels is None:
                raise ValueError("neither frame nor pixels")
            return self._pixels


class StillPixels:
    """A compressed still's pixels, decoded at each call."""

    def __init__(self, data: bytes, where: str) -> None:
        self._data = data
        self._where = where

    def __call__(self) -> ImageArray:
        """``(height, width, 3)`` uint8 BGR, read-only, as stored (a rotation flag is not applied).

        Raises:
            InputError: The file's content is damaged.
        """
        import cv2  # noqa: PLC0415 - 20 MB, and recordings without stills do without

        flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
        decoded = cv2.imdecode(np.frombuffer(self._data, dtype=np.uint8), flags)
        if decoded is None:
            raise InputError("image cannot be decoded", where=self._where, hint="the file is damaged; leave it out")
        pixels = np.asarray(decoded, dtype=np.uint8)
        pixels.setflags(write=False)
        return pixels
