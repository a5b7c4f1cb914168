"""Standard deviations from median absolute deviations, robust against outliers."""

from typing import Final

import numpy as np
import numpy.typing as npt

_STD_PER_MAD: Final = 1.4826  # of a normal distribution


def robust_std(deviations: npt.ArrayLike) -> float:
    """Standard deviation of deviations from 0, by the median of their absolute values."""
    return _STD_PER_MAD * float(np.median(np.abs(deviations)))


def middle_and_std(values: npt.NDArray[np.floating]) -> tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]:
    """Median of each column of ``(n, k)`` and its robust standard deviation, ``(k,)`` both."""
    median = np.median(values, axis=0)
    return median, _STD_PER_MAD * np.median(np.abs(values - median), axis=0)
