"""What moves before a fixed camera: background subtraction (MOG2, Zivkovic 2004), shadows taken off, outlines."""

from typing import Final

import cv2
import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.model.image import Image
from aerodft.model.observation import VISION, Observation
from aerodft.service.objects import OBJECTS, ObjectSettings
from aerodft.vision.footing import outlines_of
from aerodft.vision.reference import allowed_outside
from aerodft.vision.shadows import shadows

_HISTORY: Final = 500
_APART: Final = 25.0  # squared standard deviations from the background
_SHADOW: Final = 127  # MOG2's label
_LEARNED: Final = 5  # looks, until the background is one
_BY_ITSELF: Final = -1.0  # MOG2's own rate of learning
_STANDING_S: Final = 20.0  # who stands still for so long becomes background: what MOG2 has seen for ...
_BACKGROUND_SHARE: Final = 0.1  # ... this share of its memory
_ANOTHER_VIEW: Final = 0.5  # of the image: where more than this is new, light or camera have changed
_BACKGROUND_LOOKS: Final = 15  # it changes slowly, and takes as long to read as all the rest
_MARGIN_PX: Final = 4
_GRAIN: Final = np.ones((3, 3), dtype=np.uint8)
_GAPS: Final = np.ones((9, 5), dtype=np.uint8)  # what a belt or a shadow leaves between two parts of one object
_FRINGE: Final = 0.05  # of an object's height: what is thinner hangs on to it, the border of its shadow for one
_ONE: Final = 2  # connected component, beside what is none
_MOST_OBJECTS: Final = 100
_DECIMALS: Final = 2


class MovingObjects:
    """Implements ``service.ports.ImageObserver``: an observation of every outline, one without any where none is seen.

    What stands still for some 20 s becomes background.

    Args:
        camera: The camera.
        settings: What is looked for.
    """

    def __init__(self, camera: Camera, settings: ObjectSettings) -> None:
        self._settings = settings
        self._allowed = allowed_outside(settings.ignore, camera.width_px, camera.height_px)
        self._subtractor = cv2.createBackgroundSubtractorMOG2(_HISTORY, _APART, detectShadows=True)
        self._background: ImageArray | None = None
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
        outlines = [np.round(outline, _DECIMALS).tolist() for outline in self.outlines(image.pixels(), elapsed_s)]
        contours = [tuple((u, v) for u, v in outline) for outline in outlines[:_MOST_OBJECTS]]
        return tuple(
            Observation(
                name=OBJECTS,
                stamp_ns=image.stamp_ns,
                arrival_ns=image.arrival_ns,
                pixels=(),
                std_px=self._settings.std_px,
                clock=image.clock,
                image=image.index,
                source=VISION,
                contour=contour,
            )
            for contour in contours or [()]
        )

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
        if np.count_nonzero(new) > _ANOTHER_VIEW * new.size:
            self._subtractor = cv2.createBackgroundSubtractorMOG2(_HISTORY, _APART, detectShadows=True)
            self._background, self._looks = None, 0
            return []
        mask = self._without_shadows(pixels, labels, new) if self._settings.shadows else new
        found = outlines_of(_whole(mask, self._settings.least_px))
        return [outline for outline in found if len(outline) >= 3]  # noqa: PLR2004 - a triangle's corners

    def _without_shadows(self, pixels: ImageArray, labels: ImageArray, new: BoolArray) -> BoolArray:
        """What is new ``(height, width)`` and in no shadow; looked at only where there is something."""
        if self._background is None or self._looks % _BACKGROUND_LOOKS == 0:
            self._background = np.asarray(self._subtractor.getBackgroundImage(), dtype=np.uint8)
        mask = cv2.morphologyEx(new.astype(np.uint8), cv2.MORPH_OPEN, _GRAIN)
        _, _, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
        for left, top, width, height, area in stats[1:].tolist():
            if area >= self._settings.least_px:
                rows = slice(max(top - _MARGIN_PX, 0), top + height + _MARGIN_PX)
                part = rows, slice(max(left - _MARGIN_PX, 0), left + width + _MARGIN_PX)
                shade = shadows(pixels[part], self._background[part], labels[part] == _SHADOW)
                mask[part][shade] = 0
        return np.asarray(mask > 0)


def _without_fringe(mask: ImageArray) -> BoolArray:
    """One object ``(height, width)`` without what hangs on to it; with it, where it would fall apart."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, [max(3, round(_FRINGE * len(mask)) | 1)] * 2)
    smooth = cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel)
    parts, _ = cv2.connectedComponents(smooth, connectivity=8)
    return np.asarray((smooth if parts == _ONE else mask) > 0)


def _whole(mask: BoolArray, least_px: int) -> BoolArray:
    """A mask without grains, its gaps closed, of parts of at least so many pixels."""
    clean = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, _GRAIN)  # first, or borders of shadows grow
    clean = cv2.morphologyEx(clean, cv2.MORPH_CLOSE, _GAPS)
    _, parts, stats, _ = cv2.connectedComponentsWithStats(clean, connectivity=8)
    whole = np.zeros_like(clean)
    for number, (left, top, width, height, area) in enumerate(stats.tolist()):
        if number == 0 or area < least_px:
            continue
        part = slice(top, top + height), slice(left, left + width)
        whole[part][_without_fringe((parts[part] == number).astype(np.uint8))] = 1
    return np.asarray(whole > 0)
