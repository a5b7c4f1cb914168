"""Standard deviations that a few strays do not touch."""

from typing import Final

import numpy as np
import numpy.typing as npt

_NORMAL: Final = 1.4826  # standard deviation of a normal distribution, over its median absolute deviation


def robust_std(off: npt.ArrayLike) -> float:
    """Standard deviation of what is distributed around 0, by the median of its absolute values."""
    return _NORMAL * float(np.median(np.abs(off)))


def middle_and_std(values: npt.NDArray[np.floating]) -> tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]:
    """Median of each column of ``(n, k)``, and its standard deviation by the median deviation, ``(k,)`` both."""
    middle = np.median(values, axis=0)
    return middle, _NORMAL * np.median(np.abs(values - middle), axis=0)
