"""Work that waits for telemetry, and the order of its answers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol, TypeAlias

import numpy as np

from aerodft.dft import NO_IMAGE
from aerodft.jit import njit
from aerodft.model import BoolArray, IntArray, PoseBatch
from aerodft.service.work.recent_images import RecentImages
from aerodft.service.work.work_list import ReadyWork, Task, WorkList


@dataclass(frozen=True, slots=True, eq=False)
class _AnswerTimes:
    """Times ``n`` at which work may be answered: every tick, and deadlines at which no tick is.

    Attributes:
        time_ns: ``(n,)`` ascending.
        ticks: ``(n,)`` number of ticks of the step up to each.
        is_tick: ``(n,)`` whether it is a tick.
    """

    time_ns: IntArray
    ticks: IntArray
    is_tick: BoolArray

    @staticmethod
    def from_ticks(now_ns: IntArray, deadlines_ns: IntArray) -> "_AnswerTimes":
        """Answer times of the ticks ``now_ns (ticks,)`` and of deadlines before the last of them."""
        time_ns = np.unique(np.concatenate([now_ns, deadlines_ns[deadlines_ns < now_ns[-1]]]))
        ticks = np.searchsorted(now_ns, time_ns, side="right")
        return _AnswerTimes(time_ns, ticks, now_ns[np.maximum(ticks - 1, 0)] == time_ns)


@njit
def _answer_in_order(
    work: tuple[IntArray, IntArray, IntArray, IntArray, IntArray],
    answer_times: tuple[IntArray, IntArray],
    last_image_ns: IntArray,
) -> IntArray:
    """Indices ``(n,)`` of the answer times of work; -1 where it keeps waiting.

    Work waits for earlier arrivals with earlier stamps, but not for observations that wait for their image.

    Args:
        work: ``(n,)`` each, in order of arrival: stamps, numbers of ticks to arrival and to complete telemetry,
            deadlines, and the stamps that the last image must have reached.
        answer_times: Times ``(k,)``, and numbers of ticks up to them ``(k,)``.
        last_image_ns: ``(k,)`` stamps of the last images at these times.
    """
    stamp_ns, arrival_tick, ready_tick, deadline_ns, required_image_ns = work
    time_ns, ticks = answer_times
    answer = np.full(len(stamp_ns), -1)
    first = 0
    for answer_time in range(len(time_ns)):
        while first < len(answer) and answer[first] >= 0:
            first += 1
        blocked_ns, is_blocked = 0, False
        for k in range(first, len(answer)):
            if arrival_tick[k] > ticks[answer_time]:
                break
            is_final = deadline_ns[k] <= time_ns[answer_time]
            if answer[k] >= 0 or (not is_final and last_image_ns[answer_time] < required_image_ns[k]):
                continue
            if is_final or (ready_tick[k] <= ticks[answer_time] and not (is_blocked and stamp_ns[k] >= blocked_ns)):
                answer[k] = answer_time
            else:
                blocked_ns = min(blocked_ns, stamp_ns[k]) if is_blocked else stamp_ns[k]
                is_blocked = True
    return answer


_ANY_IMAGE: Final = np.iinfo(np.int64).min
_PoseParts: TypeAlias = list[tuple[IntArray, PoseBatch]]
"""Poses, each batch with the rows of the work that it belongs to."""


class PosesAt(Protocol):
    """Poses at stamps ``(n,)`` as of ticks, and where telemetry is pending, as ``PoseSource.at``."""

    def __call__(
        self, stamps_ns: IntArray, ticks: IntArray, *, is_final: BoolArray, by_utc: BoolArray
    ) -> tuple[PoseBatch, BoolArray]:
        """Poses at stamps."""
        ...


class PendingWork:
    """Images and observations that wait for their poses, and the order of their answers.

    Work is ready at the first tick at which its stamp is bracketed by telemetry, or at its deadline, and is answered no
    earlier than what arrived before it with an earlier stamp.

    Args:
        poses_at: Poses as of a tick.
        watermark_ns: Newest stamps of telemetry at each of so many ticks of the newest step; None where no pose waits
            for any: of a fixed camera.
        match_tolerance_ns: Largest difference between the stamps of an observation and its image.

    Attributes:
        images: Stamps of recent images.
    """

    def __init__(
        self, poses_at: PosesAt, watermark_ns: Callable[[int], IntArray] | None, match_tolerance_ns: int
    ) -> None:
        self.images = RecentImages()
        self._poses_at = poses_at
        self._watermark_ns = watermark_ns
        self._match_tolerance_ns = match_tolerance_ns
        self._work = WorkList.empty()

    def shift(self, by_ns: int) -> None:
        """Apply a change ``by_ns`` of UTC to stamps on this machine's clock."""
        self._work = self._work.shifted(by_ns)
        self.images.shift(by_ns)

    def add(self, work: WorkList) -> None:
        """Let work of the newest step wait."""
        self._work = WorkList.concatenate([self._work, work]).in_order_of_ticks()

    def take_overdue(self, now_ns: int | None, tick: int) -> ReadyWork | None:
        """Take work with deadlines before ``now_ns`` (None: all work), and work that it held up; None without any.

        Telemetry is as of the last tick; outputs get the number ``tick``.
        """
        work = self._work
        due_ns = np.unique(work.deadline_ns if now_ns is None else work.deadline_ns[work.deadline_ns < now_ns])
        if not len(due_ns):
            return None
        answer_times = _AnswerTimes(due_ns, np.zeros_like(due_ns), np.full(len(due_ns), fill_value=False))
        last_image_ns = np.full(len(due_ns), self.images.last_ns()[-1])
        is_ready = np.array([sample is not None for sample in work.samples], dtype=np.bool_)
        answer = self._answer_order(np.where(is_ready, 0, 1), answer_times, last_image_ns)
        parts = self._stored_poses()
        overdue = np.flatnonzero((answer >= 0) & ~is_ready)
        parts += self._poses_at_deadline(overdue, np.full(len(overdue), -1))
        return self._take(parts, answer, answer_times, tick)

    def take_ready(self, now_ns: IntArray, first: int) -> ReadyWork | None:
        """Take work that is ready in the ticks ``now_ns (n,)`` of the newest step, numbered from ``first``."""
        work, count = self._work, len(now_ns)
        if not len(work):
            return None
        deadline_tick = np.searchsorted(now_ns, work.deadline_ns)
        ready_tick, parts = self._complete_poses(np.minimum(deadline_tick, count), count)
        overdue = np.flatnonzero((ready_tick >= deadline_tick) & (deadline_tick < count))
        is_on_tick = now_ns[deadline_tick[overdue]] == work.deadline_ns[overdue]
        # Work that arrived after its deadline, within one long tick, is answered on that tick.
        as_of_tick = np.maximum(deadline_tick[overdue] - ~is_on_tick, work.tick[overdue])
        parts += self._poses_at_deadline(overdue, as_of_tick)
        answer_times = _AnswerTimes.from_ticks(now_ns, work.deadline_ns)
        last_image_ns = self.images.last_ns()[answer_times.ticks - 1]
        answer = self._answer_order(ready_tick + 1, answer_times, last_image_ns)
        return self._take(parts, answer, answer_times, first)

    def _answer_order(self, ready: IntArray, times: _AnswerTimes, last_image_ns: IntArray) -> IntArray:
        """Answer times ``(n,)`` of work that is ready after some ticks ``(n,)``; -1 where it keeps waiting."""
        work = self._work
        columns = work.stamp_ns, work.tick + 1, ready, work.deadline_ns, self._required_image_ns()
        return _answer_in_order(columns, (times.time_ns, times.ticks), last_image_ns)

    def _take(self, parts: _PoseParts, answer: IntArray, answer_times: _AnswerTimes, first: int) -> ReadyWork | None:
        """Take work at answer times ``answer (n,)``, ticks numbered from ``first``; work with -1 keeps waiting."""
        work = self._work
        pose_index = np.full(len(work), -1)
        if parts:
            pose_index[np.concatenate([rows for rows, _ in parts])] = np.arange(sum(len(rows) for rows, _ in parts))
        poses = PoseBatch.concatenate([poses for _, poses in parts]) if parts else None
        waiting = np.flatnonzero(answer < 0)
        samples = [None if poses is None or k < 0 else poses[k] for k in pose_index[waiting].tolist()]
        self._work = work.rows(waiting).waiting(samples)
        rows = np.flatnonzero(answer >= 0)
        if poses is None or not len(rows):
            return None
        rows = rows[np.argsort(answer[rows], kind="stable")]
        time_index = answer[rows]
        as_of_tick = answer_times.ticks[time_index] - 1
        # Deadlines between two ticks are answered on the second of them, before its own work.
        tick = first + as_of_tick + ~answer_times.is_tick[time_index]
        answered = work.rows(rows)
        self._find_images(answered, as_of_tick)
        return ReadyWork(answered, poses.rows(pose_index[rows]), tick, as_of_tick, time_index)

    def _find_images(self, work: WorkList, as_of_tick: IntArray) -> None:
        """Set the images of observations that name none, each as of a tick ``(n,)``."""
        for row in np.flatnonzero((work.task != Task.IMAGE) & (work.image == NO_IMAGE)).tolist():
            stamp_ns, tick = int(work.stamp_ns[row]), int(as_of_tick[row])
            work.image[row] = self.images.nearest(stamp_ns, self._match_tolerance_ns, tick)

    def _required_image_ns(self) -> IntArray:
        """Stamps ``(n,)`` that the last image must have reached: an observation may arrive before its image."""
        work = self._work
        has_no_image = (work.task != Task.IMAGE) & (work.image == NO_IMAGE)
        return np.where(has_no_image, work.stamp_ns - self._match_tolerance_ns, _ANY_IMAGE)

    def _poses_at_deadline(self, rows: IntArray, as_of_tick: IntArray) -> _PoseParts:
        """Poses of rows as of ticks ``(n,)`` from the telemetry at hand."""
        if not len(rows):
            return []
        stamps_ns, by_utc, is_final = (
            self._work.stamp_ns[rows],
            self._work.by_utc[rows],
            np.full(len(rows), fill_value=True),
        )
        return [(rows, self._poses_at(stamps_ns, as_of_tick, is_final=is_final, by_utc=by_utc)[0])]

    def _stored_poses(self) -> _PoseParts:
        """Poses stored with waiting work."""
        rows = [row for row, sample in enumerate(self._work.samples) if sample is not None]
        samples = [sample for sample in self._work.samples if sample is not None]
        return [(np.array(rows), PoseBatch.from_samples(samples))] if rows else []

    def _complete_poses(self, until_tick: IntArray, count: int) -> tuple[IntArray, _PoseParts]:
        """Ticks ``(n,)`` at which the telemetry of work is complete, before ``until_tick (n,)``; else ``count``.

        Also the poses at these ticks; the tick is -1 for work with a stored pose.
        """
        work, required_image_ns = self._work, self._required_image_ns()
        tick = np.maximum(work.tick, 0)
        if self._watermark_ns is not None:
            newest_ns = np.maximum.accumulate(self._watermark_ns(count))
            tick = np.maximum(tick, np.searchsorted(newest_ns, work.stamp_ns))
        ready_tick, parts = np.full(len(work), count), self._stored_poses()
        for rows, _ in parts:
            ready_tick[rows] = -1
        rows = np.flatnonzero((tick < until_tick) & (ready_tick >= 0))
        tick = tick[rows]
        while len(rows):
            has_no_image = np.flatnonzero(required_image_ns[rows] != _ANY_IMAGE)
            tick[has_no_image] = self.images.ticks_with(required_image_ns[rows[has_no_image]], tick[has_no_image])
            is_early = tick < until_tick[rows]
            rows, tick = rows[is_early], tick[is_early]
            is_final = np.full(len(rows), fill_value=False)
            poses, is_pending = self._poses_at(work.stamp_ns[rows], tick, is_final=is_final, by_utc=work.by_utc[rows])
            done = np.flatnonzero(~is_pending)
            ready_tick[rows[done]] = tick[done]
            parts.append((rows[done], poses.rows(done)))
            rows, tick = rows[is_pending], tick[is_pending] + 1
        return ready_tick, [part for part in parts if len(part[0])]
