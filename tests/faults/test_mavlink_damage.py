from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.mavlink.framing import StreamFramer
from aerodft.adapters.mavlink.tlog import TlogSource
from aerodft.model.telemetry import RawBlock

FRAMES = 5000
NOISE_BYTES = 10_000_000


def _frames(seed: int) -> list[bytes]:
    rng = np.random.default_rng(seed)
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    frames = []
    for k in range(FRAMES):
        mav.seq = k % 256
        message = dialect.MAVLink_attitude_message(k, *rng.uniform(-3, 3, 6))
        frames.append(bytes(message.pack(mav, force_mavlink1=k % 2 == 0)))
    return frames


def _damaged(frames: list[bytes], kind: str) -> tuple[list[bytes], list[bytes]]:
    """The stream with a fifth of the frames broken, and the intact ones."""
    rng = np.random.default_rng(11)
    stream, intact = [], []
    for frame in frames:
        if rng.random() < 0.8:
            stream.append(frame)
            intact.append(frame)
        elif kind == "truncated":
            stream.append(frame[: rng.integers(1, len(frame))])
        else:
            broken = bytearray(frame)
            broken[rng.integers(len(frame))] ^= 1 << int(rng.integers(8))
            stream.append(bytes(broken))
    return stream, intact


@pytest.mark.parametrize("kind", ["truncated", "flipped"])
def test_live_no_intact_frame_is_lost_and_none_invented(kind: str) -> None:
    stream, intact = _damaged(_frames(1), kind)
    framer = StreamFramer()
    found = [frame for piece in stream for frame in framer.push(piece)] + framer.flush()
    assert found == intact
    assert framer.counts.bad_crc > 0


@pytest.mark.parametrize("kind", ["truncated", "flipped"])
def test_log_no_intact_frame_is_lost_and_none_invented(kind: str, tmp_path: Path) -> None:
    stream, intact = _damaged(_frames(2), kind)
    start_us = 1_700_000_000_000_000
    path = tmp_path / "damaged.tlog"
    path.write_bytes(b"".join((start_us + k * 1000).to_bytes(8, "big") + piece for k, piece in enumerate(stream)))
    source = TlogSource(path)
    blocks = [event for event in source.events() if isinstance(event, RawBlock)]
    found = [b.data[o : o + n] for b in blocks for o, n in zip(b.offset.tolist(), b.length.tolist(), strict=True)]
    assert found == intact
    arrival_us = np.concatenate([b.arrival_ns for b in blocks]) // 1000
    positions = {piece: start_us + k * 1000 for k, piece in enumerate(stream)}
    np.testing.assert_array_equal(arrival_us, [positions[frame] for frame in intact])
    assert any("damaged frames" in sentence for sentence in source.warnings())


def test_noise_holds_no_message() -> None:
    noise = np.random.default_rng(3).integers(0, 256, NOISE_BYTES, dtype=np.uint8).tobytes()
    framer = StreamFramer()
    assert framer.push(noise) + framer.flush() == []
    assert framer.counts.skipped_bytes > 0.9 * NOISE_BYTES


def test_frames_between_noise_are_all_found() -> None:
    rng = np.random.default_rng(4)
    frames = _frames(4)[:1000]
    framer = StreamFramer()
    found = []
    for frame in frames:
        found += framer.push(rng.integers(0, 256, rng.integers(0, 60), dtype=np.uint8).tobytes() + frame)
    assert found + framer.flush() == frames
