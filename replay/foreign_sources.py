"""The telemetry and the images of another tool's recording, as sources of the pipeline."""

import heapq
import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image as PillowImage

from aerodft.adapters.foreign.frames import FrameReader
from aerodft.adapters.foreign.pictures import Picture, read_picture
from aerodft.adapters.images.packets import PacketDecoder
from aerodft.adapters.images.pixels import FramePixels, StillPixels
from aerodft.adapters.mavlink.framing import FrameCounts
from aerodft.adapters.mcap.reading import ReadMessage
from aerodft.errors import InputError
from aerodft.model.batch import Event
from aerodft.model.image import Image, StampClock
from aerodft.model.telemetry import RawBlock, WireProtocol
from aerodft.service.arrivals import Pace, first_arrival_ns
from replay.foreign import ForeignRecording

if TYPE_CHECKING:
    import av


_BATCH: Final = 4096
_BATCH_BYTES: Final = 1 << 18
_STILLS: Final = ("jpeg", "jpg", "png", "webp", "tiff")
_log = logging.getLogger(__name__)


class ForeignTelemetry:
    """The MAVLink of a recording as a ``Source``; its arrival is the log time, made not decreasing.

    Args:
        recording: The recording.

    Raises:
        InputError: It has none.
    """

    def __init__(self, recording: ForeignRecording) -> None:
        if not recording.mavlink:
            raise recording.refusal_without("MAVLink")
        self._topics = [_Topic(recording, topic) for topic in recording.mavlink]

    @property
    def counts(self) -> FrameCounts:
        """What was read so far."""
        return sum((topic.counts for topic in self._topics), FrameCounts())

    def events(self) -> Iterator[Event]:
        """All frames in order, in blocks of bounded size."""
        return heapq.merge(*(topic.blocks() for topic in self._topics), key=first_arrival_ns)

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each kind of damage met so far; complete once ``events`` has ended."""
        return tuple(sentence for topic in self._topics for sentence in topic.warnings())


class _Topic:
    """The frames of one topic."""

    def __init__(self, recording: ForeignRecording, topic: str) -> None:
        self._recording = recording
        self._topic = topic
        self._reader = FrameReader(recording.channels[topic])
        self._backwards = 0

    @property
    def counts(self) -> FrameCounts:
        return self._reader.counts

    def blocks(self) -> Iterator[RawBlock]:
        self._reader, self._backwards = FrameReader(self._recording.channels[self._topic]), 0
        last_ns, pace = 0, Pace()
        batches = _batches(self._recording.messages(self._topic))
        while messages := next(batches, None):
            stamps_ns = np.array([message.log_ns for message in messages], dtype=np.int64)
            arrivals_ns = np.maximum(np.maximum.accumulate(stamps_ns), last_ns)
            self._backwards += int(np.count_nonzero(stamps_ns < np.concatenate([[last_ns], arrivals_ns[:-1]])))
            last_ns = int(arrivals_ns[-1])
            for cut, message in self._reader.cuts([message.data for message in messages]):
                if len(message):
                    yield RawBlock(
                        protocol=WireProtocol.MAVLINK,
                        sender=self._topic,
                        arrival_ns=pace.kept(arrivals_ns[message]),
                        offset=cut.offset,
                        length=cut.length,
                        data=cut.data,
                        checked=True,
                    )
            del messages  # not to be held while the next ones are read

    def warnings(self) -> Iterator[str]:
        where, counts = f"{self._recording.path}, {self._topic}", self.counts
        if counts.bad_crc:
            yield f"{where}: {counts.bad_crc} damaged frames left out"
        if self._reader.unreadable:
            yield f"{where}: {self._reader.unreadable} messages hold no frame that could be read"
        if self._reader.is_packed:
            yield f"{where}: frames were made again from JSON, which has no signatures"
        if self._backwards:
            yield (
                f"{where}: the recording machine's clock stepped back ({self._backwards} messages stamped"
                " earlier than one before them); their arrival was held"
            )


def _batches(messages: Iterable[ReadMessage]) -> Iterator[list[ReadMessage]]:
    """Messages, some thousands together: of no more bytes than are quickly gone through."""
    batch: list[ReadMessage] = []
    size = 0
    for message in messages:
        batch.append(message)
        size += len(message.data)
        del message
        if len(batch) >= _BATCH or size >= _BATCH_BYTES:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch


@dataclass(slots=True)
class _Losses:
    unreadable: int = 0
    undecoded: int = 0
    backwards: int = 0

    def report(self, where: str) -> None:
        for count, what in (
            (self.unreadable, "that cannot be read"),
            (self.undecoded, "that cannot be decoded: damaged, or before the first key frame"),
            (self.backwards, "with a stamp that is not after the one before"),
        ):
            if count:
                _log.warning("%s: left out %d images %s", where, count, what)


class ForeignImages:
    """The images of a recording as a ``Source``; stamped by the recording machine's clock.

    Args:
        recording: The recording, with images.
        decode: False for stamps and sizes only.

    Raises:
        InputError: It has none.
    """

    def __init__(self, recording: ForeignRecording, *, decode: bool = True) -> None:
        if recording.roles.images is None:
            raise recording.refusal_without("images")
        self._recording = recording
        self._topic = recording.roles.images
        self._decode = decode

    def events(self) -> Iterator[Image]:
        """All images whose stamp is sound; what was left out is logged as a warning at the end."""
        losses, last_ns = _Losses(), 0
        # Not a loop over the messages, which would hold on to the last one: megabytes.
        read = partial(self._image, _Decoder(decode=self._decode), losses)
        for image in map(read, enumerate(self._recording.messages(self._topic))):
            if image is not None and image.stamp_ns <= last_ns:
                losses.backwards += 1
            elif image is not None:
                last_ns = image.stamp_ns
                yield image
        losses.report(self._where())

    def _image(self, decoder: "_Decoder", losses: _Losses, numbered: tuple[int, ReadMessage]) -> Image | None:
        """The image of a message; None, and counted, where there is none."""
        index, message = numbered
        try:
            picture = read_picture(message.channel, message.data)
            image = decoder.image(picture, index, picture.stamp_ns or message.log_ns, self._where(index))
        except ValueError as error:
            self._refuse_first(index, error)
            losses.unreadable += 1
            return None
        losses.undecoded += image is None
        return image

    def _where(self, index: int | None = None) -> str:
        return f"{self._recording.path}, {self._topic}" + ("" if index is None else f", image {index}")

    def _refuse_first(self, index: int, error: ValueError) -> None:
        """What is wrong with the first message is most likely wrong with all."""
        if index == 0:
            channel = self._recording.channels[self._topic]
            got = f"{channel.schema or 'no schema'} ({channel.encoding}): {error}"
            expected = "Foxglove's or ROS's CompressedImage, Foxglove's CompressedVideo, or a JPEG"
            raise InputError("the images cannot be read", where=self._where(), got=got, expected=expected) from error


class _Decoder:
    """Pictures to images: stills when somebody asks, video packet by packet."""

    def __init__(self, *, decode: bool) -> None:
        self._decode = decode
        self._video: PacketDecoder | None = None
        self._size_px: tuple[int, int] | None = None

    def image(self, picture: Picture, index: int, stamp_ns: int, where: str) -> Image | None:
        """The image; None where it cannot be decoded.

        Raises:
            ValueError: It is no picture, or in a format that nobody knows.
        """
        pixels: FramePixels | StillPixels | None
        if any(name in picture.format for name in _STILLS) or not picture.format:
            pixels, size_px = StillPixels(picture.data, where) if self._decode else None, _size_of(picture.data)
        else:
            self._video = self._video or PacketDecoder(picture.format)
            if not self._decode and self._size_px is not None:
                pixels, size_px = None, self._size_px
            else:
                frame = self._video.decode(picture.data)
                if frame is None:
                    return None
                pixels, size_px = self._pixels(frame), (frame.width, frame.height)
        self._size_px = size_px
        return Image(
            index=index,
            stamp_ns=stamp_ns,
            arrival_ns=stamp_ns,
            clock=StampClock.HOST,
            width_px=size_px[0],
            height_px=size_px[1],
            pixels=pixels,
        )

    def _pixels(self, frame: "av.VideoFrame") -> FramePixels | None:
        return FramePixels(frame) if self._decode else None


def _size_of(data: bytes) -> tuple[int, int]:
    try:
        with PillowImage.open(BytesIO(data)) as image:
            return image.size
    except (OSError, SyntaxError, PillowImage.DecompressionBombError) as error:
        raise ValueError("no image that could be read") from error
