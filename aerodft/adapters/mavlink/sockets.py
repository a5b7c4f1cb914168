"""UDP and TCP sockets that give ``(sender, bytes)`` and take bytes to send."""

import contextlib
import logging
import selectors
import socket
from collections.abc import Callable
from functools import partial
from typing import Final

from aerodft.adapters.mavlink.address import LinkAddress, LinkKind
from aerodft.adapters.mavlink.datagrams import BatchReader, Reads, read_each, sender_name

_LOG: Final = logging.getLogger(__name__)
_RECEIVE_BUFFER: Final = 16 << 20
_READ: Final = 1 << 16
_SMALL_BUFFER: Final = 1 << 20
_RECEIVE_BUFFER_FORCE: Final = 33  # Linux: beyond what the system allows everybody, for who may
_CONNECT_S: Final = 0.25

_Read = Callable[[], Reads]


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
        try:
            self._read: _Read = BatchReader(self._socket).read
        except AttributeError:
            self._read = partial(read_each, self._socket)

    @property
    def local(self) -> tuple[str, int]:
        """Own address."""
        host, port = self._socket.getsockname()[:2]
        return str(host), int(port)

    def read(self, timeout_s: float) -> Reads:
        """What has arrived, at most 1024 datagrams at once."""
        # Waiting costs a turn of the interpreter, which a flood does not leave time for: only where nothing is there.
        return self._read() or (self._read() if self._selector.select(timeout_s) else [])

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
    """Connected sockets, read together."""

    def __init__(self) -> None:
        self.selector = selectors.DefaultSelector()
        self.names: dict[socket.socket, str] = {}

    def add(self, peer: socket.socket, name: str) -> None:
        """Take over a connected socket."""
        peer.setblocking(False)
        self.names[peer] = name
        self.selector.register(peer, selectors.EVENT_READ)

    def drop(self, peer: socket.socket) -> None:
        """Forget a peer that has gone."""
        if self.names.pop(peer, None) is not None:
            self.selector.unregister(peer)
            peer.close()

    def read_from(self, peer: socket.socket) -> tuple[str, bytes]:
        """One read; empty bytes where the peer has gone."""
        name = self.names[peer]
        try:
            data = peer.recv(_READ)
        except OSError:
            data = b""
        if not data:
            _LOG.warning("%s has closed the connection", name)
            self.drop(peer)
        return name, data

    def write(self, data: bytes) -> None:
        """Send to all; one that does not take it is dropped."""
        for peer in tuple(self.names):
            self._send(peer, data)

    def write_to(self, name: str, data: bytes) -> None:
        """Send to one; where it does not take it, it is dropped."""
        for peer in [each for each, own in self.names.items() if own == name]:
            self._send(peer, data)

    def _send(self, peer: socket.socket, data: bytes) -> None:
        try:
            peer.send(data)
        except BlockingIOError:
            return
        except OSError:
            self.drop(peer)

    def close(self) -> None:
        """Close all."""
        for peer in tuple(self.names):
            self.drop(peer)
        self.selector.close()


class TcpListener:
    """Waits for peers to connect (``tcpin``).

    Raises:
        OSError: It cannot be opened.
    """

    def __init__(self, address: LinkAddress) -> None:
        family, place = _resolve(address, socket.SOCK_STREAM)
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            self._listener.bind(place)
            self._listener.listen()
            self._listener.setblocking(False)
        except OSError:
            self._listener.close()
            raise
        self._peers = _TcpPeers()
        self._peers.selector.register(self._listener, selectors.EVENT_READ)

    @property
    def local(self) -> tuple[str, int]:
        """Own address."""
        host, port = self._listener.getsockname()[:2]
        return str(host), int(port)

    def read(self, timeout_s: float) -> Reads:
        """What the peers have sent; takes in new ones."""
        reads: Reads = []
        for key, _ in self._peers.selector.select(timeout_s):
            if key.fileobj is self._listener:
                with contextlib.suppress(OSError):
                    peer, place = self._listener.accept()
                    self._peers.add(peer, sender_name(place))
                    _LOG.info("%s has connected", sender_name(place))
            elif isinstance(key.fileobj, socket.socket):
                reads.append(self._peers.read_from(key.fileobj))
        return reads

    def write(self, data: bytes) -> None:
        """Send to all peers."""
        self._peers.write(data)

    def write_to(self, sender: str, data: bytes) -> None:
        """Send to one peer, if it is still connected."""
        self._peers.write_to(sender, data)

    def close(self) -> None:
        """Give the port back."""
        self._peers.selector.unregister(self._listener)
        self._listener.close()
        self._peers.close()


class TcpClient:
    """Connects to a peer (``tcp``), and again whenever the connection is lost.

    Raises:
        OSError: The host is unknown.
    """

    def __init__(self, address: LinkAddress) -> None:
        self._family, self._place = _resolve(address, socket.SOCK_STREAM)
        self._peers = _TcpPeers()
        self._complained = False

    def read(self, timeout_s: float) -> Reads:
        """What the peer has sent; tries to connect where nobody is connected."""
        if not self._peers.names and not self._connect():
            self._peers.selector.select(timeout_s)
            return []
        return [
            self._peers.read_from(key.fileobj)
            for key, _ in self._peers.selector.select(timeout_s)
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
        self._peers.add(peer, sender_name(self._place))
        _LOG.info("connected to %s", sender_name(self._place))
        return True

    def write(self, data: bytes) -> None:
        """Send to the peer, if connected."""
        self._peers.write(data)

    def write_to(self, sender: str, data: bytes) -> None:
        """Send to one peer, if it is still connected."""
        self._peers.write_to(sender, data)

    def close(self) -> None:
        """Close the connection."""
        self._peers.close()
