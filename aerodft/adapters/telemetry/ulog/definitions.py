"""What a ULog file says of its own messages: the layout of each topic, and the number of each subscription."""

import struct
from dataclasses import dataclass
from typing import Final

import numpy as np
from pyulog import ULog

from aerodft.adapters.telemetry.ulog.framing import FORMAT, LEAST, MOST, SUBSCRIPTION, TIME_AT, topic_table

_TYPES: Final = {
    "int8_t": "i1",
    "uint8_t": "u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "u1",
    "char": "S1",
}
_PADDING: Final = "_padding"  # at a topic's end it is not logged
_TIME: Final = "timestamp"
_MOST_BYTES: Final = 0xFFFF
_MOST_FORMATS: Final = 4096  # PX4 has some 250: a damaged file must not fill the memory
_MOST_NESTED: Final = 8  # PX4 nests twice; a format that contains itself would not end


@dataclass(frozen=True, slots=True)
class Topic:
    """One subscription.

    Attributes:
        name: For instance ``vehicle_attitude``.
        instance: Which of several sensors or estimators, from 0 on.
        dtype: The structured type of its data, behind the subscription's number.
    """

    name: str
    instance: int
    dtype: np.dtype[np.void]


class Definitions:
    """Layouts and subscriptions that a log has stated so far.

    Attributes:
        topics: Readable subscriptions by number.
        sizes: What ``scan_ulog`` needs of them.
    """

    def __init__(self) -> None:
        self.topics: dict[int, Topic] = {}
        self.sizes = topic_table()
        self._formats: dict[str, ULog.MessageFormat] = {}

    def learn(self, kind: int, payload: bytes) -> None:
        """Take in a message of definition; what cannot be read changes nothing."""
        if kind == FORMAT and len(self._formats) < _MOST_FORMATS:
            try:
                parsed = ULog.MessageFormat(payload, None)
            except (IndexError, ValueError):
                return
            self._formats[parsed.name] = parsed
        elif kind == SUBSCRIPTION:
            self._subscribe(payload)

    def subscription(self, payload: bytes) -> tuple[int, Topic] | None:
        """The number and topic that a subscription states; None where its format is not known or has no time."""
        try:
            instance, number = struct.unpack_from("<BH", payload)
            name = payload[3:].decode()
            dtype = self._dtype(name)
            if dtype is None or dtype.itemsize > _MOST_BYTES or dtype[_TIME] != np.dtype("<u8"):
                return None
        except (struct.error, KeyError, ValueError, TypeError):
            return None
        return number, Topic(name, instance, dtype)

    def _subscribe(self, payload: bytes) -> None:
        found = self.subscription(payload)
        if found is None:
            return
        number, topic = found
        self.topics[number] = topic
        time_at = topic.dtype.fields[_TIME][1] if topic.dtype.fields else 0
        size = topic.dtype.itemsize
        padding = sum(count for _, count, name in self._formats[topic.name].fields if name.startswith(_PADDING))
        self.sizes[[LEAST, MOST, TIME_AT], number] = size, size + padding, time_at

    def _dtype(self, name: str, depth: int = 0) -> np.dtype[np.void] | None:
        """The structured type of a format; without the padding at its end, unless it is nested in another one."""
        fields = list(self._formats[name].fields)
        while not depth and fields and fields[-1][2].startswith(_PADDING):
            fields.pop()
        columns: list[tuple[str, object, tuple[int, ...]]] = []
        for kind, count, field in fields:
            inner: object = _TYPES.get(kind)
            if inner is None and depth < _MOST_NESTED:
                inner = self._dtype(kind, depth + 1)
            if inner is None:
                return None
            columns.append((field, inner, (count,) if count else ()))
        return np.dtype(columns)
