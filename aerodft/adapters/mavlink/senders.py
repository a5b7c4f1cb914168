"""One framer for every sender on a link: what one of them breaks harms nobody else."""

import logging
from typing import Final

from aerodft.adapters.mavlink.framing import FrameCounts, StreamFramer

_LOG: Final = logging.getLogger(__name__)
_MAX_SENDERS: Final = 64
_NAMED_SENDERS: Final = 16  # strangers must not fill the log
_MAGICS: Final = (b"\xfd", b"\xfe")


class Senders:
    """Frames out of the bytes of any number of senders, in bounded memory.

    Args:
        link: The link's name, for the log.
    """

    def __init__(self, link: str) -> None:
        self._link = link
        self._framers: dict[str, StreamFramer] = {}
        self._gone = FrameCounts()
        self._admitted = 0

    @property
    def counts(self) -> FrameCounts:
        """What all of them have sent so far, those that have gone included."""
        return sum((framer.counts for framer in tuple(self._framers.values())), self._gone)

    def push(self, sender: str, data: bytes) -> list[bytes]:
        """Whole frames that are complete with these bytes; no bytes say that the sender has gone."""
        framer = self._framers.get(sender)
        if framer is None:
            if not any(magic in data for magic in _MAGICS):
                self._gone += FrameCounts(skipped_bytes=len(data))
                return []
            framer = self._admit(sender)
        if not data:
            self._forget(sender)
            return []
        return framer.push(data)

    def overdue(self) -> list[tuple[str, list[bytes]]]:
        """By sender, frames that wait behind one which never became whole; to be asked for every half second or so."""
        return [(sender, frames) for sender, framer in self._framers.items() if (frames := framer.overdue())]

    def _admit(self, sender: str) -> StreamFramer:
        """A framer for a new sender; where they are too many, one that never sent a good frame gives way first."""
        if len(self._framers) >= _MAX_SENDERS:
            strangers = (name for name, framer in self._framers.items() if not framer.counts.frames)
            self._forget(next(strangers, next(iter(self._framers))))
        self._admitted += 1
        if self._admitted <= _NAMED_SENDERS:
            _LOG.info("%s: first bytes from %s", self._link, sender)
        elif self._admitted == _NAMED_SENDERS + 1:
            _LOG.warning("%s: bytes from more than %d senders", self._link, _NAMED_SENDERS)
        return self._framers.setdefault(sender, StreamFramer())

    def _forget(self, sender: str) -> None:
        self._gone += self._framers.pop(sender).counts
