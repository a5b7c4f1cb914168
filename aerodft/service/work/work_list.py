"""Lists of work: images and observations that wait, and those that are ready with their poses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Self

import numpy as np

from aerodft.model import Batch, BoolArray, IntArray, Observation, PoseBatch, PoseSample, Selection


class Task(IntEnum):
    """Task of an image or observation; arrays hold these as ``int64``."""

    IMAGE = 0  # compute the image's pose and measure all fixed probes
    MEASURE = 1  # measure a probe with observed pixels
    LEARN = 2  # update the calibration by an observed landmark
    TRACK = 3  # track an observed object


@dataclass(frozen=True, slots=True, eq=False)
class WorkList(Batch):
    """Images and observations ``n`` that wait for their poses, in order of arrival.

    Attributes:
        task: ``(n,)`` as ``Task``.
        stamp_ns: ``(n,)`` UTC by the current clock map.
        by_utc: ``(n,)`` whether the stamp arrived as UTC, not on this machine's clock.
        deadline_ns: ``(n,)`` tick at which each is answered with the telemetry at hand.
        tick: ``(n,)`` tick of arrival in the step; -1 for an earlier step.
        image: ``(n,)`` running numbers of images, and of the observations' images; ``NO_IMAGE`` for none.
        observations: ``n`` observations with their stamps in UTC; None for images.
        samples: ``n`` poses of work that is ready but waits for earlier stamps; None for other work.
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
    def empty() -> "WorkList":
        """An empty list."""
        empty = np.empty(0, dtype=np.int64)
        return WorkList(empty, empty, empty.astype(np.bool_), empty, empty, empty, [], [])

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """Concatenate lists."""
        observations = [each for part in parts for each in part.observations]
        samples = [each for part in parts for each in part.samples]
        return replace(super(WorkList, cls).concatenate(parts), observations=observations, samples=samples)

    def in_order_of_ticks(self) -> "WorkList":
        """The list stably sorted by tick."""
        return self.rows(np.argsort(self.tick, kind="stable"))

    def __len__(self) -> int:
        return len(self.task)

    def rows(self, rows: Selection) -> Self:
        """The work of a mask ``(n,)``, of indices ``(m,)`` or of a slice."""
        indices = np.arange(len(self))[rows].tolist()
        observations, samples = ([each[row] for row in indices] for each in (self.observations, self.samples))
        return replace(Batch.rows(self, rows), observations=observations, samples=samples)

    def waiting(self, samples: Sequence[PoseSample | None]) -> "WorkList":
        """The list for the next step, with the poses of ready work."""
        return replace(self, tick=np.full_like(self.tick, -1), samples=list(samples))

    def shifted(self, by_ns: int) -> "WorkList":
        """The list after a change ``by_ns`` of UTC for stamps on this machine's clock."""
        if not by_ns or np.all(self.by_utc):
            return self
        stamp_ns = np.where(self.by_utc, self.stamp_ns, self.stamp_ns + by_ns)
        pairs = zip(self.observations, stamp_ns.tolist(), strict=True)
        observations = [None if each is None else replace(each, stamp_ns=utc_ns) for each, utc_ns in pairs]
        valid = [each if by_utc else None for each, by_utc in zip(self.samples, self.by_utc.tolist(), strict=True)]
        return replace(self, stamp_ns=stamp_ns, observations=observations, samples=valid)


@dataclass(frozen=True, slots=True, eq=False)
class ReadyWork(Batch):
    """Work ``(n,)`` with its poses, in the order in which it is answered.

    Attributes:
        work: The work.
        poses: Unrefined poses ``(n,)``.
        tick: ``(n,)`` number of the tick, in the step, at which each is answered.
        as_of_tick: ``(n,)`` tick of the newest step as of which telemetry is known.
        group: ``(n,)`` number of the answer time, not decreasing; landmarks of one group refine only later stamps in
            it, steady points also their own.
    """

    work: WorkList
    poses: PoseBatch
    tick: IntArray
    as_of_tick: IntArray
    group: IntArray
