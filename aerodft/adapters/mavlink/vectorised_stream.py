"""``kernels.scan_stream`` over whole arrays: only what is damaged, and the very end, is looked at one by one."""

from typing import Final

import numpy as np

from aerodft.adapters.mavlink import kernels
from aerodft.adapters.mavlink.kernels import note_damage, probe, shared_tail
from aerodft.adapters.mavlink.layout import (
    AT_QUIET,
    AT_SYNC,
    MAX_FRAME,
    N_OK,
    N_SKIPPED,
    SHARED,
    V1,
    V2,
    Bytes,
    Table,
)
from aerodft.adapters.mavlink.vectorised import Region
from aerodft.model.arrays import IntArray

_TAIL: Final = 2 * MAX_FRAME  # what begins before it, or in a frame that does, is whole in the bytes


def scan_stream(
    data: Bytes, *, given_up: int, table: Table, offsets: IntArray, lengths: IntArray, state: IntArray
) -> tuple[int, int]:
    """As ``kernels.scan_stream``."""
    body = 0 if given_up else max(len(data) - _TAIL, 0)
    at, found = int(state[SHARED]), 0
    if body > at:
        frames = Region(data).frames(table)
        frames = _apart(data, frames[:, frames[0] < body], at, at)[:, : len(offsets)]
        found = frames.shape[1]
        offsets[:found], lengths[:found] = frames
        at = _account(data, table, frames, at, state)
        if at < body and found < len(offsets):
            _note_gap(data, table, at, body, state)
            at, state[SHARED] = body, 0
    first = at - int(state[SHARED])
    state[AT_SYNC:] -= first
    more, done = kernels.scan_stream(
        data[first:],
        given_up=max(given_up - first, 0),
        table=table,
        offsets=offsets[found:],
        lengths=lengths[found:],
        state=state,
    )
    offsets[found : found + more] += first
    state[AT_SYNC:] += first
    return found + more, first + done


def _apart(data: Bytes, frames: IntArray, last_end: int, shared: int) -> IntArray:
    """Frames that do not lie in each other: first come, but for the tail that a cut one may have of the next."""
    start, size = frames
    if (start[:1] >= last_end).all() and (start[1:] >= start[:-1] + size[:-1]).all():
        return frames
    chosen: list[int] = []
    for k, (first, end) in enumerate(zip(start.tolist(), (start + size).tolist(), strict=True)):
        if first >= last_end - shared:
            chosen.append(k)
            last_end, shared = end, shared_tail(data, first, end)
    return frames[:, chosen]


def _account(data: Bytes, table: Table, frames: IntArray, at: int, state: IntArray) -> int:
    """Count the frames and the damage before each of them; returns where the last one ends."""
    starts, ends = frames[0], frames[0] + frames[1]
    if not len(ends):
        return at
    before = np.concatenate([[at], ends[:-1]])
    gaps = np.flatnonzero(starts > before)
    is_plain = state[AT_QUIET] <= at and not np.isin(data[before[gaps]], (V1, V2)).any()
    if is_plain and state[AT_SYNC] <= at:
        state[N_SKIPPED] += (starts - before)[gaps].sum()
    else:
        for k in gaps.tolist():
            if k:
                state[AT_SYNC] = before[k]
            _note_gap(data, table, int(before[k]), int(starts[k]), state)
    state[N_OK] += len(ends)
    state[AT_SYNC] = last = int(ends[-1])
    state[SHARED] = shared_tail(data, int(starts[-1]), last)
    return last


def _note_gap(data: Bytes, table: Table, start: int, stop: int, state: IntArray) -> None:
    """Count bytes that belong to no frame; what a bad frame claims is skipped over in one step."""
    at = start
    while at < stop:
        due = int(state[AT_SYNC])
        if at == due:
            note_damage(state, at, *probe(data, at, len(data), table))
            at += 1
            continue
        end = min(due, stop) if due > at else stop
        state[N_SKIPPED] += max(0, end - max(at, int(state[AT_QUIET])))
        at = end
