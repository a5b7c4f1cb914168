"""What tells water from land in a small copy of an image: colour, lightness and texture of every pixel."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.model.arrays import FloatArray, ImageArray

Float32Image = npt.NDArray[np.float32]

WIDTH_PX: Final = 480  # of the small copy's longer side: a bank is found to a few pixels of the image, then refined
_SMOOTH_PX: Final = 1.0
_DETAIL_PX: Final = 2.0  # of the copy of twice the size: what is smaller is texture
_NEIGHBOURHOOD_PX: Final = 2.0
_QUIET: Final = 4e-4  # a contrast of 2 %, squared: sensor noise is no texture
_DARK: Final = 8.0  # grey levels: what is darker has no colour
_SCALE: Final = np.array([40.0, 40.0, 40.0, 8.0], dtype=np.float32)  # makes about one unit of what can just be seen


@dataclass(frozen=True, slots=True, eq=False)
class WaterFeatures:
    """A small copy of an image.

    Attributes:
        scale: Its pixels per pixel of the image, below or at 1.
        planes: ``(height, width, 4)``: logarithms of red to green, blue to green, lightness and the texture's
            contrast; shade changes none but the lightness.
        pixels: ``(height, width, 3)`` BGR.
    """

    scale: float
    planes: Float32Image
    pixels: ImageArray

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.planes.shape[0], self.planes.shape[1]

    def without_planes(self) -> "WaterFeatures":
        """What is left to go from the image to the small copy and back."""
        return WaterFeatures(self.scale, self.planes[..., :0].copy(), self.pixels[..., :0].copy())

    def to_image(self, small_px: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of the small copy as pixels of the image."""
        return np.asarray((np.asarray(small_px, dtype=np.float64) + 0.5) / self.scale - 0.5)

    def to_small(self, pixels_px: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of the image as pixels of the small copy."""
        return np.asarray((np.asarray(pixels_px, dtype=np.float64) + 0.5) * self.scale - 0.5)


def water_features(image: ImageArray) -> WaterFeatures:
    """The features of an image ``(height, width, 3)`` BGR."""
    scale = min(1.0, WIDTH_PX / max(image.shape[:2]))
    size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    double = (min(2 * size[0], image.shape[1]), min(2 * size[1], image.shape[0]))
    middle = cv2.resize(image, double, interpolation=cv2.INTER_AREA)
    small = cv2.resize(middle, size, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(small, (0, 0), _SMOOTH_PX).astype(np.float32)
    blue, green, red = cv2.split(np.log(smooth + _DARK))
    grey = cv2.cvtColor(middle, cv2.COLOR_BGR2GRAY).astype(np.float32)
    detail = grey - cv2.GaussianBlur(grey, (0, 0), _DETAIL_PX)
    light = cv2.resize(grey, size, interpolation=cv2.INTER_AREA) + _DARK
    strength = cv2.resize(detail * detail, size, interpolation=cv2.INTER_AREA) / np.square(light)
    texture = 0.5 * np.log(cv2.GaussianBlur(strength, (0, 0), _NEIGHBOURHOOD_PX) + _QUIET)
    lightness = (blue + green + red) / 3.0
    planes = _SCALE * np.dstack([red - green, blue - green, lightness, texture])
    return WaterFeatures(scale, np.asarray(planes, dtype=np.float32), np.asarray(small, dtype=np.uint8))
