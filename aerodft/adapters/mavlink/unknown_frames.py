"""Which messages the frames are of that a log holds, and the dialect does not know."""

from collections import Counter

import numpy as np

from aerodft.adapters.mavlink.dialect import frame_table
from aerodft.adapters.mavlink.kernels import measure
from aerodft.adapters.mavlink.layout import STAMP_SIZE, UNKNOWN, V1
from aerodft.model.telemetry import RawBlock, WireProtocol


def unknown_ids(block: RawBlock) -> Counter[int]:
    """How often each unknown id stands between a stamped log's frames; links hand on good frames alone."""
    found: Counter[int] = Counter()
    if block.protocol is not WireProtocol.MAVLINK or len(block.offset) < 2:  # noqa: PLR2004 - two frames have a gap
        return found
    data, table = np.frombuffer(block.data, dtype=np.uint8), frame_table()
    ends, starts = (block.offset + block.length)[:-1], block.offset[1:] - STAMP_SIZE
    for k in np.flatnonzero(starts > ends).tolist():
        at, stop = int(ends[k]) + STAMP_SIZE, int(starts[k])
        while at < stop:
            verdict, size, _ = measure(data, at, stop, table)
            if verdict != UNKNOWN or at + size > stop:
                break
            head = data[at : at + 10].tolist()
            found[head[5] if head[0] == V1 else head[7] | head[8] << 8 | head[9] << 16] += 1
            at += size + STAMP_SIZE
    return found
