"""A user's own network that says where water is, in place of the classical segmentation: ONNX, run by OpenCV."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from aerodft.errors import InputError
from aerodft.model.arrays import BoolArray, ImageArray
from aerodft.vision.water import WaterMask, around_seed
from aerodft.vision.water_features import Float32Image, WaterFeatures, outline_contrast

_MULTIPLE: Final = 32  # networks halve their input some times
_CONTRACT: Final = (
    "input 1 x 3 x H x W (RGB, 0 to 1), output 1 x 1 x h x w (probability or logit of water) or 1 x 2 x h x w"
)


@dataclass(frozen=True, slots=True, eq=False)
class WaterNetwork:
    """A network that was read from a file.

    Attributes:
        net: As OpenCV has it.
        where: Its file, for messages.
    """

    net: Any
    where: Path

    @classmethod
    def read(cls, path: Path) -> "WaterNetwork":
        """Read an ONNX file.

        Raises:
            InputError: It is missing, or no network that OpenCV can run.
        """
        try:
            data = np.fromfile(path, dtype=np.uint8)
        except OSError as error:
            raise InputError("the water model cannot be read", where=path, got=error.strerror) from error
        try:
            return cls(cv2.dnn.readNetFromONNX(data), path)
        except cv2.error:
            raise InputError("no network that OpenCV can run", where=path, expected=f"ONNX: {_CONTRACT}") from None

    def find_water(self, features: WaterFeatures, seed_px: tuple[float, float], ground: BoolArray) -> WaterMask:
        """As ``water.find_water``: what is more likely water than not, in one piece around the seed.

        Raises:
            InputError: The network does not take such an image, or does not say what it should.
        """
        wet = self.probability(features.pixels) > 0.5  # noqa: PLR2004 - more likely than not
        water = around_seed(wet & ground, features.shape, seed_px, ground)
        outline, contrast = outline_contrast(features.planes, water, ground)
        return WaterMask(water, outline, contrast)

    def probability(self, pixels: ImageArray) -> Float32Image:
        """Of water, ``(height, width)``, in an image ``(height, width, 3)`` BGR.

        Raises:
            InputError: See ``find_water``.
        """
        height, width = pixels.shape[:2]
        size = tuple(-(-side // _MULTIPLE) * _MULTIPLE for side in (width, height))
        try:
            self.net.setInput(cv2.dnn.blobFromImage(pixels, 1.0 / 255.0, size, swapRB=True))
            said = np.asarray(self.net.forward(), dtype=np.float32)
        except cv2.error:
            raise InputError("the water model does not take the image", where=self.where, expected=_CONTRACT) from None
        if said.ndim != 4 or said.shape[0] != 1 or said.shape[1] not in (1, 2) or not np.all(np.isfinite(said)):  # noqa: PLR2004
            raise InputError("the water model's output", where=self.where, got=f"{said.shape}", expected=_CONTRACT)
        logit = said[0, 1] - said[0, 0] if said.shape[1] == 2 else said[0, 0]  # noqa: PLR2004 - land, then water
        is_probability = said.shape[1] == 1 and float(logit.min()) >= 0.0 and float(logit.max()) <= 1.0
        wet = logit if is_probability else 1.0 / (1.0 + np.exp(-np.clip(logit, -30.0, 30.0)))
        return np.asarray(cv2.resize(wet, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
