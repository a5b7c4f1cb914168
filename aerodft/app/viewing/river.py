"""The river in an image of a page, with what people drew over it as hints."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

import numpy as np

from aerodft.adapters.wire.payload import as_json
from aerodft.app.river import river_question, survey_image
from aerodft.app.viewing.questions import MOST_POINTS, is_pixel
from aerodft.dft import Setup
from aerodft.errors import NoAnswerError, Reason, UsageError
from aerodft.model import ImageArray, PoseSample
from aerodft.vision.river import River, RiverHints, RiverView

_MOST_STROKES: Final = 64
_SPACING_M: Final = 1.0


def river_in(
    scene_of: Callable[[int], tuple[Setup, PoseSample]],
    pixels_of: Callable[[int], ImageArray],
    number: int,
    strokes: object,
    hinted: int,
) -> dict[str, Any]:
    """The river in an image, as ``aerodft river --json`` has it.

    Args:
        scene_of: Camera, ground and pose of an image by its number.
        pixels_of: Its pixels, ``(height, width, 3)`` BGR.
        number: Of the image.
        strokes: What a person says is ``water`` and ``land``: lists of strokes, which are lists of ``[u, v]``.
        hinted: Number of the image that the strokes are of; they are carried on the water's plane.

    Returns:
        Banks, transects and width; where there is none its ``status`` says why. ``water``: outlines of what was
        taken for water, in pixels. ``banks_enu_m``: the banks from above, lines of east and north.

    Raises:
        UsageError: The strokes are something else.
        NoAnswerError: An image has no pose.
    """
    hints, here, there = _hints_of(strokes), *(_river_view(scene_of, pixels_of, each) for each in (number, hinted))
    told = hints if number == hinted else hints.carried(there.plane, here.plane)
    survey = survey_image(here, river_question(told, _SPACING_M, None))
    water = survey.found.outlines_px if isinstance(survey.found, River) else []
    banks = [here.plane.places_en_m(np.array(line)) for line in survey.document["banks"].values() if line]
    return survey.document | {
        "water": [outline.round(1).tolist() for outline in water],
        "banks_enu_m": [bank[np.isfinite(bank).all(axis=1)].tolist() for bank in banks],
    }


def _river_view(
    scene_of: Callable[[int], tuple[Setup, PoseSample]], pixels_of: Callable[[int], ImageArray], number: int
) -> RiverView:
    setup, sample = scene_of(number)
    if sample.pose is None:
        raise NoAnswerError("the image has no pose", got=Reason("; ".join(sample.reasons)))
    return RiverView(number, setup, sample, partial(pixels_of, number))


def _hints_of(document: object) -> RiverHints:
    strokes = [document.get(side) for side in ("water", "land")] if isinstance(document, Mapping) else []
    if not strokes or not all(isinstance(each, list) and len(each) <= _MOST_STROKES for each in strokes):
        raise UsageError("the hints", got=as_json(document), expected=f"water and land, up to {_MOST_STROKES} strokes")
    for stroke in (stroke for side in strokes for stroke in side or ()):
        if not isinstance(stroke, list) or not 0 < len(stroke) <= MOST_POINTS or not all(map(is_pixel, stroke)):
            raise UsageError("a stroke", got=as_json(stroke), expected=f"1 to {MOST_POINTS} pairs of numbers")
    water, land = strokes
    return RiverHints(water or [], land or [])
