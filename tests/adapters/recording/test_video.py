"""Video that is compressed already is recorded as it came: to the byte, decodable from the start of every segment."""

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from aerodft.adapters.images.stream import PacketTap
from aerodft.adapters.recording.write import McapRecorder, RecorderSettings, segmented_writer
from aerodft.model import Camera, Image, VideoPacket
from replay.recordings import Recording, RecordingSource
from tests.batches import one_tick, take

CAMERA = Camera.from_fov(name="cam", width_px=160, height_px=120, hfov_rad=1, vfov_rad=1)
PERIOD_NS = 40_000_000
START_NS = 1_795_221_278_000_000_000
IMAGES, GROUP = 60, 10


def write_video(path: Path, **options: str) -> Path:
    noise = np.random.default_rng(5)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(25), options={"g": str(GROUP), **options})
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        still = noise.integers(0, 255, (120, 160, 3), dtype=np.uint8)
        for index in range(IMAGES):
            still[:, index : index + 30] = 255 - still[:, index : index + 30]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(still, format="bgr24")))
        container.mux(stream.encode())
    return path


def packets_of(path: Path, said: list[VideoPacket]) -> Iterator[Image]:
    """The video's images, each after its packet was handed on."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.codec_context.options = {"flags": "low_delay"}
        stream.thread_type = "SLICE"
        tap = PacketTap(stream, str(path), said.append)
        index = 0
        for packet in container.demux(stream):
            for frame in packet.decode():
                at_ns = START_NS + index * PERIOD_NS
                image = Image(
                    index=index,
                    stamp_ns=at_ns - 7,
                    arrival_ns=at_ns,
                    width_px=160,
                    height_px=120,
                    pixels=lambda frame=frame: frame.to_ndarray(format="bgr24"),
                )
                index += 1
                tap(packet, image, at_ns)
                yield image


def record(folder: Path, path: Path, **changes: object) -> tuple[McapRecorder, list[Image], list[VideoPacket]]:
    settings = RecorderSettings(station="s", camera=CAMERA, lossless=True, **changes)
    recorder = McapRecorder(folder, settings, started_ns=START_NS)
    said: list[VideoPacket] = []
    images = []
    for image in packets_of(path, said):
        while said:
            recorder.packet(said.pop(0))
        images.append(image)
        late = replace(image, arrival_ns=image.arrival_ns + 1_000_000)  # the inbox says when it arrived
        take(recorder, one_tick(late.arrival_ns + 5, [late]))
    recorder.close()
    return recorder, images, said


def unit_types(data: bytes) -> list[int]:
    parts = data.replace(b"\0\0\0\1", b"\0\0\1").split(b"\0\0\1")
    assert parts[0] == b"", "begins with a start code"
    return [part[0] & 31 for part in parts[1:]]


def recorded(path: Path) -> list[object]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [
            decoded
            for schema, _, _, decoded in reader.iter_decoded_messages()
            if schema is not None and schema.name == "foxglove.CompressedVideo"
        ]


@pytest.mark.parametrize("container", ["mp4", "ts", "h264"])
def test_packets_pass_as_they_are_and_every_segment_can_be_decoded(
    tmp_path: Path, container: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(segmented_writer, "FLUSH_S", 0.0)
    video = write_video(tmp_path / f"v.{container}", tune="zerolatency")
    recorder, images, _ = record(tmp_path / "r", video, segment_s=0.5, jpeg_quality=50)
    totals = recorder.totals
    assert (totals.offered_images, totals.images, totals.shed_images, totals.lost) == (IMAGES, IMAGES, 0, 0)
    paths = sorted((tmp_path / "r").glob("images_*.mcap"))
    assert len(paths) > 2
    for path in paths:
        messages = recorded(path)
        assert {message.format for message in messages} == {"h264"}
        kinds = [kind for kind in unit_types(messages[0].data) if kind in {7, 8, 5}]
        assert kinds[:2] == [7, 8]
        assert set(kinds[2:]) == {5}
        decoder = av.CodecContext.create("h264", "r")
        shown = [frame for message in messages for frame in decoder.decode(av.Packet(message.data))]
        assert len(shown) + len(decoder.decode(None)) == len(messages), "by itself, from its beginning"
    source = RecordingSource(Recording(tmp_path / "r"), pixels=True)
    shots = [event for event in source.events() if isinstance(event, Image)]
    assert len(shots) == IMAGES
    for shot, image in zip(shots, images, strict=True):
        np.testing.assert_array_equal(shot.pixels(), image.pixels(), err_msg="no second loss")


def test_images_that_refer_to_later_ones_become_jpegs(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    video = write_video(tmp_path / "v.mp4", bf="3", b_strategy="0")
    recorder, _, _ = record(tmp_path / "r", video, max_image_hz=1000.0)
    assert "its images refer to later ones: it is recorded as JPEGs" in caplog.text
    source = RecordingSource(Recording(tmp_path / "r"), pixels=True)
    assert sum(event.pixels is not None for event in source.events() if isinstance(event, Image)) > 5
    assert recorder.totals.offered_images == recorder.totals.images


@pytest.mark.parametrize("changes", [{"video": False}, {"max_image_hz": 0.0}])
def test_video_is_recorded_where_it_is_wanted(tmp_path: Path, changes: dict[str, object]) -> None:
    video = write_video(tmp_path / "v.mp4", tune="zerolatency")
    recorder, _, _ = record(tmp_path / "r", video, **changes)
    assert recorded(tmp_path / "r" / "images_000.mcap") == []
    assert (recorder.totals.images > 0) == ("video" in changes)


def test_after_a_shed_packet_all_are_shed_up_to_the_next_key(tmp_path: Path) -> None:
    settings = RecorderSettings(station="s", camera=CAMERA, queued_images=1)
    recorder = McapRecorder(tmp_path / "r", settings, started_ns=START_NS)
    large = bytes(2 << 20)
    for index in range(200):
        packet = VideoPacket(
            data=large, is_key=index % 10 == 0, stamp_ns=START_NS, arrival_ns=START_NS + index, index=index
        )
        recorder.packet(packet)
    recorder.close()
    totals = recorder.totals
    assert totals.offered_images == 200 == totals.images + totals.shed_images
    assert totals.shed_images > 0
    kept = [message.log_ns - START_NS for message in Recording(tmp_path / "r").image_messages()]
    assert all(number % 10 == 0 or number - 1 in kept for number in kept), "none without those that it needs"
