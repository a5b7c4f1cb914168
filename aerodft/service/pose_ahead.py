"""Poses that images of several ticks will ask for, made at once: quicker, and the same to the last bit."""

from collections.abc import Sequence

import numpy as np

from aerodft.model.arrays import IntArray
from aerodft.model.pose import PoseSample
from aerodft.service.attitude import AttitudeSources, CameraAttitude
from aerodft.service.health import HealthSources
from aerodft.service.health_verdict import Verdict
from aerodft.service.height import HeightSources
from aerodft.service.places import Places
from aerodft.service.pose_making import Parts, PoseMaker
from aerodft.service.streams import Missing
from aerodft.service.timing import ClockMap

Asked = tuple[int, int]
"""The tick on which something is asked for, and the stamp (UTC) that is asked about."""


Verdicts = dict[Asked, Verdict]
Samples = dict[Asked, tuple[Parts, PoseSample]]
Ready = dict[Asked, PoseSample]


class PosesAhead:
    """What can be told before it is asked for.

    Attributes:
        attitudes: Those that were prepared.
        samples: With their parts; neither clock nor health have had their say yet.
        verdicts: What the vehicle's health means for each.
        ready: Samples of which nothing more is to be said.

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
        self.attitudes: dict[Asked, CameraAttitude] = {}
        self.samples: Samples = {}
        self.verdicts: Verdicts = {}
        self.ready: Ready = {}

    def prepare(self, stamps_ns: IntArray, ticks: IntArray) -> None:
        """Make what can be made for stamps ``(n,)``, each as it will be seen at its tick ``(n,)``."""
        asked = list(zip(ticks.tolist(), stamps_ns.tolist(), strict=True))
        attitudes = self._attitude.at_all(stamps_ns, ticks)
        heights, places = self._height.at_all(stamps_ns, ticks), self._places.at_all(stamps_ns, ticks)
        found: dict[Asked, Parts] = {}
        for key, height, attitude, place in zip(asked, heights, attitudes, places, strict=True):
            if attitude is None:
                continue
            if height is None or place is None:
                self.attitudes[key] = attitude
            else:
                found[key] = Parts(key[1], height, attitude, place)
        made = self._maker.samples(list(found.values()), self._places.origin)
        self.samples = {key: (parts, sample) for (key, parts), sample in zip(found.items(), made, strict=True)}
        self.verdicts = dict(zip(asked, self._health.verdicts(stamps_ns, ticks), strict=True))

    def complete(self, clock: ClockMap) -> None:
        """Make samples ready, where clocks say the same of all of them, and whose UTC it is makes no difference."""
        for key, (parts, sample) in self.samples.items():
            place = parts.place or Missing.NEVER
            whole = self._maker.completed(sample, parts.height, place, clock, by_utc=False)
            self.ready[key] = self.verdicts[key].judged(whole)


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
