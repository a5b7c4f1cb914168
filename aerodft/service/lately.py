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

    def append(self, what: str, stamps_ns: IntArray) -> None:
        """Take in when a sentence held."""
        if what not in self._streams:
            _LOG.warning("%s", what)
            self._streams[what] = Stream(self._window_ns)
        self._streams[what].append(stamps_ns)

    def at(self, stamp_ns: int) -> tuple[str, ...]:
        """What was heard in the time before a stamp."""
        return tuple(what for what, each in self._streams.items() if self._is_recent(each.stamps_ns, stamp_ns))

    def _is_recent(self, stamps_ns: IntArray, stamp_ns: int) -> bool:
        row = int(np.searchsorted(stamps_ns, stamp_ns, side="right")) - 1
        return row >= 0 and stamp_ns - int(stamps_ns[row]) <= self._window_ns
