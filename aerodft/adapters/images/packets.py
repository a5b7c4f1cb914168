"""Images out of single video packets, as recordings hold them: one image a packet, in order."""

from typing import TYPE_CHECKING, Final, cast

if TYPE_CHECKING:
    import av
    from av.video.codeccontext import VideoCodecContext

MOST_PX: Final = 36_000_000
"""Of a video's image: 8K has 33 million; a few kilobytes can claim gigabytes."""
_PADDED: Final = 1.2  # what is decoded is of whole blocks
_PADDED_PX: Final = 1 << 16
_CODECS: Final = {"h264": "h264", "h265": "hevc", "hevc": "hevc", "vp9": "vp9", "av1": "av1"}


class PacketDecoder:
    """Decodes packets that each hold one image and refer to none that comes later (Foxglove's CompressedVideo).

    Args:
        name: ``h264``, ``h265``, ``vp9`` or ``av1``.
        most_px: Larger images are damage; None where nobody knows their size.

    Raises:
        ValueError: No such codec.
    """

    def __init__(self, name: str, most_px: int | None = None) -> None:
        import av  # noqa: PLC0415 - 15 MB, and most images are JPEGs

        codec = _CODECS.get(name.lower())
        if codec is None:
            raise ValueError(f"video format {name!r}, must be one of {', '.join(_CODECS)}")
        self._context = cast("VideoCodecContext", av.CodecContext.create(codec, "r"))
        # One thread, or images would come out several packets late.
        self._context.thread_count = 1
        most_px = round(_PADDED * min(MOST_PX if most_px is None else most_px, MOST_PX)) + _PADDED_PX
        self._context.options = {"flags": "low_delay", "max_pixels": str(most_px)}
        self._count = 0

    def decode(self, data: bytes) -> "av.VideoFrame | None":
        """A packet's image; None where it is damaged, or refers to images that are missing."""
        import av  # noqa: PLC0415 - as above

        packet = av.Packet(data)
        packet.pts = packet.dts = self._count
        self._count += 1
        try:
            frames = self._context.decode(packet)
        except av.FFmpegError:
            return None
        own = [frame for frame in frames if frame.pts == packet.pts and not frame.is_corrupt]
        return own[-1] if own else None
