"""The queries of one station on the bus, live or replayed: ``measure``, ``probes`` and ``history``."""

import logging
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import zenoh

from aerodft.adapters.wire.keys import Keys
from aerodft.adapters.wire.requests import (
    MeasureRequest,
    encode_error,
    encode_probes,
    parse_history_request,
    parse_measure_request,
)
from aerodft.errors import AerodftError
from aerodft.model import Probe

MOST_HISTORY: Final = 1000
"""Measurements that ``history`` queries can ask for."""
_BUG: Final = 1  # the exit code of what nobody foresaw
_Answer: TypeAlias = Callable[[bytes], bytes]

_log = logging.getLogger(__name__)


class StationQueries:
    """Answers the queries of one station until it is closed; what has no answer gets a zenoh error reply.

    Args:
        session: Where to.
        keys: The station's.
        probes: The probes that are measured; called in threads of the bus, as ``measure`` is.
        measure: Answers a ``measure`` query with the payload of its reply; None where nobody can.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        *,
        probes: Callable[[], Sequence[Probe]],
        measure: Callable[[MeasureRequest], bytes] | None,
    ) -> None:
        self._history: deque[tuple[str, bytes]] = deque(maxlen=MOST_HISTORY)
        self._lock = threading.Lock()
        answers: dict[str, _Answer] = {
            keys.probes: lambda _: encode_probes(probes()),
            keys.history: self._answer_history,
        }
        if measure is not None:
            answers[keys.measure] = lambda data: measure(parse_measure_request(data))
        self._declared = [_declare(session, key, answer) for key, answer in answers.items()]

    def remember(self, probe: str, payload: bytes) -> None:
        """Take a measurement's payload into what ``history`` answers."""
        with self._lock:
            self._history.append((probe, payload))

    def forget(self) -> None:
        """Begin the history anew."""
        with self._lock:
            self._history.clear()

    def close(self) -> None:
        """Answer nothing any more."""
        for each in self._declared:
            each.undeclare()  # type: ignore[no-untyped-call]  # zenoh is annotated in part

    def _answer_history(self, data: bytes) -> bytes:
        last, probe = parse_history_request(data)
        with self._lock:
            found = [payload for name, payload in self._history if probe is None or name == probe]
        return b"[" + b",".join(found[max(len(found) - last, 0) :]) + b"]"


def _declare(session: zenoh.Session, key: str, answer: _Answer) -> "zenoh.Queryable[None]":
    """Answer queries on ``key`` with the JSON that ``answer`` makes of the payload, or with its error."""

    def reply(query: zenoh.Query) -> None:
        with query:
            payload = query.payload
            try:
                found = answer(b"" if payload is None else payload.to_bytes())
            except AerodftError as error:
                refusal = encode_error(error.exit_code, str(error))
            except Exception as error:  # noqa: BLE001 - whatever it is, the client must hear of it
                _log.exception("%s: the question could not be answered", key)
                refusal = encode_error(_BUG, f"{key}: internal error: {type(error).__name__}: {error}")
            else:
                query.reply(key, found, encoding=zenoh.Encoding.APPLICATION_JSON)
                return
            query.reply_err(refusal, encoding=zenoh.Encoding.APPLICATION_JSON)

    return session.declare_queryable(key, reply, complete=True)
