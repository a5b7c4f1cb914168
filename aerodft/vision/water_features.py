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
_QUIET: Final = 4.0  # grey levels squared: sensor noise is no texture


@dataclass(frozen=True, slots=True, eq=False)
class WaterFeatures:
    """A small copy of an image.

    Attributes:
        scale: Its pixels per pixel of the image, below or at 1.
        planes: ``(height, width, 4)``: CIE a and b, lightness L (0 to 100), logarithm of the texture's strength.
        pixels: ``(height, width, 3)`` BGR.
    """

    scale: float
    planes: Float32Image
    pixels: ImageArray

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.planes.shape[0], self.planes.shape[1]

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
    smooth = cv2.GaussianBlur(small, (0, 0), _SMOOTH_PX).astype(np.float32) / 255.0
    lab = cv2.cvtColor(smooth, cv2.COLOR_BGR2Lab)
    grey = cv2.cvtColor(middle, cv2.COLOR_BGR2GRAY).astype(np.float32)
    detail = grey - cv2.GaussianBlur(grey, (0, 0), _DETAIL_PX)
    strength = cv2.GaussianBlur(
        cv2.resize(detail * detail, size, interpolation=cv2.INTER_AREA), (0, 0), _NEIGHBOURHOOD_PX
    )
    texture = 0.5 * np.log(strength + _QUIET)
    planes = np.dstack([lab[..., 1], lab[..., 2], lab[..., 0], texture]).astype(np.float32)
    return WaterFeatures(scale, planes, np.asarray(small, dtype=np.uint8))
