"""MAVLink messages as JSON objects (as mavlink2rest and mavlink-server write them), packed into frames again."""

import math
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega

from aerodft.adapters.mavlink.dialect import MESSAGES

_BY_NAME: Final = {str(message.msgname): message for message in MESSAGES.values()}
_FLOATS: Final = ("float", "double")


class JsonPacker:
    """Packs messages; counts them.

    Attributes:
        packed: Messages so far.
    """

    def __init__(self) -> None:
        self.packed = 0
        self._link = ardupilotmega.MAVLink(None)

    def pack(self, item: dict[str, Any]) -> bytes:
        """The frame of ``{"header": {...}, "message": {"type": "ATTITUDE", ...}}``.

        Raises:
            ValueError, KeyError, TypeError: It is no such object, or of a message or value that nobody knows.
        """
        header, fields = item.get("header") or {}, dict(item["message"])
        kind = _BY_NAME[fields.pop("type")]
        if "mavtype" in fields:  # a word of their language; the field is called ``type``
            fields["type"] = fields.pop("mavtype")
        values = [
            _value(fields.get(name, 0 if not count else []), wire_type, count)
            for name, wire_type, count in zip(kind.fieldnames, kind.fieldtypes, _counts(kind), strict=True)
        ]
        self._link.srcSystem = int(header.get("system_id", 1))
        self._link.srcComponent = int(header.get("component_id", 1))
        self._link.seq = int(header.get("sequence", self.packed)) & 0xFF
        frame = bytes(kind(*values).pack(self._link))
        self.packed += 1
        return frame


def _counts(kind: Any) -> list[int]:  # noqa: ANN401 - pymavlink's classes have no type
    """Array lengths (0: no array) in the order of ``fieldnames``."""
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    return [lengths[name] for name in kind.fieldnames]


def _value(given: Any, wire_type: str, count: int) -> Any:  # noqa: ANN401 - whatever JSON holds
    if wire_type == "char":
        text = "".join(map(str, given)) if isinstance(given, list) else str(given or "")
        return text.encode()[: max(count, 1)]
    if count:
        items = list(given or [])[:count]
        return [_number(each, wire_type) for each in items] + [0] * (count - len(items))
    return _number(given, wire_type)


def _number(given: Any, wire_type: str) -> int | float:  # noqa: ANN401 - whatever JSON holds
    if isinstance(given, dict):
        given = given["type"] if "type" in given else given["bits"]
    if given is None:
        return math.nan if wire_type in _FLOATS else 0
    if isinstance(given, str):
        return sum(_constant(name.strip()) for name in given.split("|") if name.strip())
    return float(given) if wire_type in _FLOATS else int(given)


def _constant(name: str) -> int:
    value = getattr(ardupilotmega, name, None)
    if not isinstance(value, int):
        raise ValueError(f"no constant {name}")  # noqa: TRY004 - of the text, not of its type
    return value
