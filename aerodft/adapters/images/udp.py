"""A UDP port as a readable file.

Unlike FFmpeg's own it stops at once, is bound before anything runs, tells when each byte came, and drops what a
stranger sends in between.
"""

import errno
import ipaddress
import logging
import socket
import struct
import threading
import time
from bisect import bisect_right
from collections import deque
from urllib.parse import urlsplit

from aerodft.errors import ConfigError, LinkError
from aerodft.service.ports import Clock

_BUFFER_BYTES = 4 << 20
_DATAGRAM_BYTES = 65_535
_POLL_S = 0.1
_TRANSPORT = "mpegts"
_TRANSPORT_SYNC, _TRANSPORT_BYTES = b"\x47", 188
_RTP_VERSION = 2
_LOG = logging.getLogger(__name__)
_REMEMBERED = 8192  # datagrams: 10 MB of transport stream, more than any image


class UdpFile:
    """The datagrams of one port, one after the other, and when each came."""

    def __init__(self, url: str, *, clock: Clock, stopping: threading.Event, silence_s: float) -> None:
        """Bind the port.

        Args:
            url: ``udp://HOST:PORT`` with the local address to listen on, or a multicast group; ``@`` is ignored.
            clock: Tells when a datagram came.
            stopping: Ends every read when set.
            silence_s: How long a silence counts as the stream's end, once there was something.

        Raises:
            ConfigError: No host or port in the URL.
            LinkError: The port is taken, or the address is none of this machine's.
        """
        host, port = _address(url)
        self._clock = clock
        self._stopping = stopping
        self._silence_s = silence_s
        self._rest = b""
        self._format: str | None = None
        self._heard_s: float | None = None
        self._received = 0
        self._arrivals: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)  # (offset of the first byte, host UTC)
        self.dropped = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            self._bind(host, port)
        except OSError as error:
            self._socket.close()
            hint = "another program listens there; choose another port" if error.errno == errno.EADDRINUSE else ""
            raise LinkError("cannot listen for images", where=url, got=error.strerror or "", hint=hint) from None
        self._socket.settimeout(_POLL_S)

    def await_format(self) -> str | None:
        """Wait for the first datagram of a stream, dropping what is none; its bytes are at offset 0.

        Returns:
            FFmpeg's name of the format; None where the file was told to stop.
        """
        self._rest, self._heard_s, self._received, self._format = b"", None, 0, None
        self._arrivals.clear()
        while not self._rest and not self._stopping.is_set():
            self._receive()
        return self._format

    def _receive(self) -> None:
        """Take one datagram in, or nothing."""
        try:
            data = self._socket.recv(_DATAGRAM_BYTES)
        except TimeoutError:
            return
        found = _format_of(data)
        if found is None if self._format is None else self._format == _TRANSPORT and found != _TRANSPORT:
            if not self.dropped:
                _LOG.warning("UDP port %d: dropped a datagram that holds %s", self.port, _described(data))
            self.dropped += 1
            return
        self._format = self._format or found
        self._rest = data
        self._heard_s = time.monotonic()
        self._arrivals.append((self._received, self._clock.now_ns()))
        self._received += len(data)

    def _bind(self, host: str, port: int) -> None:
        if not ipaddress.ip_address(host).is_multicast:
            self._socket.bind((host, port))
            return
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.bind((host, port))
        group = struct.pack("4sl", socket.inet_aton(host), socket.INADDR_ANY)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)

    @property
    def port(self) -> int:
        """The port that is listened on; tells which one the system chose for port 0."""
        return int(self._socket.getsockname()[1])

    def read(self, size: int) -> bytes:
        """At most ``size`` bytes, as soon as there are any; nothing at the end: told to stop, or silence."""
        while not self._rest:
            if self._stopping.is_set() or self._is_silent():
                return b""
            self._receive()
        data, self._rest = self._rest[:size], self._rest[size:]
        return data

    def arrival_ns(self, offset: int) -> int | None:
        """When the byte at ``offset`` of the stream came; None where that is forgotten.

        A transport stream's image ends only where the next one begins: its own first byte tells the truth, a period
        before the demuxer lets it out.
        """
        at = bisect_right(self._arrivals, offset, key=lambda arrival: arrival[0])
        return self._arrivals[at - 1][1] if at else None

    def _is_silent(self) -> bool:
        return self._heard_s is not None and time.monotonic() - self._heard_s > self._silence_s

    def close(self) -> None:
        """Release the port."""
        self._socket.close()


def _format_of(datagram: bytes) -> str | None:
    if datagram[:1] == _TRANSPORT_SYNC and datagram[_TRANSPORT_BYTES : _TRANSPORT_BYTES + 1] in (b"", _TRANSPORT_SYNC):
        return _TRANSPORT
    return "h264" if datagram.startswith((b"\0\0\1", b"\0\0\0\1")) else None


def _described(datagram: bytes) -> str:
    if datagram[:1] and datagram[0] >> 6 == _RTP_VERSION:
        return "RTP, which needs a session description: give the path of an .sdp file instead"
    return f"neither a transport stream nor H.264 but {datagram[:8].hex(' ')}..."


def _address(url: str) -> tuple[str, int]:
    try:
        parts = urlsplit(url)
        host, port = parts.hostname or "0.0.0.0", parts.port  # noqa: S104 (what udp://:PORT means everywhere)
        if port is not None:
            return socket.gethostbyname(host), port
    except (ValueError, OSError):
        pass  # an impossible port, an unknown host: told below, as a missing one
    raise ConfigError("not a UDP address", where=url, expected="udp://HOST:PORT")
