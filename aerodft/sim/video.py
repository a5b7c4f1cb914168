"""Video encoding: a file with exact stamps, or the datagrams of a live stream."""

import io
from collections.abc import Iterable
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import Self

import av
from av.container import OutputContainer
from av.video.stream import VideoStream

from aerodft.errors import InputError
from aerodft.model import ImageArray

FILE_TIME_BASE = Fraction(1, 1_000_000)
STREAM_TIME_BASE = Fraction(1, 90_000)
DATAGRAM_BYTES = 1316
"""Seven MPEG-TS packets, the usual size of a datagram."""

_CRF = "18"  # x264's quality for files
_LOW_DELAY = {"preset": "ultrafast", "tune": "zerolatency"}
# A PES packet with a length, by which a receiver can decode an image before the next one comes, holds at most 65 kB:
# the rate buffer keeps every image below that, key images too.
_MAX_IMAGE_KBIT = 400


def write_video(path: Path, images: Iterable[tuple[int, ImageArray]], *, fps: float) -> None:
    """Write a video file (H.264 in MP4) whose presentation stamps are the images' to the microsecond.

    Args:
        path: The file.
        images: ``(stamp_ns, (h, w, 3) uint8 BGR)`` ascending; sizes even.
        fps: Nominal rate.

    Raises:
        InputError: The file cannot be written.
    """
    # Microseconds as they are; without custom tags MP4 keeps its start to the second only.
    options = {"video_track_timescale": str(FILE_TIME_BASE.denominator), "movflags": "use_metadata_tags"}
    start_ns, stream = 0, None
    try:
        with av.open(str(path), "w", format="mp4", options=options) as container:
            for stamp_ns, image in images:
                if stream is None:
                    start_ns = stamp_ns
                    _write_start(container, start_ns)
                    stream = _add_stream(container, image, fps, FILE_TIME_BASE, {**_LOW_DELAY, "crf": _CRF})
                _encode(container, stream, image, (stamp_ns - start_ns) // 1000, FILE_TIME_BASE)
            if stream is not None:
                container.mux(stream.encode(None))
    except av.FFmpegError as error:
        raise InputError("cannot be written", where=path, got=error, hint="choose another folder") from None


def _write_start(container: OutputContainer, start_ns: int) -> None:
    seconds, nanoseconds = divmod(start_ns, 1_000_000_000)
    moment = datetime.fromtimestamp(seconds, tz=UTC).replace(microsecond=nanoseconds // 1000)
    text = moment.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    container.metadata["creation_time"] = text
    container.metadata["com.apple.quicktime.creationdate"] = text


def _add_stream(
    container: OutputContainer, image: ImageArray, fps: float, base: Fraction, options: dict[str, str]
) -> VideoStream:
    stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000), options=options)
    stream.height, stream.width = image.shape[:2]
    stream.pix_fmt = "yuv420p"
    stream.time_base = base
    stream.codec_context.time_base = base
    stream.codec_context.thread_count = 1
    return stream


def _encode(container: OutputContainer, stream: VideoStream, image: ImageArray, pts: int, base: Fraction) -> None:
    frame = av.VideoFrame.from_ndarray(image, format="bgr24")
    frame.pts = pts
    frame.time_base = base
    container.mux(stream.encode(frame))


class TransportStream:
    """Encoder of images to MPEG-TS (H.264 baseline, no delayed images, a key image every second).

    Args:
        fps: Rate of the images.
    """

    def __init__(self, fps: float) -> None:
        self._fps = fps
        self._buffer = io.BytesIO()
        options = {"flush_packets": "1", "omit_video_pes_length": "0"}
        self._container = av.open(self._buffer, "w", format="mpegts", options=options)
        self._stream: VideoStream | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._container.close()

    def encode(self, image: ImageArray, elapsed_ns: int) -> list[bytes]:
        """The datagrams of one image ``(h, w, 3)`` uint8 BGR, ``elapsed_ns`` after the first."""
        if self._stream is None:
            key_every = max(round(self._fps), 1)
            options = {
                **_LOW_DELAY,
                "profile": "baseline",
                "maxrate": f"{round(_MAX_IMAGE_KBIT * self._fps)}k",
                "bufsize": f"{_MAX_IMAGE_KBIT}k",
                "crf": "23",
                "x264-params": f"keyint={key_every}:min-keyint={key_every}:scenecut=0:repeat-headers=1",
            }
            self._stream = _add_stream(self._container, image, self._fps, STREAM_TIME_BASE, options)
        pts = elapsed_ns * STREAM_TIME_BASE.denominator // 1_000_000_000
        self._buffer.seek(0)
        self._buffer.truncate()
        _encode(self._container, self._stream, image, pts, STREAM_TIME_BASE)
        data = self._buffer.getvalue()
        return [data[start : start + DATAGRAM_BYTES] for start in range(0, len(data), DATAGRAM_BYTES)]
