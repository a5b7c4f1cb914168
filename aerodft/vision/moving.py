"""What moves before a fixed camera: background subtraction (MOG2, Zivkovic 2004), shadows taken off, outlines."""

from typing import Final

import cv2
import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.model.image import Image
from aerodft.model.observation import Observation
from aerodft.service.objects import OBJECTS, ObjectSettings
from aerodft.vision.blobs import (
    MOST_OUTLINES,
    TOO_MANY,
    Planes,
    calm,
    is_ghost,
    objects_in,
    remember_changes,
    without_shadows,
)
from aerodft.vision.reference import allowed_outside

_HISTORY: Final = 500
_APART: Final = 25.0  # squared standard deviations from the background
_SHADOW: Final = 127  # MOG2's label
_LEARNED: Final = 5  # looks, until the background is one
_BY_ITSELF: Final = -1.0  # MOG2's own rate of learning
_STANDING_S: Final = 20.0  # who stands still for so long becomes background: what MOG2 has seen for ...
_BACKGROUND_SHARE: Final = 0.1  # ... this share of its memory
_ANOTHER_VIEW: Final = 0.5  # of the image: where more than this is new, light or camera have changed
_BACKGROUND_LOOKS: Final = 15  # it changes slowly, and takes as long to read as all the rest
_COARSE: Final = 4  # pixels of which one is made, to remember what changes
_DECIMALS: Final = 2


class MovingObjects:
    """Implements ``service.ports.ImageObserver``: an observation of every outline, one without any where none is seen.

    What stands still for some 20 s becomes background.

    Args:
        camera: The camera.
        settings: What is looked for.

    Attributes:
        restless: Images so far in which too much seemed to move.
    """

    def __init__(self, camera: Camera, settings: ObjectSettings) -> None:
        self._settings = settings
        self._allowed = allowed_outside(settings.ignore, camera.width_px, camera.height_px)
        self._subtractor = cv2.createBackgroundSubtractorMOG2(_HISTORY, _APART, detectShadows=True)
        self._background: ImageArray | None = None
        self.restless = 0
        self._changes: tuple[Planes, Planes] | None = None
        self._looks = 0
        self._last_ns: int | None = None

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """Outlines of what moves.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        last_ns, self._last_ns = self._last_ns, image.stamp_ns
        elapsed_s = 0.0 if last_ns is None else max(image.stamp_ns - last_ns, 0) / SECOND_NS
        seen = observations_of(self.outlines(image.pixels(), elapsed_s), image, self._settings.std_px)
        self.restless += bool(seen[0].unseen)
        return seen

    def outlines(self, pixels: ImageArray, elapsed_s: float = 0.1) -> list[FloatArray]:
        """Outlines ``(n, 2)`` of what moves in the next image ``(height, width, 3)`` BGR, the largest first.

        Args:
            pixels: The image.
            elapsed_s: Since the last one.
        """
        rate = _BY_ITSELF if self._looks < _LEARNED else min(_BACKGROUND_SHARE * elapsed_s / _STANDING_S, 0.05)
        labels = np.asarray(self._subtractor.apply(pixels, learningRate=rate), dtype=np.uint8)
        self._looks += 1
        new = np.asarray(labels > 0) & self._allowed
        if self._looks <= _LEARNED:
            return []
        calm = self._calm(new, elapsed_s)
        if np.count_nonzero(new) > _ANOTHER_VIEW * new.size:
            self._subtractor = cv2.createBackgroundSubtractorMOG2(_HISTORY, _APART, detectShadows=True)
            self._background, self._looks = None, 0
            return []
        mask = new = np.asarray(new & calm)
        if self._background is None or self._looks % _BACKGROUND_LOOKS == 0:
            self._background = np.asarray(self._subtractor.getBackgroundImage(), dtype=np.uint8)
        background = self._background
        if self._settings.shadows:
            labelled = np.asarray(labels == _SHADOW)
            mask = without_shadows(pixels, background, new, labelled, self._settings.least_px)
        found = objects_in(mask, self._settings.least_px)
        return [outline for outline in found if not is_ghost(pixels, background, new, outline)]

    def _calm(self, new: BoolArray, elapsed_s: float) -> BoolArray:
        """Where who moves can be told ``(height, width)``, with what is new in the next image."""
        size = new.shape[1] // _COARSE, new.shape[0] // _COARSE
        now = np.asarray(cv2.resize(new.astype(np.float32), size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        if self._changes is None:
            self._changes = np.zeros_like(now), now.copy()
        remember_changes(*self._changes, now, np.ones_like(now), self._looks, elapsed_s)
        mask = cv2.resize(calm(self._changes[0]).astype(np.uint8), new.shape[::-1], interpolation=cv2.INTER_NEAREST)
        return np.asarray(mask > 0)


def observations_of(outlines: list[FloatArray], image: Image, std_px: float) -> tuple[Observation, ...]:
    """One observation for each outline ``(n, 2)``; one without any where there are none, or too many."""
    too_many = len(outlines) > MOST_OUTLINES
    rounded = [np.round(outline, _DECIMALS).tolist() for outline in ([] if too_many else outlines)]
    contours = [tuple((u, v) for u, v in outline) for outline in rounded]
    return tuple(
        Observation.in_image(image, OBJECTS, std_px=std_px, contour=contour, unseen=TOO_MANY if too_many else "")
        for contour in contours or [()]
    )
