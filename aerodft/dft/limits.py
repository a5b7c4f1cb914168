"""Where first order ends, and where an answer does."""

from typing import Final

from aerodft.model.status import CODES, Status

FIRST_ORDER_LIMIT: Final = 0.05
"""Relative standard deviation of a slant range above which errors are drawn."""

MAX_RELATIVE_RANGE_STD: Final = 0.3
"""A point whose slant range is less certain than this is ``ILL_CONDITIONED``."""

MAX_BEARING_STD_RAD: Final = 0.3
"""So is a direction that is less certain than this; over a third of it, errors are drawn."""

NEAR_FOOT: Final = 0.1
"""An object's height is drawn where its distance from the camera's foot is less certain than this share of it."""

LEANING_STDS: Final = 6.0
"""What leans by more than 45 degrees, and by more than so many standard deviations, is no upright object."""

NO_RAY_CODES: Final = (CODES.index(Status.OUT_OF_IMAGE), CODES.index(Status.BEYOND_LENS_MODEL))
"""As arrays of statuses have it: a pixel without a ray has no answer of any kind."""
