from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

WIDTH_PX, HEIGHT_PX = 64, 48


def grey_of(index: int) -> int:
    """The brightness that tells which image one looks at."""
    return 20 + 12 * (index % 16)


def write_video(
    path: Path,
    stamps: Sequence[int],
    *,
    base: Fraction = Fraction(1, 1000),
    codec: str = "libx264",
    metadata: dict[str, str] | None = None,
    options: dict[str, str] | None = None,
    muxer: dict[str, str] | None = None,
) -> Path:
    """A video whose image ``i`` has presentation stamp ``stamps[i] * base`` and brightness ``grey_of(i)``."""
    with av.open(str(path), "w", options=muxer or {}) as container:
        container.metadata.update(metadata or {})
        stream = container.add_stream(codec, rate=Fraction(30))
        stream.width, stream.height, stream.pix_fmt = WIDTH_PX, HEIGHT_PX, "yuv420p"
        stream.time_base = stream.codec_context.time_base = base
        stream.options = options or {}
        for index, pts in enumerate(stamps):
            pixels = np.full((HEIGHT_PX, WIDTH_PX, 3), grey_of(index), dtype=np.uint8)
            frame = av.VideoFrame.from_ndarray(pixels, format="bgr24")
            frame.pts, frame.time_base = pts, base
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.fixture(scope="session")
def make_video() -> Callable[..., Path]:
    return write_video


@pytest.fixture(scope="session")
def grey() -> Callable[[int], int]:
    return grey_of
