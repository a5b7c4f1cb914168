"""The frames of a block taken apart: their headers, and payloads as rows of one structured type."""

import numpy as np
import numpy.typing as npt

from aerodft.adapters.mavlink.dialect import frame_table
from aerodft.adapters.mavlink.kernels import gather, read_headers
from aerodft.model.arrays import IntArray
from aerodft.model.telemetry import RawBlock


def headers(block: RawBlock) -> IntArray:
    """``(5, n)`` message id (-1: no good frame), system, component, payload's start and length (``read_headers``)."""
    heads = np.empty((5, len(block.offset)), dtype=np.int64)
    data = np.frombuffer(block.data, dtype=np.uint8)
    frames = np.stack([block.offset, block.length])
    read_headers(data, frames, frame_table(), heads, checked=block.checked)
    return heads


def payload_rows(block: RawBlock, places: IntArray, dtype: np.dtype[np.void]) -> npt.NDArray[np.void]:
    """Payloads of one message ``(k,)``, with zeros where they were cut off.

    Args:
        block: The frames.
        places: ``(2, k)`` start and length (bytes) of each payload in the block's bytes.
        dtype: What a whole payload is made of.
    """
    raw = np.zeros((places.shape[1], dtype.itemsize), dtype=np.uint8)
    gather(np.frombuffer(block.data, dtype=np.uint8), np.ascontiguousarray(places), raw)
    return raw.view(dtype)[:, 0]
