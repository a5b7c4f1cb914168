"""A picture that claims more pixels than it can have is not decoded: kilobytes of it are gigabytes."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from aerodft.adapters.images import PacketDecoder, decode_jpeg
from aerodft.errors import InputError

WIDTH, HEIGHT = 640, 480


def h264() -> bytes:
    """One key frame, as x264 packs it."""
    encoder = av.CodecContext.create("libx264", "w")
    assert isinstance(encoder, av.VideoCodecContext)
    encoder.width, encoder.height, encoder.pix_fmt = WIDTH, HEIGHT, "yuv420p"
    encoder.time_base, encoder.options = Fraction(1, 30), {"tune": "zerolatency"}
    frame = av.VideoFrame.from_ndarray(np.full((HEIGHT, WIDTH, 3), 90, np.uint8), format="bgr24")
    frame.pts = 0
    return b"".join(bytes(packet) for packet in [*encoder.encode(frame), *encoder.encode(None)])


def test_a_jpeg_is_no_larger_than_its_image() -> None:
    data = cv2.imencode(".jpg", np.full((HEIGHT, WIDTH, 3), 90, np.uint8))[1].tobytes()
    assert decode_jpeg(data, "a", WIDTH * HEIGHT).shape == (HEIGHT, WIDTH, 3)
    assert decode_jpeg(data, "a").shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(InputError, match="larger than the image that it is of"):
        decode_jpeg(data, "a", WIDTH * HEIGHT - 1)
    start = data.index(b"\xff\xc0") + 5
    huge = data[:start] + (30_000).to_bytes(2, "big") * 2 + data[start + 4 :]
    with pytest.raises(InputError, match="larger"):
        decode_jpeg(huge, "a", WIDTH * HEIGHT)
    with pytest.raises(InputError, match="damaged"):
        decode_jpeg(b"\xff\xd8\xff", "a", WIDTH * HEIGHT)


def test_a_video_s_images_are_no_larger_than_theirs() -> None:
    data = h264()
    for most_px in (WIDTH * HEIGHT, None):
        frame = PacketDecoder("h264", most_px).decode(data)
        assert frame is not None
        assert (frame.width, frame.height) == (WIDTH, HEIGHT)
    assert PacketDecoder("h264", 160 * 120).decode(data) is None
