"""The autopilot's own parameters, as far as a log or link says them (PARAM_VALUE; PARM of an on-board log)."""

import math
import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from aerodft.adapters.mavlink.blocks import headers, payload_rows
from aerodft.adapters.mavlink.dataflash_format import HEAD_SIZE, MessageFormat
from aerodft.adapters.mavlink.dialect import payload_dtype
from aerodft.model.telemetry import RawBlock, WireProtocol

_PARAM_VALUE: Final = 22
_DTYPE: Final = payload_dtype(_PARAM_VALUE)
_RATE: Final = re.compile(r"((?:SR|MAV)\d)_(EXT_STAT|EXTRA[123]|POSITION|RAW_SENS|RC_CHAN)")
_FACTOR: Final = 2.0  # a rate that comes may be off by that: links are slow, and messages have divided rates

Sender = tuple[int | None, int | None]
"""System and component; None of an on-board log."""


@dataclass(frozen=True, slots=True)
class Parameters:
    """What one autopilot said.

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
        if block.protocol is WireProtocol.MAVLINK:
            self._add_mavlink(block)
        else:
            self._add_dataflash(block, formats)

    def of(self, system: int | None, component: int | None) -> Parameters:
        """What one autopilot said."""
        said = self._values.get((system, component), {})
        return Parameters({name: tuple(values) for name, values in said.items()})

    def _add_mavlink(self, block: RawBlock) -> None:
        heads = headers(block)
        index = np.flatnonzero(heads[0] == _PARAM_VALUE)
        payload = payload_rows(block, heads[3:, index], _DTYPE)
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
