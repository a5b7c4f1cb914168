"""Recorded video packets give each image its own pixels, in order and going back."""

from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from aerodft.adapters.recording.write import McapRecorder, RecorderSettings
from aerodft.errors import InputError
from aerodft.model import Camera, Image
from replay.player.publish import VideoStills
from replay.recordings import Recording, RecordingSource
from tests.batches import one_tick, take
from tests.cli.test_foreign_recordings import h264

START_NS, STEP_NS = 1_795_221_278_000_000_000, 200_000_000
COUNT = 8


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Images 0 to 7, each 20 grey levels lighter; the packets are in a file beside."""
    folder = tmp_path / "r"
    camera = Camera.from_fov(name="c", width_px=64, height_px=48, hfov_rad=1, vfov_rad=1)
    recorder = McapRecorder(folder, RecorderSettings(station="s", camera=camera, lossless=True), started_ns=START_NS)
    for k in range(COUNT):
        at_ns = START_NS + k * STEP_NS
        take(recorder, one_tick(at_ns, [Image(index=k, stamp_ns=at_ns, arrival_ns=at_ns, width_px=64, height_px=48)]))
    recorder.close()
    with (folder / "images_001.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        text = build_file_descriptor_set(CompressedVideo).SerializeToString()
        schema = writer.register_schema("foxglove.CompressedVideo", "protobuf", text)
        channel = writer.register_channel("aerodft/s/image/video", "protobuf", schema)
        for k, packet in enumerate(h264(COUNT)):
            data = CompressedVideo(data=packet, format="h264").SerializeToString()
            writer.add_message(channel, START_NS + k * STEP_NS, data, START_NS + k * STEP_NS, k)
        writer.finish()
    return folder


def test_each_image_has_its_own_pixels_in_any_order(recording: Path) -> None:
    images = [each for each in RecordingSource(Recording(recording), pixels=True).events() if isinstance(each, Image)]
    assert len(images) == COUNT
    for index in (0, 1, 3, 7, 2, 2, 5):
        pixels = images[index].pixels
        assert pixels is not None
        assert np.mean(pixels()) == pytest.approx(20 + 20 * index, abs=4)


def test_a_packet_that_is_damaged_is_refused_and_no_other(recording: Path) -> None:
    path = recording / "images_001.mcap"
    images = [each for each in RecordingSource(Recording(recording), pixels=True).events() if isinstance(each, Image)]
    path.unlink()
    pixels = images[3].pixels
    assert pixels is not None
    with pytest.raises(InputError, match="cannot be read"):
        pixels()


def test_a_replay_that_loops_has_its_stills_in_every_round(recording: Path) -> None:
    stills, messages = VideoStills(), list(Recording(recording).image_messages())
    rounds = [[stills.still(message) for message in messages] for _ in range(3)]
    assert [each is not None for each in rounds[0]] == [k % 3 == 0 for k in range(COUNT)]  # every half second
    assert rounds[0] == rounds[1] == rounds[2]
