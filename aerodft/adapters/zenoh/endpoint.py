"""zenoh's endpoints: what is wrong with one, in words of ours."""

import os
import re
from typing import Final

EXPECTED: Final = "an endpoint such as tcp/127.0.0.1:7447"
_WITH_PORT: Final = ("tcp", "udp", "ws", "tls", "quic")
_OTHERS: Final = ("unixsock-stream",)
_MOST_PORT: Final = 65535
_OS_ERROR: Final = re.compile(r"\(os error (\d+)\)")


def fault_of(endpoint: str) -> str:
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


def reason_in(text: str) -> str:
    """Why the system refused an endpoint, out of zenoh's error; empty where the error does not tell."""
    found = _OS_ERROR.search(text)
    if found is not None:
        return os.strerror(int(found[1]))
    if "lookup address" in text:
        return "a host that nobody knows"
    return "no certificate, which TLS and QUIC need" if "private key" in text else ""
