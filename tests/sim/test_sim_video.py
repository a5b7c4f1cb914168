import io
from datetime import UTC, datetime
from pathlib import Path

import av
import numpy as np
import pytest

from aerodft.adapters.images import VideoFileSource
from aerodft.errors import InputError
from aerodft.model import ImageArray
from aerodft.sim.video import DATAGRAM_BYTES, TransportStream, write_video

START_NS = 1_795_221_278_868_833_000
PES_LIMIT = 65_535


def pictures(count: int, *, noise: int = 0) -> list[ImageArray]:
    """A bright bar that walks over noise, 320 x 240."""
    images = []
    for index in range(count):
        image = np.random.default_rng(index).integers(0, noise + 1, (240, 320, 3)).astype(np.uint8)
        image[:, 10 * index : 10 * index + 10] = 255
        images.append(image)
    return images


def test_stamps_survive_to_the_microsecond(tmp_path: Path) -> None:
    gaps_us = np.random.default_rng(1).integers(20_000, 150_000, 24)
    stamps = [START_NS + int(us) * 1000 for us in np.cumsum(gaps_us)]
    path = tmp_path / "video.mp4"
    write_video(path, zip(stamps, pictures(24), strict=True), fps=10.0)
    with av.open(path) as container:
        base = container.streams.video[0].time_base
        assert base is not None
        frames = list(container.decode(video=0))
        created = container.metadata["creation_time"]
    assert len(frames) == len(stamps)
    start = datetime.fromisoformat(created)
    start_us = int((start - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()) * 1_000_000 + start.microsecond
    assert [start_us + round(frame.pts * base * 1_000_000) for frame in frames] == [stamp // 1000 for stamp in stamps]
    for index, frame in enumerate(frames):
        columns = frame.to_ndarray(format="bgr24")[:, :, 1].mean(axis=0)
        assert columns[10 * index + 2 : 10 * index + 8].min() > 200


def test_the_products_own_reader_needs_no_start(tmp_path: Path) -> None:
    stamps = [START_NS + i * 100_000_000 for i in range(5)]
    write_video(tmp_path / "video.mp4", zip(stamps, pictures(5), strict=True), fps=10.0)
    assert [image.stamp_ns for image in VideoFileSource(tmp_path / "video.mp4").events()] == stamps


def test_an_unwritable_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_video(tmp_path / "missing" / "video.mp4", [(START_NS, pictures(1)[0])], fps=10.0)


def test_every_live_image_is_whole_small_and_decodes() -> None:
    images = pictures(25, noise=120)
    with TransportStream(10.0) as stream:
        sent = [stream.encode(image, index * 100_000_000) for index, image in enumerate(images)]
    assert all(len(packet) <= DATAGRAM_BYTES and len(packet) % 188 == 0 for packets in sent for packet in packets)
    assert max(sum(map(len, packets)) for packets in sent) < PES_LIMIT
    with av.open(io.BytesIO(b"".join(b"".join(packets) for packets in sent)), format="mpegts") as container:
        frames = list(container.decode(video=0))
    assert len(frames) == len(images)
    assert [frame.pts - frames[0].pts for frame in frames] == [9000 * index for index in range(len(images))]
    assert [index for index, frame in enumerate(frames) if frame.key_frame] == [0, 10, 20]


def test_an_image_is_complete_before_the_next_is_sent() -> None:
    images = pictures(12)
    with TransportStream(10.0) as stream:
        sent = [stream.encode(image, index * 100_000_000) for index, image in enumerate(images)]
    for packets in sent:
        # A PES packet with a length ends by itself; without one a receiver waits for the next image.
        stream = b"".join(packets)
        header = stream.index(b"\x00\x00\x01\xe0")
        assert int.from_bytes(stream[header + 4 : header + 6], "big") > 0
