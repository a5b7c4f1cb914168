"""The recorder: a ``Sink`` that writes a folder of MCAP segments from threads of its own.

``data_*.mcap`` holds raw telemetry, image stamps, observations, poses, measurements, calibration estimates and status;
``images_*.mcap`` the camera, and JPEGs at a rate or the packets of a video that is compressed already. Inputs are
logged at their arrival, in order of arrival; outputs at the tick that made them.
"""

import logging
import os
import secrets
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypeAlias

import orjson
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo

from aerodft.adapters.files import check_is_local
from aerodft.adapters.images import encode_jpeg, is_due
from aerodft.adapters.recording.channels import RECORDING_KEY, STATION_KEY, Channel, ChannelMessage, protobuf_channel
from aerodft.adapters.recording.write.records import (
    RecordEncoder,
    camera_calibration,
    compressed_image,
    compressed_video,
    image_sequence,
    warm_up,
)
from aerodft.adapters.recording.write.segment import (
    CONFIG_NAME,
    METADATA_NAME,
    CopiedSegment,
    copied_metadata,
    sync_folder,
)
from aerodft.adapters.recording.write.segmented_writer import SegmentedWriter, SegmentedWriterSettings
from aerodft.adapters.wire.keys import Keys
from aerodft.adapters.wire.status import UNMEASURED, StationStatus
from aerodft.adapters.worker_queue import WorkerQueue
from aerodft.conventions import SECOND_NS
from aerodft.dft import MeasurementBatch
from aerodft.errors import AerodftError, InputError, os_errors_as
from aerodft.model import Camera, Image, ImageRows, Observation, VideoPacket
from aerodft.service import Batches, StepOutputs
from aerodft.version import SOFTWARE


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
        copied: The image segments of another recording that are copied into the folder afterwards.
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
    copied: tuple[CopiedSegment, ...] = ()


_QUEUED_IMAGE_BYTES = 1 << 20  # what an image counts for in the queue
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
            tend=writer.maintain,
            capacity=(_LOSSLESS_QUEUE if settings.lossless else settings.queued_images) * _QUEUED_IMAGE_BYTES,
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
        self.shed += not self._queue.put(image, _QUEUED_IMAGE_BYTES)

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


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingTotals:
    """Totals of all that was offered to a recorder: ``offered = stored + shed + lost``, of both kinds.

    Attributes:
        folder: Where the recording is.
        offered: Messages of the data files: what came, and the recorder's own status.
        messages: Stored.
        shed_messages: Not taken, because the disk was too slow.
        lost_messages: Not written, because it failed or was full.
        offered_images: Images that were due by the rate.
        images: Stored.
        shed_images: Not taken, because encoder or disk were too slow.
        lost_images: Not written, because the disk failed or was full, or because they could not be encoded.
    """

    folder: Path
    offered: int
    messages: int
    shed_messages: int
    lost_messages: int
    offered_images: int
    images: int
    shed_images: int
    lost_images: int

    @property
    def lost(self) -> int:
        """Messages and images that a failing disk cost."""
        return self.lost_messages + self.lost_images

    @property
    def counts(self) -> dict[str, int]:
        """The totals by name, as the station's status has them; what waits is not in a file yet, or not counted."""
        messages, images = self.shed_messages + self.lost_messages, self.shed_images + self.lost_images
        return {
            "offered_messages": self.offered,
            "recorded_messages": self.messages,
            "shed_messages": self.shed_messages,
            "lost_messages": self.lost_messages,
            "waiting_messages": self.offered - self.messages - messages,
            "offered_images": self.offered_images,
            "recorded_images": self.images,
            "shed_images": self.shed_images,
            "lost_images": self.lost_images,
            "waiting_images": self.offered_images - self.images - images,
        }


# What waits for the disk takes about so much: an image's pose and measurements, anything else that is made, a frame.
_IMAGE_BYTES, _OUTPUT_BYTES, _INPUT_BYTES = 8000, 4000, 128
_ID_BYTES = 16
_LOSSLESS_QUEUE_BYTES = 16 << 20  # of data may wait for the disk before who brings more waits as well
# Allocated ahead: once images have filled the disk there is room for minutes of data.
_SPARE_DATA_BYTES, _SPARE_IMAGE_BYTES = 16 << 20, 4 << 20

_Work: TypeAlias = tuple[Batches, StepOutputs] | StationStatus

_log = logging.getLogger(__name__)


class McapRecorder:
    """Records what a pipeline reads and makes.

    Attributes:
        unmeasured: Images that were never measured, by cause; the last status says them too.

    Args:
        folder: A new or empty folder.
        settings: How.
        started_ns: Host UTC of the start; for recorded input its own start.
        texts: Files to put beside the segments by name, ``config.toml`` and the like.

    Raises:
        InputError: The folder holds something already, or cannot be written; nothing has been written then.
    """

    def __init__(
        self, folder: Path, settings: RecorderSettings, *, started_ns: int, texts: Mapping[str, str] | None = None
    ) -> None:
        self._folder = folder
        self._settings = settings
        self._now_ns = started_ns
        self._encoder = RecordEncoder(Keys(settings.station), settings.camera.name)
        self._camera = protobuf_channel(Keys(settings.station).camera, CameraCalibration)
        self._shed_messages = 0
        self.unmeasured: Mapping[str, int] = {}
        self._is_open = False
        warm_up()
        _prepare(folder)
        with os_errors_as("the recording cannot be written", where=folder):
            for name, text in (texts or {}).items():
                _write_synced(folder / name, text)
            with suppress(OSError):  # a folder above that may not be read
                sync_folder(folder.resolve().parent)
            metadata = _metadata(settings, texts or {})
            self._data = self._writer("data", metadata, self._encoder.channels, self._first_data)
            try:
                channels = (self._camera, *image_channels(settings))
                images = self._writer("images", metadata, channels, self._first_images)
            except OSError:
                self._data.close()
                raise
        self._data_queue: WorkerQueue[_Work] = WorkerQueue(
            "record-data",
            self._write_item,
            tend=self._data.maintain,
            capacity=_LOSSLESS_QUEUE_BYTES if settings.lossless else settings.queue_bytes,
            lossless=settings.lossless,
        )
        self._image_writer = ImageWriter(images, settings, folder)
        self._is_open = True

    @property
    def totals(self) -> RecordingTotals:
        """The totals so far; final after ``close``."""
        images = self._image_writer
        return RecordingTotals(
            folder=self._folder,
            offered=self._data.offered + self._shed_messages,
            messages=self._data.stored,
            shed_messages=self._shed_messages,
            lost_messages=self._data.lost,
            offered_images=images.offered,
            images=images.stored,
            shed_images=images.shed,
            lost_images=images.lost,
        )

    def take(self, batches: Batches, outputs: StepOutputs) -> None:
        """Record what was read in some ticks, and the poses, measurements and estimates that were made of it."""
        self._now_ns = int(batches.now_ns[-1])
        inputs = batches.event_count
        images = sum(len(block.images) for block in outputs.images)
        measured = sum(len(batch) for _, _, batch in outputs.measured())
        kept = [each for each in outputs.singles if not isinstance(each.content, (Observation, MeasurementBatch))]
        others = measured + len(kept)
        if inputs + images + others:
            size = _INPUT_BYTES * inputs + _IMAGE_BYTES * images + _OUTPUT_BYTES * others
            self._put((batches, outputs), inputs + images + others, size)
        self._offer_images(batches.images)

    def _offer_images(self, images: Iterable[Image]) -> None:
        if isinstance(images, ImageRows) and images.width_px is None:
            return
        for image in images:
            if image.width_px is not None:  # a stamp alone has no picture
                self._image_writer.image(image)

    def packet(self, packet: VideoPacket) -> None:
        """Record a packet of the video that images come from, which then are not recorded a second time."""
        self._image_writer.packet(packet)

    def status(self, value: StationStatus) -> None:
        """Record a station's state."""
        self._put(value, 1, _OUTPUT_BYTES)

    def close(self) -> None:
        """Write out what is left, close the files, and log where they are."""
        with ExitStack() as stack:  # whatever one of them raises, the others are closed; last in, first out
            stack.callback(self._close_data)
            stack.callback(self._data_queue.close)
            stack.callback(self._image_writer.close)
        totals = self.totals
        _log.log(
            logging.WARNING if totals.shed_messages or totals.lost else logging.DEBUG,
            "recording in %s: %d messages, %d images; shed %d messages, %d images; lost %d messages, %d images",
            totals.folder,
            totals.messages,
            totals.images,
            totals.shed_messages,
            totals.shed_images,
            totals.lost_messages,
            totals.lost_images,
        )

    def _close_data(self) -> None:
        self._write(self._encoder.from_status(self._status_now("ending")))
        self._data.close()

    def _writer(
        self,
        stem: str,
        metadata: Mapping[str, dict[str, str]],
        channels: tuple[Channel, ...],
        first: Callable[[int, int | None], Iterable[ChannelMessage]],
    ) -> SegmentedWriter:
        is_data = stem == "data"
        settings = SegmentedWriterSettings(
            folder=self._folder,
            stem=stem,
            metadata=metadata,
            channels=channels,
            recording=metadata[METADATA_NAME][RECORDING_KEY],
            lossless=self._settings.lossless,
            compress=is_data,
            segment_bytes=self._settings.segment_bytes,
            segment_s=self._settings.segment_s,
            spare_bytes=_SPARE_DATA_BYTES if is_data else _SPARE_IMAGE_BYTES,
        )
        return SegmentedWriter(settings, first)

    def _first_data(self, number: int, at_ns: int | None) -> Iterable[ChannelMessage]:
        status = self._status_now("running" if number else "starting")
        return (self._encoder.from_status(status if at_ns is None else replace(status, stamp_ns=at_ns)),)

    def _first_images(self, number: int, at_ns: int | None) -> Iterable[ChannelMessage]:  # noqa: ARG002 - all begin alike
        now_ns = self._now_ns if at_ns is None else at_ns
        return (ChannelMessage(now_ns, self._camera, camera_calibration(self._settings.camera, now_ns)),)

    def _status_now(self, state: str) -> StationStatus:
        shed_images = self._image_writer.shed if self._is_open else 0
        counts = {"shed_messages": self._shed_messages, "shed_images": shed_images}
        counts |= {f"{UNMEASURED}{cause}": number for cause, number in self.unmeasured.items()}
        return StationStatus(station=self._settings.station, stamp_ns=self._now_ns, state=state, counts=counts)

    def _put(self, work: _Work, messages: int, size: int) -> None:
        if not self._data_queue.put(work, size):
            if not self._shed_messages:
                _log.warning("%s: the disk is too slow, data is shed", self._folder)
            self._shed_messages += messages

    def _write_item(self, work: _Work) -> None:
        if isinstance(work, StationStatus):
            self._write(self._encoder.from_status(work))
        else:
            self._data.write_rows(self._encoder.from_step(*work))

    def _write(self, record: ChannelMessage) -> None:
        self._data.write(record.channel, record.log_ns, record.data, record.sequence)


def _metadata(settings: RecorderSettings, texts: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Metadata of every segment: the recording's id, software, configuration and camera."""
    camera = settings.camera
    recording = secrets.token_hex(_ID_BYTES)
    about = {STATION_KEY: settings.station, "software": SOFTWARE, RECORDING_KEY: recording}
    return {
        METADATA_NAME: about | copied_metadata(settings.copied),
        **({CONFIG_NAME: dict(texts)} if texts else {}),
        "camera": {each.name: _as_text(getattr(camera, each.name)) for each in fields(camera)},
    }


def _write_synced(path: Path, text: str) -> None:
    """Write a file that a power cut does not leave empty.

    Raises:
        OSError: It cannot be written.
    """
    with path.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def _as_text(value: object) -> str:
    return str(value) if isinstance(value, str) else orjson.dumps(value, option=orjson.OPT_SERIALIZE_NUMPY).decode()


def _prepare(folder: Path) -> None:
    """Make the folder, or see that it is empty.

    Raises:
        InputError: It holds something, is a file, or cannot be made.
    """
    check_is_local(folder)
    with os_errors_as("the recording cannot be written", where=folder):
        folder.mkdir(parents=True, exist_ok=True)
        found = next(folder.iterdir(), None)
    if found is not None:
        raise InputError(
            "a recording is never written over something else",
            where=folder,
            got=f"{found.name} in it",
            expected="a new or empty folder",
        )
