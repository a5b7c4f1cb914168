"""Surveyed points that a live calibration looks for in the images."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyedLandmark:
    """A point whose place is known; an observation of one pixel that bears its name is of it.

    Attributes:
        name: Unique; the last part of its observations' key expression.
        position_enu_m: East, north, up of the station's origin.
        std_m: Of each of the three. The same error is in every observation of it, however many there are.
        std_px: Of each pixel coordinate, unless the observation brings its own.
    """

    name: str
    position_enu_m: tuple[float, float, float]
    std_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std_px: float = 1.0
