"""What the pipeline has yet to answer, and the images that observations may still refer to."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final

import numpy as np

from aerodft.dft import NO_IMAGE
from aerodft.jit import njit
from aerodft.model import BoolArray, IntArray, Observation, PoseSample

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
        tick: ``(n,)`` of the step on which each came; -1 before it.
        image: ``(n,)`` running numbers of images, and of those that observations name; ``NO_IMAGE`` for none.
        observations: ``n`` observations with their stamps in UTC; None for images.
        samples: ``n`` poses of what is ready, and waits for something with an earlier stamp; None for all else.
    """

    task: IntArray
    stamp_ns: IntArray
    by_utc: BoolArray
    deadline_ns: IntArray
    tick: IntArray
    image: IntArray
    observations: list[Observation | None]
    samples: list[PoseSample | None]

    @staticmethod
    def none() -> "WorkList":
        """Nothing to do."""
        nothing = np.empty(0, dtype=np.int64)
        return WorkList(nothing, nothing, nothing.astype(np.bool_), nothing, nothing, nothing, [], [])

    @staticmethod
    def joined(parts: Sequence["WorkList"]) -> "WorkList":
        """Lists one after the other."""
        columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS}
        observations = [each for part in parts for each in part.observations]
        samples = [each for part in parts for each in part.samples]
        return WorkList(**columns, observations=observations, samples=samples)

    def in_order_of_ticks(self) -> "WorkList":
        """The list by ticks, of one tick as it is."""
        return self.rows(np.argsort(self.tick, kind="stable"))

    def __len__(self) -> int:
        return len(self.task)

    def rows(self, rows: IntArray) -> "WorkList":
        """What is to be done by indices ``(m,)``."""
        columns = {name: getattr(self, name)[rows] for name in _COLUMNS}
        observations, samples = ([each[row] for row in rows.tolist()] for each in (self.observations, self.samples))
        return WorkList(**columns, observations=observations, samples=samples)

    def left(self, samples: Sequence[PoseSample | None]) -> "WorkList":
        """What a next step begins with, with the poses of what is ready."""
        return replace(self, tick=np.full_like(self.tick, -1), samples=list(samples))

    def shifted(self, by_ns: int) -> "WorkList":
        """The list where UTC of this machine's stamps has changed."""
        if not by_ns or np.all(self.by_utc):
            return self
        stamp_ns = np.where(self.by_utc, self.stamp_ns, self.stamp_ns + by_ns)
        pairs = zip(self.observations, stamp_ns.tolist(), strict=True)
        observations = [None if each is None else replace(each, stamp_ns=own_ns) for each, own_ns in pairs]
        kept = [each if by_utc else None for each, by_utc in zip(self.samples, self.by_utc.tolist(), strict=True)]
        return replace(self, stamp_ns=stamp_ns, observations=observations, samples=kept)


_COLUMNS: Final = ("task", "stamp_ns", "by_utc", "deadline_ns", "tick", "image")


@dataclass(frozen=True, slots=True, eq=False)
class AnswerTimes:
    """When something may be answered, ``n`` times: on every tick, and on deadlines between ticks that nothing came on.

    Attributes:
        time_ns: ``(n,)`` ascending.
        ticks: ``(n,)`` how many ticks of the step have been taken in by then.
        is_tick: ``(n,)`` whether it is a tick.
    """

    time_ns: IntArray
    ticks: IntArray
    is_tick: BoolArray

    @staticmethod
    def of(now_ns: IntArray, deadlines_ns: IntArray) -> "AnswerTimes":
        """The ticks ``now_ns (ticks,)``, and those of the deadlines up to the last of them that are none."""
        time_ns = np.unique(np.concatenate([now_ns, deadlines_ns[deadlines_ns < now_ns[-1]]]))
        ticks = np.searchsorted(now_ns, time_ns, side="right")
        return AnswerTimes(time_ns, ticks, now_ns[np.maximum(ticks - 1, 0)] == time_ns)


@njit
def answer_in_order(
    work: tuple[IntArray, IntArray, IntArray, IntArray, IntArray],
    answer_times: tuple[IntArray, IntArray],
    last_image_ns: IntArray,
) -> IntArray:
    """Occasions ``(n,)`` on which work is answered; -1 where it goes on waiting.

    What one stamp waits for, later ones that came after it wait for too; but nothing waits for what itself waits for
    the image that it was seen in.

    Args:
        work: ``(n,)`` each, in the order in which it came: stamps, after how many ticks it is there, after how many its
            telemetry is complete, deadlines, and the least stamp of the last image before which it is not looked at.
        answer_times: Times ``(k,)``, and after how many ticks ``(k,)``.
        last_image_ns: ``(k,)`` stamps of the last images on these occasions.
    """
    stamp_ns, came, ready, deadline_ns, near_ns = work
    time_ns, ticks = answer_times
    answer = np.full(len(stamp_ns), -1)
    first = 0
    for answer_time in range(len(time_ns)):
        while first < len(answer) and answer[first] >= 0:
            first += 1
        blocked_ns, is_blocked = 0, False
        for k in range(first, len(answer)):
            if came[k] > ticks[answer_time]:
                break
            is_final = deadline_ns[k] <= time_ns[answer_time]
            if answer[k] >= 0 or (not is_final and last_image_ns[answer_time] < near_ns[k]):
                continue
            if is_final or (ready[k] <= ticks[answer_time] and not (is_blocked and stamp_ns[k] >= blocked_ns)):
                answer[k] = answer_time
            else:
                blocked_ns = min(blocked_ns, stamp_ns[k]) if is_blocked else stamp_ns[k]
                is_blocked = True
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

    def last_ns(self) -> IntArray:
        """``(ticks,)`` stamps of the last images; that of the end of time before there is any."""
        stamps_ns = np.append(self._stamp_ns, np.iinfo(np.int64).max)
        return stamps_ns[self._end - 1]

    def ticks_with(self, stamps_ns: IntArray, ticks: IntArray) -> IntArray:
        """The first of the ticks from ``ticks (n,)`` on at which the last image is not before stamps ``(n,)``.

        The number of ticks where there is none.
        """
        last_ns = self.last_ns()
        is_reached = (last_ns >= stamps_ns[:, None]) & (np.arange(len(last_ns)) >= ticks[:, None])
        return np.where(np.any(is_reached, axis=1), np.argmax(is_reached, axis=1), len(last_ns))

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
