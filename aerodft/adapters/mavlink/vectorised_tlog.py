"""``kernels.scan_tlog`` over whole arrays: only what is damaged is looked at one by one."""

from typing import Final

import numpy as np

from aerodft.adapters.mavlink.arrivals import following_stamp, settle_all
from aerodft.adapters.mavlink.kernels import note_damage, probe
from aerodft.adapters.mavlink.layout import (
    AT_QUIET,
    AT_SYNC,
    BACKWARDS,
    INCOMPLETE,
    LAST_US,
    MAX_FRAME,
    MAX_STAMP_US,
    MOST_SHARED,
    N_OK,
    N_SKIPPED,
    STAMP_SIZE,
    Bytes,
    Table,
)
from aerodft.adapters.mavlink.vectorised import Region
from aerodft.model.arrays import IntArray

_RECORD: Final = 48  # bytes of a usual one


def scan_tlog(data: Bytes, start: int, limit: int, table: Table, rows: IntArray, state: IntArray) -> tuple[int, int]:
    """As ``kernels.scan_tlog``; goes less far at once."""
    stop = min(limit, len(data), start + _RECORD * rows.shape[1])
    resumes = start == state[AT_SYNC]
    first = max(start + STAMP_SIZE - (MOST_SHARED if resumes else 0), STAMP_SIZE)
    low = first - STAMP_SIZE
    region = Region(data[low : stop + STAMP_SIZE + MAX_FRAME])
    frames = region.frames(table)
    frames = frames[:, (frames[0] >= STAMP_SIZE) & (frames[0] + low < stop + STAMP_SIZE)]
    frames = _apart(frames, start - low if resumes else 0)[:, : rows.shape[1]]
    found = frames.shape[1]
    stamps_us = region.windows(frames[0], STAMP_SIZE).view(">u8")[:, 0]
    frames[0] += low
    at = _account(data, table, frames, start, state)
    if found < rows.shape[1] and at < stop:
        _note_gap(data, table, at, stop, state)
        at = stop
    rows[:2, :found] = frames
    rows[2, :found] = _arrivals(data, frames, stamps_us, state)
    return found, at


def _apart(frames: IntArray, last_end: int) -> IntArray:
    """Frames that do not lie in each other: first come, but where a record is due that one."""
    start, size = frames
    if (start[1:] == start[:-1] + size[:-1] + STAMP_SIZE).all():
        return frames
    chosen: list[int] = []
    starts, ends = start.tolist(), (start + size).tolist()
    places = {place: k for k, place in enumerate(starts)}
    k = 0
    while k < len(starts):
        if starts[k] < last_end + STAMP_SIZE - MOST_SHARED:
            k += 1
            continue
        due = last_end + STAMP_SIZE
        if starts[k] < due:
            k = places.get(due, k)
        chosen.append(k)
        last_end = ends[k]
        k += 1
    return frames[:, chosen]


def _account(data: Bytes, table: Table, frames: IntArray, start: int, state: IntArray) -> int:
    """Count the frames and the damage before each of them; returns where the last one ends."""
    starts, ends = frames[0] - STAMP_SIZE, frames[0] + frames[1]
    before = np.concatenate([[start], ends[:-1]])
    for k in np.flatnonzero(starts > before[: len(starts)]).tolist():
        if k:
            state[AT_SYNC] = before[k]
        _note_gap(data, table, int(before[k]), int(starts[k]), state)
    if not len(ends):
        return start
    state[N_OK] += len(ends)
    state[AT_SYNC] = ends[-1]
    return int(ends[-1])


def _note_gap(data: Bytes, table: Table, start: int, stop: int, state: IntArray) -> None:
    """Count bytes that belong to no frame; what a bad frame claims is skipped over in one step."""
    at = start
    while at < stop:
        due = int(state[AT_SYNC])
        if at == due:
            verdict, size = INCOMPLETE, 0
            if at + STAMP_SIZE < len(data):
                verdict, size = probe(data, at + STAMP_SIZE, len(data), table)
            note_damage(state, at, verdict, size + STAMP_SIZE)
            at += 1
            continue
        end = min(due, stop) if due > at else stop
        state[N_SKIPPED] += max(0, end - max(at, int(state[AT_QUIET])))
        at = end


def _arrivals(data: Bytes, frames: IntArray, stamps_us: IntArray, state: IntArray) -> IntArray:
    """The frames' arrivals, not decreasing (``arrivals.settle``)."""
    arrivals_us = np.where(stamps_us < MAX_STAMP_US, stamps_us, MAX_STAMP_US).astype(np.int64)
    arrivals_us[arrivals_us == MAX_STAMP_US] = -1
    ends = frames[0] + frames[1]
    state[BACKWARDS] += settle_all(arrivals_us, int(state[LAST_US]), lambda k: following_stamp(data, int(ends[k])))
    state[LAST_US] = arrivals_us[-1] if len(arrivals_us) else state[LAST_US]
    return arrivals_us
