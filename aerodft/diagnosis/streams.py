"""What a log or link holds: every message of every sender, when, how often; and the autopilot's own parameters."""

import math
import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from aerodft.adapters.telemetry import FMT_TYPE, HEAD_SIZE, CompositeDecoder, MessageFormat
from aerodft.adapters.telemetry.mavlink import (
    GIMBAL_MESSAGES,
    RANGEFINDER,
    headers,
    message_name,
    payload_dtype,
    payload_rows,
)
from aerodft.conventions import SECOND_NS
from aerodft.model import FloatArray, GimbalSource, IntArray, RawBlock, WireProtocol

_SYSTEM_BITS, _COMPONENT_BITS = 24, 32
_BYTE = 0xFF
_BURST_NS: Final = SECOND_NS // 10  # shorter is one answer in several frames
_ID_MASK = (1 << 24) - 1
_RANGEFINDER = payload_dtype(RANGEFINDER)
_PARAM_VALUE: Final = 22
_PARAMETER_DTYPE: Final = payload_dtype(_PARAM_VALUE)
_RATE: Final = re.compile(r"((?:SR|MAV)\d)_(EXT_STAT|EXTRA[123]|POSITION|RAW_SENS|RC_CHAN)")
_FACTOR: Final = 2.0  # a rate that comes may be off by that: links are slow, and messages have divided rates

Sender = tuple[int | None, int | None]
"""System and component; None of an on-board log."""


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
        """Mean rate between the first and the last; 0 for a single one, and for a burst: it has none."""
        span_ns = self.last_ns - self.first_ns
        return (self.count - 1) * SECOND_NS / span_ns if span_ns > _BURST_NS else 0.0

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
        self._named: dict[str, Stream] = {}

    def streams(self) -> list[Stream]:
        """All streams by name, then sender."""
        return sorted(
            (*self._streams.values(), *self._named.values()), key=lambda s: (s.name, s.system or 0, s.component or 0)
        )

    def add(self, block: RawBlock, formats: dict[int, MessageFormat], decoder: CompositeDecoder) -> None:
        """Count a block's frames.

        Args:
            block: The frames.
            formats: Names of an ArduPilot log's messages.
            decoder: Knows the names of other formats' messages.
        """
        if not len(block.offset):
            return
        if block.protocol == WireProtocol.MAVLINK:
            heads = headers(block)
            keys = np.where(heads[0] < 0, -1, heads[0] | heads[1] << _SYSTEM_BITS | heads[2] << _COMPONENT_BITS)
        elif block.protocol == WireProtocol.DATAFLASH:
            kinds = np.frombuffer(block.data, dtype=np.uint8)[block.offset + HEAD_SIZE - 1]
            keys = kinds.astype(np.int64)
        else:
            self._add_named(block, *decoder.frame_names(block))
            return
        for key in np.unique(keys[keys >= 0]).tolist():
            arrival_ns = block.arrival_ns[keys == key]
            if key not in self._streams:
                self._streams[key] = _new_stream(block.protocol, key, int(arrival_ns[0]), formats)
            self._streams[key].add(arrival_ns)

    def _add_named(self, block: RawBlock, keys: IntArray, names: Mapping[int, str]) -> None:
        """Count frames by the names of their messages: several keys may share one."""
        of_name: dict[str, list[int]] = defaultdict(list)
        for key in np.unique(keys[keys >= 0]).tolist():
            of_name[names.get(key, f"UNKNOWN_{key}")].append(key)
        for name, own in of_name.items():
            arrival_ns = block.arrival_ns[np.isin(keys, own)]
            stream = self._named.setdefault(name, Stream(name, None, None, int(arrival_ns[0]), int(arrival_ns[0])))
            stream.add(arrival_ns)


def _new_stream(protocol: str, key: int, first_ns: int, formats: dict[int, MessageFormat]) -> Stream:
    if protocol == WireProtocol.MAVLINK:
        return Stream(
            message_name(key & _ID_MASK), key >> _SYSTEM_BITS & _BYTE, key >> _COMPONENT_BITS, first_ns, first_ns
        )
    layout = formats.get(key)
    name = "FMT" if key == FMT_TYPE else layout.name if layout else f"UNKNOWN_{key}"
    return Stream(name, None, None, first_ns, first_ns)


def rangefinder_readings_m(block: RawBlock) -> FloatArray:
    """Every finite RANGEFINDER distance in a block ``(n,)``, also where a better message makes it superfluous."""
    if block.protocol != WireProtocol.MAVLINK:
        return np.empty(0)
    heads = headers(block)
    index = np.flatnonzero(heads[0] == RANGEFINDER)
    payload = payload_rows(block, heads[3:, index], _RANGEFINDER)
    return _finite(payload["distance"])


def gimbal_pitches_deg(block: RawBlock, formats: Mapping[int, MessageFormat]) -> dict[str, FloatArray]:
    """Finite pitches ``(n,)`` of gimbals by the messages that state angles, also beyond what an angle may be."""
    if block.protocol == WireProtocol.DATAFLASH:
        return _logged_pitches_deg(block, formats)
    if block.protocol != WireProtocol.MAVLINK:
        return {}
    heads, found = headers(block), {}
    for message in GIMBAL_MESSAGES:
        index = np.flatnonzero(heads[0] == message.message_id)
        if len(index) and message.pitch is not None:
            field_name, unit_deg = message.pitch
            payload = payload_rows(block, heads[3:, index], payload_dtype(message.message_id))
            found[message.name] = _finite(payload[field_name]) * unit_deg
    return found


def _logged_pitches_deg(block: RawBlock, formats: Mapping[int, MessageFormat]) -> dict[str, FloatArray]:
    kind = next((kind for kind, layout in formats.items() if layout.name == GimbalSource.DATAFLASH_MNT), None)
    if kind is None or "Pitch" not in (formats[kind].dtype.names or ()):
        return {}
    kinds = np.frombuffer(block.data, dtype=np.uint8)[block.offset + HEAD_SIZE - 1]
    index = np.flatnonzero((kinds == kind) & (block.length == formats[kind].dtype.itemsize + HEAD_SIZE))
    places = np.stack([block.offset[index] + HEAD_SIZE, block.length[index] - HEAD_SIZE])
    payload = payload_rows(block, places, formats[kind].dtype)
    return {str(GimbalSource.DATAFLASH_MNT): _finite(payload["Pitch"]) * formats[kind].scale["Pitch"]}


def _finite(values: FloatArray) -> FloatArray:
    """The finite ones of values ``(n,)`` of any type."""
    with np.errstate(invalid="ignore"):  # damaged senders write signalling NaN too
        numbers = values.astype(np.float64)
    return numbers[np.isfinite(numbers)]


@dataclass(frozen=True, slots=True)
class Parameters:
    """Parameters of one autopilot.

    Attributes:
        values: By name; each change of a value is one more, the last one holds.
    """

    values: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def switch_off(self, *patterns: str) -> str:
        """The setting that switches something off, as ``NAME = 0``; empty where it may be on.

        Args:
            patterns: Regular expressions of the names of its types, one for each instance: all known ones must be 0.
        """
        names = [name for name in self.values if any(re.fullmatch(each, name) for each in patterns)]
        if not names or any(self.values[name][-1] != 0 for name in names):
            return ""
        return f"{min(names, key=lambda name: (len(name), name))} = 0"

    def port(self, rates_hz: Mapping[str, float]) -> str:
        """The port that a link is on, as its rates are called (``SR1``); empty where that cannot be told.

        Args:
            rates_hz: How often what belongs to a group comes, by ArduPilot's name of the group.
        """
        ports: dict[str, dict[str, tuple[float, ...]]] = defaultdict(dict)
        for name, values in self.values.items():
            if found := _RATE.fullmatch(name):
                ports[found[1]][found[2]] = values
        speaking = [port for port, groups in ports.items() if any(values[-1] > 0 for values in groups.values())]
        heard = {group: rate_hz for group, rate_hz in rates_hz.items() if rate_hz > 0}
        fitting = [port for port in speaking if heard and _fits(ports[port], heard)]
        found_ports = fitting if len(speaking) > 1 else speaking
        return found_ports[0] if len(found_ports) == 1 else ""


def _fits(groups: Mapping[str, tuple[float, ...]], rates_hz: Mapping[str, float]) -> bool:
    """Whether each rate that comes is about one that the port was set to."""
    return all(
        any(value > 0 and abs(math.log(value / rate_hz)) <= math.log(_FACTOR) for value in groups.get(group, ()))
        for group, rate_hz in rates_hz.items()
    )


class ParameterTable:
    """Takes in blocks; keeps what every sender says of its parameters."""

    def __init__(self) -> None:
        self._values: dict[Sender, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))

    def add(self, block: RawBlock, formats: Mapping[int, MessageFormat]) -> None:
        """Take in a block; ``formats`` says how an on-board log's messages are laid out."""
        if not len(block.offset):
            return
        if block.protocol == WireProtocol.MAVLINK:
            self._add_mavlink(block)
        elif block.protocol == WireProtocol.DATAFLASH:
            self._add_dataflash(block, formats)

    def of(self, system: int | None, component: int | None) -> Parameters:
        """Parameters of one autopilot."""
        values = self._values.get((system, component), {})
        return Parameters({name: tuple(values) for name, values in values.items()})

    def _add_mavlink(self, block: RawBlock) -> None:
        heads = headers(block)
        index = np.flatnonzero(heads[0] == _PARAM_VALUE)
        payload = payload_rows(block, heads[3:, index], _PARAMETER_DTYPE)
        names = np.ascontiguousarray(payload["param_id"]).view("S16")[:, 0].tolist()
        senders = zip(heads[1, index].tolist(), heads[2, index].tolist(), strict=True)
        for sender, name, value in zip(senders, names, payload["param_value"].tolist(), strict=True):
            self._note(sender, name, value)

    def _add_dataflash(self, block: RawBlock, formats: Mapping[int, MessageFormat]) -> None:
        kind = next((kind for kind, layout in formats.items() if layout.name == "PARM"), None)
        if kind is None or not {"Name", "Value"} <= set(formats[kind].dtype.names or ()):
            return
        kinds = np.frombuffer(block.data, dtype=np.uint8)[block.offset + HEAD_SIZE - 1]
        index = np.flatnonzero(kinds == kind)
        places = np.stack([block.offset[index] + HEAD_SIZE, block.length[index] - HEAD_SIZE])
        payload = payload_rows(block, places, formats[kind].dtype)
        for name, value in zip(payload["Name"].tolist(), payload["Value"].tolist(), strict=True):
            self._note((None, None), name, value)

    def _note(self, sender: Sender, name: bytes, value: float) -> None:
        values = self._values[sender][name.split(b"\0")[0].decode("ascii", "replace")]
        if math.isfinite(value) and value not in values[-1:]:
            values.append(value)
