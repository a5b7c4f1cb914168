"""Poses that images of several ticks will ask for, made at once: quicker, and the same to the last bit."""

from collections.abc import Sequence

import numpy as np

from aerodft.model.arrays import BoolArray, IntArray
from aerodft.model.pose import PoseSample
from aerodft.model.pose_columns import HORIZONTAL, PoseColumns, Posed, PoseRow, PoseRows
from aerodft.service.attitude import AttitudeSources, CameraAttitude, CameraAttitudes
from aerodft.service.health import HealthSources
from aerodft.service.health_verdict import Verdict, Verdicts
from aerodft.service.height import HeightSources
from aerodft.service.places import Places
from aerodft.service.pose_making import PartColumns, Parts, PoseMaker
from aerodft.service.streams import Missing
from aerodft.service.timing import ClockMap

Asked = tuple[int, int]
"""The tick on which something is asked for, and the stamp (UTC) that is asked about."""


class PosesAhead:
    """What can be told before it is asked for.

    Args:
        attitude: Attitudes at many stamps.
        height: Heights likewise.
        places: Positions likewise.
        health: What the vehicle's health means for poses at many stamps.
        maker: Makes samples of them.
    """

    def __init__(
        self, attitude: AttitudeSources, height: HeightSources, places: Places, health: HealthSources, maker: PoseMaker
    ) -> None:
        self._attitude = attitude
        self._height = height
        self._places = places
        self._health = health
        self._maker = maker
        self.clear()

    def clear(self) -> None:
        """The ticks are over."""
        self._asked: dict[Asked, int] = {}  # and its row in these
        self._attitudes = CameraAttitudes.none(0)
        self._verdicts = Verdicts((), np.empty(0, dtype=np.int64))
        self._whole: dict[Asked, int] = {}  # what has all its parts, and its row in these
        self._parts: PartColumns | None = None
        self._columns: PoseColumns | None = None
        self._is_left: BoolArray | None = None  # rows of which nothing more is to be said
        self._completed: dict[Asked, PoseSample] = {}  # those of the others; none before all are complete

    def prepare(self, stamps_ns: IntArray, ticks: IntArray) -> None:
        """Make what can be made for stamps ``(n,)``, each as it will be seen at its tick ``(n,)``."""
        asked = list(zip(ticks.tolist(), stamps_ns.tolist(), strict=True))
        self._asked = dict(zip(asked, range(len(asked)), strict=True))
        self._verdicts = self._health.verdicts(stamps_ns, ticks)
        self._attitudes = self._attitude.at_all(stamps_ns, ticks)
        heights, places = self._height.at_all(stamps_ns, ticks), self._places.at_all(stamps_ns, ticks)
        rows = np.flatnonzero(self._attitudes.is_known & heights.is_known & places.is_known)
        if len(rows):
            self._whole = {asked[row]: number for number, row in enumerate(rows.tolist())}
            self._parts = PartColumns(stamps_ns, heights, self._attitudes, places).rows(rows)
            self._columns = self._maker.columns(self._parts, self._places.origin)

    def complete(self, clock: ClockMap) -> None:
        """Make samples ready, where clocks say the same of all of them, and whose UTC it is makes no difference."""
        if self._parts is None or self._columns is None:
            return
        is_left = self._maker.leaves(self._parts.heights, clock)
        rows = [self._asked[key] for key in self._whole]
        self._is_left = is_left & self._verdicts.leave(rows, self._columns.std[:, HORIZONTAL])
        others = np.flatnonzero(~self._is_left).tolist()
        if others:
            keys = list(self._whole)
            self._completed = {keys[row]: self._complete(keys[row], row, clock) for row in others}

    def _complete(self, key: Asked, row: int, clock: ClockMap) -> PoseSample:
        assert self._parts is not None  # noqa: S101 - the callers' own condition, for the type checker
        assert self._columns is not None  # noqa: S101 - likewise
        parts, sample = self._parts.row(row), self._columns.sample(row)
        whole = self._maker.completed(sample, parts.height, parts.place or Missing.NEVER, clock, by_utc=False)
        return self._verdicts.of(self._asked[key]).judged(whole)

    def ready(self, key: Asked) -> Posed | None:
        """A pose of which nothing more is to be said."""
        row = self._whole.get(key)
        if row is None or self._is_left is None or self._columns is None:
            return None
        return PoseRow(self._columns, row) if self._is_left[row] else self._completed[key]

    def rows(self, ticks: IntArray, stamps_ns: IntArray) -> PoseRows | None:
        """The poses that are ready at ticks and stamps ``(n,)``, -1 for none that is a row; None where none is."""
        if self._is_left is None or self._columns is None:
            return None
        asked = zip(ticks.tolist(), stamps_ns.tolist(), strict=True)
        rows = np.array([self._whole.get(key, -1) for key in asked], dtype=np.int64)
        return PoseRows(self._columns, np.where(self._is_left[rows], rows, -1))

    def attitude(self, key: Asked) -> CameraAttitude | None:
        """An attitude, where it was prepared."""
        row = self._asked.get(key)
        return None if row is None or not self._attitudes.is_known[row] else self._attitudes.row(row)

    def verdict(self, key: Asked) -> Verdict | None:
        """What the vehicle's health means for a pose, likewise."""
        row = self._asked.get(key)
        return None if row is None else self._verdicts.of(row)

    def sample(self, key: Asked) -> tuple[Parts, PoseSample] | None:
        """A sample with its parts, likewise; neither clock nor health have had their say yet."""
        row = self._whole.get(key)
        if row is None or self._parts is None or self._columns is None:
            return None
        return self._parts.row(row), self._columns.sample(row)


def by_tick(asked: IntArray, newest_ns: Sequence[IntArray]) -> IntArray:
    """On which of several ticks stamps will be asked for: the first that all streams have passed them on.

    Args:
        asked: ``(n, 2)`` stamps (UTC), and the tick before which each is not asked for.
        newest_ns: ``(ticks,)`` each, the newest stamp of each stream at each tick; empty where nothing of it came.

    Returns:
        ``(m, 2)`` ticks and stamps; without those that not all streams have passed.
    """
    spoken = [each for each in newest_ns if len(each)]
    if not spoken:
        return np.empty((0, 2), dtype=np.int64)
    stamps_ns, from_tick = asked.T
    ticks = np.maximum.reduce([from_tick, *(np.searchsorted(each, stamps_ns) for each in spoken)])
    return np.asarray(np.stack([ticks, stamps_ns], axis=-1)[ticks < len(spoken[0])])


def each_once(pairs: IntArray) -> IntArray:
    """The different ones of pairs ``(n, 2)``, in order ``(2, m)``; numpy's own takes ten times as long."""
    ordered = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    is_new = np.ones(len(pairs), dtype=np.bool_)
    is_new[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    return ordered[is_new].T
