"""What arrives: telemetry frames, images and observations."""

from typing import TypeAlias

from aerodft.model.image import Image, ImageRows
from aerodft.model.observation import Observation
from aerodft.model.telemetry import RawBlock

Event: TypeAlias = RawBlock | Image | Observation
Arrival: TypeAlias = Event | ImageRows
"""An event, or many images that are read together."""
