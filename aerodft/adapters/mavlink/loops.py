"""The loops over files' bytes: over whole arrays while they are few, then compiled where that is possible."""

import numpy as np
import numpy.typing as npt

from aerodft.adapters.mavlink import (
    dataflash_kernels,
    dataflash_vectorised,
    kernels,
    payloads,
    selection,
    vectorised,
    vectorised_selection,
    vectorised_stream,
    vectorised_tlog,
)
from aerodft.adapters.mavlink.layout import MAX_FRAME, Bytes, Table
from aerodft.geometry.jit import expect, is_loaded
from aerodft.model.arrays import IntArray

_BYTES_A_STEP, _FRAMES_A_STEP = 64, 8  # over whole arrays


def scan_tlog(data: Bytes, start: int, limit: int, table: Table, rows: IntArray, state: IntArray) -> tuple[int, int]:
    """``kernels.scan_tlog``; may go less far at once."""
    scan = kernels.scan_tlog if is_loaded() else vectorised_tlog.scan_tlog
    return scan(data, start, limit, table, rows, state)


def scan_dataflash(
    data: Bytes, start: int, limit: int, types: IntArray, rows: IntArray, state: IntArray
) -> tuple[int, int]:
    """``dataflash_kernels.scan_dataflash``; may go less far at once."""
    scan = dataflash_kernels.scan_dataflash if is_loaded() else dataflash_vectorised.scan_dataflash
    return scan(data, start, limit, types, rows, state)


def scan_stream(
    data: Bytes, *, given_up: int, table: Table, offsets: IntArray, lengths: IntArray, state: IntArray
) -> tuple[int, int]:
    """``kernels.scan_stream``."""
    expect(min(len(data), MAX_FRAME) + len(data) // _BYTES_A_STEP)
    scan = kernels.scan_stream if is_loaded() else vectorised_stream.scan_stream
    return scan(data, given_up=given_up, table=table, offsets=offsets, lengths=lengths, state=state)


def read_headers(data: Bytes, frames: IntArray, table: Table, heads: IntArray, *, checked: bool) -> None:
    """``kernels.read_headers``."""
    expect(frames.shape[1] // _FRAMES_A_STEP)
    read = kernels.read_headers if is_loaded() else vectorised.read_headers
    read(data, frames, table, heads, checked=checked)


def gather(data: Bytes, places: IntArray, out: Bytes) -> None:
    """``payloads.gather``."""
    copy = payloads.gather if is_loaded() else vectorised.gather
    copy(data, places, out)


def select(data: Bytes, heads: IntArray, slots: npt.NDArray[np.int16], state: IntArray, rows: IntArray) -> None:
    """``selection.select``."""
    choose = selection.select if is_loaded() else vectorised_selection.select
    choose(data, heads, slots, state, rows)
