import time
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.generator.mavcrc import x25crc

from aerodft.adapters.telemetry import TlogSource
from aerodft.adapters.telemetry.mavlink import SIGNATURE, V1, V2, MavlinkDecoder, StreamFramer
from aerodft.adapters.telemetry.mavlink.signing import sign
from aerodft.model import RawBlock, WireProtocol
from aerodft.service import block_of

FRAMES = 5000
NOISE_BYTES = 10_000_000
DATAGRAM = 1400
LEAST_BYTES_PER_S = 2e6
MOST_LUCKY_SHARE = 1e-3
START_US = 1_700_000_000_000_000


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


def _frames_of(source: TlogSource) -> list[bytes]:
    blocks = [event for event in source.events() if isinstance(event, RawBlock)]
    return [b.data[o : o + n] for b in blocks for o, n in zip(b.offset.tolist(), b.length.tolist(), strict=True)]


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
    path = tmp_path / "damaged.tlog"
    path.write_bytes(b"".join((START_US + k * 1000).to_bytes(8, "big") + piece for k, piece in enumerate(stream)))
    source = TlogSource(path)
    assert _frames_of(source) == intact
    blocks = [event for event in source.events() if isinstance(event, RawBlock)]
    arrival_us = np.concatenate([b.arrival_ns for b in blocks]) // 1000
    positions = {piece: START_US + k * 1000 for k, piece in enumerate(stream)}
    np.testing.assert_array_equal(arrival_us, [positions[frame] for frame in intact])
    assert any("damaged frames" in sentence for sentence in source.warnings())


def _report(capsys: pytest.CaptureFixture[str], what: str, count: int, size: int, cpu_s: float) -> None:
    """Print a figure; processor time, because other work shares the machine."""
    assert size / cpu_s > LEAST_BYTES_PER_S
    with capsys.disabled():
        print(f"\n{what}: {size / 1e6:.1f} MB at {size / cpu_s / 1e6:.0f} MB/s, {count} frames found")


def test_noise_holds_no_message(capsys: pytest.CaptureFixture[str]) -> None:
    noise = np.random.default_rng(3).integers(0, 256, NOISE_BYTES, dtype=np.uint8).tobytes()
    StreamFramer().push(noise[:DATAGRAM])  # compiled by now, as on a live link
    framer = StreamFramer()
    start_s = time.process_time()
    found = [frame for at in range(0, NOISE_BYTES, DATAGRAM) for frame in framer.push(noise[at : at + DATAGRAM])]
    found += framer.flush()
    _report(capsys, "noise in datagrams", len(found), NOISE_BYTES, time.process_time() - start_s)
    assert found == []
    assert framer.counts.skipped_bytes > 0.9 * NOISE_BYTES


def test_noise_in_a_log_holds_no_message(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (first, last) = _frames(6)[:2]
    stamp = (1_700_000_000_000_000).to_bytes(8, "big")
    noise = np.random.default_rng(6).integers(0, 256, NOISE_BYTES, dtype=np.uint8).tobytes()
    path = tmp_path / "noise.tlog"
    path.write_bytes(stamp + first + noise + stamp + last)
    source = TlogSource(path)
    start_s = time.process_time()
    found = _frames_of(source)
    _report(capsys, "noise in a .tlog", len(found), NOISE_BYTES, time.process_time() - start_s)
    assert found == [first, last]


def _assert_honest(found: list[bytes], sent: list[bytes], intact: list[bytes]) -> None:
    """Every intact frame is there, in its order; what is there beside them was sent, and cut where it did not matter.

    A frame whose last byte is cut off is whole again where what follows happens to begin with that byte.
    """
    known, rest = set(sent), iter(found)
    assert all(frame in known for frame in found)
    assert all(any(frame == other for other in rest) for frame in intact)
    assert len(found) - len(intact) < MOST_LUCKY_SHARE * len(sent)


@pytest.mark.parametrize("kind", ["truncated", "flipped"])
@pytest.mark.parametrize("log", ["dronekit_quad.tlog", "vtol.tlog"])
def test_a_damaged_flight(
    log: str, kind: str, data_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = _frames_of(TlogSource(data_folder / "logs" / log))
    stream, intact = _damaged(frames, kind)
    path = tmp_path / log
    path.write_bytes(b"".join((START_US + k * 1000).to_bytes(8, "big") + piece for k, piece in enumerate(stream)))
    source, size = TlogSource(path), path.stat().st_size
    decoder = MavlinkDecoder()
    start_s = time.process_time()
    blocks = [event for event in source.events() if isinstance(event, RawBlock)]
    tracks = [track for block in blocks for track in decoder.decode(block)]
    cpu_s = time.process_time() - start_s
    found = [b.data[o : o + n] for b in blocks for o, n in zip(b.offset.tolist(), b.length.tolist(), strict=True)]
    _report(capsys, f"{log}, a fifth {kind} ({len(intact)} frames intact)", len(found), size, cpu_s)
    assert tracks
    _assert_honest(found, frames, intact)
    framer = StreamFramer()
    _assert_honest([frame for piece in stream for frame in framer.push(piece)] + framer.flush(), frames, intact)


def test_frames_between_noise_are_all_found() -> None:
    rng = np.random.default_rng(4)
    frames = _frames(4)[:1000]
    framer = StreamFramer()
    found = []
    for frame in frames:
        found += framer.push(rng.integers(0, 256, rng.integers(0, 60), dtype=np.uint8).tobytes() + frame)
    assert found + framer.flush() == frames


@pytest.mark.parametrize("magic", [b"\xfd", b"\xfe"])
def test_a_frame_whose_last_byte_is_the_next_ones_first(magic: bytes) -> None:
    frames = [frame for frame in _frames(9) if frame[-1:] == magic]
    following = [frame for frame in _frames(10) if frame[:1] == magic]
    assert len(frames) > 3
    for cut, whole in zip(frames, following, strict=False):
        framer = StreamFramer()
        found = [frame for byte in cut[:-1] + whole for frame in framer.push(bytes([byte]))]
        assert found + framer.flush() == [cut, whole]


def _signed(frames: list[bytes]) -> list[bytes]:
    return [sign(frame, bytes(32), link_id=0, stamp=k) for k, frame in enumerate(frames) if frame[0] == V2]


@pytest.mark.parametrize("cut", range(1, SIGNATURE + 1))
def test_a_cut_signature_swallows_no_neighbour(cut: int, tmp_path: Path) -> None:
    frames = _signed(_frames(12)[:400])
    frames[3::5] = [frame for frame in _frames(13)[:400] if frame[0] == V1][: len(frames[3::5])]
    stream = [frame[:-cut] if k % 5 == 2 else frame for k, frame in enumerate(frames)]
    intact = set(frames) - set(frames[2::5])
    framer = StreamFramer()
    found = [frame for piece in stream for frame in framer.push(piece)] + framer.flush()
    assert intact <= set(found)
    path = tmp_path / "signed.tlog"
    path.write_bytes(b"".join((START_US + k * 1000).to_bytes(8, "big") + piece for k, piece in enumerate(stream)))
    assert intact <= set(_frames_of(TlogSource(path)))


def test_whole_signed_frames_delay_nobody() -> None:
    framer = StreamFramer()
    for frame in _signed(_frames(14)[:1000]):
        assert framer.push(frame) == [frame]


def test_what_waits_behind_a_cut_frame_comes_when_that_one_is_overdue() -> None:
    long = bytes(dialect.MAVLink_statustext_message(6, b"x" * 50, 1).pack(dialect.MAVLink(None)))
    frames = _frames(15)[:2]
    framer = StreamFramer()
    assert framer.push(long[:20]) == []
    assert framer.push(frames[0]) == []  # 54 bytes are claimed
    assert framer.overdue() == []  # it has only just begun
    assert framer.overdue() == frames[:1]
    assert framer.push(frames[1]) == frames[1:]


def test_a_frame_that_a_link_stopped_in_is_waited_for() -> None:
    (frame,) = _frames(15)[:1]
    framer = StreamFramer()
    assert framer.push(frame[:20]) == []
    assert [framer.overdue() for _ in range(5)] == [[]] * 5
    assert framer.push(frame[20:]) == [frame]
    assert framer.counts.truncated == framer.counts.skipped_bytes == 0


def test_a_payload_of_zeros_that_was_cut_off_altogether() -> None:
    body = bytes([V2, 0, 0, 0, 7, 1, 1, 30, 0, 0])  # as the first senders of MAVLink 2 did
    crc = x25crc(body[1:] + bytes([dialect.MAVLink_attitude_message.crc_extra])).crc
    frame = body + crc.to_bytes(2, "little")
    assert dialect.MAVLink(None).decode(bytearray(frame)).to_dict()["pitch"] == 0.0
    assert StreamFramer().push(frame) == [frame]
    (track,) = MavlinkDecoder().decode(block_of(WireProtocol.MAVLINK, "x", [1], [frame]))[:1]
    np.testing.assert_array_equal(track.wxyz, [[1.0, 0.0, 0.0, 0.0]])


def test_a_shared_byte_delays_nobody() -> None:
    frames = [frame for frame in _frames(9) if frame[-1:] in {b"\xfd", b"\xfe"}]
    framer = StreamFramer()
    for frame in frames:
        assert framer.push(frame) == [frame]
    assert framer.counts.skipped_bytes == 0


def test_a_cut_record_is_whole_by_the_next_ones_stamp(tmp_path: Path) -> None:
    frames = [frame for frame in _frames(8) if frame[-1] == 0][:7]  # and so is the first byte of every stamp
    stamp = START_US.to_bytes(8, "big")
    path = tmp_path / "cut.tlog"
    path.write_bytes(b"".join(stamp + (frame[:-1] if k % 2 else frame) for k, frame in enumerate(frames)))
    assert len(frames) == 7
    assert _frames_of(TlogSource(path)) == frames
