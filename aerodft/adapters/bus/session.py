"""zenoh sessions that open the endpoints of the configuration, and nothing else."""

import json
import logging
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

import zenoh

from aerodft.errors import LinkError

_EXPECTED: Final = "an endpoint such as tcp/127.0.0.1:7447"
_WITH_PORT: Final = ("tcp", "udp", "ws", "tls", "quic")
_OTHERS: Final = ("unixsock-stream",)
_MOST_PORT: Final = 65535
_OS_ERROR: Final = re.compile(r"\(os error (\d+)\)")

_log = logging.getLogger(__name__)


def open_session(listen: str | None, connect: Sequence[str] = ()) -> zenoh.Session:
    """Open a peer without multicast and gossip.

    Args:
        listen: Endpoint such as ``tcp/127.0.0.1:7447``; None to listen nowhere.
        connect: Endpoints to connect to; one that is not there yet is tried again until it is.

    Raises:
        LinkError: An endpoint is busy or makes no sense.
    """
    config = zenoh.Config()
    settings = {
        "mode": "peer",
        "listen/endpoints": [] if listen is None else [listen],
        "listen/exit_on_failure": True,
        "connect/endpoints": list(connect),
        "connect/exit_on_failure": False,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    endpoints = (*([] if listen is None else [listen]), *connect)
    for each in endpoints:
        if fault := _fault_of(each):
            raise LinkError("no endpoint", got=fault, expected=_EXPECTED)
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise _link_error(", ".join(endpoints), error) from error
    _log.info("zenoh listens on %s, connects to %s", listen or "nothing", ", ".join(connect) or "nothing")
    return session


@contextmanager
def session_on(listen: str | None, connect: Sequence[str] = ()) -> Iterator[zenoh.Session]:
    """A session that is closed at the end.

    Raises:
        LinkError: As ``open_session``.
    """
    session = open_session(listen, connect)
    try:
        yield session
    finally:
        close_session(session)


def close_session(session: zenoh.Session) -> None:
    """Close a session; one that cannot say goodbye to a stuck peer is left to the end of the process."""
    try:
        session.close()  # type: ignore[no-untyped-call]  # zenoh is annotated in part
    except zenoh.ZError as error:
        _log.warning("zenoh did not close in time: %s", _short(error))


def _link_error(where: str, error: zenoh.ZError) -> LinkError:
    if "in use" in str(error):
        return LinkError(
            "the port is busy",
            where=where,
            expected="a free port",
            hint="another service runs there, or choose another port in the configuration",
        )
    _log.debug("zenoh says: %s", error)
    got = _reason_in(str(error)) or "an endpoint that zenoh cannot open"
    return LinkError("the bus cannot be opened", where=where, got=got, expected=_EXPECTED)


def _short(error: zenoh.ZError) -> str:
    """The error without the source locations that zenoh puts behind it."""
    return str(error).split(" at /", 1)[0].split(" at ", 1)[0]


def _fault_of(endpoint: str) -> str:
    """What is wrong with how an endpoint is written; empty where nothing is."""
    protocol, _, address = endpoint.partition("/")
    if protocol not in (*_WITH_PORT, *_OTHERS):
        return f"{protocol!r} for a protocol" if address else repr(endpoint)
    if protocol in _OTHERS:
        return "" if address else f"{endpoint!r}, without a path"
    host, _, port = re.split(r"[?#]", address, maxsplit=1)[0].rpartition(":")
    if not host:
        return f"{endpoint!r}, without {'a port' if address else 'a host'}"
    if not (port.isascii() and port.isdigit() and int(port) <= _MOST_PORT):
        return f"{port!r} for a port"
    return ""


def _reason_in(text: str) -> str:
    """Why the system refused an endpoint, out of zenoh's error; empty where the error does not tell."""
    found = _OS_ERROR.search(text)
    if found is not None:
        return os.strerror(int(found[1]))
    if "lookup address" in text:
        return "a host that nobody knows"
    return "no certificate, which TLS and QUIC need" if "private key" in text else ""
