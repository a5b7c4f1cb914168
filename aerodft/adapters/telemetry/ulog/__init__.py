"""PX4's self-describing log format (ULog, .ulg): messages found in a file, and decoded to telemetry tracks.

Format messages name the fields of each topic, and a subscription gives a topic's instance the number of its data.
"""

from pathlib import Path
from typing import Final

from aerodft.adapters.telemetry.mavlink import FollowedIds
from aerodft.adapters.telemetry.ulog.decoding import PROTOCOL, USED_MESSAGES, UlogDecoder
from aerodft.adapters.telemetry.ulog.framing import MAGIC
from aerodft.adapters.telemetry.ulog.source import TITLE, UlogSource

__all__ = [
    "PROTOCOL",
    "TITLE",
    "USED_MESSAGES",
    "UlogDecoder",
    "UlogSource",
    "new_decoder",
    "open_source",
    "recognises",
]

_MAGIC: Final = bytes(MAGIC)


def recognises(head: bytes) -> bool:
    """Whether the file header of ULog stands at the beginning."""
    return head.startswith(_MAGIC)


def open_source(path: Path) -> UlogSource:
    """A .ulg log as blocks of messages."""
    return UlogSource(path)


def new_decoder(followed: FollowedIds) -> UlogDecoder:
    """A decoder that learns the topics' layouts on the way, and follows one gimbal."""
    return UlogDecoder(followed.gimbal)
