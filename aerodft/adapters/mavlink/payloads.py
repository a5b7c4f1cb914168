"""Payloads out of a block's bytes, as rows of equal size."""

import numpy as np
import numpy.typing as npt

from aerodft.adapters.mavlink.layout import Bytes
from aerodft.geometry.jit import njit_late
from aerodft.model.arrays import IntArray


@njit_late
def gather(data: Bytes, places: IntArray, out: npt.NDArray[np.uint8]) -> None:
    """Copy payloads to rows of equal size, with zeros where MAVLink 2 cut them off.

    Args:
        data: The block's bytes.
        places: ``(2, k)`` start and length of each payload.
        out: ``(k, size)`` zeros, filled.
    """
    for k in range(places.shape[1]):
        at = places[0, k]
        for i in range(min(places[1, k], out.shape[1])):
            out[k, i] = data[at + i]
