"""A stream looked through over whole arrays: the frames, counters and rest that the loop over its bytes finds."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.mavlink import kernels, vectorised_stream
from aerodft.adapters.mavlink.dialect import frame_table
from aerodft.adapters.mavlink.layout import AT_SYNC, N_OK, N_SKIPPED, STATE_SIZE
from aerodft.adapters.mavlink.tlog import TlogSource
from aerodft.geometry.jit import load_compiler

load_compiler()  # what is compared with is compiled
SAMPLE = Path(__file__).parents[3] / "samples/copter.tlog"
READS = (150, 900, 1 << 20)

Scan = Callable[..., tuple[int, int]]


def scanned(scan: Scan, content: bytes, read: int) -> tuple[list[bytes], list[np.ndarray]]:
    """Frames, and the state after each read."""
    state, rest = np.zeros(STATE_SIZE, dtype=np.int64), b""
    frames, states = [], []
    for first in range(0, len(content), read):
        data = rest + content[first : first + read]
        offsets, lengths = np.empty((2, len(data) // 8 + 1), dtype=np.int64)
        array = np.frombuffer(data, dtype=np.uint8)
        found, done = scan(array, given_up=0, table=frame_table(), offsets=offsets, lengths=lengths, state=state)
        frames += [data[a : a + n] for a, n in zip(offsets[:found].tolist(), lengths[:found].tolist(), strict=True)]
        rest = data[done:]
        state[AT_SYNC:] -= done
        states.append(state.copy())
    return frames, states


def assert_the_same(content: bytes, read: int) -> np.ndarray:
    ours, our_states = scanned(vectorised_stream.scan_stream, content, read)
    theirs, their_states = scanned(kernels.scan_stream, content, read)
    assert ours == theirs
    np.testing.assert_array_equal(np.array(our_states), np.array(their_states))
    return our_states[-1]


def pieces_of(rng: np.random.Generator, kinds: list[str]) -> list[bytes]:
    """Frames, every fifth of them signed, some of them ending in what could begin another; one thing done to each."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.signing.secret_key = bytes(32)
    pieces = []
    for k, kind in enumerate(kinds):
        mav.seq, mav.signing.sign_outgoing = k & 0xFF, k % 5 == 0
        text = dialect.MAVLink_statustext_message(6, rng.bytes(int(rng.integers(0, 40))))
        angles = dialect.MAVLink_attitude_message(k, *rng.uniform(-3, 3, 6))
        piece = bytearray((text if k % 3 == 0 else angles).pack(mav, force_mavlink1=bool(k % 2)))
        while kind == "tailed" and piece[-1] not in (0xFD, 0xFE):
            mav.seq = int(rng.integers(256))
            piece = bytearray(angles.pack(mav, force_mavlink1=bool(rng.integers(2))))
        match kind:
            case "cut" | "tailed":
                # what is behind is as if a cut frame's last bytes were the next one's first
                del piece[len(piece) - (0 if kind == "tailed" and k % 2 else int(rng.integers(1, 16))) :]
            case "flipped":
                piece[int(rng.integers(len(piece)))] ^= 1 << int(rng.integers(8))
            case "noise":
                piece += rng.bytes(int(rng.integers(0, 30)))
            case "wrapped":
                piece = bytearray(b"\0\1\0\0" + rng.bytes(8) + len(piece).to_bytes(4, "little")) + piece
            case "alien":
                piece[5], piece[9] = piece[5] ^ 0xFF, 7
            case "within":
                piece = bytearray(dialect.MAVLink_statustext_message(6, bytes(piece)[:50]).pack(mav))
        pieces.append(bytes(piece))
    return pieces


KINDS = ["whole", "cut", "flipped", "noise", "wrapped", "alien", "tailed", "within"]


@settings(deadline=None)  # the first call compiles
@given(
    st.integers(0, 2**32),
    st.lists(st.sampled_from([*["whole"] * 6, *KINDS]), min_size=1, max_size=80),
    st.sampled_from(READS),
)
def test_damaged_streams_are_scanned_alike(seed: int, kinds: list[str], read: int) -> None:
    assert_the_same(b"".join(pieces_of(np.random.default_rng(seed), kinds)), read)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("read", READS)
def test_what_all_messages_share_is_scanned_alike(kind: str, read: int) -> None:
    state = assert_the_same(b"".join(pieces_of(np.random.default_rng(7), [kind] * 400)), read)
    assert state[N_OK] == 400 or kind in {"cut", "flipped", "alien", "tailed"}


@pytest.mark.parametrize("size", [1, 7, 600, 200_000])
def test_noise_is_scanned_alike(size: int) -> None:
    assert assert_the_same(np.random.default_rng(size).bytes(size), 1 << 20)[N_SKIPPED] > size - 600


def test_a_flight_is_scanned_alike() -> None:
    blocks = list(TlogSource(SAMPLE).events())
    frames = [
        block.data[start : start + size]
        for block in blocks
        for start, size in zip(block.offset.tolist(), block.length.tolist(), strict=True)
    ]
    assert assert_the_same(b"".join(frames), 1 << 18)[N_OK] == len(frames)
    wrapped = b"".join(b"\x0a" + len(frame).to_bytes(2, "big") + frame + b"\x12\xfd\xfe" for frame in frames)
    assert assert_the_same(wrapped, 1 << 18)[N_OK] == len(frames)
