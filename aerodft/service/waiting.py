"""What the pipeline has yet to answer, and the images that observations may still refer to."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final

import numpy as np

from aerodft.dft.measurement_batch import NO_IMAGE
from aerodft.geometry.jit import njit
from aerodft.model.arrays import BoolArray, IntArray
from aerodft.model.observation import Observation

_REMEMBERED: Final = 512  # an observation comes at most this many images after its own


class Task(IntEnum):
    """What is to be done; arrays hold these as ``int64``."""

    IMAGE = 0  # its pose is made, and all fixed probes are measured in it
    MEASURE = 1  # a probe is measured by an observation
    LEARN = 2  # an observation of a landmark is learned from
    TRACK = 3  # an observation of an object is followed


@dataclass(frozen=True, slots=True, eq=False)
class WorkList:
    """Images and observations that wait for their poses, ``n`` in the order in which they came.

    Attributes:
        task: ``(n,)`` as ``Task``.
        stamp_ns: ``(n,)`` UTC, as far as it is known.
        by_utc: ``(n,)`` whether stamps came as UTC, by another clock than this machine's.
        deadline_ns: ``(n,)`` tick on which each is answered with what there is.
        tick: ``(n,)`` of the step, as of which each may be answered at the earliest.
        image: ``(n,)`` running numbers of images, and of those that observations name; ``NO_IMAGE`` for none.
        observations: ``n`` observations with their stamps in UTC; None for images.
    """

    task: IntArray
    stamp_ns: IntArray
    by_utc: BoolArray
    deadline_ns: IntArray
    tick: IntArray
    image: IntArray
    observations: list[Observation | None]

    @staticmethod
    def none() -> "WorkList":
        """Nothing to do."""
        nothing = np.empty(0, dtype=np.int64)
        return WorkList(nothing, nothing, nothing.astype(np.bool_), nothing, nothing, nothing, [])

    @staticmethod
    def joined(parts: Sequence["WorkList"]) -> "WorkList":
        """Lists one after the other."""
        columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS}
        return WorkList(**columns, observations=[each for part in parts for each in part.observations])

    def in_order_of_ticks(self) -> "WorkList":
        """The list by ticks, of one tick as it is."""
        return self.rows(np.argsort(self.tick, kind="stable"))

    def __len__(self) -> int:
        return len(self.task)

    def rows(self, rows: IntArray) -> "WorkList":
        """What is to be done by indices ``(m,)``."""
        columns = {name: getattr(self, name)[rows] for name in _COLUMNS}
        return WorkList(**columns, observations=[self.observations[row] for row in rows.tolist()])

    def at_first_tick(self) -> "WorkList":
        """What a next step begins with."""
        return replace(self, tick=np.zeros_like(self.tick))

    def shifted(self, by_ns: int) -> "WorkList":
        """The list where UTC of this machine's stamps has changed."""
        if not by_ns or np.all(self.by_utc):
            return self
        stamp_ns = np.where(self.by_utc, self.stamp_ns, self.stamp_ns + by_ns)
        pairs = zip(self.observations, stamp_ns.tolist(), strict=True)
        observations = [None if each is None else replace(each, stamp_ns=own_ns) for each, own_ns in pairs]
        return replace(self, stamp_ns=stamp_ns, observations=observations)


_COLUMNS: Final = ("task", "stamp_ns", "by_utc", "deadline_ns", "tick", "image")


@njit
def answer_in_order(stamp_ns: IntArray, ready_tick: IntArray, deadline_tick: IntArray) -> IntArray:
    """Ticks ``(n,)`` on which work is answered: what one stamp waits for, later ones that came after it wait for too.

    Args:
        stamp_ns: ``(n,)`` UTC, in the order in which the work came.
        ready_tick: ``(n,)`` from which telemetry is complete; behind the last tick where it is not.
        deadline_tick: ``(n,)`` on which it is answered with what there is, whatever others wait for.
    """
    answer = np.minimum(ready_tick, deadline_tick)
    newest_ns, last = stamp_ns[0] if len(answer) else 0, 0
    for k in range(len(answer)):
        waits_for = 0
        if stamp_ns[k] >= newest_ns:
            newest_ns, waits_for = stamp_ns[k], last
        else:
            for i in range(k):
                if stamp_ns[i] <= stamp_ns[k]:
                    waits_for = max(waits_for, answer[i])
        answer[k] = min(max(answer[k], waits_for), deadline_tick[k])
        last = max(last, answer[k])
    return answer


class RecentImages:
    """The stamps (UTC) of the newest images, as known at each tick of the newest step."""

    def __init__(self) -> None:
        self._image = self._stamp_ns = np.empty(0, dtype=np.int64)
        self._by_utc = np.empty(0, dtype=np.bool_)
        self._end = np.zeros(1, dtype=np.int64)  # rows known at each tick

    def add(self, image: IntArray, stamp_ns: IntArray, by_utc: BoolArray, tick: IntArray, count: int) -> None:
        """Remember the images ``(n,)`` of a step of so many ticks, each from its ``tick (n,)`` on."""
        kept = slice(max(len(self._image) - _REMEMBERED, 0), None)
        before = len(self._image[kept])
        self._image = np.concatenate([self._image[kept], image])
        self._stamp_ns = np.concatenate([self._stamp_ns[kept], stamp_ns])
        self._by_utc = np.concatenate([self._by_utc[kept], by_utc])
        self._end = before + np.searchsorted(tick, np.arange(count), side="right")

    def shift(self, by_ns: int) -> None:
        """UTC of this machine's stamps has changed."""
        if by_ns:
            self._stamp_ns = np.where(self._by_utc, self._stamp_ns, self._stamp_ns + by_ns)

    def ticks_with(self, stamps_ns: IntArray, ticks: IntArray) -> IntArray:
        """The first of the ticks from ``ticks (n,)`` on at which the last image is not before stamps ``(n,)``.

        The number of ticks where there is none; the given tick as long as there are no images at all.
        """
        last = np.maximum.accumulate(self._stamp_ns[np.maximum(self._end - 1, 0)]) if len(self._stamp_ns) else None
        if last is None:
            return ticks
        reached = np.searchsorted(last, stamps_ns)
        return np.where(self._end[ticks] == 0, ticks, np.maximum(reached, ticks))

    def stamp_ns(self, image: int, tick: int) -> int | None:
        """Stamp of the image with this number as of a tick; None where it is not remembered."""
        window = self._window(tick)
        rows = np.flatnonzero(self._image[window] == image)
        return int(self._stamp_ns[window][rows[-1]]) if len(rows) else None

    def nearest(self, stamp_ns: int, tolerance_ns: int, tick: int) -> int:
        """Number of the image taken closest to a stamp as of a tick; ``NO_IMAGE`` where none is close."""
        window = self._window(tick)
        apart_ns = np.abs(self._stamp_ns[window] - stamp_ns)
        if not len(apart_ns) or apart_ns.min() > tolerance_ns:
            return NO_IMAGE
        return int(self._image[window][apart_ns.argmin()])

    def _window(self, tick: int) -> slice:
        end = int(self._end[tick])
        return slice(max(end - _REMEMBERED, 0), end)
