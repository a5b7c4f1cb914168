"""Queryables that always answer: an empty reply looks to a client like a service that is gone."""

import logging
from collections.abc import Callable
from typing import TypeAlias

import zenoh

from aerodft.adapters.codec.requests import encode_error
from aerodft.errors import AerodftError

Answer: TypeAlias = Callable[[bytes], bytes]

_log = logging.getLogger(__name__)


def declare_answer(session: zenoh.Session, key: str, answer: Answer) -> "zenoh.Queryable[None]":
    """Answer queries on ``key`` with JSON: what ``answer`` makes of the payload, or ``{"error": sentence}``."""

    def reply(query: zenoh.Query) -> None:
        with query:
            payload = query.payload
            query.reply(
                key,
                _answer(answer, b"" if payload is None else payload.to_bytes(), key),
                encoding=zenoh.Encoding.APPLICATION_JSON,
            )

    return session.declare_queryable(key, reply, complete=True)


def _answer(answer: Answer, payload: bytes, key: str) -> bytes:
    try:
        return answer(payload)
    except AerodftError as error:
        return encode_error(str(error))
    except Exception as error:  # noqa: BLE001 - whatever it is, the client must hear of it
        _log.exception("%s: the question could not be answered", key)
        return encode_error(f"{key}: internal error: {type(error).__name__}: {error}")
