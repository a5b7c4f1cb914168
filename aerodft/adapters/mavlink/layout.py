"""What MAVLink frames, logs with stamps, and the scanners' states are laid out like."""

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
Table = npt.NDArray[np.int32]

FRAME, NOTHING, INCOMPLETE, UNKNOWN, BAD_CRC = 0, 1, 2, 3, 4  # verdicts of ``probe``
MIN_FRAME = 8
MAX_FRAME = 280
# Where the scanners' state keeps what: counters, then positions in the buffer.
N_OK, N_BAD_CRC, N_UNKNOWN, N_SKIPPED, N_TRUNCATED, SHARED, AT_SYNC, AT_QUIET, STATE_SIZE = 0, 1, 2, 3, 4, 5, 6, 7, 8

LAST_US, BACKWARDS, TLOG_STATE = 8, 9, 10  # what the state of a log with stamps has beside
STAMP_SIZE = 8
JUMP_US = 60_000_000
BACK_US = 1_000_000
MAX_STAMP_US = 1 << 52  # year 2112; its nanoseconds still fit 64 bits

V1, V2 = 0xFE, 0xFD
V1_HEAD, V2_HEAD = 6, 10
SIGNED = 1
SIGNATURE = 13
MOST_SHARED = SIGNATURE + 1  # bytes of a cut frame that the next one may have begun in
TABLE_IDS = 1 << 16


def crc_tables() -> npt.NDArray[np.uint16]:
    """``(8, 256)`` remainders of CRC-16/MCRF4XX, MAVLink's checksum (X.25's polynomial, reflected).

    Row ``k`` has those of a byte with ``k`` zero bytes after it.
    """
    values = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        values = np.where(values & 1, (values >> 1) ^ np.uint16(0x8408), values >> 1)
    rows = [values]
    for _ in range(7):
        rows.append((rows[-1] >> 8) ^ values[rows[-1] & 0xFF])
    return np.stack(rows)
