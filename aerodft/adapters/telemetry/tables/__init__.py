"""Flight tables (.csv): of AirData, Litchi, converted DJI flight logs, Mission Planner, or by stated columns."""

from pathlib import Path

from aerodft.adapters.telemetry.mavlink import FollowedIds
from aerodft.adapters.telemetry.tables.decoding import PROTOCOL, TableDecoder
from aerodft.adapters.telemetry.tables.layouts import COLUMN_KEYS, layout_of
from aerodft.adapters.telemetry.tables.source import TITLE, TableLog

__all__ = ["COLUMN_KEYS", "PROTOCOL", "TITLE", "TableDecoder", "TableLog", "new_decoder", "open_source", "recognises"]


def recognises(head: bytes) -> bool:
    """Whether the columns of a known tool are named in the first line."""
    return b"\0" not in head and layout_of(head.decode("utf-8-sig", "replace").partition("\n")[0]) is not None


def open_source(path: Path) -> TableLog:
    """A known tool's table as rows."""
    return TableLog(path)


def new_decoder(followed: FollowedIds) -> TableDecoder:  # noqa: ARG001 - of one vehicle alone
    """A decoder of rows, which learns their layout from the first frame."""
    return TableDecoder()
