"""The decoder of a recording's video, for those who may meet one: FFmpeg is loaded when there is one."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from aerodft.adapters.images.packets import PacketDecoder


def decoder_of(name: str) -> "PacketDecoder":
    """A decoder of ``h264``, ``h265``, ``vp9`` or ``av1``.

    Raises:
        ValueError: No such codec.
    """
    from aerodft.adapters.images.packets import PacketDecoder  # noqa: PLC0415 - 15 MB, and most images are JPEGs

    return PacketDecoder(name)
