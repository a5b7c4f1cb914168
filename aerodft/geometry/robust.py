"""Standard deviations from median absolute deviations, robust against outliers."""

from typing import Final

import numpy as np
import numpy.typing as npt

_STD_PER_MAD: Final = 1.4826  # of a normal distribution


def robust_std(deviations: npt.ArrayLike) -> float:
    """Standard deviation of deviations from 0, by the median of their absolute values."""
    return _STD_PER_MAD * float(np.median(np.abs(deviations)))
