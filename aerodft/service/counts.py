"""What came into the pipeline."""

from dataclasses import dataclass


@dataclass(slots=True)
class Counts:
    """What came in and what could not be used."""

    images: int = 0
    observations: int = 0
    unknown_probe: int = 0
    wrong_pixel_count: int = 0
