"""What commands take of memory with other tools' files, damaged ones and such as claim too much: libraries included."""

import os
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.writer import CompressionType, Writer

from aerodft.adapters.recording import MAGIC, RECORD_HEAD, encode_records
from tests.peak import CAN_MEASURE, Taken, taken_by
from tests.replay.foreign_files import frames_of, jpegs, write_foreign

SAMPLE = Path(__file__).parents[2] / "samples/copter.tlog"
FROZEN = Path(__file__).parents[1] / "cli/frozen-0.1"
MOST_MB = 500
LONG_LOG = 60 << 20
QUIETLY = ("--rate", "max", "--listen", "tcp/127.0.0.1:0")
IS_FULL = os.environ.get("AERODFT_FAULTS") == "full"
CHANNELS = 60_000 if IS_FULL else 6_000
MOST_CHUNK = 31 << 20
FROZEN_NS = 1_795_221_278_000_000_000
QUICKLY = {  # what took the most with each; all of them take a minute
    "zeros": ["recompute", "export", "compare", "replay", "recover"],
    "records": ["recompute"],
    "messages": ["recompute"],
    "large": ["export", "compare", "replay"],
    "lists": ["replay"],
    "channels": ["recompute", "recover"],
    "schemas": ["recompute", "recover"],
}
STATION = """
[station]
name = "far"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["home"]
[[probe]]
name = "centre"
kind = "position"
pixels = [[320, 240]]
"""

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(not CAN_MEASURE, reason="peaks are read from /proc")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made: Path = tmp_path_factory.mktemp("memory")
    (made / "camera.toml").write_text('name = "far"\nwidth_px = 640\nheight_px = 480\nhfov_deg = 60.0\n')
    (made / "station.toml").write_text(STATION)
    frames = frames_of(SAMPLE)
    pictures = jpegs([frames[0][0] + k * 400_000_000 for k in range(1, 60)], 640, 480)
    data = write_foreign(made / "whole.mcap", frames, pictures).read_bytes()
    (made / "cut.mcap").write_bytes(data[: len(data) * 2 // 3])
    flipped = bytearray(data)
    for place in np.random.default_rng(3).integers(len(data), size=20):
        flipped[place] ^= 1 << 3
    (made / "flipped.mcap").write_bytes(flipped)
    (made / "empty.mcap").write_bytes(b"")
    (made / "noise.mcap").write_bytes(data[:8] + np.random.default_rng(4).bytes(1 << 20))
    write_foreign(made / "pictures.mcap", (), pictures)
    write_long(made, frames)
    (made / "bomb.mcap").write_bytes(data[:8] + bomb(1 << 30))
    return made


def write_long(folder: Path, frames: list[tuple[int, bytes]]) -> None:
    """Six minutes of telemetry, and with it some large images of 1080p; and a station for these."""
    span_ns = frames[-1][0] - frames[0][0] + 10**9
    long = [(at_ns + turn * span_ns, data) for turn in range(6) for at_ns, data in frames]
    write_foreign(folder / "long.mcap", long)
    wrapped = [(at_ns, b"\0\1\0\0" + len(data).to_bytes(4, "little") + data) for at_ns, data in long]
    write_foreign(folder / "wrapped.mcap", wrapped, topic="/mavlink/from")
    noise = np.random.default_rng(5).integers(0, 255, (1080, 1920, 3), dtype=np.uint8)
    jpeg = cv2.imencode(".jpg", cv2.GaussianBlur(noise, (0, 0), 0.8), [cv2.IMWRITE_JPEG_QUALITY, 96])[1].tobytes()
    step_ns = (long[-1][0] - long[0][0]) // 41
    pictures = [(long[0][0] + (k + 1) * step_ns, jpeg) for k in range(40)]
    write_foreign(folder / "large.mcap", long, pictures)
    (folder / "full-hd.toml").write_text('name = "far"\nwidth_px = 1920\nheight_px = 1080\nhfov_deg = 60.0\n')
    (folder / "large.toml").write_text(STATION.replace("camera.toml", "full-hd.toml"))


def bomb(claimed: int) -> bytes:
    """A chunk record of a few kilobytes that unpacks to a gigabyte of zeros."""
    packer = zstandard.ZstdCompressor(level=3).compressobj(size=claimed)
    block = bytes(1 << 24)
    packed = b"".join([*(packer.compress(block) for _ in range(claimed >> 24)), packer.flush()])
    head = (1).to_bytes(8, "little") + (2).to_bytes(8, "little") + claimed.to_bytes(8, "little") + bytes(4)
    content = head + (4).to_bytes(4, "little") + b"zstd" + len(packed).to_bytes(8, "little") + packed
    return b"\x06" + len(content).to_bytes(8, "little") + content


def checked(taken: Taken, most_mb: float, codes: set[int], what: str) -> None:
    print(f"\n{what}: {taken.peak_mb:.0f} MB, exit code {taken.code}")
    assert taken.code in codes, taken.err
    assert "Traceback" not in taken.err
    assert taken.peak_mb < most_mb


@pytest.mark.parametrize(
    ("name", "codes"),
    [
        ("whole", {0}),
        ("cut", {0}),
        ("flipped", {0}),
        ("pictures", {0}),
        ("empty", {3}),
        ("noise", {3, 4}),
        ("bomb", {4}),
    ],
)
def test_replay_of_other_tools_files(folder: Path, name: str, codes: set[int]) -> None:
    checked(taken_by("replay", folder / f"{name}.mcap", *QUIETLY), MOST_MB, codes, f"replay {name}")


@pytest.mark.parametrize("command", ["doctor", "import", "recompute"])
@pytest.mark.parametrize("name", ["empty", "noise", "bomb", "pictures"])
def test_what_is_refused_is_refused_before_much_is_loaded(
    folder: Path, tmp_path: Path, name: str, command: str
) -> None:
    arguments = () if command == "doctor" else ("-c", folder / "station.toml", "-o", tmp_path / "out")
    taken = taken_by(command, folder / f"{name}.mcap", *arguments)
    checked(taken, MOST_MB, {3, 4}, f"{command} {name}")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["whole", "cut", "flipped", "long", "wrapped", "large"])
def test_what_is_looked_through(folder: Path, name: str) -> None:
    checked(taken_by("doctor", folder / f"{name}.mcap"), MOST_MB, {0}, f"doctor {name}")


def attitudes(count: int) -> bytes:
    """An ArduPilot log of so many ATT messages, 2.5 ms apart."""
    declared = bytes((128, 10, 31)) + b"ATT\0" + b"Qfffff".ljust(16, b"\0")
    rows = np.zeros(count, dtype=[("head", "u1", 3), ("us", "<u8"), ("deg", "<f4", 5)])
    rows["head"], rows["us"] = (0xA3, 0x95, 10), 10**6 + 2500 * np.arange(count)
    return b"\xa3\x95" + declared + b"TimeUS,Roll,Pitch,Yaw,ErrRP,ErrYaw".ljust(64, b"\0") + rows.tobytes()


@pytest.mark.parametrize("kind", ["tlog", "bin"])
def test_memory_does_not_grow_with_a_log(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"long.{kind}"
    content = SAMPLE.read_bytes() * (LONG_LOG // SAMPLE.stat().st_size) if kind == "tlog" else attitudes(LONG_LOG // 31)
    path.write_bytes(content)
    checked(taken_by("doctor", path), MOST_MB, {0, 4}, f"doctor of a .{kind} of {LONG_LOG >> 20} MB")


@pytest.mark.parametrize(
    ("size_px", "images", "said"),
    [((1280, 960), "", "640 x 480"), ((640, 480), "[images]\ntime_offset_s = 86400.0\n", "do not overlap in time")],
    ids=["size", "overlap"],
)
def test_images_that_do_not_fit_are_refused(
    folder: Path, tmp_path: Path, size_px: tuple[int, int], images: str, said: str
) -> None:
    width_px, height_px = size_px
    camera = f'name = "other"\nwidth_px = {width_px}\nheight_px = {height_px}\nhfov_deg = 60.0\n'
    (tmp_path / "camera.toml").write_text(camera)
    config = tmp_path / "station.toml"
    config.write_text(images + STATION)
    taken = taken_by("import", folder / "whole.mcap", "-c", config, "-o", tmp_path / "out")
    checked(taken, MOST_MB, {3}, f"import {said}")
    assert said in taken.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["whole", "cut", "flipped", "long", "wrapped"])
def test_what_is_measured(folder: Path, tmp_path: Path, name: str) -> None:
    arguments = ("-c", folder / "station.toml", "-o", tmp_path / "out")
    checked(taken_by("import", folder / f"{name}.mcap", *arguments), MOST_MB, {0}, f"import {name}")
    taken = taken_by("recompute", tmp_path / "out", "-o", tmp_path / "again")
    checked(taken, MOST_MB, {0}, f"recompute {name}")


def test_large_images_and_the_video_that_is_made_of_them(folder: Path, tmp_path: Path) -> None:
    arguments = ("-c", folder / "large.toml", "-o", tmp_path / "out")
    checked(taken_by("import", folder / "large.mcap", *arguments), MOST_MB, {0}, "import of images of 1.7 MB")
    taken = taken_by("export", tmp_path / "out", "--format", "mp4", "-o", tmp_path / "out.mp4")
    checked(taken, MOST_MB, {0}, "export as a video of 1080p")
    assert (tmp_path / "out.mp4").stat().st_size > 100_000


@pytest.mark.parametrize(
    "arguments",
    [
        ("replay", FROZEN, *QUIETLY),
        ("recover", FROZEN),
        ("compare", FROZEN, FROZEN),
        ("export", FROZEN, "--format", "mcap", "-o", "OUT/all.mcap"),
        ("export", FROZEN, "--format", "parquet", "-o", "OUT/all.parquet"),
        ("recompute", FROZEN, "-o", "OUT/again"),  # seen through a lens that bends
    ],
    ids=["replay", "recover", "compare", "mcap", "parquet", "recompute"],
)
def test_our_own_recordings(tmp_path: Path, arguments: tuple[object, ...]) -> None:
    line = [str(each).replace("OUT", str(tmp_path)) for each in arguments]
    checked(taken_by(*line), MOST_MB, {0}, " ".join(line))


def test_as_many_channels_as_a_file_may_claim(tmp_path: Path) -> None:
    """Two messages on each; what it takes is for the channels' names, and no more than a bounded part is declared."""
    path = tmp_path / "many.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(library="another tool")
        ids = [writer.register_channel(f"/c/{k}", "application/octet-stream", 0) for k in range(CHANNELS)]
        for second in range(2):
            for k, channel in enumerate(ids):
                at_ns = 10**18 + second * 10**9 + k * 1000
                writer.add_message(channel, at_ns, b"\xfd%d" % k, at_ns)
        writer.finish()
    checked(taken_by("replay", path, *QUIETLY, timeout_s=250), MOST_MB, {0}, f"replay {CHANNELS} channels")
    taken = taken_by("doctor", path, timeout_s=250)
    checked(taken, MOST_MB, {3}, f"doctor {CHANNELS} channels")
    assert f"MAVLink is looked for in 500 of {CHANNELS} topics" in taken.err


def small(record: Callable[[int], Channel | Schema]) -> bytes:
    """As many small definitions as there are numbers for them."""
    return encode_records(*map(record, range(1000, 1 << 16)))


def message(channel: int, data: bytes) -> bytes:
    return struct.pack("<BQHIQQ", Opcode.MESSAGE, 22 + len(data), channel, 0, FROZEN_NS, FROZEN_NS) + data


IMAGE, POSE = 1, 2  # channels of the frozen recording
BOMBS: dict[str, Callable[[], bytes]] = {
    "zeros": lambda: bytes(MOST_CHUNK),
    "records": lambda: (b"\x07" + bytes(8)) * ((MOST_CHUNK if IS_FULL else 10 << 20) // 9),
    "messages": lambda: message(POSE, b"") * (MOST_CHUNK // 31),
    "large": lambda: message(POSE, bytes(MOST_CHUNK - 100)),
    "lists": lambda: message(IMAGE, b"[" + b"[]," * (MOST_CHUNK // 3 - 100) + b"1]"),
    "channels": lambda: small(
        lambda k: Channel(id=k, topic=f"/{k}", message_encoding="x", schema_id=0, metadata={"a": f"{k}" * 10})
    ),
    "schemas": lambda: small(lambda k: Schema(id=k, name=f"{k}", encoding="x", data=b"%d" % k * 80)),
}


@pytest.mark.parametrize("name", BOMBS)
def test_chunks_of_kilobytes_that_unpack_to_megabytes(tmp_path: Path, name: str) -> None:
    """Each is below the limit of a chunk and has the right checksum."""
    folder = tmp_path / "bombs"
    shutil.copytree(FROZEN, folder)
    path = folder / "data_000.mcap"
    path.write_bytes(with_chunks(path.read_bytes(), BOMBS[name]()))
    commands = {
        "recompute": (folder, "-o", tmp_path / "out"),
        "export": (folder, "--format", "mcap", "-o", tmp_path / "all.mcap"),
        "compare": (folder, folder),
        "replay": (folder, *QUIETLY),
        "recover": (folder,),
    }
    for command in commands if IS_FULL else QUICKLY[name]:
        codes = {0, 3, 5} if name == "lists" else {0, 5}  # its image is none
        checked(taken_by(command, *commands[command], timeout_s=600), MOST_MB, codes, f"{command} {name}")


def with_chunks(data: bytes, content: bytes) -> bytes:
    """A recording whose index is lost, with chunks of the content before its second one."""
    end = len(MAGIC)
    chunks: list[int] = []
    while data[end] != Opcode.DATA_END:
        chunks += [end] if data[end] == Opcode.CHUNK else []
        end += RECORD_HEAD.size + RECORD_HEAD.unpack_from(data, end)[1]
    packed = zstandard.compress(content)
    times = bytes(8) + data[chunks[1] + RECORD_HEAD.size :][8:16]  # from 1970 on
    head = times + len(content).to_bytes(8, "little") + zlib.crc32(content).to_bytes(4, "little")
    chunk = head + (4).to_bytes(4, "little") + b"zstd" + len(packed).to_bytes(8, "little") + packed
    return data[: chunks[1]] + 3 * (RECORD_HEAD.pack(Opcode.CHUNK, len(chunk)) + chunk) + data[chunks[1] : end]
