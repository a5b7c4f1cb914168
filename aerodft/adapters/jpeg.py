"""Pixels to JPEG and back."""

import numpy as np

from aerodft.errors import InputError
from aerodft.model.arrays import ImageArray
from aerodft.model.image import Image


def encode_jpeg(image: Image, quality: int) -> bytes:
    """An image's pixels as JPEG.

    Args:
        image: With pixels.
        quality: 0 to 100.

    Raises:
        ValueError: The image has no pixels.
        InputError: They cannot be encoded.
    """
    import cv2  # noqa: PLC0415 - 20 MB, and a recording need not have images

    if image.pixels is None:
        raise ValueError(f"image {image.index} has no pixels")
    try:
        done, data = cv2.imencode(".jpg", image.pixels(), [cv2.IMWRITE_JPEG_QUALITY, quality])
    except cv2.error as error:
        raise InputError("the image cannot be encoded", where=f"image {image.index}", got=error.err) from error
    if not done:
        raise InputError("the image cannot be encoded", where=f"image {image.index}")
    return data.tobytes()


def decode_jpeg(data: bytes, where: str) -> ImageArray:
    """A JPEG as ``(height, width, 3)`` uint8 BGR.

    Raises:
        InputError: It is damaged; names ``where``.
    """
    import cv2  # noqa: PLC0415 - as above

    pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR) if data else None
    if pixels is None:
        raise InputError("the JPEG is damaged", where=where, got=f"{len(data)} bytes")
    return np.asarray(pixels, dtype=np.uint8)
