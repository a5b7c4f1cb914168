"""Requests to one vehicle over an open link, one at a time, each with the answer that it got."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.mavlink.blocks import headers, payload_rows
from aerodft.adapters.mavlink.dialect import payload_dtype
from aerodft.adapters.mavlink.link import OWN_SYSTEM, MavlinkLink
from aerodft.adapters.mavlink.requests import MessageRequest
from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import IntArray
from aerodft.model.batch import Batch
from aerodft.model.telemetry import RawBlock

_ATTEMPTS: Final = 3
_PATIENCE_NS: Final = SECOND_NS
_COMMAND_ACK: Final = dialect.MAVLINK_MSG_ID_COMMAND_ACK
_ACK: Final = payload_dtype(_COMMAND_ACK)
_ANSWERS: Final = {
    dialect.MAV_RESULT_ACCEPTED: "accepted",
    dialect.MAV_RESULT_TEMPORARILY_REJECTED: "denied for now",
    dialect.MAV_RESULT_DENIED: "denied",
    dialect.MAV_RESULT_UNSUPPORTED: "unsupported",
    dialect.MAV_RESULT_FAILED: "failed",
}
_NO_ANSWER: Final = "no answer"
_Senders = dict[tuple[int, int], str]  # by system and component


@dataclass(frozen=True, slots=True)
class Outcome:
    """A request and what was answered: ``accepted``, ``denied``, ``unsupported``, ..., or ``no answer``."""

    request: MessageRequest
    answer: str

    def document(self, after_hz: float) -> dict[str, Any]:
        """Plain JSON values, with the rate that came of it."""
        asked = self.request.document()
        return {key: asked[key] for key in ("message", "message_id", "system", "component", "rate_hz")} | {
            "answer": self.answer,
            "before_hz": asked["now_hz"],
            "after_hz": round(after_hz, 3),
        }


def ask(link: MavlinkLink, batches: Iterator[Batch], requests: Iterable[MessageRequest]) -> tuple[Outcome, ...]:
    """Send each request to who shall fulfil it, and wait for the answer; up to three times.

    An acknowledgement does not say which message it is about: the next request is sent only after it.

    Args:
        link: Open; its frames come with ``batches``.
        batches: One a tick, empty ones included.
        requests: To systems that are heard on the link; to nobody else anything is sent.
    """
    senders: _Senders = {}
    return tuple(Outcome(request, _asked(link, batches, request, senders)) for request in requests)


def _asked(link: MavlinkLink, batches: Iterator[Batch], request: MessageRequest, senders: _Senders) -> str:
    attempts, due_ns, first_ns = 0, 0, None
    for batch in batches:
        first_ns = batch.now_ns if first_ns is None else first_ns
        for block in batch.raw:
            heads = headers(block)
            senders |= dict.fromkeys(map(tuple, np.unique(heads[1:3, heads[0] >= 0], axis=1).T.tolist()), block.sender)
            answer = _answer(block, heads, request) if attempts else None
            if answer is not None:
                return answer
        if batch.now_ns < due_ns:
            continue
        if attempts == _ATTEMPTS or batch.now_ns - first_ns > _ATTEMPTS * _PATIENCE_NS:
            break
        sender = _sender_of(request, senders)
        if sender is not None:
            link.send(sender, request.command(attempts))
            attempts, due_ns = attempts + 1, batch.now_ns + _PATIENCE_NS
    return _NO_ANSWER


def _sender_of(request: MessageRequest, senders: _Senders) -> str | None:
    """Where who is asked sends from, else somebody of its system, who may pass it on; None where nobody was heard."""
    of_system = (sender for (system, _), sender in senders.items() if system == request.system)
    return senders.get((request.system, request.component)) or next(of_system, None)


def _answer(block: RawBlock, heads: IntArray, request: MessageRequest) -> str | None:
    """What a block's frames say of a request; None where they are of something else, or it is being worked on."""
    sender = (heads[1] == request.system) & (heads[2] == request.component)
    said = payload_rows(block, heads[3:, (heads[0] == _COMMAND_ACK) & sender], _ACK)
    is_ours = np.isin(said["target_system"], (0, OWN_SYSTEM)) & (said["command"] == request.command_id)
    results = said["result"][is_ours & (said["result"] != dialect.MAV_RESULT_IN_PROGRESS)].tolist()
    return _ANSWERS.get(results[0], f"refused (result {results[0]})") if results else None
