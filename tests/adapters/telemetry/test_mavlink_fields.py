"""Every field of every message that is used, in every recorded flight, to the last bit as pymavlink has it."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil

from aerodft.adapters.telemetry import TlogSource
from aerodft.adapters.telemetry.mavlink import frame_table, message_name, payload_dtype
from aerodft.adapters.telemetry.mavlink.decoding import WANTED
from aerodft.adapters.telemetry.mavlink.kernels import copy_payloads, read_headers
from aerodft.model import RawBlock
from tests.nights import at_night

LOGS = [
    "logs/dronekit_quad.tlog",
    "logs/vtol.tlog",
    "sitl/cold_boot.tlog",
    "sitl/servo_consumer.tlog",
    *at_night("sitl/brushless_consumer.tlog", "sitl/brushless_ctl.tlog"),
]


def ours(path: Path) -> dict[str, np.ndarray]:
    """Payloads by message, those of all senders, in their order."""
    found = defaultdict(list)
    for block in TlogSource(path).events():
        assert isinstance(block, RawBlock)
        data, heads = np.frombuffer(block.data, dtype=np.uint8), np.empty((5, len(block.offset)), dtype=np.int64)
        read_headers(data, np.stack([block.offset, block.length]), frame_table(), heads, checked=False)
        for message_id in WANTED:
            index, dtype = np.flatnonzero(heads[0] == message_id), payload_dtype(message_id)
            raw = np.zeros((len(index), dtype.itemsize), dtype=np.uint8)
            copy_payloads(data, heads[3:, index], raw)
            found[message_name(message_id)].append(raw.view(dtype)[:, 0])
    return {name: np.concatenate(parts) for name, parts in found.items()}


def theirs(path: Path, names: list[str]) -> dict[str, list[Any]]:
    log = mavutil.mavlink_connection(str(path))
    found = defaultdict(list)
    while (message := log.recv_match(type=names)) is not None:
        found[message.get_type()].append(message)
    log.close()
    return found


def padded(value: object, like: np.ndarray) -> np.ndarray:
    """A field's values as an array; text comes without the zeros at its end."""
    if like.dtype.kind == "i" and like.ndim == 2 and isinstance(value[0], str):  # type: ignore[index]
        codes = [text.encode("latin-1").ljust(like.shape[1], b"\0") for text in value]  # type: ignore[attr-defined]
        return np.frombuffer(b"".join(codes), dtype=np.int8).reshape(like.shape)
    return np.asarray(value)


@pytest.mark.parametrize("log", LOGS)
def test_every_field_is_pymavlinks(log: str, data_folder: Path) -> None:
    mine = ours(data_folder / log)
    peers = theirs(data_folder / log, list(mine))
    compared = 0
    for name, rows in mine.items():
        assert len(rows) == len(peers[name])
        for field in rows.dtype.names if len(rows) else ():
            # Extensions do not exist for pymavlink in MAVLink 1, where they are zero by definition.
            nothing = np.zeros(rows[field].shape[1:]).tolist()
            value = padded([getattr(message, field, nothing) for message in peers[name]], rows[field])
            np.testing.assert_array_equal(rows[field], value, err_msg=f"{name}.{field}")
            compared += rows[field].size
    assert compared > 10_000
