"""The decoder of a recording's video, for those who may meet one: FFmpeg is loaded when there is one."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from aerodft.adapters.images.packets import PacketDecoder


def decoder_of(name: str, most_px: int | None = None) -> "PacketDecoder":
    """A decoder of ``h264``, ``h265``, ``vp9`` or ``av1``; where it is known, of images of so many pixels at most.

    Raises:
        ValueError: No such codec.
    """
    from aerodft.adapters.images.packets import MOST_PX, PacketDecoder  # noqa: PLC0415 - 15 MB, and most images are JPEGs

    return PacketDecoder(name, MOST_PX if most_px is None else most_px)
