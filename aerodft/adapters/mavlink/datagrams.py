"""Many datagrams with one call to the system, so that a flood does not starve who sends among it.

Read one by one, each datagram hands the interpreter over to whichever thread computes, and a flood overruns the socket
meanwhile.
"""

import contextlib
import ctypes
import errno
import mmap
import os
import socket
import struct
import time
from typing import Final

import numpy as np

BATCH: Final = 1024
_SLOT: Final = 1 << 16
_NAME: Final = 28  # sockaddr_in6
_NAME_V4: Final = 8  # sockaddr_in without its padding
_MOST_NAMES: Final = 4096
_GATHER_S: Final = 0.004
_CROWD: Final = range(8, BATCH // 4)  # so many at once: more than 2000 messages a second, and no flood
_HARMLESS: Final = {errno.EAGAIN, errno.EINTR, errno.ECONNREFUSED}

Reads = list[tuple[str, bytes]]


class _IoVec(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("size", ctypes.c_size_t))


class _Head(ctypes.Structure):
    """``struct msghdr``."""

    _fields_ = (
        ("name", ctypes.c_void_p),
        ("name_size", ctypes.c_uint32),
        ("iov", ctypes.c_void_p),
        ("iov_count", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_size", ctypes.c_size_t),
        ("flags", ctypes.c_int),
    )


class _Message(ctypes.Structure):
    """``struct mmsghdr``."""

    _fields_ = (("head", _Head), ("size", ctypes.c_uint))


def sender_name(place: tuple[object, ...]) -> str:
    """``host:port`` of a socket address."""
    return f"{place[0]}:{place[1]}"


def read_each(sock: socket.socket) -> Reads:
    """The same one by one, for systems that cannot do better."""
    reads: Reads = []
    # A refused datagram (nobody listens there yet) is reported on the next read: no fault of this link.
    with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
        while len(reads) < BATCH:
            data, place = sock.recvfrom(_SLOT)
            if data:
                reads.append((sender_name(place), data))
    return reads


class BatchReader:
    """Reads a UDP socket that does not block.

    Args:
        sock: The socket; it stays the caller's.

    Raises:
        AttributeError: The system has no ``recvmmsg``.
    """

    def __init__(self, sock: socket.socket) -> None:
        self._receive = ctypes.CDLL(None, use_errno=True).recvmmsg
        self._socket = sock
        self._place_size = _NAME if sock.family == socket.AF_INET6 else _NAME_V4
        self._data = mmap.mmap(-1, BATCH * _SLOT)  # takes memory only where a datagram came to lie
        self._places = bytearray(BATCH * _NAME)
        data = ctypes.addressof(ctypes.c_char.from_buffer(self._data))
        places = ctypes.addressof(ctypes.c_char.from_buffer(self._places))
        self._vectors = (_IoVec * BATCH)(*[_IoVec(data + k * _SLOT, _SLOT) for k in range(BATCH)])
        first, size = ctypes.addressof(self._vectors), ctypes.sizeof(_IoVec)
        heads = [_Head(places + k * _NAME, _NAME, first + k * size, 1) for k in range(BATCH)]
        self._messages = (_Message * BATCH)(*[_Message(head) for head in heads])
        table = np.frombuffer(memoryview(self._messages), dtype=np.dtype(_Message))
        self._sizes, self._place_sizes = table["size"], table["head"]["name_size"]
        rows = np.frombuffer(self._places, dtype=np.uint8).reshape(BATCH, _NAME)
        self._places_by_row = rows[:, : self._place_size]
        self._names: dict[bytes, str] = {}
        self._is_crowded = False

    def read(self) -> Reads:
        """What has arrived, at most ``BATCH`` datagrams; those of one sender together, in their order.

        Where they come thick and fast it gathers them for 4 ms first: that takes a quarter of the time.

        Raises:
            OSError: The socket is broken.
        """
        if self._is_crowded:
            time.sleep(_GATHER_S)
        self._place_sizes[:] = _NAME
        count = self._receive(self._socket.fileno(), self._messages, BATCH, socket.MSG_DONTWAIT, None)
        self._is_crowded = count in _CROWD
        if count < 0:
            code = ctypes.get_errno()
            if code in _HARMLESS:
                return []
            raise OSError(code, os.strerror(code))
        data, places = memoryview(self._data), self._places_by_row[:count]
        parts = [data[k * _SLOT : k * _SLOT + size] for k, size in enumerate(self._sizes[:count].tolist())]
        if not count or (places == places[0]).all():  # of one sender, as nearly always
            of_senders = {places[0].tobytes(): parts} if count else {}
        else:
            of_senders = {}
            for place, part in zip(map(bytes, places), parts, strict=True):
                of_senders.setdefault(place, []).append(part)
        joined = ((place, b"".join(pieces)) for place, pieces in of_senders.items())
        return [(self._name(place), whole) for place, whole in joined if whole]

    def _name(self, place: bytes) -> str:
        name = self._names.get(place)
        if name is None:
            if len(self._names) >= _MOST_NAMES:
                self._names.clear()
            self._names[place] = name = _numeric(place)
        return name


def _numeric(place: bytes) -> str:
    """A ``sockaddr`` as ``host:port``."""
    (family,) = struct.unpack_from("=H", place)
    (port,) = struct.unpack_from("!H", place, 2)
    host = place[8:24] if family == socket.AF_INET6 else place[4:8]
    return sender_name((socket.inet_ntop(family, host), port))
