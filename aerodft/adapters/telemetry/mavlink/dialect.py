"""What pymavlink's ``ardupilotmega`` dialect says about messages, as tables for the hot loops."""

from functools import cache
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega
from pymavlink.generator.mavcrc import x25crc

TABLE_IDS: Final = 1 << 16
"""Message ids that tables have a row for."""

MessageClass: TypeAlias = Any
"""A class of pymavlink, which has no types."""

MESSAGES: Final[dict[int, MessageClass]] = ardupilotmega.mavlink_map
_NUMPY_TYPES: Final = {
    "char": "i1",
    "int8_t": "<i1",
    "uint8_t": "<u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
}


def message_name(message_id: int) -> str:
    """The message's name, or ``UNKNOWN_<id>``."""
    message = MESSAGES.get(message_id)
    return f"UNKNOWN_{message_id}" if message is None else str(message.msgname)


def _wire_fields(message: MessageClass) -> list[tuple[str, str, int]]:
    """Name, MAVLink type and array length (0: no array) of every field, in wire order, extensions last."""
    types = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    names = message.ordered_fieldnames
    return [
        (name, types[name].removesuffix("_mavlink_version"), count)
        for name, count in zip(names, message.array_lengths, strict=True)
    ]


def payload_dtype(message_id: int) -> np.dtype[np.void]:
    """The structured type of a whole payload, extensions included."""
    return np.dtype(
        [
            (name, _NUMPY_TYPES[kind], (count,)) if count else (name, _NUMPY_TYPES[kind])
            for name, kind, count in _wire_fields(MESSAGES[message_id])
        ]
    )


def field_offset(message_id: int, field: str) -> int:
    """Offset of a field in a whole payload, in bytes."""
    return dict(payload_dtype(message_id).fields or {})[field][1]


def _base_length(message: MessageClass) -> int:
    """Payload bytes without extensions: CRC_EXTRA covers exactly the fields before them.

    By chance (1 in 256) a shorter run of fields has the same CRC_EXTRA; then the frame check is wider than it need be,
    and no valid frame is refused.
    """
    crc = x25crc()
    crc.accumulate_str(f"{message.msgname} ")
    size = 0
    for name, kind, count in _wire_fields(message):
        crc.accumulate_str(f"{kind} ")
        crc.accumulate_str(f"{name} ")
        if count:
            crc.accumulate([count])
        size += np.dtype(_NUMPY_TYPES[kind]).itemsize * max(count, 1)
        if (crc.crc & 0xFF) ^ (crc.crc >> 8) == message.crc_extra:
            return size
    return size


@cache
def frame_table() -> npt.NDArray[np.int32]:
    """``(65536,)`` by message id: CRC_EXTRA | base length << 8 | full length << 16, or -1 for an unknown id."""
    table = np.full(TABLE_IDS, -1, dtype=np.int32)
    for message_id, message in MESSAGES.items():
        full = message.unpacker.size
        table[message_id] = message.crc_extra | _base_length(message) << 8 | full << 16
    table.setflags(write=False)
    return table
