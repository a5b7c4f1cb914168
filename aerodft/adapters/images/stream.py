"""Live streams: read in a thread, stamped by the host's clock, newest image first when somebody is slow."""

import logging
import re
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import av
from av.bitstream import BitStreamFilterContext
from av.container import InputContainer
from av.video.stream import VideoStream

from aerodft.adapters.images.arrival import ArrivalClock
from aerodft.adapters.images.pixels import FramePixels
from aerodft.adapters.images.udp import UdpFile
from aerodft.conventions import SECOND_NS
from aerodft.errors import LinkError
from aerodft.model.image import Image, StampClock, VideoPacket
from aerodft.service.ports import Clock

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
_OPTIONS = {
    "fflags": "nobuffer",
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
    """How a stream is doing.

    Attributes:
        connected: Whether images are coming.
        images: Delivered so far.
        left_out: Too many for the receiver, damaged, or stamped not after the one before.
        losses: How often the stream broke off.
        reason: Of the last loss.
    """

    connected: bool = False
    images: int = 0
    left_out: int = 0
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
        """How it is doing now."""
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

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
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
            self._leave_out()
            return None
        for frame in frames:
            if frame.pts is None:
                stamp_ns = arrival_ns
            elif arrivals.settled:
                stamp_ns = arrivals.stamp_ns(round(frame.pts * base * SECOND_NS))
            else:
                continue
            if frame.is_corrupt or stamp_ns <= self._last_stamp_ns:
                self._leave_out()
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
                self._status = replace(self._status, left_out=self._status.left_out + 1)
            self._waiting.append(image)
            self._changed.notify_all()
        return image

    def _leave_out(self) -> None:
        with self._changed:
            self._status = replace(self._status, left_out=self._status.left_out + 1)

    def _deliver(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._stopping.is_set())
                if self._stopping.is_set():
                    return
                image = self._waiting.popleft()
                self._status = replace(self._status, images=self._status.images + 1)
            self._on_image(image)
