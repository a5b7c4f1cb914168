"""Cast shadows told from what casts them (the paper's Section 4.2): darker, of the same colour, and as rough as before.

A shadow leaves of every pixel a part, the photometric gain: below about 0.9 (Branca et al. 2002), nearly the same all
around, with chromaticity and texture unchanged (Xu et al. 2005). What MOG2 itself labels a shadow is a second opinion:
then one of colour and texture is enough.
"""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, ImageArray

MOST_GAIN: Final = 0.9
_LEAST_GAIN: Final = 0.25  # the sky still lights what the sun does not
_WINDOW_PX: Final = 5
_SAME_COLOUR: Final = 0.025  # of red and green over the sum of all three ...
_COLOUR_NOISE: Final = 3.0  # ... and of that sum, in grey levels
_SAME_TEXTURE: Final = 0.07  # of the brightness: what is left when the background times the gain is taken away
_TEXTURE_NOISE: Final = 3.0  # grey levels

_Plane = np.ndarray[tuple[int, ...], np.dtype[np.float32]]


def shadows(
    image: ImageArray, background: ImageArray, labelled: BoolArray | None = None, most_gain: float = MOST_GAIN
) -> BoolArray:
    """Where there is shadow, of what is not background.

    Args:
        image: ``(height, width, 3)`` BGR.
        background: The same place without objects, likewise.
        labelled: ``(height, width)``: where somebody else sees a shadow.
        most_gain: What is brighter than this share of the background is in no shadow.

    Returns:
        ``(height, width)``.
    """
    now, then = _smooth(image), _smooth(background)
    now_sum, then_sum = _total(now) + 1.0, _total(then) + 1.0
    gain = now_sum / then_sum
    darker = (gain > _LEAST_GAIN) & (gain < most_gain)
    green, red = (np.abs(now[..., k] / now_sum - then[..., k] / then_sum) for k in (1, 2))
    same_colour = np.maximum(green, red) < _SAME_COLOUR + _COLOUR_NOISE / now_sum
    same_texture = _roughness(image, background, gain) < _TEXTURE_NOISE + _SAME_TEXTURE * now_sum / 3
    seen = same_colour & same_texture
    if labelled is not None:
        seen |= labelled & (same_colour | same_texture)
    return np.asarray(darker & seen)


def _smooth(image: ImageArray) -> _Plane:
    return np.asarray(cv2.blur(image.astype(np.float32), (_WINDOW_PX, _WINDOW_PX)))


def _total(image: _Plane) -> _Plane:
    return image[..., 0] + image[..., 1] + image[..., 2]


def _roughness(image: ImageArray, background: ImageArray, gain: _Plane) -> _Plane:
    """Root mean square of what the gain does not explain, grey levels ``(height, width)``."""
    now, then = (_total(each.astype(np.float32)) / 3 for each in (image, background))
    rest = now - gain * then
    return np.asarray(np.sqrt(cv2.blur(rest * rest, (_WINDOW_PX, _WINDOW_PX))))
