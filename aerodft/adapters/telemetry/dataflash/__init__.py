"""ArduPilot's self-describing log format (.bin): messages found in a file, and decoded to telemetry tracks.

A FMT message names the fields of every other message.
"""

from pathlib import Path
from typing import Final

from aerodft.adapters.telemetry.dataflash.decoding import (
    DataflashDecoder,
    MessageFormat,
    gps_to_unix_ns,
    parse_format,
)
from aerodft.adapters.telemetry.dataflash.framing import FMT_TYPE, HEAD, HEAD_SIZE
from aerodft.adapters.telemetry.dataflash.source import TITLE, DataflashSource
from aerodft.adapters.telemetry.mavlink import FollowedIds
from aerodft.model import WireProtocol

__all__ = [
    "FMT_TYPE",
    "HEAD",
    "HEAD_SIZE",
    "PROTOCOL",
    "TITLE",
    "DataflashDecoder",
    "DataflashSource",
    "MessageFormat",
    "gps_to_unix_ns",
    "new_decoder",
    "open_source",
    "parse_format",
    "recognises",
]

PROTOCOL: Final = WireProtocol.DATAFLASH


def recognises(head: bytes) -> bool:
    """Whether a message stands at the beginning."""
    return head.startswith(bytes(HEAD))


def open_source(path: Path) -> DataflashSource:
    """A .bin log as blocks of messages."""
    return DataflashSource(path)


def new_decoder(followed: FollowedIds) -> DataflashDecoder:
    """A decoder that learns the messages' layouts on the way; the log is of its own vehicle alone."""
    return DataflashDecoder(followed.angle_scales)
