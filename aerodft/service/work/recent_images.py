"""Stamps of recent images, by which observations find theirs."""

from typing import Final

import numpy as np

from aerodft.dft import NO_IMAGE
from aerodft.model import BoolArray, IntArray

_MAX_IMAGES: Final = 512  # an observation arrives at most this many images after its own


class RecentImages:
    """Stamps (UTC) of the newest images, as known at each tick of the newest step."""

    def __init__(self) -> None:
        self._image = self._stamp_ns = np.empty(0, dtype=np.int64)
        self._by_utc = np.empty(0, dtype=np.bool_)
        self._end = np.zeros(1, dtype=np.int64)  # rows known at each tick

    def add(self, image: IntArray, stamp_ns: IntArray, by_utc: BoolArray, tick: IntArray, count: int) -> None:
        """Add the images ``(n,)`` of a step of ``count`` ticks, each known from its ``tick (n,)`` on."""
        recent = slice(max(len(self._image) - _MAX_IMAGES, 0), None)
        before = len(self._image[recent])
        self._image = np.concatenate([self._image[recent], image])
        self._stamp_ns = np.concatenate([self._stamp_ns[recent], stamp_ns])
        self._by_utc = np.concatenate([self._by_utc[recent], by_utc])
        self._end = before + np.searchsorted(tick, np.arange(count), side="right")

    def shift(self, by_ns: int) -> None:
        """Apply a change ``by_ns`` of UTC to stamps on this machine's clock."""
        if by_ns:
            self._stamp_ns = np.where(self._by_utc, self._stamp_ns, self._stamp_ns + by_ns)

    def last_ns(self) -> IntArray:
        """Stamps ``(ticks,)`` of the last images; the end of time before the first image."""
        stamps_ns = np.append(self._stamp_ns, np.iinfo(np.int64).max)
        return stamps_ns[self._end - 1]

    def ticks_with(self, stamps_ns: IntArray, ticks: IntArray) -> IntArray:
        """First ticks ``(n,)`` from ``ticks (n,)`` on at which the last image has reached ``stamps_ns (n,)``.

        The number of ticks where there is none.
        """
        last_ns = self.last_ns()
        is_reached = (last_ns >= stamps_ns[:, None]) & (np.arange(len(last_ns)) >= ticks[:, None])
        return np.where(np.any(is_reached, axis=1), np.argmax(is_reached, axis=1), len(last_ns))

    def stamp_ns(self, image: int, tick: int) -> int | None:
        """Stamp of the image with a running number as of a tick; None where it is not kept."""
        window = self._window(tick)
        rows = np.flatnonzero(self._image[window] == image)
        return int(self._stamp_ns[window][rows[-1]]) if len(rows) else None

    def nearest(self, stamp_ns: int, tolerance_ns: int, tick: int) -> int:
        """Running number of the image closest to a stamp as of a tick; ``NO_IMAGE`` beyond the tolerance."""
        window = self._window(tick)
        distance_ns = np.abs(self._stamp_ns[window] - stamp_ns)
        if not len(distance_ns) or distance_ns.min() > tolerance_ns:
            return NO_IMAGE
        return int(self._image[window][distance_ns.argmin()])

    def _window(self, tick: int) -> slice:
        end = int(self._end[tick])
        return slice(max(end - _MAX_IMAGES, 0), end)
