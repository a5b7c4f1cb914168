"""A live MAVLink link: a thread that reads, one framer for every sender, and whole frames handed on."""

import logging
import queue
import threading
import time
from typing import Final, Self

from pymavlink.dialects.v20 import ardupilotmega

from aerodft.adapters.telemetry.mavlink.framing import FrameCounts, StreamFramer
from aerodft.adapters.telemetry.mavlink.signing import SignatureCheck, SigningCounts
from aerodft.adapters.telemetry.mavlink.transport import (
    LinkAddress,
    LinkKind,
    Reads,
    TcpListener,
    Transport,
    UdpTransport,
    open_transport,
    parse_address,
)
from aerodft.model import WireProtocol
from aerodft.service import Inbox

_LOG: Final = logging.getLogger(__name__)
_MAX_SENDERS: Final = 64
_NAMED_SENDERS: Final = 16  # strangers must not fill the log
_MAGICS: Final = (b"\xfd", b"\xfe")
_WAIT_S: Final = 0.1
_HEARTBEAT_S: Final = 1.0
_STOP_S: Final = 2.0
_OVERDUE_S: Final = 0.5  # what is not whole after that is cut: 280 bytes take 0.2 s at 14400 baud
OWN_SYSTEM: Final = 255
OWN_COMPONENT: Final = 190


class Senders:
    """Frames out of the bytes of any number of senders, in bounded memory.

    Args:
        link: The link's name, for the log.
    """

    def __init__(self, link: str) -> None:
        self._link = link
        self._framers: dict[str, StreamFramer] = {}
        self._gone = FrameCounts()
        self._admitted = 0

    @property
    def counts(self) -> FrameCounts:
        """Counts of all senders so far, those that have gone included."""
        return sum((framer.counts for framer in tuple(self._framers.values())), self._gone)

    def push(self, sender: str, data: bytes) -> list[bytes]:
        """Whole frames that are complete with these bytes; no bytes say that the sender has gone."""
        framer = self._framers.get(sender)
        if framer is None:
            if not any(magic in data for magic in _MAGICS):
                self._gone += FrameCounts(skipped_bytes=len(data))
                return []
            framer = self._admit(sender)
        if not data:
            self._forget(sender)
            return []
        return framer.push(data)

    def overdue(self) -> list[tuple[str, list[bytes]]]:
        """Frames, by sender, that wait behind an incomplete one; to be asked for every half second or so."""
        return [(sender, frames) for sender, framer in self._framers.items() if (frames := framer.overdue())]

    def _admit(self, sender: str) -> StreamFramer:
        """A framer for a new sender; where they are too many, one that never sent a good frame gives way first."""
        if len(self._framers) >= _MAX_SENDERS:
            strangers = (name for name, framer in self._framers.items() if not framer.counts.frames)
            self._forget(next(strangers, next(iter(self._framers))))
        self._admitted += 1
        if self._admitted <= _NAMED_SENDERS:
            _LOG.info("%s: first bytes from %s", self._link, sender)
        elif self._admitted == _NAMED_SENDERS + 1:
            _LOG.warning("%s: bytes from more than %d senders", self._link, _NAMED_SENDERS)
        return self._framers.setdefault(sender, StreamFramer())

    def _forget(self, sender: str) -> None:
        self._gone += self._framers.pop(sender).counts


class MavlinkLink:
    """One live link, open from construction to ``close``; usable with ``with``.

    A peer that waits to be spoken to (``udpout``, ``tcp``, ``tcpin``, serial) gets a ground station's heartbeat once a
    second; a ``udpin`` link only listens.

    Args:
        address: A connection string, or a parsed one.
        inbox: Takes the frames, on the link's own thread.
        signing: Decides which frames are believed and signs what is sent; None on a link without keys. It stays the
            caller's to close, after the link.

    Raises:
        LinkError: The string makes no sense, the port is busy, the host unknown, the device missing.
    """

    def __init__(self, address: str | LinkAddress, inbox: Inbox, *, signing: SignatureCheck | None = None) -> None:
        self.address = parse_address(address) if isinstance(address, str) else address
        self._inbox = inbox
        self._signing = signing
        self._senders = Senders(self.address.text)
        StreamFramer().push(_heartbeat())  # compiles on the very first run, which takes seconds: not while bytes wait
        self._transport: Transport = open_transport(self.address)
        self._stop = threading.Event()
        self._outbox: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        _LOG.info("%s: opened %s", self.address.text, self.place)
        self._thread = threading.Thread(target=self._run, name=f"mavlink {self.address.text}", daemon=True)
        self._thread.start()

    @property
    def place(self) -> str:
        """Actual address of the link: own host and port of a listening one, else the peer's."""
        if self.address.kind in {LinkKind.UDP_IN, LinkKind.TCP_IN}:
            return f"{self.address.host}:{self.local_port}"
        return f"{self.address.host}:{self.address.port}"

    @property
    def local_port(self) -> int:
        """Own port number (of use where 0 was asked for); 0 where the link has none."""
        transport = self._transport
        return transport.local[1] if isinstance(transport, UdpTransport | TcpListener) else 0

    @property
    def counts(self) -> FrameCounts:
        """Counts of all senders' frames."""
        return self._senders.counts

    @property
    def signing(self) -> SigningCounts | None:
        """Counts of the frames of a signed link; None on one without keys."""
        return None if self._signing is None else self._signing.counts

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def send(self, sender: str, frame: bytes) -> None:
        """Send an own MAVLink 2 frame to one of the senders, signed where the link is; within a tenth of a second.

        Args:
            sender: As the inbox knows it.
            frame: Unsigned, whole.
        """
        self._outbox.put((sender, frame))

    def close(self) -> None:
        """Stop the thread and give the port back, within half a second."""
        if self._stop.is_set():
            return
        self._stop.set()
        self._thread.join(_STOP_S)
        self._transport.close()

    def _run(self) -> None:
        heartbeat = _heartbeat()
        talks = self.address.kind is not LinkKind.UDP_IN
        due_s = overdue_s = time.monotonic()
        while not self._stop.is_set():
            while not self._outbox.empty():
                sender, frame = self._outbox.get()
                self._transport.write_to(sender, self._signed(frame))
            if talks and time.monotonic() >= due_s:
                self._transport.write(self._signed(heartbeat))
                due_s = time.monotonic() + _HEARTBEAT_S
            try:
                reads = self._transport.read(_WAIT_S)
            except OSError as error:
                _LOG.warning("%s: reading failed (%s); trying again", self.address.text, error.strerror or error)
                self._stop.wait(_HEARTBEAT_S / 4)
                continue
            self._take(reads)
            if time.monotonic() >= overdue_s:
                for sender, frames in self._senders.overdue():
                    self._put(sender, frames)
                overdue_s = time.monotonic() + _OVERDUE_S

    def _signed(self, frame: bytes) -> bytes:
        return frame if self._signing is None else self._signing.sign(frame)

    def _take(self, reads: Reads) -> None:
        for sender, data in reads:
            self._put(sender, self._senders.push(sender, data))
        if self._signing is not None:
            self._signing.commit()

    def _put(self, sender: str, frames: list[bytes]) -> None:
        """Hand on what may be believed."""
        if self._signing is not None:
            frames = self._signing.passed(frames)
        if frames:
            self._inbox.put_frames(WireProtocol.MAVLINK, sender, frames)


def _heartbeat() -> bytes:
    """A ground station's HEARTBEAT, MAVLink 2."""
    mav = ardupilotmega.MAVLink(None, srcSystem=OWN_SYSTEM, srcComponent=OWN_COMPONENT)
    message = ardupilotmega.MAVLink_heartbeat_message(
        type=ardupilotmega.MAV_TYPE_GCS,
        autopilot=ardupilotmega.MAV_AUTOPILOT_INVALID,
        base_mode=0,
        custom_mode=0,
        system_status=ardupilotmega.MAV_STATE_ACTIVE,
        mavlink_version=3,
    )
    return bytes(message.pack(mav))
