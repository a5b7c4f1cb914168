"""Pixels out of compressed images: converted when somebody asks, and valid afterwards; and JPEGs of pixels."""

import threading
import warnings
from io import BytesIO
from pathlib import Path
from typing import Final, cast

import av
import cv2
import numpy as np
from PIL import Image as PillowImage

from aerodft.adapters.files import looks_like, read_whole
from aerodft.errors import InputError, counted, os_errors_as
from aerodft.model import Camera, Image, ImageArray

STILLS: Final = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
"""What files of stills are called."""


class FramePixels:
    """A decoded frame's pixels, converted once; may be called from several threads."""

    def __init__(self, frame: av.VideoFrame) -> None:
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
        pixels = _decoded(self._data)
        if pixels is None:
            hint = f"the file is damaged, or of more than {_MOST_PIXELS // 10**6} million pixels; leave it out"
            raise InputError("image cannot be decoded", where=self._where, hint=hint)
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
    with os_errors_as("the image cannot be read", where=path, expected=expected):
        data = read_whole(path)
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


MOST_PX: Final = 36_000_000
"""Of a video's image: 8K has 33 million; a few kilobytes can claim gigabytes."""
_PADDED: Final = 1.2  # what is decoded is of whole blocks
_PADDED_PX: Final = 1 << 16
_CODECS: Final = {"h264": "h264", "h265": "hevc", "hevc": "hevc", "vp9": "vp9", "av1": "av1"}


class PacketDecoder:
    """Decodes packets that each hold one image and refer to none that comes later (Foxglove's CompressedVideo).

    Args:
        name: ``h264``, ``h265``, ``vp9`` or ``av1``.
        most_px: Larger images are damage; None where nobody knows their size.

    Raises:
        ValueError: No such codec.
    """

    def __init__(self, name: str, most_px: int | None = None) -> None:
        codec = _CODECS.get(name.lower())
        if codec is None:
            raise ValueError(f"video format {name!r}, must be one of {', '.join(_CODECS)}")
        self._context = cast("av.VideoCodecContext", av.CodecContext.create(codec, "r"))
        # One thread, or images would come out several packets late.
        self._context.thread_count = 1
        most_px = round(_PADDED * min(MOST_PX if most_px is None else most_px, MOST_PX)) + _PADDED_PX
        self._context.options = {"flags": "low_delay", "max_pixels": str(most_px)}
        self._count = 0

    def decode(self, data: bytes) -> av.VideoFrame | None:
        """A packet's image; None where it is damaged, or refers to images that are missing."""
        packet = av.Packet(data)
        packet.pts = packet.dts = self._count
        self._count += 1
        try:
            frames = self._context.decode(packet)
        except av.FFmpegError:
            return None
        own = [frame for frame in frames if frame.pts == packet.pts and not frame.is_corrupt]
        return own[-1] if own else None


_KEY_UNITS: Final = {"h264": (0x1F, 0, {5, 7}), "h265": (0x7E, 1, {*range(16, 22), 32, 33})}
"""Of a NAL unit's first byte the bits of its type, and the types that only packets of key images have."""
_START: Final = b"\x00\x00\x01"
_MOST_UNITS: Final = 4


def is_key_packet(name: str, data: bytes) -> bool:
    """Whether decoding can begin with a packet (Annex B of H.264 and H.265); False of codecs that do not tell so.

    Args:
        name: As ``PacketDecoder``.
        data: The packet.
    """
    bits, shift, keys = _KEY_UNITS.get(name.lower(), (0, 0, set()))
    at = data.find(_START)
    for _ in range(_MOST_UNITS):
        first = at + len(_START)
        if at < 0 or first >= len(data):
            return False
        if (data[first] & bits) >> shift in keys:
            return True
        at = data.find(_START, first)
    return False


def encode_jpeg(image: Image, quality: int) -> bytes:
    """An image's pixels as JPEG.

    Args:
        image: With pixels.
        quality: 0 to 100.

    Raises:
        ValueError: The image has no pixels.
        InputError: The pixels cannot be encoded.
    """
    if image.pixels is None:
        raise ValueError(f"image {image.index} has no pixels")
    try:
        done, data = cv2.imencode(".jpg", image.pixels(), [cv2.IMWRITE_JPEG_QUALITY, quality])
    except cv2.error as error:
        raise InputError("the image cannot be encoded", where=f"image {image.index}", got=error.err) from error
    if not done:
        raise InputError("the image cannot be encoded", where=f"image {image.index}")
    return data.tobytes()


def decode_jpeg(data: bytes, where: str, most_px: int | None = None) -> ImageArray:
    """A JPEG as ``(height, width, 3)`` uint8 BGR.

    Args:
        data: The file's bytes.
        where: Its name in messages.
        most_px: A larger image is damage: some kilobytes can claim gigabytes. None where nobody knows its size.

    Raises:
        InputError: It is damaged; names ``where``.
    """
    if most_px is not None and _pixels_of(data) > most_px:
        raise InputError("the JPEG is larger than the image that it is of", where=where, expected=f"{most_px} pixels")
    pixels = _decoded(data)
    if pixels is None:
        raise InputError("the JPEG is damaged", where=where, got=counted(len(data), "byte"))
    return pixels


_MOST_PIXELS: Final = 1 << 28
"""Of an image: a gigabyte in memory, more than any aerial camera has; a header of some bytes can claim any number."""


def _decoded(data: bytes) -> ImageArray | None:
    """An image file's pixels ``(height, width, 3)`` uint8 BGR, as stored; None where it is damaged."""
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    if not data or _pixels_of(data) > _MOST_PIXELS:
        return None
    try:
        pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error:  # a header that claims more than OpenCV believes
        return None
    return None if pixels is None else np.asarray(pixels, dtype=np.uint8)


def _pixels_of(data: bytes) -> int:
    """Number of pixels by an image's header; 0 where none could be read."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PillowImage.DecompressionBombWarning)
            with PillowImage.open(BytesIO(data)) as image:
                return image.width * image.height
    except PillowImage.DecompressionBombError:
        return _MOST_PIXELS + 1
    except (OSError, SyntaxError):
        return 0
