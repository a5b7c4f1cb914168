"""Payloads with all their stamps moved by one amount; everything else in them stays as it was, byte by byte."""

import re
import struct
from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Any, Final

import orjson
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError, Message

from aerodft.adapters import bounded_json
from aerodft.adapters.foreign.kinds import CDR, JSON, PROTOBUF, ROS1
from aerodft.adapters.foreign.pictures import NANOSECONDS, SECONDS
from aerodft.adapters.mcap.places import ReadChannel
from aerodft.conventions import SECOND_NS

Shift = Callable[[bytes, int], bytes]
_STAMP: Final = re.compile(rb'("(?:stamp|arrival|since|moved|compared)_ns"\s*:\s*")(\d{1,20})(")')
_INSTANT: Final = re.compile(rb"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(\.\d{1,9})?Z")
_TIMESTAMP: Final = "google.protobuf.Timestamp"
_FIRST_FIELD: Final = re.compile(rb"^\s*([A-Za-z_/0-9]+)\s+\w+", re.MULTILINE)
_COMMENT: Final = re.compile(rb"#.*$", re.MULTILINE)
_HEADERS: Final = (b"Header", b"std_msgs/Header", b"std_msgs/msg/Header")
_TIMES: Final = (b"time", b"builtin_interfaces/Time", b"builtin_interfaces/msg/Time")
_STAMP_BYTES: Final = 8


def shifted(payload: bytes, shift_ns: int) -> bytes:
    """One of aerodft's own JSON payloads, with every stamp, also those in sentences, ``shift_ns`` later."""
    if not shift_ns:
        return payload
    moved = _STAMP.sub(lambda found: b"%s%d%s" % (found[1], int(found[2]) + shift_ns, found[3]), payload)
    return _INSTANT.sub(lambda found: _instant(found[1], found[2] or b"", shift_ns), moved)


def _instant(whole: bytes, fraction: bytes, shift_ns: int) -> bytes:
    rest_ns = int(fraction[1:].ljust(9, b"0") or 0) + shift_ns
    try:
        moment = datetime.fromisoformat(whole.decode()) + timedelta(seconds=rest_ns // SECOND_NS)
    except (ValueError, OverflowError):
        return whole + fraction + b"Z"
    digits = b".%09d" % (rest_ns % SECOND_NS)
    return moment.isoformat(timespec="seconds").encode() + digits[: len(fraction)] + b"Z"


def shift_of(channel: ReadChannel) -> Shift | None:
    """How the stamps of another tool's messages are moved; None where nobody knows where they are."""
    if channel.encoding == PROTOBUF:
        return _protobuf_shift(channel)
    if channel.encoding == JSON:
        return _shift_json
    if channel.encoding in {CDR, ROS1}:
        return _ros_shift(channel)
    return None


def _protobuf_shift(channel: ReadChannel) -> Shift | None:
    pool = descriptor_pool.DescriptorPool()
    try:
        for file in descriptor_pb2.FileDescriptorSet.FromString(channel.schema_data).file:
            pool.Add(file)
        kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(channel.schema))
    except (DecodeError, KeyError, TypeError, ValueError):
        return None

    def shift(data: bytes, shift_ns: int) -> bytes:
        try:
            message = kind.FromString(data)
            _shift_message(message, shift_ns)
        except (DecodeError, ValueError):  # the latter: a stamp that cannot be moved so far
            return data
        return bytes(message.SerializeToString())

    return shift


def _shift_message(message: Message, shift_ns: int) -> None:
    for descriptor, value in message.ListFields():
        if descriptor.message_type is None or descriptor.message_type.GetOptions().map_entry:
            continue
        for each in value if hasattr(value, "add") else [value]:
            if each.DESCRIPTOR.full_name == _TIMESTAMP:
                each.seconds, each.nanos = divmod(each.seconds * SECOND_NS + each.nanos + shift_ns, SECOND_NS)
            else:
                _shift_message(each, shift_ns)


def _shift_json(data: bytes, shift_ns: int) -> bytes:
    try:
        return shifted(orjson.dumps(_moved(bounded_json.loads(data), shift_ns)), shift_ns)
    except (ValueError, TypeError, RecursionError):  # no JSON, or values beyond what it can hold once they are moved
        return data


def _moved(item: Any, shift_ns: int) -> Any:  # noqa: ANN401 - whatever JSON holds
    if isinstance(item, list):
        return [_moved(each, shift_ns) for each in item]
    if not isinstance(item, dict):
        return item
    whole = next((key for key in SECONDS if isinstance(item.get(key), int)), None)
    rest = next((key for key in NANOSECONDS if isinstance(item.get(key), int)), None)
    if whole is None or rest is None:
        return {key: _moved(each, shift_ns) for key, each in item.items()}
    seconds, rest_ns = divmod(item[whole] * SECOND_NS + item[rest] + shift_ns, SECOND_NS)
    return item | {whole: seconds, rest: rest_ns}


def _ros_shift(channel: ReadChannel) -> Shift | None:
    """The stamp of a ROS message that begins with a header or a time; None of others."""
    found = _FIRST_FIELD.search(_COMMENT.sub(b"", channel.schema_data))
    is_header = found is not None and found[1] in _HEADERS
    if found is None or not (is_header or found[1] in _TIMES):
        return None
    start = (4 if is_header else 0) if channel.encoding == ROS1 else 4

    def shift(data: bytes, shift_ns: int) -> bytes:
        order = ">" if channel.encoding == CDR and len(data) > 1 and data[1] % 2 == 0 else "<"
        stamp = struct.Struct(f"{order}II")
        if len(data) < start + _STAMP_BYTES:
            return data
        whole, rest = stamp.unpack_from(data, start)
        moved = divmod(whole * SECOND_NS + rest + shift_ns, SECOND_NS)
        if not 0 <= moved[0] < 1 << 32:
            return data
        return data[:start] + stamp.pack(*moved) + data[start + _STAMP_BYTES :]

    return shift
