"""A small recording of numbered frames and images, in short segments, for disks that fail."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from aerodft.adapters.recording.write import McapRecorder, RecorderSettings, RecordingTotals, recorder, segmented_writer
from aerodft.model import Camera, Event, Image, WireProtocol
from aerodft.service import block_of
from replay.recordings import Recording
from tests.batches import one_tick, take

CAMERA = Camera.from_fov(name="c", width_px=64, height_px=48, hfov_rad=1, vfov_rad=1)
STEPS = 12
FRAMES = 3
BYTES = 4000  # of noise in each frame
PIXELS = np.zeros((48, 64, 3), dtype=np.uint8)


def write_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Close chunks and sync whenever there is something, and allocate little ahead."""
    monkeypatch.setattr(recorder, "_SPARE_DATA_BYTES", 1 << 16)
    monkeypatch.setattr(recorder, "_SPARE_IMAGE_BYTES", 1 << 16)
    monkeypatch.setattr(segmented_writer, "FLUSH_S", 0.0)
    monkeypatch.setattr(segmented_writer, "SYNC_S", 0.0)


def record(folder: Path, *, lossless: bool = True) -> Iterator[RecordingTotals | None]:
    """A recording of a few segments: None after each step, at the end what the recorder says of it."""
    noise = np.random.default_rng(1)
    settings = RecorderSettings(
        station="s", camera=CAMERA, lossless=lossless, max_image_hz=1e6, segment_bytes=70_000, queued_images=1
    )
    made = McapRecorder(folder, settings, started_ns=1)
    for step in range(STEPS):
        frames = [b"%06d" % (step * FRAMES + k) + noise.bytes(BYTES) for k in range(FRAMES)]
        arrivals_ns = [(step + 1) * 1000 + k for k in range(FRAMES)]
        now_ns = arrivals_ns[-1] + 100
        shot = Image(index=step, stamp_ns=now_ns, arrival_ns=now_ns, width_px=64, height_px=48, pixels=lambda: PIXELS)
        events: list[Event] = [block_of(WireProtocol.MAVLINK, "a", arrivals_ns, frames), shot]
        take(made, one_tick(now_ns, events))
        yield None
    made.close()
    yield made.totals


def frames_in(recording: Recording) -> list[int]:
    """The numbers of the frames that a recording holds."""
    return [int(m.data[:6]) for m in recording.messages() if m.channel.encoding == "mavlink"]


def images_in(recording: Recording) -> list[int]:
    """The numbers of the images that a recording holds."""
    return [m.sequence for m in recording.image_messages() if m.channel.topic.endswith("jpeg")]
