"""The images of a recording: JPEGs at a rate, or the packets of a video that is compressed already."""

import logging
import threading
from collections import deque
from dataclasses import replace
from pathlib import Path

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo

from aerodft.adapters.codec.keys import Keys
from aerodft.adapters.images.thinning import is_due
from aerodft.adapters.jpeg import encode_jpeg
from aerodft.adapters.lane import Lane
from aerodft.adapters.mcap.channels import Channel, protobuf_channel
from aerodft.adapters.mcap.foxglove import compressed_image, compressed_video
from aerodft.adapters.mcap.records import image_sequence
from aerodft.adapters.mcap.series import Series
from aerodft.adapters.mcap.settings import RecorderSettings
from aerodft.conventions import SECOND_NS
from aerodft.errors import AerodftError
from aerodft.model.image import Image, VideoPacket

_IMAGE_BYTES = 1 << 20  # what an image counts for in the queue
_LOSSLESS_QUEUE = 1  # images at once where nothing is shed: whoever brings the next one waits until it is encoded
_NO_IMAGE = 0xFFFFFFFF  # sequence of a packet that became no image
_SILENCE_NS = 2 * SECOND_NS  # without packets for so long, images are recorded as JPEGs

_MOST_WAITING = 128  # packets: seconds of video, far longer than any image takes to come

_log = logging.getLogger(__name__)


def picture_channels(settings: RecorderSettings) -> tuple[Channel, Channel]:
    """The channels of JPEGs and of video."""
    keys = Keys(settings.station)
    return protobuf_channel(keys.jpeg, CompressedImage), protobuf_channel(keys.video, CompressedVideo)


class Pictures:
    """Records images from a thread of its own; sheds them when that is too slow.

    Args:
        series: Where to; closed with this.
        settings: How.
        folder: Of the recording, for messages.
    """

    def __init__(self, series: Series, settings: RecorderSettings, folder: Path) -> None:
        self._series = series
        self._settings = settings
        self._folder = folder
        self._jpeg, self._video = picture_channels(settings)
        self._last_image_ns: int | None = None
        self._last_packet_ns: int | None = None
        self._is_decodable = False
        self._pairing = _PacketPairing()
        self._packets = threading.Lock()  # they come from the stream's thread, what they wait for from another
        self._failed = 0
        self.offered = self.shed = 0
        self._lane: Lane[Image | VideoPacket] = Lane(
            "record-images",
            self._do,
            series.tend,
            capacity=(_LOSSLESS_QUEUE if settings.lossless else settings.queued_images) * _IMAGE_BYTES,
            lossless=settings.lossless,
        )

    @property
    def stored(self) -> int:
        """Images and packets that are in the files."""
        return self._series.stored - self._series.own + self._own_lost

    @property
    def lost(self) -> int:
        """Those that a failing disk cost, or that could not be encoded."""
        return self._series.lost - self._own_lost + self._failed

    @property
    def _own_lost(self) -> int:
        """What segments begin with and is lost too: of a folder that was deleted nothing is left."""
        return max(self._series.own - self._series.stored, 0)

    def image(self, image: Image) -> None:
        """Record an image where one is due, and it does not come as video."""
        with self._packets:
            for packet in self._pairing.arrived(image.index, image.arrival_ns):
                self._put(packet)
        is_wanted = is_due(self._last_image_ns, image.arrival_ns, self._settings.max_image_hz)
        if image.pixels is None or not is_wanted or self._has_video(image.arrival_ns):
            return
        self._last_image_ns = image.arrival_ns
        self.offered += 1
        self.shed += not self._lane.put(image, _IMAGE_BYTES)

    def packet(self, packet: VideoPacket) -> None:
        """Record a packet; after one that was shed, all are up to the next that can be decoded."""
        if not self._settings.video or self._settings.max_image_hz <= 0:
            return
        if not packet.is_key and self._last_packet_ns is None:
            return  # the recording begins with the next key image
        self._last_packet_ns = packet.arrival_ns
        with self._packets:
            for waited in self._pairing.add(packet):
                self._put(waited)

    def _put(self, packet: VideoPacket) -> None:
        self.offered += 1
        self._is_decodable = (self._is_decodable or packet.is_key) and self._lane.put(packet, len(packet.data))
        self.shed += not self._is_decodable

    def close(self) -> None:
        """Write out what is left."""
        with self._packets:
            for packet in self._pairing.rest():
                self._put(packet)
        try:
            self._lane.close()
        finally:
            self._series.close()

    def _has_video(self, now_ns: int) -> bool:
        last_ns = self._last_packet_ns
        return last_ns is not None and now_ns - last_ns < _SILENCE_NS

    def _do(self, item: Image | VideoPacket) -> None:
        if isinstance(item, VideoPacket):
            data = compressed_video(item, self._settings.camera.name)
            sequence = _NO_IMAGE if item.index is None else image_sequence(item.index)
            self._series.write(self._video, item.arrival_ns, data, sequence, may_begin=item.is_key)
        else:
            self._do_image(item)

    def _do_image(self, image: Image) -> None:
        try:
            jpeg = encode_jpeg(image, self._settings.jpeg_quality)
        except (AerodftError, OSError, ValueError) as error:
            if not self._failed:
                _log.warning("%s: image %d cannot be recorded: %s", self._folder, image.index, error)
            self._failed += 1
            return
        data = compressed_image(image, jpeg, self._settings.camera.name)
        self._series.write(self._jpeg, image.arrival_ns, data, image_sequence(image.index))


class _PacketPairing:
    """Holds packets until their image is there, or will not come.

    A packet gets the arrival of the image that it became, by which the two find each other in a recording. It comes
    straight from the stream, its image through the inbox, which says when it arrived; so the packet waits.
    """

    def __init__(self) -> None:
        self._waiting: deque[VideoPacket] = deque()
        self._last_ns = 0

    def add(self, packet: VideoPacket) -> list[VideoPacket]:
        """Take a packet; returns one that has waited too long."""
        self._waiting.append(packet)
        return [self._timed(self._waiting.popleft())] if len(self._waiting) > _MOST_WAITING else []

    def arrived(self, index: int, arrival_ns: int) -> list[VideoPacket]:
        """The packets up to that of this image, in order; its own with the image's arrival."""
        done: list[VideoPacket] = []
        if any(packet.index == index for packet in self._waiting):
            while not done or done[-1].index != index:
                packet = self._waiting.popleft()
                done.append(self._timed(replace(packet, arrival_ns=arrival_ns) if packet.index == index else packet))
        return done

    def rest(self) -> list[VideoPacket]:
        """All that still waits."""
        done = [self._timed(packet) for packet in self._waiting]
        self._waiting.clear()
        return done

    def _timed(self, packet: VideoPacket) -> VideoPacket:
        """The packet, not before the one that was handed out last."""
        if packet.arrival_ns <= self._last_ns:
            packet = replace(packet, arrival_ns=self._last_ns + 1)
        self._last_ns = packet.arrival_ns
        return packet
