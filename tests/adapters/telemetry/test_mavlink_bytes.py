"""Whatever bytes come in: nothing raises, nothing warns, and what comes out is finite, or is not said where it may."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.generator.mavcrc import x25crc

from aerodft.adapters.telemetry.dataflash import DataflashDecoder, DataflashSource
from aerodft.adapters.telemetry.mavlink import MavlinkDecoder, StreamFramer, headers
from aerodft.adapters.telemetry.mavlink.decoding import WANTED
from aerodft.errors import InputError
from aerodft.model import CameraTrack, GpsTrack, HeightTrack, RawBlock, Track, WireProtocol, ZoomSource
from aerodft.service import block_of

START_NS = 10**18
SPECIAL = [struct.pack("<f", value) for value in (0, 1, -1, 30, 1e-40, 1e30, np.nan, np.inf, -np.inf)] + [b"\xff" * 4]
quickly = settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])


def _frame(message_id: int, payload: bytes) -> bytes:
    """A MAVLink 2 frame of system 1, component 1, with the right checksum, not truncated."""
    body = struct.pack("<BBBBBB", len(payload), 0, 0, 0, 1, 1) + message_id.to_bytes(3, "little") + payload
    crc = x25crc(body + bytes([dialect.mavlink_map[message_id].crc_extra])).crc
    return b"\xfd" + body + crc.to_bytes(2, "little")


@st.composite
def valid_frames(draw: st.DrawFn) -> bytes:
    """A frame of a wanted message with any payload, or with one of special numbers."""
    message_id = draw(st.sampled_from(WANTED))
    size = draw(st.integers(1, dialect.mavlink_map[message_id].unpacker.size))
    chosen = draw(st.none() | st.binary(min_size=64, max_size=64))
    if chosen is not None:
        return _frame(message_id, b"".join(SPECIAL[each % len(SPECIAL)] for each in chosen)[:size])
    return _frame(message_id, draw(st.binary(min_size=size, max_size=size)))


def _not_said(track: Track) -> dict[str, np.ndarray]:
    """Where each field of a track may be NaN, which means that nobody said it; nowhere in all other fields."""
    size = len(track.arrival_ns)
    always, never = np.ones(size, dtype=bool), np.zeros(size, dtype=bool)
    match track:
        case HeightTrack():
            return {"std_m": always}
        case GpsTrack():
            return {"horizontal_std_m": always, "vertical_std_m": always}
        case CameraTrack(source=ZoomSource.CAMERA_SETTINGS):
            return {"hfov_rad": always, "level": never}
        case CameraTrack(source=ZoomSource.CAMERA_FOV_STATUS):
            return {"hfov_rad": never, "level": always}
        case CameraTrack(source=ZoomSource.VIDEO_STREAM_INFORMATION):
            return {"hfov_rad": (track.size_px > 0).any(axis=-1), "level": always}
        case _:
            return {}


def _assert_sound(tracks: tuple[Track, ...]) -> None:
    for track in tracks:
        not_said = _not_said(track)
        for cls in type(track).__mro__:
            for name in getattr(cls, "__slots__", ()):
                values = getattr(track, name)
                if isinstance(values, np.ndarray):
                    assert len(values) == len(track.arrival_ns) > 0
                    unknown = np.isnan(values) & not_said.get(name, np.zeros(len(values), dtype=bool)).reshape(
                        -1, *(1,) * (values.ndim - 1)
                    )
                    assert (np.isfinite(values) | unknown).all()
                if name == "wxyz":
                    np.testing.assert_allclose(np.linalg.norm(values, axis=-1), 1, atol=1e-9)
        _assert_possible(track)


def _assert_possible(track: Track) -> None:
    """What is said is what can be."""
    match track:
        case HeightTrack():
            assert (np.abs(track.value_m) <= 50_000).all()
            assert not (track.std_m <= 0).any()
        case GpsTrack():
            assert not (track.horizontal_std_m <= 0).any()
            assert not (track.vertical_std_m <= 0).any()
        case CameraTrack():
            assert not ((track.hfov_rad <= 0) | (track.hfov_rad >= np.pi)).any()
            assert not ((track.level < 0) | (track.level > 1)).any()


@quickly
@given(st.lists(valid_frames(), max_size=20))
def test_any_payload_decodes_to_sound_tracks(frames: list[bytes]) -> None:
    vehicle = _frame(0, struct.pack("<IBBBBB", 0, 2, 3, 0, 4, 3))
    frames = [vehicle, *frames]
    assert StreamFramer().push(b"".join(frames)) == frames
    block = block_of(WireProtocol.MAVLINK, "any", range(START_NS, START_NS + len(frames)), frames)
    _assert_sound(MavlinkDecoder().decode(block))
    assert (headers(block)[0] >= 0).all()


@quickly
@given(st.lists(st.binary(max_size=300), max_size=10))
def test_any_bytes_are_framed_without_error(pieces: list[bytes]) -> None:
    framer = StreamFramer()
    found = [frame for piece in pieces for frame in framer.push(piece)] + framer.flush()
    stream = b"".join(pieces)
    assert sum(map(len, found)) + framer.counts.skipped_bytes <= len(stream)
    assert all(frame in stream for frame in found)


@quickly
@given(st.lists(st.binary(max_size=40), min_size=1, max_size=10))
def test_any_frames_decode_without_error(frames: list[bytes]) -> None:
    for protocol, decoder in ((WireProtocol.MAVLINK, MavlinkDecoder()), (WireProtocol.DATAFLASH, DataflashDecoder())):
        _assert_sound(decoder.decode(block_of(protocol, "any", range(len(frames)), frames)))


@pytest.fixture(scope="module")
def log_head() -> bytes:
    path = Path(__file__).parents[3].parent / "shared/data/sitl/brushless_cut.BIN"
    if not path.is_file():
        pytest.skip(f"no recorded flight: {path} is absent")
    return path.read_bytes()[:150_000]


@settings(parent=quickly, max_examples=40)
@given(places=st.lists(st.integers(0, 149_999), min_size=1, max_size=30), value=st.integers(0, 255))
def test_a_damaged_on_board_log_never_raises_anything_else(
    log_head: bytes, tmp_path: Path, places: list[int], value: int
) -> None:
    content = bytearray(log_head)
    for place in places:
        content[place] = value
    path = tmp_path / "damaged.bin"
    path.write_bytes(content)
    try:
        source = DataflashSource(path)
    except InputError:
        return
    decoder = DataflashDecoder()
    last_ns = 0
    for event in source.events():
        assert isinstance(event, RawBlock)
        assert last_ns <= event.arrival_ns[0]
        assert (np.diff(event.arrival_ns) >= 0).all()
        last_ns = int(event.arrival_ns[-1])
        _assert_sound(decoder.decode(event))
