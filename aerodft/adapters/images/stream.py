"""Live streams: read in a thread, stamped by the host's clock, newest image first when somebody is slow."""

import errno
import ipaddress
import logging
import re
import socket
import struct
import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

import av
from av.bitstream import BitStreamFilterContext
from av.container import InputContainer
from av.video.stream import VideoStream

from aerodft.adapters.images.pixels import FramePixels
from aerodft.conventions import SECOND_NS
from aerodft.errors import ConfigError, LinkError
from aerodft.model import Image, StampClock, VideoPacket
from aerodft.service import Clock

_WINDOW_NS = 5 * SECOND_NS
_JUMP_NS = SECOND_NS
_QUIET_NS = SECOND_NS // 2
_PATIENCE_NS = 2 * SECOND_NS
_IMPROVEMENT_NS = 2_000_000


class ArrivalClock:
    """Maps presentation stamps (ns, any zero) to the host's clock, by the images that were delayed least.

    A stream says when an image was shown after the one before, exactly, but not what time it is; arrival says what time
    it is, late by encoding, network and buffers. ``arrival - pts`` is that delay plus a constant, so its minimum over a
    few seconds is the constant plus the smallest delay; the rest of the jitter is gone. The smallest delay itself
    cannot be seen from here: it is what the configured time offset is for.
    """

    def __init__(self) -> None:
        self._minima: deque[tuple[int, int]] = deque()  # (arrival, delay); both increase
        self._last_pts_ns = 0
        self._last_arrival_ns = 0
        self._first_arrival_ns = 0
        self._improved_ns = 0
        self.resets = 0

    def observe(self, pts_ns: int, arrival_ns: int) -> None:
        """Take one packet into account.

        Args:
            pts_ns: Its presentation stamp; may step back a little where images are stored out of order.
            arrival_ns: Host UTC, not decreasing.
        """
        if self._minima and self._has_jumped(pts_ns, arrival_ns):
            self._minima.clear()
            self.resets += 1
        self._last_pts_ns, self._last_arrival_ns = pts_ns, arrival_ns
        delay_ns = arrival_ns - pts_ns
        if not self._minima:
            self._first_arrival_ns = self._improved_ns = arrival_ns
        elif delay_ns < self._minima[0][1] - _IMPROVEMENT_NS:
            self._improved_ns = arrival_ns
        while self._minima and self._minima[-1][1] >= delay_ns:
            self._minima.pop()
        self._minima.append((arrival_ns, delay_ns))
        while self._minima[0][0] < arrival_ns - _WINDOW_NS:
            self._minima.popleft()

    def _has_jumped(self, pts_ns: int, arrival_ns: int) -> bool:
        """Whether the sender started anew: its time went back, or on much farther than ours."""
        step_ns = pts_ns - self._last_pts_ns
        return step_ns < -_JUMP_NS or step_ns > arrival_ns - self._last_arrival_ns + _JUMP_NS

    @property
    def settled(self) -> bool:
        """Whether the least delay has stopped to improve; stamps before that would be late by a start-up burst."""
        if not self._minima:
            return False
        quiet = self._last_arrival_ns - self._improved_ns >= _QUIET_NS
        return quiet or self._last_arrival_ns - self._first_arrival_ns >= _PATIENCE_NS

    def stamp_ns(self, pts_ns: int) -> int:
        """Host UTC of a presentation stamp.

        Raises:
            ValueError: Nothing was observed yet.
        """
        if not self._minima:
            raise ValueError("no packet was observed yet")
        return pts_ns + self._minima[0][1]


_BUFFER_BYTES = 4 << 20
_DATAGRAM_BYTES = 65_535
_POLL_S = 0.1
_TRANSPORT = "mpegts"
_TRANSPORT_SYNC, _TRANSPORT_BYTES = b"\x47", 188
_RTP_VERSION = 2
_REMEMBERED = 8192  # datagrams: 10 MB of transport stream, more than any image


class UdpFile:
    """The datagrams of one UDP port as a readable file, one after the other, and when each came.

    Unlike FFmpeg's own it stops at once, is bound before anything runs, tells when each byte came, and drops what a
    stranger sends in between.
    """

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
            raise LinkError("cannot listen for images", where=url, got=error, hint=hint) from None
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
        """Arrival of the byte at ``offset`` of the stream; None where that is forgotten.

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


_LOG = logging.getLogger(__name__)
_CODEC = "h264"
_UNIT = re.compile(rb"\x00\x00\x01")
_TYPE_MASK = 0x1F
_PARAMETER_SETS = frozenset({7, 8})  # of the sequence, of pictures
_SETS_BYTES = 4096  # they stand in front of a packet
_WAITING = 4  # images between reading and delivery; the oldest gives way
_OPEN_S = 4.0
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.2, 5.0
_STOP_S = 0.9
_OPTIONS = {  # not fflags=nobuffer: FFmpeg then drops all that it probed, the first key image among it
    "flags": "low_delay",
    "analyzeduration": "500000",
    "probesize": "500000",
    "rtsp_transport": "tcp",
    "protocol_whitelist": "file,rtp,udp,tcp,tls,rtsp,http,https,crypto,data",
}


class PacketTap:
    """Hands the packets of one H.264 stream on as they came, in the form that recordings have them.

    That is Annex B, one image a packet, decodable from every key image on.

    A stream of another codec, or whose images refer to later ones, is not handed on.

    Args:
        stream: The stream.
        where: Its name in messages.
        on_packet: Takes the packets; None for nobody.
    """

    def __init__(self, stream: VideoStream, where: str, on_packet: Callable[[VideoPacket], None] | None) -> None:
        self._where = where
        self._on_packet = on_packet if stream.codec_context.name == _CODEC else None
        self._filter = BitStreamFilterContext("h264_mp4toannexb", stream) if self._on_packet is not None else None
        self._sets: dict[int, bytes] = {}
        self._last_pts: int | None = None

    def __call__(self, packet: "av.Packet[VideoStream]", image: Image | None, now_ns: int) -> None:
        """Hand over a packet, with the image that it became, if it became one."""
        if self._filter is None or self._on_packet is None or not packet.size:
            return
        if packet.pts is not None:
            if self._last_pts is not None and packet.pts <= self._last_pts:
                _LOG.warning("%s: its images refer to later ones: it is recorded as JPEGs", self._where)
                self._on_packet = None
                return
            self._last_pts = packet.pts
        is_key = packet.is_keyframe  # the filter takes the packet's content away
        data = self._data(self._filter, packet)
        if data:
            arrival_ns = now_ns if image is None else image.arrival_ns
            stamp_ns, index = (now_ns, None) if image is None else (image.stamp_ns, image.index)
            self._on_packet(
                VideoPacket(data=data, is_key=is_key, stamp_ns=stamp_ns, arrival_ns=arrival_ns, index=index)
            )

    def _data(self, annexb: BitStreamFilterContext, packet: "av.Packet[VideoStream]") -> bytes:
        """The packet in Annex B form, a key image with its parameter sets; empty where it is damaged."""
        is_key = packet.is_keyframe
        try:
            data = b"".join(bytes(part) for part in annexb.filter(packet))
        except av.FFmpegError:
            return b""
        sets = {kind: unit for kind, unit in _units(data) if kind in _PARAMETER_SETS}
        self._sets |= sets
        if is_key and not sets:
            data = b"".join(self._sets[kind] for kind in sorted(self._sets)) + data
        return data


def _units(data: bytes) -> list[tuple[int, bytes]]:
    """Type and bytes of the units that begin early in a packet, start codes included."""
    starts = [found.start() for found in _UNIT.finditer(data[:_SETS_BYTES]) if found.end() < len(data)]
    ends = [*starts[1:], len(data)]
    return [(data[a + 3] & _TYPE_MASK, b"\0" + data[a:b].rstrip(b"\0")) for a, b in zip(starts, ends, strict=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamStatus:
    """State of a stream: whether it is connected, images delivered and left out, and losses.

    Attributes:
        connected: Whether images are coming.
        images: Delivered so far.
        left_out: Images that came and were not delivered, by cause: ``too_many`` for the receiver, ``damaged``,
            ``not_later`` than the one before, before the first key image (``undecodable``), or before the stream's
            clock was known (``unstamped``).
        losses: How often the stream broke off.
        reason: Of the last loss.
    """

    connected: bool = False
    images: int = 0
    left_out: Mapping[str, int] = field(default_factory=dict)
    losses: int = 0
    reason: str = ""


class StreamReader:
    """A live stream: ``udp://`` (MPEG-TS or plain H.264), ``rtsp://``, ``/dev/video0``, or what else FFmpeg opens.

    A stream that breaks off is opened again, with a growing pause. Stamps are the host's (``StampClock.HOST``): the
    stream's own, put where the least delayed images arrived, plus the time offset. The first half second is not
    delivered, because its delay is not known yet.
    """

    def __init__(
        self,
        url: str,
        on_image: Callable[[Image], None],
        *,
        clock: Clock,
        on_packet: Callable[[VideoPacket], None] | None = None,
        time_offset_s: float = 0.0,
        silence_s: float = 3.0,
    ) -> None:
        """Describe the stream; nothing is opened yet.

        Args:
            url: The stream.
            on_image: Called with each image, from one thread; while it takes long, older images give way.
            clock: The host's clock.
            on_packet: Called with each packet of an H.264 stream whose images come in order, from another thread.
            time_offset_s: Added to every stamp; usually negative, by the time from exposure to arrival.
            silence_s: How long a silence counts as a loss; the stream is then opened again.
        """
        self.url = url
        self._on_image = on_image
        self._on_packet = on_packet
        self._clock = clock
        self._silence_s = silence_s
        self._offset_ns = round(time_offset_s * SECOND_NS)
        self._stopping = threading.Event()
        self._changed = threading.Condition()
        self._waiting: deque[Image] = deque()
        self._status = StreamStatus()
        self._index = 0
        self._last_stamp_ns = 0
        self._udp: UdpFile | None = None
        self._reader = threading.Thread(target=self._run, name="image-reader", daemon=True)
        self._deliverer = threading.Thread(target=self._deliver, name="image-delivery", daemon=True)

    @property
    def status(self) -> StreamStatus:
        """State of the stream now."""
        return self._status

    def start(self) -> None:
        """Begin; once only.

        Raises:
            ConfigError: A UDP address without a port.
            LinkError: The UDP port is taken, or the device does not exist.
        """
        if self.url.startswith("udp:"):
            self._udp = UdpFile(self.url, clock=self._clock, stopping=self._stopping, silence_s=self._silence_s)
        elif self.url.startswith("/") and not Path(self.url).exists():
            raise LinkError("no such device", where=self.url, hint="is the camera plugged in?")
        self._reader.start()
        self._deliverer.start()

    def stop(self) -> None:
        """End within a second; no call of ``on_image`` begins after this returns.

        A connection that hangs in a foreign server's hands is left behind, and ends by its own time limit.
        """
        self._stopping.set()
        with self._changed:
            self._changed.notify_all()
        for thread in (self._deliverer, self._reader):
            if thread.is_alive():
                thread.join(_STOP_S)
        if self._udp is not None:
            self._udp.close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _run(self) -> None:
        pause_s = _FIRST_PAUSE_S
        while not self._stopping.is_set():
            before = self._index
            try:
                with self._opened() as (container, stream):
                    self._read(container, stream)
                reason = "it ended, or fell silent"
            except (av.FFmpegError, OSError) as error:
                reason = error.strerror or "unreadable"
            if self._stopping.is_set():
                return
            pause_s = _FIRST_PAUSE_S if self._index > before else min(2 * pause_s, _LONGEST_PAUSE_S)
            with self._changed:
                losses = self._status.losses + 1
                self._status = replace(self._status, connected=False, losses=losses, reason=reason)
            _LOG.warning("%s: no images (%s); trying again in %.1f s", self.url, reason, pause_s)
            self._stopping.wait(pause_s)

    @contextmanager
    def _opened(self) -> Iterator[tuple[InputContainer, VideoStream]]:
        if self._udp is not None:
            kind = self._udp.await_format()
            container = av.open(self._udp, "r", format=kind, options=_OPTIONS, metadata_errors="replace")
        else:
            kind = "v4l2" if self.url.startswith("/dev/video") else None
            container = av.open(
                self.url,
                "r",
                format=kind,
                options=_OPTIONS,
                timeout=(_OPEN_S, self._silence_s),
                metadata_errors="replace",
            )
        with container:
            if not container.streams.video:
                raise OSError(0, "it carries no video")
            stream = container.streams.video[0]
            stream.thread_type = "SLICE"  # decoding several images at once would hold each one back
            yield container, stream

    def _read(self, container: InputContainer, stream: VideoStream) -> None:
        arrivals = ArrivalClock()
        tap = PacketTap(stream, self.url, self._on_packet)
        base = stream.time_base or Fraction(1, SECOND_NS)
        seen_key = False
        for packet in container.demux(stream):
            if self._stopping.is_set():
                return
            arrival_ns = self._arrival_ns(packet.pos)
            if packet.pts is not None:
                arrivals.observe(round(packet.pts * base * SECOND_NS), arrival_ns)
            if not seen_key and packet.is_keyframe:
                seen_key = True
                _LOG.info("%s: first key image", self.url)
            if seen_key:
                image = self._decode(packet, base, arrivals, arrival_ns)
                tap(packet, image, self._clock.now_ns())
            elif packet.size:
                self._leave_out("undecodable")

    def _arrival_ns(self, offset: int | None) -> int:
        known = self._udp.arrival_ns(offset) if self._udp is not None and offset is not None and offset >= 0 else None
        return self._clock.now_ns() if known is None else known

    def _decode(
        self, packet: "av.Packet[VideoStream]", base: Fraction, arrivals: ArrivalClock, arrival_ns: int
    ) -> Image | None:
        """Decode a packet and deliver what it gives; returns the last of it."""
        image: Image | None = None
        try:
            frames = packet.decode()
        except av.FFmpegError:
            self._leave_out("damaged")
            return None
        for frame in frames:
            if frame.pts is None:
                stamp_ns = arrival_ns
            elif arrivals.settled:
                stamp_ns = arrivals.stamp_ns(round(frame.pts * base * SECOND_NS))
            else:
                self._leave_out("unstamped")
                continue
            if frame.is_corrupt or stamp_ns <= self._last_stamp_ns:
                self._leave_out("damaged" if frame.is_corrupt else "not_later")
                continue
            self._last_stamp_ns = stamp_ns
            image = self._put(frame, stamp_ns)
        return image

    def _put(self, frame: av.VideoFrame, stamp_ns: int) -> Image:
        image = Image(
            index=self._index,
            stamp_ns=stamp_ns + self._offset_ns,
            arrival_ns=self._clock.now_ns(),
            clock=StampClock.HOST,
            width_px=frame.width,
            height_px=frame.height,
            pixels=FramePixels(frame),
        )
        self._index += 1
        with self._changed:
            if not self._status.connected:
                self._status = replace(self._status, connected=True)
                _LOG.info("%s: images are coming, %d x %d px", self.url, frame.width, frame.height)
            if len(self._waiting) == _WAITING:
                self._waiting.popleft()
                self._leave_out("too_many")
            self._waiting.append(image)
            self._changed.notify_all()
        return image

    def _leave_out(self, cause: str) -> None:
        with self._changed:
            left_out = self._status.left_out
            self._status = replace(self._status, left_out={**left_out, cause: left_out.get(cause, 0) + 1})

    def _deliver(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._stopping.is_set())
                if self._stopping.is_set():
                    return
                image = self._waiting.popleft()
                self._status = replace(self._status, images=self._status.images + 1)
            self._on_image(image)
