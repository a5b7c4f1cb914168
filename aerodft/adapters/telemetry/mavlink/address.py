"""Connection strings, as pymavlink and the ground stations write them."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from aerodft.errors import LinkError

LOOPBACK: Final = "127.0.0.1"
DEFAULT_BAUD: Final = 115200
_MAX_PORT: Final = 65535
_EXPECTED: Final = (
    "udpin:[HOST:]PORT, udpout:HOST:PORT, udp:[HOST:]PORT, tcp:HOST:PORT, tcpin:[HOST:]PORT, or a serial device with"
    " its baud rate (/dev/ttyACM0,115200)"
)


class LinkKind(StrEnum):
    """How a link is opened."""

    UDP_IN = "udpin"
    UDP_OUT = "udpout"
    TCP_OUT = "tcp"
    TCP_IN = "tcpin"
    SERIAL = "serial"


_SCHEMES: Final = {
    "udpin": LinkKind.UDP_IN,
    "udp": LinkKind.UDP_IN,
    "udpout": LinkKind.UDP_OUT,
    "tcp": LinkKind.TCP_OUT,
    "tcpin": LinkKind.TCP_IN,
}
_LISTENING: Final = (LinkKind.UDP_IN, LinkKind.TCP_IN)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkAddress:
    """A parsed connection string.

    Attributes:
        text: As given.
        kind: How it is opened.
        host: Host name or address; for a serial link the device.
        port: Port number; for a serial link the baud rate.
    """

    text: str
    kind: LinkKind
    host: str
    port: int


def is_link(text: str) -> bool:
    """Whether this reads as a connection string rather than as the path of a file."""
    return text.partition(":")[0] in _SCHEMES or _is_device(text)


def parse_address(text: str, *, baud: int | None = None) -> LinkAddress:
    """Parse a connection string; without a host a listening link opens on this machine only.

    Args:
        text: For instance ``udpin:14550``, ``tcp:10.0.0.5:5760``, ``/dev/ttyACM0,57600``.
        baud: Of a serial device whose string names none; None for 115200.

    Raises:
        LinkError: It is none.
    """
    scheme, _, rest = text.partition(":")
    kind = _SCHEMES.get(scheme)
    if kind is not None:
        host, _, port = rest.rpartition(":")
        if not host and kind in _LISTENING:
            host = LOOPBACK
        host = host.strip("[]")
        if host and port.isdecimal() and int(port) <= _MAX_PORT and (int(port) or kind in _LISTENING):
            return LinkAddress(text=text, kind=kind, host=host, port=int(port))
    elif _is_device(text):
        device, _, rate = text.partition(",")
        if not rate or (rate.isdecimal() and int(rate)):
            return LinkAddress(
                text=text, kind=LinkKind.SERIAL, host=device, port=int(rate) if rate else baud or DEFAULT_BAUD
            )
    raise LinkError("no such link", where=text, expected=_EXPECTED)


def _is_device(text: str) -> bool:
    return text.startswith(("/dev/", "COM"))
