"""The server of ``[foxglove]``: a live station's images, measurements, poses and places for Foxglove's viewer."""

import logging
from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING, Final, TypeAlias

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from aerodft.adapters.images import encode_jpeg, is_due
from aerodft.adapters.outputs.output import Run
from aerodft.adapters.recording import Channel, ChannelMessage, is_raw, protobuf_channel
from aerodft.adapters.recording.write import Annotator, RecordEncoder, camera_calibration, compressed_image
from aerodft.adapters.wire.keys import Keys
from aerodft.adapters.wire.status import StationStatus
from aerodft.adapters.worker_queue import WorkerQueue
from aerodft.errors import AerodftError, InputError, LinkError
from aerodft.model import Image
from aerodft.service import Batches, StepOutputs

if TYPE_CHECKING:
    import foxglove

_HOST: Final = "127.0.0.1"  # of this machine alone; any page in its browser can read it, as Foxglove's own does
_QUEUED_TICKS, _QUEUED_IMAGES, _BACKLOG = 256, 2, 256
_JPEG_QUALITY = 75

_log = logging.getLogger(__name__)

_Work: TypeAlias = tuple[Batches, StepOutputs] | StationStatus


class FoxgloveServer:
    """Sends a recording's messages as they are made, and what an exported file has beside them, to whoever looks.

    What a viewer, or this machine, is too slow for is dropped; measuring never waits.

    Args:
        run: What is shown.
        port: Where to listen, on loopback.
        image_hz: JPEGs per second.

    Raises:
        InputError: The SDK is not installed.
        LinkError: The port is busy.
    """

    def __init__(self, run: Run, *, port: int, image_hz: float) -> None:
        try:
            import foxglove  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise InputError("a live view needs Foxglove's SDK", got=error, hint="install aerodft[foxglove]") from error
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name=run.station,
                host=_HOST,
                port=port,
                context=self._context,
                message_backlog_size=_BACKLOG,
            )
        except RuntimeError as error:
            where, hint = f"{_HOST}:{port}", "choose another foxglove.port in the configuration"
            raise LinkError("the port is busy", where=where, got=error, expected="a free port", hint=hint) from error
        self._camera, self._image_hz = run.camera, image_hz
        self._last_image_ns: int | None = None
        self._dropped_ticks = 0
        self._channels: dict[str, foxglove.Channel] = {}
        keys = Keys(run.station)
        self._encoder, self._annotator = RecordEncoder(keys, run.camera.name), Annotator(run.station)
        self._jpegs = protobuf_channel(keys.jpeg, CompressedImage)
        self._calibrations = protobuf_channel(keys.camera, CameraCalibration)
        self._annotator.messages(self._calibration_at(0))  # says in which frame the images are
        drawn = self._annotator.channels(probe.name for probe in run.probes)
        for channel in (*self._encoder.channels, self._jpegs, self._calibrations, *drawn):
            self._channel(channel)  # a viewer has to have subscribed before the first message
        self._queue: WorkerQueue[_Work] = WorkerQueue("foxglove", self._show, capacity=_QUEUED_TICKS)
        self._images: WorkerQueue[Image] = WorkerQueue("foxglove-images", self._show_image, capacity=_QUEUED_IMAGES)
        _log.info("open ws://%s:%d in Foxglove", _HOST, port)

    def take(self, batches: Batches, outputs: StepOutputs) -> None:
        """Send what was read and made in some ticks, and of their images as many as the rate allows."""
        for image in batches.images:
            if image.pixels is not None and is_due(self._last_image_ns, image.arrival_ns, self._image_hz):
                self._last_image_ns = image.arrival_ns
                self._images.put(image)
        self._dropped_ticks += not self._queue.put((batches, outputs))

    def status(self, value: StationStatus) -> None:
        """Send the station's state."""
        self._queue.put(value)

    def warnings(self) -> tuple[str, ...]:
        """How much of what was measured was not sent, in one sentence."""
        sentence = f"{self._dropped_ticks} ticks were not shown in Foxglove: the machine was too slow"
        return (sentence,) if self._dropped_ticks else ()

    def close(self) -> None:
        """Send what is left, and end the server."""
        with ExitStack() as stack:  # whatever one of them raises, the others are closed; last in, first out
            stack.callback(self._server.stop)
            stack.callback(self._queue.close)
            stack.callback(self._images.close)

    def _show(self, work: _Work) -> None:
        for message in self._messages(work):
            if not is_raw(message.channel):
                self._send(message)
                for beside in self._annotator.messages(message):
                    self._send(beside)

    def _messages(self, work: _Work) -> Iterator[ChannelMessage]:
        if isinstance(work, StationStatus):
            yield self._encoder.from_status(work)
        else:
            rows = self._encoder.from_step(*work)
            yield from map(rows.message, range(len(rows)))

    def _show_image(self, image: Image) -> None:
        if not self._channel(self._jpegs).has_sinks():
            return  # nobody looks
        try:
            jpeg = encode_jpeg(image, _JPEG_QUALITY)
        except (AerodftError, OSError, ValueError) as error:
            _log.debug("image %d cannot be shown: %s", image.index, error)
            return
        data = compressed_image(image, jpeg, self._camera.name)
        self._send(self._calibration_at(image.stamp_ns))
        self._send(ChannelMessage(image.arrival_ns, self._jpegs, data))

    def _calibration_at(self, stamp_ns: int) -> ChannelMessage:
        return ChannelMessage(stamp_ns, self._calibrations, camera_calibration(self._camera, stamp_ns))

    def _send(self, message: ChannelMessage) -> None:
        self._channel(message.channel).log(message.data, log_time=message.log_ns)

    def _channel(self, channel: Channel) -> "foxglove.Channel":
        """The server's channel of a recording's."""
        import foxglove  # noqa: PLC0415 - an extra

        if channel.topic not in self._channels:
            schema = foxglove.Schema(name=channel.schema, encoding=channel.schema_encoding, data=channel.schema_data)
            self._channels[channel.topic] = foxglove.Channel(
                channel.topic,
                message_encoding=channel.encoding,
                schema=schema if channel.schema else None,
                context=self._context,
            )
        return self._channels[channel.topic]
