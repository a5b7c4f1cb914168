"""The registry of lens models: ``LENS_MODELS``.

A model is an entry, with a class that says how it distorts. Camera files, their formats, messages, calibrations and
ground maps ask the entry.
"""

from typing import Final

from aerodft.geometry.lenses.brown import BROWN
from aerodft.geometry.lenses.division import DIVISION
from aerodft.geometry.lenses.fisheye import FISHEYE
from aerodft.geometry.lenses.model import Coefficients, Distorted, Lens
from aerodft.geometry.lenses.omnidirectional import OMNIDIRECTIONAL
from aerodft.model import LensModel

LENS_MODELS: Final[dict[LensModel, Lens]] = {lens.model: lens for lens in (BROWN, FISHEYE, DIVISION, OMNIDIRECTIONAL)}
"""Every lens model by name."""
