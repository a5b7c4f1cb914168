"""The recorder: a ``Sink`` that writes a folder of MCAP segments from threads of its own.

``data_*.mcap`` holds raw telemetry, image stamps, observations, poses, measurements,
calibration estimates and status; ``images_*.mcap`` the
JPEGs and the camera. Inputs are logged at their arrival, in order of arrival; outputs at the tick that made them.
"""

import logging
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from aerodft.adapters.codec.keys import Keys
from aerodft.adapters.codec.status import StationStatus
from aerodft.adapters.jpeg import encode_jpeg
from aerodft.adapters.lane import Lane
from aerodft.adapters.mcap.channels import protobuf_channel
from aerodft.adapters.mcap.foxglove import camera_calibration, compressed_image
from aerodft.adapters.mcap.records import Record, Records, image_sequence
from aerodft.adapters.mcap.segment import Segment
from aerodft.adapters.mcap.series import Series
from aerodft.conventions import SECOND_NS
from aerodft.errors import AerodftError, InputError
from aerodft.model.batch import Batch
from aerodft.model.camera import Camera
from aerodft.model.height import HeightSwitch
from aerodft.model.image import Image
from aerodft.model.measurement import Measurement
from aerodft.model.pose import PoseSample
from aerodft.service.ports import Estimate, Output

_OUTPUT_BYTES = 2000  # what an output takes in the queue, about
_FRAME_OVERHEAD_BYTES = 64

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderSettings:
    """How a recording is made.

    Attributes:
        station: Name in topics.
        camera: Recorded as a Foxglove calibration.
        lossless: Wait for the disk instead of shedding; for input that can wait.
        max_image_hz: Images per second that are kept; 0 for none.
        jpeg_quality: 0 to 100.
        queue_bytes: Data that may wait for the disk before it is shed.
        queued_images: Images that may wait for the encoder before they are shed.
        segment_bytes: Size at which a new segment begins.
    """

    station: str
    camera: Camera
    lossless: bool = False
    max_image_hz: float = 5.0
    jpeg_quality: int = 85
    queue_bytes: int = 64 << 20
    queued_images: int = 4
    segment_bytes: int = 2 << 30


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingTotals:
    """What a recorder stored, shed because the disk was too slow, and lost because it failed."""

    folder: Path
    messages: int
    images: int
    shed_messages: int
    shed_images: int
    lost: int


@dataclass(frozen=True, slots=True)
class _Outputs:
    now_ns: int
    items: tuple[Output, ...]


_Work: TypeAlias = Batch | _Outputs | StationStatus


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
        self._records = Records(Keys(settings.station), settings.camera.name)
        keys = Keys(settings.station)
        self._jpeg = protobuf_channel(keys.jpeg, CompressedImage)
        self._camera = protobuf_channel(keys.camera, CameraCalibration)
        self._last_image_ns: int | None = None
        self._shed_messages = self._shed_images = self._failed_images = 0
        _prepare(folder)
        try:
            for name, text in (texts or {}).items():
                (folder / name).write_text(text, encoding="utf-8")
            self._data = self._series("data", self._first_data)
            try:
                self._images = self._series("images", self._first_images)
            except OSError:
                self._data.close()
                raise
        except OSError as error:
            raise InputError("the recording cannot be written", where=folder, got=error.strerror) from error
        self._data_lane: Lane[_Work] = Lane(
            "record-data", self._do, self._data.tend, capacity=settings.queue_bytes, lossless=settings.lossless
        )
        self._image_lane: Lane[Image] = Lane(
            "record-images",
            self._do_image,
            self._images.tend,
            capacity=settings.queued_images,
            lossless=settings.lossless,
        )

    @property
    def totals(self) -> RecordingTotals:
        """The totals so far; final after ``close``."""
        return RecordingTotals(
            folder=self._folder,
            messages=self._data.stored,
            images=max(self._images.stored - 1, 0),
            shed_messages=self._shed_messages,
            shed_images=self._shed_images,
            lost=self._data.lost + self._images.lost,
        )

    def inputs(self, batch: Batch) -> None:
        """Record the raw input of one tick; its time is that of the outputs that follow."""
        self._now_ns = batch.now_ns
        messages = sum(len(block.length) for block in batch.raw) + len(batch.images) + len(batch.observations)
        if messages:
            frames = sum(int(block.length.sum()) for block in batch.raw)
            self._put(batch, messages, frames + _FRAME_OVERHEAD_BYTES * messages)
        for image in batch.images:
            if image.pixels is not None and self._is_due(image):
                self._last_image_ns = image.arrival_ns
                self._shed_images += not self._image_lane.put(image)

    def outputs(self, outputs: tuple[Output, ...]) -> None:
        """Record poses, measurements and estimates; images and observations are inputs and recorded as such."""
        kept = tuple(item for item in outputs if isinstance(item, PoseSample | Measurement | Estimate | HeightSwitch))
        if kept:
            self._put(_Outputs(self._now_ns, kept), len(kept), _OUTPUT_BYTES * len(kept))

    def status(self, value: StationStatus) -> None:
        """Record a station's state."""
        self._put(value, 1, _OUTPUT_BYTES)

    def close(self) -> None:
        """Write out what is left, close the files, and log where they are."""
        with ExitStack() as stack:  # whatever one of them raises, the others are closed; last in, first out
            stack.callback(self._images.close)
            stack.callback(self._close_data)
            stack.callback(self._data_lane.close)
            stack.callback(self._image_lane.close)
        totals = self.totals
        _log.log(
            logging.WARNING if totals.shed_messages or totals.lost else logging.INFO,
            "recording in %s: %d messages, %d images; shed %d messages, %d images; lost %d",
            totals.folder,
            totals.messages,
            totals.images,
            totals.shed_messages,
            totals.shed_images,
            totals.lost,
        )

    def _close_data(self) -> None:
        self._write(self._records.of_status(self._status_now("ending")))
        self._data.close()

    def _series(self, stem: str, first: Callable[[Segment], None]) -> Series:
        return Series(
            self._folder,
            stem,
            self._settings.station,
            compress=stem == "data",
            segment_bytes=self._settings.segment_bytes,
            first_messages=first,
        )

    def _first_data(self, segment: Segment) -> None:
        for channel in self._records.channels:
            segment.register(channel)
        record = self._records.of_status(self._status_now("running" if segment.number else "starting"))
        segment.write(record.channel, record.log_ns, record.data)

    def _first_images(self, segment: Segment) -> None:
        segment.register(self._jpeg)
        segment.write(self._camera, self._now_ns, camera_calibration(self._settings.camera, self._now_ns))

    def _status_now(self, state: str) -> StationStatus:
        counts = {"shed_messages": self._shed_messages, "shed_images": self._shed_images}
        return StationStatus(station=self._settings.station, stamp_ns=self._now_ns, state=state, counts=counts)

    def _put(self, work: _Work, messages: int, size: int) -> None:
        if not self._data_lane.put(work, size):
            if not self._shed_messages:
                _log.warning("%s: the disk is too slow, data is shed", self._folder)
            self._shed_messages += messages

    def _is_due(self, image: Image) -> bool:
        rate_hz = self._settings.max_image_hz
        if rate_hz <= 0 or self._last_image_ns is None:
            return rate_hz > 0
        # A tenth of slack: a camera at exactly the rate jitters around its period.
        return image.arrival_ns - self._last_image_ns >= 0.9 * SECOND_NS / rate_hz

    def _do(self, work: _Work) -> None:
        if isinstance(work, StationStatus):
            self._write(self._records.of_status(work))
        elif isinstance(work, Batch):
            for record in self._records.of_inputs(work):
                self._write(record)
        else:
            for item in work.items:
                if isinstance(item, Measurement):
                    self._write(self._records.of_measurement(item, work.now_ns))
                elif isinstance(item, PoseSample):
                    for record in self._records.of_pose(item, work.now_ns):
                        self._write(record)
                elif isinstance(item, HeightSwitch):
                    self._write(self._records.of_height_switch(item, work.now_ns))
                elif isinstance(item, Estimate):
                    self._write(self._records.of_estimate(item, work.now_ns))

    def _write(self, record: Record) -> None:
        self._data.write(record.channel, record.log_ns, record.data, record.sequence)

    def _do_image(self, image: Image) -> None:
        try:
            jpeg = encode_jpeg(image, self._settings.jpeg_quality)
        except (AerodftError, OSError, ValueError) as error:
            if not self._failed_images:
                _log.warning("%s: image %d cannot be recorded: %s", self._folder, image.index, error)
            self._failed_images += 1
            return
        data = compressed_image(image, jpeg, self._settings.camera.name)
        self._images.write(self._jpeg, image.arrival_ns, data, image_sequence(image.index))


def _prepare(folder: Path) -> None:
    """Make the folder, or see that it is empty.

    Raises:
        InputError: It holds something, is a file, or cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        found = next(folder.iterdir(), None)
    except OSError as error:
        raise InputError("the recording cannot be written", where=folder, got=error.strerror) from error
    if found is not None:
        raise InputError(
            "a recording is never written over something else",
            where=folder,
            got=f"{found.name} in it",
            expected="a new or empty folder",
        )
