"""Without a compiler the same answers: frames, arrivals, counters, headers, payloads and what is selected."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.mavlink import kernels, payloads, selection, vectorised, vectorised_selection, vectorised_tlog
from aerodft.adapters.mavlink.dialect import frame_table
from aerodft.adapters.mavlink.layout import TLOG_STATE
from aerodft.adapters.mavlink.selection import SLOTS, Followed, fresh_state
from aerodft.geometry.jit import load_compiler
from tests.adapters.mavlink.spoiling import WAYS, spoil

load_compiler()  # what is compared with is compiled
SAMPLE = Path(__file__).parents[3] / "samples/copter.tlog"
START_US = 1_700_000_000_000_000
CAPACITY = 300

Scan = Callable[..., tuple[int, int]]


def scanned(scan: Scan, data: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """All rows and the final state, whatever the scan does at once."""
    state, rows = np.zeros(TLOG_STATE, dtype=np.int64), np.empty((3, CAPACITY), dtype=np.int64)
    parts, at = [rows[:, :0]], 0
    while at < len(data):
        found, at = scan(data, at, at + step, frame_table(), rows, state)
        parts.append(rows[:, :found].copy())
    return np.concatenate(parts, axis=1), state


def assert_the_same(content: bytes, step: int = 1 << 20) -> None:
    data = np.frombuffer(content, dtype=np.uint8)
    ours, our_state = scanned(vectorised_tlog.scan_tlog, data, step)
    theirs, their_state = scanned(kernels.scan_tlog, data, step)
    np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(our_state, their_state)


@st.composite
def damaged_logs(draw: st.DrawFn) -> bytes:
    """A log of a few frames with pieces cut out, bytes changed, noise between and stamps that jump."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.signing.secret_key = bytes(32)
    pieces, stamp_us = [], START_US
    for k in range(draw(st.integers(1, 40))):
        mav.seq, mav.signing.sign_outgoing = k, k % 4 == 0
        text = dialect.MAVLink_statustext_message(6, rng.bytes(int(rng.integers(0, 40))))
        angles = dialect.MAVLink_attitude_message(k, *rng.uniform(-3, 3, 6))
        frame = bytes((text if k % 3 == 0 else angles).pack(mav, force_mavlink1=bool(k % 2)))
        stamp_us += int(rng.choice([0, 1000, 10**6, 10**9, -(2 * 10**6)], p=[0.1, 0.6, 0.2, 0.05, 0.05]))
        piece = bytearray(stamp_us.to_bytes(8, "big") + frame)
        way = draw(st.sampled_from([*WAYS, "alien", "bare"]))
        spoil(piece, way, rng)
        if way == "alien":
            piece[8 + 5] ^= 0xFF
            piece[8 + 9 : 8 + 10] = b"\x07"
        elif way == "bare":
            del piece[:8]
        pieces.append(bytes(piece))
    return b"".join(pieces)


@settings(deadline=None)  # the first call compiles
@given(damaged_logs(), st.sampled_from([64, 700, 1 << 20]))
def test_damaged_logs_are_scanned_alike(content: bytes, step: int) -> None:
    assert_the_same(content, step)


@pytest.mark.parametrize("size", [1, 8, 9, 17, 200_000])
def test_noise_is_scanned_alike(size: int) -> None:
    assert_the_same(np.random.default_rng(size).bytes(size))


def test_a_flight_is_scanned_alike() -> None:
    content = SAMPLE.read_bytes()
    assert_the_same(content)
    assert_the_same(content[: 200_000 - 7])


@settings(deadline=None)
@given(st.lists(st.binary(min_size=0, max_size=280), min_size=1, max_size=20), st.integers(0, 255))
def test_checksums_are_the_compiled_ones(runs: list[bytes], extra: int) -> None:
    data = np.frombuffer(b"".join(runs) + b"\0", dtype=np.uint8)
    lengths = np.array([len(run) for run in runs], dtype=np.int64)
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    ours = vectorised.Region(data).checksums(starts, lengths, np.full(len(runs), extra))
    theirs = [kernels.checksum(data, a, a + n, extra) for a, n in zip(starts.tolist(), lengths.tolist(), strict=True)]
    assert ours.tolist() == theirs


def heads_of(module: object, data: np.ndarray, frames: np.ndarray, *, checked: bool) -> np.ndarray:
    heads = np.zeros((5, frames.shape[1]), dtype=np.int64)
    module.read_headers(data, frames, frame_table(), heads, checked=checked)  # type: ignore[attr-defined]
    heads[1:, heads[0] < 0] = 0  # where there is no good frame nothing else is said
    return heads


@pytest.fixture(scope="module")
def flight() -> tuple[np.ndarray, np.ndarray]:
    """The sample's bytes, and its frames with a few that are none among them."""
    data = np.fromfile(SAMPLE, dtype=np.uint8)
    rows, _ = scanned(kernels.scan_tlog, data, 1 << 20)
    rng = np.random.default_rng(8)
    wrong = np.stack([rng.integers(-20, len(data) + 20, 500), rng.integers(0, 300, 500)])
    frames = np.concatenate([rows[:2], wrong, rows[:2, :100] + 1, rows[:2, :100] * [[1], [0]]], axis=1)
    return data, frames[:, rng.permutation(frames.shape[1])]


@pytest.mark.parametrize("checked", [False, True])
def test_headers_are_the_compiled_ones(flight: tuple[np.ndarray, np.ndarray], checked: bool) -> None:  # noqa: FBT001
    data, frames = flight
    if checked:
        frames = frames[:, heads_of(kernels, data, frames, checked=False)[0] >= 0]
    ours = heads_of(vectorised, data, frames, checked=checked)
    np.testing.assert_array_equal(ours, heads_of(kernels, data, frames, checked=checked))
    assert (ours[0] >= 0).sum() > 10_000


def test_payloads_are_the_compiled_ones(flight: tuple[np.ndarray, np.ndarray]) -> None:
    data, frames = flight
    heads = heads_of(kernels, data, frames, checked=False)
    places = heads[3:, heads[0] >= 0]
    ours, theirs = np.zeros((2, places.shape[1], 60), dtype=np.uint8)
    vectorised.gather(data, places, ours)
    payloads.gather(data, places, theirs)
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    "followed", [Followed(), Followed(system=1, gimbal=2), Followed(gimbal=154), Followed(component=2)]
)
@pytest.mark.parametrize("seed", range(4))
def test_what_is_selected_is_the_compiled_choice(pack: Callable[..., bytes], followed: Followed, seed: int) -> None:
    rng = np.random.default_rng(seed)
    messages = [
        dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
        dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3),
        dialect.MAVLink_attitude_message(5, 0.1, 0.2, 0.3, 0, 0, 0),
        dialect.MAVLink_rangefinder_message(12.0, 0),
        dialect.MAVLink_distance_sensor_message(3, 20, 6000, 800, 0, 0, 25, 0),
        dialect.MAVLink_distance_sensor_message(3, 20, 6000, 800, 0, 0, 0, 0),
        dialect.MAVLink_altitude_message(7, 0, 0, 0, 0, 30, 20),
        dialect.MAVLink_terrain_report_message(1, 1, 100, 0, 40, 0, 0),
        dialect.MAVLink_mount_orientation_message(4, 5.0, -60.0, 20.0),
        *(
            dialect.MAVLink_gimbal_device_attitude_status_message(
                0, 0, 4, 44, (1, 0, 0, 0), 0, 0, 0, 0, gimbal_device_id=device
            )
            for device in (0, 1, 2)
        ),
        dialect.MAVLink_statustext_message(6, b"hello"),
    ]
    frames = [
        pack(messages[rng.integers(len(messages))], system=int(rng.integers(1, 3)), component=int(component))
        for component in rng.choice([1, 2, 154], 400)
    ]
    frames[rng.integers(400)] = b"\xfd" + bytes(30)
    lengths = np.array([len(frame) for frame in frames])
    places = np.stack([np.concatenate([[0], np.cumsum(lengths)[:-1]]), lengths])
    data = np.frombuffer(b"".join(frames), dtype=np.uint8)
    heads = heads_of(kernels, data, places, checked=False)
    states = [fresh_state(followed), fresh_state(followed)]
    for start in range(0, 400, 57):  # the state goes on from block to block
        part = heads[:, start : start + 57]
        ours, theirs = np.empty((2, part.shape[1]), dtype=np.int64)
        vectorised_selection.select(data, part, SLOTS, states[0], ours)
        selection.select(data, part, SLOTS, states[1], theirs)
        np.testing.assert_array_equal(ours, theirs)
        np.testing.assert_array_equal(states[0], states[1])


DIGEST = """
import hashlib, json, sys
if "--without" in sys.argv:
    sys.modules["numba"] = None
from pathlib import Path
import numpy as np
from aerodft.adapters.mavlink.composite import CompositeDecoder, open_log
from aerodft.geometry import jit
if "--at-once" in sys.argv:
    jit.load_compiler()
if "--soon" in sys.argv:
    jit._PATIENCE, jit._PATIENCE_A_SECOND = 300, 0
source, decoder, digests = open_log(Path(sys.argv[1])), CompositeDecoder(), {}
for block in source.events():
    for track in decoder.decode(block):
        for kind in type(track).__mro__:
            for name in getattr(kind, "__slots__", ()):
                value = getattr(track, name)
                if isinstance(value, np.ndarray):
                    key = f"{type(track).__name__}.{name}.{getattr(track, 'source', '')}"
                    digests.setdefault(key, hashlib.sha256()).update(value.tobytes())
found = {key: digest.hexdigest() for key, digest in sorted(digests.items())}
print(json.dumps([jit.is_loaded(), found, dict(decoder.rejected), str(source.counts)]))
"""


def test_a_flight_is_decoded_alike_with_and_without_numba() -> None:
    answers = []
    for arguments, variables in (
        (["--at-once"], {}),
        (["--soon"], {}),
        ([], {}),
        ([], {"NUMBA_DISABLE_JIT": "1"}),
        (["--without"], {}),
    ):
        command = [sys.executable, "-c", DIGEST, str(SAMPLE), *arguments]
        done = subprocess.run(command, env=variables, capture_output=True, text=True, check=True, timeout=60)
        answers.append(json.loads(done.stdout))
    assert [answer[0] for answer in answers] == [True, True, False, False, False]
    assert all(answer[1:] == answers[0][1:] for answer in answers)
    assert len(answers[0][1]) > 10
