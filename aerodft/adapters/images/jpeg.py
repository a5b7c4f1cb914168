"""Pixels to JPEG and back."""

import warnings
from io import BytesIO

import numpy as np

from aerodft.errors import InputError
from aerodft.model import Image, ImageArray


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


def decode_jpeg(data: bytes, where: str, most_px: int | None = None) -> ImageArray:
    """A JPEG as ``(height, width, 3)`` uint8 BGR.

    Args:
        data: The file's bytes.
        where: Its name in messages.
        most_px: A larger image is damage: some kilobytes can claim gigabytes. None where nobody knows its size.

    Raises:
        InputError: It is damaged; names ``where``.
    """
    import cv2  # noqa: PLC0415 - as above

    if most_px is not None and _pixels_of(data) > most_px:
        raise InputError("the JPEG is larger than the image that it is of", where=where, expected=f"{most_px} pixels")
    pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR) if data else None
    if pixels is None:
        raise InputError("the JPEG is damaged", where=where, got=f"{len(data)} bytes")
    return np.asarray(pixels, dtype=np.uint8)


def _pixels_of(data: bytes) -> int:
    """How many an image has by its header; 0 where it has none that could be read."""
    from PIL import Image as PillowImage  # noqa: PLC0415 - for what was recorded only

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", PillowImage.DecompressionBombWarning)
            with PillowImage.open(BytesIO(data)) as image:
                return image.width * image.height
    except (PillowImage.DecompressionBombWarning, PillowImage.DecompressionBombError):
        return PillowImage.MAX_IMAGE_PIXELS or 0
    except (OSError, SyntaxError):
        return 0
