"""Pixels that are converted when somebody asks, and stay valid afterwards."""

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from aerodft.adapters.filetype import looks_like
from aerodft.errors import InputError
from aerodft.model.arrays import ImageArray
from aerodft.model.camera import Camera

if TYPE_CHECKING:
    import av


STILLS: Final = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
"""What files of stills are called."""


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


def read_still(path: Path, expected: str = "") -> ImageArray:
    """An image file's pixels, ``(height, width, 3)`` uint8 BGR, as stored.

    Args:
        path: The file.
        expected: What it should be, for messages.

    Raises:
        InputError: It cannot be read, or is no image.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError("the image cannot be read", where=path, got=error.strerror, expected=expected) from error
    if not data:
        raise InputError("not a readable image", where=path, got=looks_like(path), expected=expected or "an image")
    return StillPixels(data, str(path))()


def read_camera_image(path: Path, camera: Camera, hint: str = "") -> ImageArray:
    """An image file of the camera's size, ``(height, width, 3)`` BGR, as stored.

    Args:
        path: The file.
        camera: Whose image it must be.
        hint: What to do where it is of another size.

    Raises:
        InputError: It cannot be read, is no image, or is of another size.
    """
    expected = f"an image of {camera.width_px} x {camera.height_px} px"
    pixels = read_still(path, expected)
    height, width = pixels.shape[:2]
    if (width, height) != (camera.width_px, camera.height_px):
        got = f"{width} x {height} px"
        raise InputError("the image is not the camera's", where=path, got=got, expected=expected, hint=hint)
    return pixels
