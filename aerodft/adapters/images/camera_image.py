"""One image of a camera, from a file that somebody names."""

from pathlib import Path

from aerodft.adapters.filetype import looks_like
from aerodft.adapters.images.pixels import StillPixels
from aerodft.errors import InputError
from aerodft.model.arrays import ImageArray
from aerodft.model.camera import Camera


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
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError("the image cannot be read", where=path, got=error.strerror, expected=expected) from error
    if not data:
        raise InputError("not a readable image", where=path, got=looks_like(path), expected=expected)
    pixels = StillPixels(data, str(path))()
    height, width = pixels.shape[:2]
    if (width, height) != (camera.width_px, camera.height_px):
        got = f"{width} x {height} px"
        raise InputError("the image is not the camera's", where=path, got=got, expected=expected, hint=hint)
    return pixels
