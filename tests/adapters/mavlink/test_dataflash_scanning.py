"""Messages of ArduPilot's logs are found alike by the compiled loop and over whole arrays, and stamps settled alike."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerodft.adapters.mavlink import dataflash_kernels, dataflash_vectorised
from aerodft.adapters.mavlink.arrivals import settle, settle_all
from aerodft.adapters.mavlink.dataflash_format import FMT_SIZE, FMT_TYPE
from aerodft.adapters.mavlink.layout import BACK_US, JUMP_US, STATE_SIZE
from aerodft.geometry.jit import load_compiler
from tests.adapters.mavlink.spoiling import WAYS, spoil

load_compiler()  # what is compared with is compiled
CAPACITY = 50
SIZES = {FMT_TYPE: FMT_SIZE, 10: 20, 11: 5, 12: 31, 13: 3}

Scan = Callable[..., tuple[int, int]]


def declared(kind: int, size: int, columns: bytes = b"TimeUS,Roll") -> bytes:
    return bytes((0xA3, 0x95, FMT_TYPE, kind, size)) + b"ATT\0" + b"Qf".ljust(16, b"\0") + columns.ljust(64, b"\0")


def scanned(scan: Scan, data: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All rows, the final state and the types, whatever the scan does at once."""
    state, types = np.zeros(STATE_SIZE, dtype=np.int64), np.zeros(256, dtype=np.int64)
    types[FMT_TYPE] = FMT_SIZE
    rows = np.empty((3, CAPACITY), dtype=np.int64)
    parts, at = [rows[:, :0]], 0
    while at < len(data):
        found, at = scan(data, at, at + step, types, rows, state)
        parts.append(rows[:, :found].copy())
    return np.concatenate(parts, axis=1), state, types


def assert_the_same(content: bytes, step: int = 1 << 20) -> int:
    data = np.frombuffer(content, dtype=np.uint8)
    ours = scanned(dataflash_vectorised.scan_dataflash, data, step)
    theirs = scanned(dataflash_kernels.scan_dataflash, data, step)
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(one, other)
    return ours[0].shape[1]


@st.composite
def damaged_logs(draw: st.DrawFn) -> bytes:
    """Messages of known and unknown types, formats among them, heads inside, pieces cut out and bytes changed."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    pieces = [declared(10, SIZES[10])]
    for k in range(draw(st.integers(1, 60))):
        kind = int(rng.choice([10, 10, 10, 11, 12, 13, 99]))
        body = bytearray(rng.bytes(SIZES.get(kind, 9) - 3))
        if len(body) > 8:
            body[:8] = (k * 1000).to_bytes(8, "little")
        if len(body) > 12 and k % 3 == 0:
            body[-3:] = bytes((0xA3, 0x95, int(rng.choice([10, 11, 128]))))
        piece = bytearray(bytes((0xA3, 0x95, kind)) + body)
        way = draw(st.sampled_from([*WAYS, "declared"]))
        spoil(piece, way, rng)
        if way == "declared":
            other = int(rng.choice([10, 11, 12, 13]))
            columns = b"TimeUS,Roll" if k % 2 else b"Other,Roll"
            piece += declared(other, SIZES[other] + (k % 5 == 0), columns)
        pieces.append(bytes(piece))
    return b"".join(pieces)


@settings(deadline=None)  # the first call compiles
@given(damaged_logs(), st.sampled_from([1, 64, 700, 1 << 20]))
def test_damaged_logs_are_scanned_alike(content: bytes, step: int) -> None:
    assert_the_same(content, step)


@pytest.mark.parametrize("size", [1, 2, 3, 88, 89, 100_000])
def test_noise_is_scanned_alike(size: int) -> None:
    assert_the_same(declared(10, 20)[:size] + np.random.default_rng(size).bytes(size))


def test_heads_in_everything_are_scanned_alike() -> None:
    assert assert_the_same(declared(7, 6) + bytes((0xA3, 0x95, 7)) * 20_000) > 9_000


def test_a_flight_is_scanned_alike(data_folder: Path) -> None:
    content = (data_folder / "sitl/brushless_cut.BIN").read_bytes()[:1_000_000]
    assert assert_the_same(content) > 10_000
    assert_the_same(content[300_000:])


STEPS_US = st.sampled_from([0, 1, 1000, JUMP_US, JUMP_US + 1, 10**12, -BACK_US, -BACK_US - 1, -(10**10)])


@given(st.lists(st.one_of(STEPS_US, st.none()), min_size=0, max_size=60), st.sampled_from([0, 5, 10**9]))
def test_stamps_are_settled_one_after_the_other(steps_us: list[int | None], last_us: int) -> None:
    stamps, at = [], last_us + 1
    for step_us in steps_us:
        at = max(at + (step_us or 0), 0)
        stamps.append(-1 if step_us is None else at)
    arrivals = np.array(stamps, dtype=np.int64)
    following = [next((late for late in stamps[k + 1 :] if late >= 0), -1) for k in range(len(stamps))]
    backwards = settle_all(arrivals, last_us, following.__getitem__)
    expected, before, back = [], last_us, 0
    for stamp, next_us in zip(stamps, following, strict=True):
        back += 0 <= stamp < before - BACK_US
        before = settle(stamp, before, next_us)
        expected.append(before)
    assert arrivals.tolist() == expected
    assert backwards == back
