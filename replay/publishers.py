"""Publishers of a replay, declared as their keys come up, and whether anybody listens to them."""

from typing import Final, cast

import zenoh

_MOST: Final = 1000  # declared; a file may claim any number of channels, and each costs 4 kB and a message to all peers
_LOOK_AT: Final = 64  # of them at a time, until somebody has subscribed


class WaitingPublishers:
    """Publishes on any number of keys; a slow subscriber slows it down, nothing is dropped.

    Args:
        session: Where to.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: dict[str, zenoh.Publisher] = {}
        self._in_turn: list[zenoh.Publisher] = []
        self._anything: zenoh.Publisher | None = None  # stands for the keys beyond those that are declared
        self._sent, self._looked_at, self._was_heard = 0, 0, False

    @property
    def was_heard(self) -> bool:
        """Whether somebody was seen to listen, as far as was looked."""
        return self._was_heard

    @property
    def has_listeners(self) -> bool:
        """Whether anybody has subscribed to something that was published."""
        self._was_heard = self._was_heard or any(map(is_matched, self._in_turn))
        return self._was_heard

    def put(self, key: str, payload: bytes, encoding: zenoh.Encoding, attachment: bytes | None = None) -> None:
        """Publish."""
        publisher = self._declared.get(key)
        if publisher is None and len(self._declared) < _MOST:
            publisher = self._declared[key] = self._declare(key, encoding)
        if publisher is not None:
            publisher.put(payload, attachment=attachment)
        else:
            self._anything = self._anything or self._declare("**", encoding)
            congestion = zenoh.CongestionControl.BLOCK
            self._session.put(key, payload, encoding=encoding, congestion_control=congestion, attachment=attachment)
        self._sent += 1
        if self._sent % _LOOK_AT == 0 and not self._was_heard:
            self._look()

    def close(self) -> None:
        """Withdraw what was declared."""
        for publisher in self._in_turn:
            undeclare(publisher)
        self._declared.clear()
        self._in_turn.clear()

    def _declare(self, key: str, encoding: zenoh.Encoding) -> zenoh.Publisher:
        publisher = self._session.declare_publisher(
            key, encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK
        )
        self._in_turn.append(publisher)
        return publisher

    def _look(self) -> None:
        """Whether somebody listens to some of them; to the next ones at the next look."""
        self._looked_at %= len(self._in_turn)
        some = self._in_turn[self._looked_at : self._looked_at + _LOOK_AT]
        self._looked_at += len(some)
        self._was_heard = any(map(is_matched, some))


def is_matched(publisher: zenoh.Publisher) -> bool:
    """Whether somebody has subscribed to a publisher's key."""
    # zenoh's annotation says bool, what comes is a MatchingStatus, and that is always true.
    return cast("zenoh.MatchingStatus", publisher.matching_status).matching


def undeclare(publisher: zenoh.Publisher) -> None:
    """Withdraw a publisher."""
    publisher.undeclare()  # type: ignore[no-untyped-call]  # zenoh is annotated in part
