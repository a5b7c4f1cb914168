"""``selection.select`` over whole arrays: one frame of each kind stands for all of it, until one changes the state."""

import numpy as np
import numpy.typing as npt

from aerodft.adapters.mavlink import selection as pick
from aerodft.adapters.mavlink.layout import Bytes
from aerodft.model.arrays import IntArray

_KIND_BITS = 32  # of message, system and component; bytes of the payload come above them
_COUNTERS = list(pick.COUNTERS)


def select(data: Bytes, heads: IntArray, slots: npt.NDArray[np.int16], state: IntArray, rows: IntArray) -> None:
    """As ``selection.select``."""
    rows[:] = -1
    state[pick.DAMAGED] += np.count_nonzero(heads[0] < 0)
    index = np.flatnonzero((heads[0] >= 0) & (heads[0] < len(slots)))
    index = index[slots[heads[0, index]] >= 0]
    kinds = _kinds(data, heads[:, index])
    done = 0
    while done < len(index):
        firsts, members = np.unique(kinds[done:], return_index=True, return_inverse=True)[1:]
        answers, counted, changes = _answers(data, heads[:, index[done + firsts]], slots, state)
        stop = int(firsts[changes].min()) if changes.any() else len(index) - done
        rows[index[done : done + stop]] = answers[members[:stop]]
        state[_COUNTERS] += counted[members[:stop]].sum(axis=0)
        done += stop
        if done < len(index):
            one = index[done : done + 1]
            answer = np.empty(1, dtype=np.int64)
            pick.select(data, heads[:, one], slots, state, answer)
            rows[one] = answer
            done += 1


def _kinds(data: Bytes, heads: IntArray) -> IntArray:
    """``(n,)`` a number for all that the selection looks at in a frame."""
    message_id, system, component, start, length = heads
    kinds: IntArray = message_id << 16 | system << 8 | component
    for message, places in pick.LOOKED_AT.items():
        own = np.flatnonzero(message_id == message)
        for number, place in enumerate(places):
            index = own[length[own] > place]
            kinds[index] |= data[start[index] + place].astype(np.int64) << (_KIND_BITS + 8 * number)
    return kinds


def _answers(
    data: Bytes, heads: IntArray, slots: npt.NDArray[np.int16], state: IntArray
) -> tuple[IntArray, IntArray, npt.NDArray[np.bool_]]:
    """What frames would do, each of them if it were the next.

    Returns:
        ``(n,)`` what becomes of each; ``(n, c)`` what it adds to the counters; ``(n,)`` whether it changes more of the
        state than those.
    """
    count = heads.shape[1]
    answers, counted = np.empty(count, dtype=np.int64), np.empty((count, len(_COUNTERS)), dtype=np.int64)
    changes = np.empty(count, dtype=np.bool_)
    for k in range(count):
        after = state.copy()
        pick.select(data, heads[:, k : k + 1], slots, after, answers[k : k + 1])
        counted[k] = after[_COUNTERS] - state[_COUNTERS]
        after[_COUNTERS] = state[_COUNTERS]
        changes[k] = (after != state).any()
    return answers, counted, changes
