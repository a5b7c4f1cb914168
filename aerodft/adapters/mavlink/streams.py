"""Counting what a log or link holds: every message of every sender, when, how often, with which gaps."""

from dataclasses import dataclass, field

import numpy as np

from aerodft.adapters.mavlink.blocks import headers, payload_rows
from aerodft.adapters.mavlink.dataflash_format import FMT_TYPE, HEAD_SIZE, MessageFormat
from aerodft.adapters.mavlink.dialect import message_name, payload_dtype
from aerodft.adapters.mavlink.selection import RANGEFINDER
from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.telemetry import RawBlock, WireProtocol

_SYSTEM_BITS, _COMPONENT_BITS = 24, 32
_BYTE = 0xFF
_ID_MASK = (1 << 24) - 1
_RANGEFINDER = payload_dtype(RANGEFINDER)


@dataclass(slots=True)
class Stream:
    """One message from one sender, counted while it comes in.

    Attributes:
        name: The message.
        system: MAVLink system id; None for an on-board log.
        component: MAVLink component id; None for an on-board log.
        count: How many.
        first_ns: Arrival of the first.
        last_ns: Arrival of the last.
        gaps_ns: ``(start, length)`` of every silence longer than a second.
    """

    name: str
    system: int | None
    component: int | None
    first_ns: int
    last_ns: int
    count: int = 0
    gaps_ns: list[tuple[int, int]] = field(default_factory=list)

    @property
    def rate_hz(self) -> float:
        """Mean rate between the first and the last; 0 for a single one."""
        span_ns = self.last_ns - self.first_ns
        return (self.count - 1) * SECOND_NS / span_ns if span_ns > 0 else 0.0

    def add(self, arrival_ns: IntArray) -> None:
        """Take in arrivals ``(n,)``, n > 0, not before the last one."""
        steps = np.diff(arrival_ns, prepend=self.last_ns)
        for k in np.flatnonzero(steps > SECOND_NS).tolist():
            self.gaps_ns.append((int(arrival_ns[k] - steps[k]), int(steps[k])))
        self.count += len(arrival_ns)
        self.last_ns = int(arrival_ns[-1])


class StreamTable:
    """All streams of a log or link."""

    def __init__(self) -> None:
        self._streams: dict[int, Stream] = {}

    def streams(self) -> list[Stream]:
        """By name, then sender."""
        return sorted(self._streams.values(), key=lambda s: (s.name, s.system or 0, s.component or 0))

    def add(self, block: RawBlock, formats: dict[int, MessageFormat]) -> None:
        """Count a block's frames; ``formats`` names an on-board log's messages."""
        if not len(block.offset):
            return
        if block.protocol is WireProtocol.MAVLINK:
            heads = headers(block)
            keys = np.where(heads[0] < 0, -1, heads[0] | heads[1] << _SYSTEM_BITS | heads[2] << _COMPONENT_BITS)
        else:
            kinds = np.frombuffer(block.data, dtype=np.uint8)[block.offset + HEAD_SIZE - 1]
            keys = kinds.astype(np.int64)
        for key in np.unique(keys[keys >= 0]).tolist():
            arrival_ns = block.arrival_ns[keys == key]
            if key not in self._streams:
                self._streams[key] = _new_stream(block.protocol, key, int(arrival_ns[0]), formats)
            self._streams[key].add(arrival_ns)


def _new_stream(protocol: WireProtocol, key: int, first_ns: int, formats: dict[int, MessageFormat]) -> Stream:
    if protocol is WireProtocol.MAVLINK:
        return Stream(
            message_name(key & _ID_MASK), key >> _SYSTEM_BITS & _BYTE, key >> _COMPONENT_BITS, first_ns, first_ns
        )
    layout = formats.get(key)
    name = "FMT" if key == FMT_TYPE else layout.name if layout else f"UNKNOWN_{key}"
    return Stream(name, None, None, first_ns, first_ns)


def rangefinder_readings_m(block: RawBlock) -> FloatArray:
    """Every finite RANGEFINDER distance in a block ``(n,)``, also where a better message makes it superfluous."""
    if block.protocol is not WireProtocol.MAVLINK:
        return np.empty(0)
    heads = headers(block)
    index = np.flatnonzero(heads[0] == RANGEFINDER)
    payload = payload_rows(block, heads[3:, index], _RANGEFINDER)
    with np.errstate(invalid="ignore"):  # damaged senders write signalling NaN too
        distance_m = payload["distance"].astype(np.float64)
    return distance_m[np.isfinite(distance_m)]
