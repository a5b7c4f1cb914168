"""A network that says where water is: the one that comes with the package, or a user's own, run by OpenCV."""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from aerodft.errors import InputError
from aerodft.model import ImageArray
from aerodft.vision.river.water.plane import Float32Image

_MOST_BYTES: Final = 1 << 31  # of a network; a file without end takes all memory
_MULTIPLE: Final = 32  # networks halve their input some times
_SURE: Final = 12.0  # of a logit: beyond, it is certain
_SCALE: Final = 0.75  # of the looks: of 1, 0.875, 0.75, 0.625 and 0.5 it finds most in labelled pictures held back
_CONTRACT: Final = (
    "input 1 x 3 x H x W (RGB, 0 to 1, sides multiples of 32),"
    " output 1 x 1 x h x w (probability or logit of water) or 1 x 2 x h x w (land, water)"
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
        if path.exists() and not path.is_file():  # to open a pipe would wait for somebody who writes
            raise InputError("the water model is no file", where=path, expected=f"ONNX: {_CONTRACT}")
        try:
            data = np.fromfile(path, dtype=np.uint8, count=min(path.stat().st_size, _MOST_BYTES))
        except OSError as error:
            raise InputError("the water model cannot be read", where=path, got=error) from error
        try:
            return cls(cv2.dnn.readNetFromONNX(data), path)
        except cv2.error:
            raise InputError("no network that OpenCV can run", where=path, expected=f"ONNX: {_CONTRACT}") from None

    @staticmethod
    @cache
    def shipped() -> "WaterNetwork":
        """The network that comes with the package; docs/water-network.md says what it was trained on."""
        return WaterNetwork.read(Path(str(files(__package__) / "water.onnx")))

    def looks(self, pixels: ImageArray) -> tuple[Float32Image, Float32Image]:
        """Logits of water ``(height, width)`` from two looks, the second mirrored.

        How far they are apart says how well the network knows a bank.

        Args:
            pixels: ``(height, width, 3)`` BGR.

        Raises:
            InputError: The network does not take such an image, or does not say what it should.
        """
        return self._logit(pixels), self._logit(pixels[:, ::-1])[:, ::-1]

    def _logit(self, pixels: ImageArray) -> Float32Image:
        height, width = pixels.shape[:2]
        size = [max(1, round(_SCALE * side / _MULTIPLE)) * _MULTIPLE for side in (width, height)]
        smaller = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        try:
            self.net.setInput(cv2.dnn.blobFromImage(smaller, 1.0 / 255.0, swapRB=True))
            said = np.asarray(self.net.forward(), dtype=np.float32)
        except cv2.error:
            raise InputError("the water model does not take the image", where=self.where, expected=_CONTRACT) from None
        if said.ndim != 4 or said.shape[0] != 1 or said.shape[1] not in (1, 2) or not np.all(np.isfinite(said)):  # noqa: PLR2004
            raise InputError("the water model's output", where=self.where, got=f"{said.shape}", expected=_CONTRACT)
        logit = said[0, 1] - said[0, 0] if said.shape[1] == 2 else said[0, 0]  # noqa: PLR2004 - land, then water
        if said.shape[1] == 1 and float(logit.min()) >= 0.0 and float(logit.max()) <= 1.0:  # a probability
            inside = np.clip(logit, np.exp(-_SURE), 1.0 - np.exp(-_SURE))
            logit = np.log(inside / (1.0 - inside))
        sure = np.clip(logit, -_SURE, _SURE)
        return np.asarray(cv2.resize(sure, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
