"""What was heard lately that poses must be told of: a rival's voice, a gimbal's failure."""

import logging
from typing import Final

import numpy as np

from aerodft.model.arrays import IntArray
from aerodft.service.streams import Stream

_LOG: Final = logging.getLogger(__name__)


class HeardLately:
    """Sentences, each at once in the log when it is first heard, and of every stamp up to ``window_ns`` later."""

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._streams: dict[str, Stream] = {}

    def streams(self) -> tuple[Stream, ...]:
        """All streams."""
        return tuple(self._streams.values())

    def append(self, what: str, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Take in when a sentence held, as ``Stream.append``."""
        if what not in self._streams:
            _LOG.warning("%s", what)
            self._streams[what] = Stream(self._window_ns)
        self._streams[what].append(stamps_ns, row_end_by_tick)

    def at_all(self, stamps_ns: IntArray, ticks: IntArray) -> list[tuple[str, ...]]:
        """What was heard in the time before each of the stamps ``(n,)``, as of ticks ``(n,)``."""
        found: list[tuple[str, ...]] = [()] * len(stamps_ns)
        for what, each in self._streams.items():
            rows = each.last_before(stamps_ns, ticks)
            for k in np.flatnonzero(rows >= 0).tolist():
                if stamps_ns[k] - each.stamps_ns[rows[k]] <= self._window_ns:
                    found[k] = (*found[k], what)
        return found
