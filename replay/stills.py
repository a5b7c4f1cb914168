"""Recorded video as a live station publishes it: a JPEG now and then."""

from typing import TYPE_CHECKING, Final

from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from google.protobuf.message import DecodeError

from aerodft.adapters.images.packet_decoders import decoder_of
from aerodft.adapters.images.pixels import FramePixels
from aerodft.adapters.jpeg import encode_jpeg
from aerodft.adapters.mcap.reading import ReadMessage
from aerodft.conventions import SECOND_NS
from aerodft.model.image import Image

if TYPE_CHECKING:
    from aerodft.adapters.images.packets import PacketDecoder

_PERIOD_NS: Final = SECOND_NS // 2  # as a live station does
_QUALITY: Final = 75


class VideoStills:
    """Decodes one recording's packets in order; where their times go back it begins anew, as a loop does."""

    def __init__(self) -> None:
        self._decoder: PacketDecoder | None = None
        self._last_ns = self._next_ns = 0

    def still(self, message: ReadMessage) -> bytes | None:
        """A packet's image as JPEG; None where none is due, or where it cannot be decoded."""
        if message.log_ns < self._last_ns:  # what was seen last is no reference for what comes now
            self._decoder, self._next_ns = None, 0
        self._last_ns = message.log_ns
        try:
            packet = CompressedVideo.FromString(message.data)
            self._decoder = self._decoder or decoder_of(packet.format)
        except (DecodeError, ValueError):
            return None
        frame = self._decoder.decode(packet.data)
        if frame is None or message.log_ns < self._next_ns:
            return None
        self._next_ns = message.log_ns + _PERIOD_NS
        at_ns = message.log_ns
        return encode_jpeg(Image(index=0, stamp_ns=at_ns, arrival_ns=at_ns, pixels=FramePixels(frame)), _QUALITY)
