"""H.264 as it came, for recordings: Annex B, one image a packet, decodable from every key image on."""

import logging
import re
from collections.abc import Callable
from typing import TYPE_CHECKING

import av
from av.bitstream import BitStreamFilterContext

from aerodft.model.packet import VideoPacket

if TYPE_CHECKING:
    from av.video.stream import VideoStream

    from aerodft.model.image import Image

_CODEC = "h264"
_UNIT = re.compile(rb"\x00\x00\x01")
_TYPE_MASK = 0x1F
_PARAMETER_SETS = frozenset({7, 8})  # of the sequence, of pictures
_SETS_BYTES = 4096  # they stand in front of a packet

_log = logging.getLogger(__name__)


class PacketTap:
    """Hands the packets of one stream on, in the form that recordings have them.

    A stream of another codec, or whose images refer to later ones, is not handed on.

    Args:
        stream: The stream.
        where: Its name in messages.
        on_packet: Takes the packets; None for nobody.
    """

    def __init__(self, stream: "VideoStream", where: str, on_packet: Callable[[VideoPacket], None] | None) -> None:
        self._where = where
        self._on_packet = on_packet if stream.codec_context.name == _CODEC else None
        self._filter = BitStreamFilterContext("h264_mp4toannexb", stream) if self._on_packet is not None else None
        self._sets: dict[int, bytes] = {}
        self._last_pts: int | None = None

    def __call__(self, packet: "av.Packet[VideoStream]", image: "Image | None", now_ns: int) -> None:
        """Hand over a packet, with the image that it became, if it became one."""
        if self._filter is None or self._on_packet is None or not packet.size:
            return
        if packet.pts is not None:
            if self._last_pts is not None and packet.pts <= self._last_pts:
                _log.warning("%s: its images refer to later ones: it is recorded as JPEGs", self._where)
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
