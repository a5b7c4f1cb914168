"""Poses that images of several ticks will ask for, made at once: quicker, and the same to the last bit."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from aerodft.model.arrays import IntArray
from aerodft.model.pose import PoseSample
from aerodft.service.attitude import AttitudeSources, CameraAttitude, Reading
from aerodft.service.height import HeightSources
from aerodft.service.places import Places
from aerodft.service.pose_making import Parts, PoseMaker

Asked = tuple[int, int]
"""The tick on which something is asked for, and the stamp (UTC) that is asked about."""


class PosesAhead:
    """What can be told before it is asked for.

    Args:
        attitude: Turns readings into attitudes.
        height: Heights at many stamps.
        places: Positions at many stamps.
        maker: Makes samples of them.
    """

    def __init__(self, attitude: AttitudeSources, height: HeightSources, places: Places, maker: PoseMaker) -> None:
        self._attitude = attitude
        self._height = height
        self._places = places
        self._maker = maker
        self._attitudes: dict[Asked, CameraAttitude] = {}
        self._samples: dict[Asked, tuple[Parts, PoseSample]] = {}

    def clear(self) -> None:
        """The ticks are over."""
        self._attitudes, self._samples = {}, {}

    def attitude(self, asked: Asked) -> CameraAttitude | None:
        """The attitude, where it was prepared."""
        return self._attitudes.get(asked)

    def sample(self, asked: Asked) -> tuple[Parts, PoseSample] | None:
        """The sample and its parts, where they were prepared; what its clock has to say is not in it yet."""
        return self._samples.get(asked)

    def prepare(self, readings: Mapping[Asked, Reading]) -> None:
        """Make what can be made of readings, each as it will be seen when it is asked for."""
        attitudes = self._attitude.resolved(list(readings.values()))
        self._attitudes = dict(zip(readings, attitudes, strict=True))
        ticks, stamps_ns = np.array(list(readings), dtype=np.int64).reshape(-1, 2).T
        heights, places = self._height.at_all(stamps_ns, ticks), self._places.at_all(stamps_ns, ticks)
        found = {
            asked: Parts(asked[1], height, attitude, place)
            for (asked, attitude), height, place in zip(self._attitudes.items(), heights, places, strict=True)
            if height is not None and place is not None
        }
        made = self._maker.samples(list(found.values()), self._places.origin)
        self._samples = {asked: (parts, sample) for (asked, parts), sample in zip(found.items(), made, strict=True)}


def by_tick(stamps: Iterable[tuple[int, int]], newest_ns: Sequence[IntArray]) -> dict[int, list[int]]:
    """On which of several ticks stamps will be asked for: the first that all streams have passed them on.

    Args:
        stamps: UTC, and the tick before which it is not asked for.
        newest_ns: ``(ticks,)`` each, the newest stamp of each stream at each tick.
    """
    asked: dict[int, list[int]] = {}
    for stamp_ns, from_tick in stamps:
        tick = max([from_tick, *(int(np.searchsorted(each, stamp_ns)) for each in newest_ns)])
        if newest_ns and tick < len(newest_ns[0]):
            asked.setdefault(tick, []).append(stamp_ns)
    return dict(sorted(asked.items()))
