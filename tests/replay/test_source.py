"""A recording's input read with its images together is the input that is read one by one."""

from pathlib import Path

from aerodft.adapters.recording.write import McapRecorder, RecorderSettings
from aerodft.adapters.wire.events import encode_image, encode_observation
from aerodft.model import Arrival, Camera, Image, ImageRows, Observation, RawBlock, StampClock, WireProtocol
from aerodft.service import block_of, first_arrival_ns
from replay.recordings import Recording, RecordingSource
from tests.batches import one_tick, take

CAMERA = Camera.from_fov(name="c", width_px=64, height_px=48, hfov_rad=1, vfov_rad=1)
COUNT = 700


def shot(number: int, now_ns: int) -> Image:
    """A stamp alone, but for two images of the camera."""
    size = (64, 48) if number in {40, 650} else (None, None)
    return Image(
        index=number, stamp_ns=now_ns - 5, arrival_ns=now_ns, clock=StampClock.HOST, width_px=size[0], height_px=size[1]
    )


def recorded(folder: Path) -> Recording:
    """Frames, images and observations in turn, in segments that end early and late."""
    settings = RecorderSettings(station="s", camera=CAMERA, lossless=True, segment_s=3e-5)
    recorder = McapRecorder(folder, settings, started_ns=1)
    for number in range(1, COUNT + 1):
        now_ns = number * 100
        frames = block_of(WireProtocol.MAVLINK, "a", [now_ns - 3, now_ns + 3], [b"%d" % number, b"x" * 30])
        seen = Observation(name="w", stamp_ns=now_ns, arrival_ns=now_ns, pixels=((1.0, 2.0),), image=number)
        others = [seen] if number % 90 == 0 else []
        take(recorder, one_tick(now_ns + 10, [frames, shot(number, now_ns), *others]))
    recorder.close()
    return Recording(folder)


def payloads(events: list[Arrival]) -> tuple[list[bytes], list[bytes], list[bytes]]:
    """Frames, images and observations, each kind in its order."""
    blocks = [event for event in events if isinstance(event, RawBlock)]
    frames = [
        block.data[start : start + size]
        for block in blocks
        for start, size in zip(block.offset.tolist(), block.length.tolist(), strict=True)
    ]
    images = [
        encode_image(image)
        for event in events
        if isinstance(event, Image | ImageRows)
        for image in (event if isinstance(event, ImageRows) else [event])
    ]
    return frames, images, [encode_observation(event) for event in events if isinstance(event, Observation)]


def test_what_is_read_together_is_what_is_read_one_by_one(tmp_path: Path) -> None:
    recording = recorded(tmp_path / "r")
    source = RecordingSource(recording)
    together, apart = list(source.gathered()), list(source.events())
    assert payloads(together) == payloads(apart)
    assert payloads(apart)[1] == [encode_image(shot(number, 100 * number)) for number in range(1, COUNT + 1)]
    many = [event for event in together if isinstance(event, ImageRows)]
    assert sum(map(len, many)) > COUNT // 4
    assert max(map(len, many)) <= 256
    assert not any(isinstance(event, ImageRows) for event in apart)
    for events in (together, apart):
        arrivals_ns = list(map(first_arrival_ns, events))
        assert arrivals_ns == sorted(arrivals_ns)


def test_images_with_pixels_come_one_by_one(tmp_path: Path) -> None:
    source = RecordingSource(recorded(tmp_path / "r"), pixels=True)
    assert not any(isinstance(event, ImageRows) for event in source.gathered())
