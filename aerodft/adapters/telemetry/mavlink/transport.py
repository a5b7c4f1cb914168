"""What a live link reads from and writes to: UDP and TCP sockets, serial devices, by its address.

Each gives ``(sender, bytes)`` and takes bytes to send.
"""

import contextlib
import errno
import logging
import selectors
import socket
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, TypeAlias

import serial

from aerodft.errors import LinkError

LOOPBACK: Final = "127.0.0.1"
DEFAULT_BAUD: Final = 115200
_MAX_PORT: Final = 65535
_EXPECTED: Final = (
    "udpin:[HOST:]PORT, udpout:HOST:PORT, udp:[HOST:]PORT, tcp:HOST:PORT, tcpin:[HOST:]PORT, or a serial device with"
    " its baud rate (/dev/ttyACM0,115200)"
)

_BATCH: Final = 1024  # datagrams of one read: a flood must let others have their turn
_DATAGRAM_BYTES: Final = 1 << 16
Reads = list[tuple[str, bytes]]
_LOG: Final = logging.getLogger(__name__)
_RECEIVE_BUFFER: Final = 16 << 20
_READ: Final = 1 << 16
_SMALL_BUFFER: Final = 1 << 20
_RECEIVE_BUFFER_FORCE: Final = 33  # Linux: beyond what the system allows everybody, for who may
_CONNECT_S: Final = 0.25


class LinkKind(StrEnum):
    """Kinds of links."""

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


def sender_name(place: tuple[object, ...]) -> str:
    """``host:port`` of a socket address."""
    return f"{place[0]}:{place[1]}"


def _resolve(address: LinkAddress, kind: socket.SocketKind) -> tuple[socket.AddressFamily, tuple[str, int]]:
    """Family and numeric address of the host, IPv4 first."""
    found = socket.getaddrinfo(address.host, address.port, type=kind)
    family, _, _, _, place = min(found, key=lambda entry: entry[0] != socket.AF_INET)
    return family, (str(place[0]), int(place[1]))


def _widen(sock: socket.socket, text: str) -> None:
    """Ask for a receive buffer that bursts and floods fit into; say where the system does not give it."""
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
    if sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) < _RECEIVE_BUFFER:
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, _RECEIVE_BUFFER_FORCE, _RECEIVE_BUFFER)
    size = sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    if size < _SMALL_BUFFER:
        hint = f"sysctl -w net.core.rmem_max={_RECEIVE_BUFFER}"
        _LOG.warning("%s: the system gives a receive buffer of %d KiB, bursts may be lost; %s", text, size >> 10, hint)


class UdpTransport:
    """Datagrams from any number of senders (``udpin``), or to and from one peer (``udpout``).

    Raises:
        OSError: It cannot be opened.
    """

    def __init__(self, address: LinkAddress) -> None:
        family, place = _resolve(address, socket.SOCK_DGRAM)
        self._peer = place if address.kind is LinkKind.UDP_OUT else None
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            _widen(self._socket, address.text)
            self._socket.setblocking(False)
            # No SO_REUSEADDR: on Linux two programs would then share the port, and one of them would hear nothing.
            if self._peer is None:
                self._socket.bind(place)
        except OSError:
            self._socket.close()
            raise
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._socket, selectors.EVENT_READ)

    @property
    def local(self) -> tuple[str, int]:
        """Own address."""
        host, port = self._socket.getsockname()[:2]
        return str(host), int(port)

    def read(self, timeout_s: float) -> Reads:
        """Datagrams that have arrived, at most 1024 at once."""
        # Waiting costs a turn of the interpreter, which a flood does not leave time for: only where nothing is there.
        return self._arrived() or (self._arrived() if self._selector.select(timeout_s) else [])

    def _arrived(self) -> Reads:
        reads: Reads = []
        # A refused datagram (nobody listens there yet) is reported on the next read: no fault of this link.
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            while len(reads) < _BATCH:
                data, place = self._socket.recvfrom(_DATAGRAM_BYTES)
                if data:
                    reads.append((sender_name(place), data))
        return reads

    def write(self, data: bytes) -> None:
        """Send to the peer; a listening link only listens."""
        if self._peer is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(data, self._peer)

    def write_to(self, sender: str, data: bytes) -> None:
        """Send to one of the senders, also on a listening link."""
        host, _, port = sender.rpartition(":")
        with contextlib.suppress(OSError):
            self._socket.sendto(data, (host, int(port)))

    def close(self) -> None:
        """Give the port back."""
        self._selector.close()
        self._socket.close()


class _TcpPeers:
    """Connected sockets, read together and written to."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._names: dict[socket.socket, str] = {}

    def _add(self, peer: socket.socket, name: str) -> None:
        """Take over a connected socket."""
        peer.setblocking(False)
        self._names[peer] = name
        self._selector.register(peer, selectors.EVENT_READ)

    def _drop(self, peer: socket.socket) -> None:
        """Forget a peer that has gone."""
        if self._names.pop(peer, None) is not None:
            self._selector.unregister(peer)
            peer.close()

    def _read_from(self, peer: socket.socket) -> tuple[str, bytes]:
        """One read; empty bytes where the peer has gone."""
        name = self._names[peer]
        try:
            data = peer.recv(_READ)
        except OSError:
            data = b""
        if not data:
            _LOG.warning("%s has closed the connection", name)
            self._drop(peer)
        return name, data

    def write(self, data: bytes) -> None:
        """Send to all; one that does not take it is dropped."""
        for peer in tuple(self._names):
            self._send(peer, data)

    def write_to(self, sender: str, data: bytes) -> None:
        """Send to one; where it does not take it, it is dropped."""
        for peer in [each for each, name in self._names.items() if name == sender]:
            self._send(peer, data)

    def _send(self, peer: socket.socket, data: bytes) -> None:
        try:
            peer.send(data)
        except BlockingIOError:
            return
        except OSError:
            self._drop(peer)

    def close(self) -> None:
        """Close all."""
        for peer in tuple(self._names):
            self._drop(peer)
        self._selector.close()


class TcpListener(_TcpPeers):
    """Waits for peers to connect (``tcpin``).

    Raises:
        OSError: It cannot be opened.
    """

    def __init__(self, address: LinkAddress) -> None:
        family, place = _resolve(address, socket.SOCK_STREAM)
        self._listener = socket.create_server(place, family=family)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        self._listener.setblocking(False)
        super().__init__()
        self._selector.register(self._listener, selectors.EVENT_READ)

    @property
    def local(self) -> tuple[str, int]:
        """Own address."""
        host, port = self._listener.getsockname()[:2]
        return str(host), int(port)

    def read(self, timeout_s: float) -> Reads:
        """Bytes that the peers have sent; accepts new peers."""
        reads: Reads = []
        for key, _ in self._selector.select(timeout_s):
            if key.fileobj is self._listener:
                with contextlib.suppress(OSError):
                    peer, place = self._listener.accept()
                    self._add(peer, sender_name(place))
                    _LOG.info("%s has connected", sender_name(place))
            elif isinstance(key.fileobj, socket.socket):
                reads.append(self._read_from(key.fileobj))
        return reads

    def close(self) -> None:
        """Give the port back."""
        self._selector.unregister(self._listener)
        self._listener.close()
        super().close()


class TcpClient(_TcpPeers):
    """Connects to a peer (``tcp``), and again whenever the connection is lost.

    Raises:
        OSError: The host is unknown.
    """

    def __init__(self, address: LinkAddress) -> None:
        self._family, self._place = _resolve(address, socket.SOCK_STREAM)
        super().__init__()
        self._complained = False

    def read(self, timeout_s: float) -> Reads:
        """Bytes that the peer has sent; tries to connect where nobody is connected."""
        if not self._names and not self._connect():
            self._selector.select(timeout_s)
            return []
        return [
            self._read_from(key.fileobj)
            for key, _ in self._selector.select(timeout_s)
            if isinstance(key.fileobj, socket.socket)
        ]

    def _connect(self) -> bool:
        peer = socket.socket(self._family, socket.SOCK_STREAM)
        try:
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            peer.settimeout(_CONNECT_S)
            peer.connect(self._place)
        except OSError as error:
            peer.close()
            if not self._complained:
                _LOG.warning("%s does not answer (%s); trying again", sender_name(self._place), error.strerror or error)
                self._complained = True
            return False
        self._complained = False
        self._add(peer, sender_name(self._place))
        _LOG.info("connected to %s", sender_name(self._place))
        return True


class SerialTransport:
    """A serial device; comes back by itself after it was unplugged.

    Raises:
        OSError: It cannot be opened.
    """

    def __init__(self, address: LinkAddress) -> None:
        self._device, self._baud = address.host, address.port
        self._port: serial.Serial | None = self._open()

    def _open(self) -> serial.Serial:
        return serial.Serial(self._device, self._baud, timeout=0, write_timeout=0, exclusive=True)

    def read(self, timeout_s: float) -> Reads:
        """Bytes that have arrived; tries to open the device again where it was lost."""
        if self._port is None:
            with contextlib.suppress(OSError):
                self._port = self._open()
                _LOG.info("%s is back", self._device)
        if self._port is None:
            with selectors.DefaultSelector() as selector:
                selector.select(timeout_s)
            return []
        try:
            self._port.timeout = timeout_s
            data = self._port.read(1)
            data += self._port.read(self._port.in_waiting)
        except OSError as error:
            _LOG.warning("%s is lost (%s); trying again", self._device, error.strerror or error)
            self.close()
            return [(self._device, b"")]
        return [(self._device, data)] if data else []

    def write(self, data: bytes) -> None:
        """Send, if the device is there."""
        if self._port is not None:
            with contextlib.suppress(OSError):
                self._port.write(data)

    def write_to(self, sender: str, data: bytes) -> None:  # noqa: ARG002 - there is but one at the other end
        """Send, if the device is there."""
        self.write(data)

    def close(self) -> None:
        """Give the device back."""
        if self._port is not None:
            self._port.close()
            self._port = None


Transport: TypeAlias = UdpTransport | TcpListener | TcpClient | SerialTransport
"""One open link.

``read`` gives what has arrived, each with its sender, empty after ``timeout_s`` without any; empty bytes say that their
sender has gone. ``write`` sends to whoever is at the other end, if anybody is; ``write_to`` to one of those that
``read`` named, if it is still there.
"""


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
    return LinkError(what, where=address.text, got=error)
