"""Requests to one vehicle over an open link, one at a time, each with the answer that it got."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.mavlink.dialect import payload_dtype
from aerodft.adapters.mavlink.link import OWN_SYSTEM, MavlinkLink
from aerodft.adapters.mavlink.requests import MessageRequest
from aerodft.conventions import SECOND_NS
from aerodft.model.batch import Batch

_ATTEMPTS: Final = 3
_PATIENCE_NS: Final = SECOND_NS
_V1: Final = 0xFE
_V1_HEAD, _V2_HEAD = 6, 10
_COMMAND_ACK: Final = 77
_ACK: Final = payload_dtype(_COMMAND_ACK)
_ANSWERS: Final = {
    dialect.MAV_RESULT_ACCEPTED: "accepted",
    dialect.MAV_RESULT_TEMPORARILY_REJECTED: "denied for now",
    dialect.MAV_RESULT_DENIED: "denied",
    dialect.MAV_RESULT_UNSUPPORTED: "unsupported",
    dialect.MAV_RESULT_FAILED: "failed",
}
NO_ANSWER: Final = "no answer"
ACCEPTED: Final = "accepted"


@dataclass(frozen=True, slots=True)
class Outcome:
    """A request and what the vehicle answered: ``accepted``, ``denied``, ``unsupported``, ..., or ``no answer``."""

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


@dataclass(frozen=True, slots=True)
class _Frame:
    sender: str
    system: int
    component: int
    message_id: int
    payload: bytes


def ask(link: MavlinkLink, batches: Iterator[Batch], requests: Iterable[MessageRequest]) -> tuple[Outcome, ...]:
    """Send each request to who shall fulfil it, and wait for the answer; up to three times.

    An acknowledgement does not say which message it is about: the next request is sent only after it.

    Args:
        link: Open; its frames come with ``batches``.
        batches: One a tick, empty ones included.
        requests: To systems that are heard on the link; to nobody else anything is sent.
    """
    senders: dict[int, str] = {}
    return tuple(Outcome(request, _asked(link, batches, request, senders)) for request in requests)


def _asked(link: MavlinkLink, batches: Iterator[Batch], request: MessageRequest, senders: dict[int, str]) -> str:
    attempts, due_ns, first_ns = 0, 0, None
    for batch in batches:
        first_ns = batch.now_ns if first_ns is None else first_ns
        for frame in _frames(batch):
            senders[frame.system] = frame.sender
            answer = _answer(frame, request) if attempts else None
            if answer is not None:
                return answer
        if batch.now_ns < due_ns:
            continue
        if attempts == _ATTEMPTS or batch.now_ns - first_ns > _ATTEMPTS * _PATIENCE_NS:
            break
        if request.system in senders:
            link.send(senders[request.system], request.command(attempts))
            attempts, due_ns = attempts + 1, batch.now_ns + _PATIENCE_NS
    return NO_ANSWER


def _answer(frame: _Frame, request: MessageRequest) -> str | None:
    """What a frame says of a request; None where it is of something else, or only that it is being worked on."""
    if frame.message_id != _COMMAND_ACK or (frame.system, frame.component) != (request.system, request.component):
        return None
    payload = np.frombuffer(frame.payload[: _ACK.itemsize].ljust(_ACK.itemsize, b"\0"), dtype=_ACK)[0]
    is_ours = int(payload["target_system"]) in {0, OWN_SYSTEM}
    if int(payload["command"]) != dialect.MAV_CMD_SET_MESSAGE_INTERVAL or not is_ours:
        return None
    result = int(payload["result"])
    return None if result == dialect.MAV_RESULT_IN_PROGRESS else _ANSWERS.get(result, f"refused (result {result})")


def _frames(batch: Batch) -> Iterator[_Frame]:
    for block in batch.raw:
        for offset, length in zip(block.offset.tolist(), block.length.tolist(), strict=True):
            raw = block.data[offset : offset + length]
            if raw[0] == _V1:
                yield _Frame(block.sender, raw[3], raw[4], raw[5], raw[_V1_HEAD : _V1_HEAD + raw[1]])
            else:
                message_id = int.from_bytes(raw[7:10], "little")
                yield _Frame(block.sender, raw[5], raw[6], message_id, raw[_V2_HEAD : _V2_HEAD + raw[1]])
