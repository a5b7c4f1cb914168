"""The recorder: a ``Sink`` that writes a folder of MCAP segments from threads of its own.

``data_*.mcap`` holds raw telemetry, image stamps, observations, poses, measurements, calibration estimates and status;
``images_*.mcap`` the camera, and JPEGs at a rate or the packets of a video that is compressed already. Inputs are
logged at their arrival, in order of arrival; outputs at the tick that made them.
"""

import logging
import os
import secrets
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypeAlias

import orjson
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

from aerodft.adapters.recording.channels import RECORDING_KEY, STATION_KEY, Channel, ChannelMessage, protobuf_channel
from aerodft.adapters.recording.write.image_writer import ImageWriter, RecorderSettings, image_channels
from aerodft.adapters.recording.write.records import RecordEncoder, camera_calibration, warm_up
from aerodft.adapters.recording.write.segment import CONFIG_NAME, METADATA_NAME, sync_folder
from aerodft.adapters.recording.write.segmented_writer import SegmentedWriter, SegmentedWriterSettings
from aerodft.adapters.wire.keys import Keys
from aerodft.adapters.wire.status import StationStatus
from aerodft.adapters.worker_queue import WorkerQueue
from aerodft.dft import MeasurementBatch
from aerodft.errors import InputError, os_errors_as
from aerodft.model import Image, ImageRows, Observation, VideoPacket
from aerodft.service import Batches, StepOutputs
from aerodft.version import SOFTWARE


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
            self._data.maintain,
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
    return {
        METADATA_NAME: {STATION_KEY: settings.station, "software": SOFTWARE, RECORDING_KEY: recording},
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
