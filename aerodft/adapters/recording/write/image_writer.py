"""Images of a recording: JPEGs at a rate, or the packets of a compressed video, in a thread of its own."""

import logging
import threading
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo

from aerodft.adapters.images import encode_jpeg, is_due
from aerodft.adapters.recording.channels import Channel, protobuf_channel
from aerodft.adapters.recording.write.records import compressed_image, compressed_video, image_sequence
from aerodft.adapters.recording.write.segmented_writer import SegmentedWriter
from aerodft.adapters.wire.keys import Keys
from aerodft.adapters.worker_queue import WorkerQueue
from aerodft.conventions import SECOND_NS
from aerodft.errors import AerodftError
from aerodft.model import Camera, Image, VideoPacket

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderSettings:
    """Settings of a recording.

    Attributes:
        station: Name in topics.
        camera: Recorded as a Foxglove calibration.
        lossless: Wait for the disk instead of shedding; for input that can wait.
        max_image_hz: JPEGs per second that are kept; 0 for no images at all.
        video: Whether packets of a video that is H.264 already are kept in place of JPEGs.
        jpeg_quality: 0 to 100.
        queue_bytes: Data that may wait for the disk before it is shed.
        queued_images: Images that may wait for the encoder before they are shed.
        segment_bytes: Size beyond which a new segment begins.
        segment_s: Time after which a new segment begins.
    """

    station: str
    camera: Camera
    lossless: bool = False
    max_image_hz: float = 5.0
    video: bool = True
    jpeg_quality: int = 85
    queue_bytes: int = 64 << 20
    queued_images: int = 4
    segment_bytes: int = 2 << 30
    segment_s: float = 900.0


_IMAGE_BYTES = 1 << 20  # what an image counts for in the queue
_LOSSLESS_QUEUE = 1  # images at once where nothing is shed: whoever brings the next one waits until it is encoded
_NO_IMAGE = 0xFFFFFFFF  # sequence of a packet that became no image
_SILENCE_NS = 2 * SECOND_NS  # without packets for so long, images are recorded as JPEGs

_MOST_WAITING = 128  # packets: seconds of video, far longer than any image takes to come


def image_channels(settings: RecorderSettings) -> tuple[Channel, Channel]:
    """The channels of JPEGs and of video."""
    keys = Keys(settings.station)
    return protobuf_channel(keys.jpeg, CompressedImage), protobuf_channel(keys.video, CompressedVideo)


class ImageWriter:
    """Records images from a thread of its own; sheds them when that is too slow.

    Args:
        writer: Where to; closed with this.
        settings: How.
        folder: Of the recording, for messages.
    """

    def __init__(self, writer: SegmentedWriter, settings: RecorderSettings, folder: Path) -> None:
        self._writer = writer
        self._settings = settings
        self._folder = folder
        self._jpeg, self._video = image_channels(settings)
        self._last_image_ns: int | None = None
        self._last_packet_ns: int | None = None
        self._is_decodable = False
        self._pairing = _PacketPairing()
        self._packets = threading.Lock()  # they come from the stream's thread, what they wait for from another
        self._failed = 0
        self.offered = self.shed = 0
        self._queue: WorkerQueue[Image | VideoPacket] = WorkerQueue(
            "record-images",
            self._write_item,
            writer.maintain,
            capacity=(_LOSSLESS_QUEUE if settings.lossless else settings.queued_images) * _IMAGE_BYTES,
            lossless=settings.lossless,
        )

    @property
    def stored(self) -> int:
        """Images and packets that are in the files."""
        return self._writer.stored - self._writer.own + self._own_lost

    @property
    def lost(self) -> int:
        """Number of images that a failing disk cost, or that could not be encoded."""
        return self._writer.lost - self._own_lost + self._failed

    @property
    def _own_lost(self) -> int:
        """Lost messages that segments begin with: of a folder that was deleted nothing is left."""
        return max(self._writer.own - self._writer.stored, 0)

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
        self.shed += not self._queue.put(image, _IMAGE_BYTES)

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
        self._is_decodable = (self._is_decodable or packet.is_key) and self._queue.put(packet, len(packet.data))
        self.shed += not self._is_decodable

    def close(self) -> None:
        """Write out what is left."""
        with self._packets:
            for packet in self._pairing.rest():
                self._put(packet)
        try:
            self._queue.close()
        finally:
            self._writer.close()

    def _has_video(self, now_ns: int) -> bool:
        last_ns = self._last_packet_ns
        return last_ns is not None and now_ns - last_ns < _SILENCE_NS

    def _write_item(self, item: Image | VideoPacket) -> None:
        if isinstance(item, VideoPacket):
            data = compressed_video(item, self._settings.camera.name)
            sequence = _NO_IMAGE if item.index is None else image_sequence(item.index)
            self._writer.write(self._video, item.arrival_ns, data, sequence, may_start_segment=item.is_key)
        else:
            self._write_image(item)

    def _write_image(self, image: Image) -> None:
        try:
            jpeg = encode_jpeg(image, self._settings.jpeg_quality)
        except (AerodftError, OSError, ValueError) as error:
            if not self._failed:
                _log.warning("%s: image %d cannot be recorded: %s", self._folder, image.index, error)
            self._failed += 1
            return
        data = compressed_image(image, jpeg, self._settings.camera.name)
        self._writer.write(self._jpeg, image.arrival_ns, data, image_sequence(image.index))


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
        """All packets that still wait for their stamp."""
        done = [self._timed(packet) for packet in self._waiting]
        self._waiting.clear()
        return done

    def _timed(self, packet: VideoPacket) -> VideoPacket:
        """The packet, not before the one that was handed out last."""
        if packet.arrival_ns <= self._last_ns:
            packet = replace(packet, arrival_ns=self._last_ns + 1)
        self._last_ns = packet.arrival_ns
        return packet
