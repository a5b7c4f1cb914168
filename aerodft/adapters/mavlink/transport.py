"""What a live link reads from and writes to, and how one is opened."""

import errno
import socket
from typing import Protocol

from aerodft.adapters.mavlink.address import LinkAddress, LinkKind
from aerodft.adapters.mavlink.datagrams import Reads
from aerodft.adapters.mavlink.serialport import SerialTransport
from aerodft.adapters.mavlink.sockets import TcpClient, TcpListener, UdpTransport
from aerodft.errors import LinkError


class Transport(Protocol):
    """One open link."""

    def read(self, timeout_s: float) -> Reads:
        """What has arrived, each with its sender; empty after ``timeout_s`` without any.

        An empty ``bytes`` says that this sender has gone.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send to whoever is at the other end, if anybody is."""
        ...

    def write_to(self, sender: str, data: bytes) -> None:
        """Send to one of those that ``read`` named, if it is still there."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...


def open_transport(address: LinkAddress) -> Transport:
    """Open a link; an outgoing TCP link comes up by itself later where nobody listens yet.

    Raises:
        LinkError: The port is busy, the host unknown, the device missing or not allowed.
    """
    try:
        if address.kind is LinkKind.SERIAL:
            return SerialTransport(address)
        if address.kind in {LinkKind.UDP_IN, LinkKind.UDP_OUT}:
            return UdpTransport(address)
        return TcpListener(address) if address.kind is LinkKind.TCP_IN else TcpClient(address)
    except OSError as error:
        raise _refusal(address, error) from error
    except ValueError as error:
        raise LinkError("impossible baud rate", where=address.text, got=address.port, hint=str(error)) from error


def _refusal(address: LinkAddress, error: OSError) -> LinkError:
    if isinstance(error, socket.gaierror):
        return LinkError(
            "unknown host", where=address.text, got=address.host, hint="check the name, or give the address"
        )
    if error.errno == errno.EADDRINUSE:
        return LinkError(
            "the port is busy", where=address.text, hint="close the other program on it, or take another port"
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return LinkError("not an address of this machine", where=address.text, got=address.host)
    what = "the device cannot be opened" if address.kind is LinkKind.SERIAL else "cannot be opened"
    return LinkError(what, where=address.text, got=error.strerror or error)
