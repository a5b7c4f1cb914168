"""The recorded JPEGs, found by an image's arrival and decoded when somebody asks."""

from dataclasses import dataclass

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.message import DecodeError

from aerodft.adapters.jpeg import decode_jpeg
from aerodft.adapters.mcap.reading import ChunkReader
from aerodft.adapters.mcap.records import image_sequence
from aerodft.adapters.mcap.scanning import ChunkPlace, SegmentScan
from aerodft.errors import InputError
from aerodft.model.arrays import ImageArray
from replay.recording import Recording

IMAGE_SCHEMA = str(CompressedImage.DESCRIPTOR.full_name)


def jpeg_of(data: bytes) -> bytes:
    """The JPEG in a ``foxglove.CompressedImage``.

    Raises:
        InputError: It is none.
    """
    try:
        return bytes(CompressedImage.FromString(data).data)
    except DecodeError as error:
        raise InputError("a recorded image is damaged", got=error) from error


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedPixels:
    """One recorded image's pixels; calling it reads and decodes them.

    Attributes:
        place: The chunk that holds it.
        first: The file's first chunk, which names the channels.
        log_ns: Its log time.
        sequence: Its sequence number.
    """

    place: ChunkPlace
    first: ChunkPlace
    log_ns: int
    sequence: int

    def __call__(self) -> ImageArray:
        """``(height, width, 3)`` uint8 BGR.

        Raises:
            InputError: The recording is damaged there.
        """
        chunks = (self.place,) if self.place.offset == self.first.offset else (self.first, self.place)
        where = f"{self.place.path}, image at {self.log_ns} ns"
        for message in ChunkReader().messages(chunks):
            found = message.log_ns == self.log_ns and message.sequence == self.sequence
            if found and message.channel.schema == IMAGE_SCHEMA:
                return decode_jpeg(jpeg_of(message.data), where)
        raise InputError("the recorded image is gone", where=where)


class JpegStore:
    """Which images of a recording have pixels."""

    def __init__(self, recording: Recording) -> None:
        self._places: dict[int, tuple[ChunkPlace, ChunkPlace]] = {}
        for segment in recording.images:
            for place in segment.chunks:
                for log_ns in _log_times(segment, place):
                    self._places[log_ns] = (place, segment.chunks[0])

    def __len__(self) -> int:
        return len(self._places)

    def pixels(self, arrival_ns: int, index: int) -> RecordedPixels | None:
        """The pixels of an image; None where none were recorded."""
        found = self._places.get(arrival_ns)
        if found is None:
            return None
        place, first = found
        return RecordedPixels(place=place, first=first, log_ns=arrival_ns, sequence=image_sequence(index))


def _log_times(segment: SegmentScan, place: ChunkPlace) -> list[int]:
    """The log times of a chunk's images: from its indexes, or where a killed recorder left none from itself."""
    is_first = place.offset == segment.chunks[0].offset
    if place.log_ns is not None and not is_first:
        return [log_ns for times in place.log_ns.values() for log_ns in times]
    chunks = (place,) if is_first else (segment.chunks[0], place)
    messages = ChunkReader().messages(chunks)
    return [
        message.log_ns
        for message in messages
        if message.channel.schema == IMAGE_SCHEMA and place.start_ns <= message.log_ns <= place.end_ns
    ]
