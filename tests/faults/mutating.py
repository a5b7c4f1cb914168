"""Records once, mutates copies of that, reads and recovers each; prints what came of it as JSON."""

import json
import logging
import random
import shutil
import struct
import sys
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np
import zstandard
from mcap.reader import make_reader

from aerodft.adapters.recording.recover import recover_folder
from aerodft.adapters.recording.write import McapRecorder, RecorderSettings, segmented_writer
from aerodft.errors import AerodftError
from aerodft.model import Camera, Image, Observation, WireProtocol
from aerodft.service import block_of
from replay.recordings import Recording, RecordingSource
from tests.batches import one_tick, take

CAMERA = Camera.from_fov(name="c", width_px=64, height_px=48, hfov_rad=1, vfov_rad=1)
Message = tuple[int, str, bytes]


def record(folder: Path) -> None:
    noise = np.random.default_rng(3)
    segmented_writer.FLUSH_S = 0.0
    settings = RecorderSettings(station="s", camera=CAMERA, lossless=True, max_image_hz=1e9, segment_s=2e-6)
    recorder = McapRecorder(folder, settings, started_ns=1)
    for step in range(1, 41):
        now_ns = step * 100
        frames = [noise.bytes(30) for _ in range(3)]
        pixels = noise.integers(0, 255, (48, 64, 3), dtype=np.uint8)
        image = Image(
            index=step, stamp_ns=now_ns, arrival_ns=now_ns, width_px=64, height_px=48, pixels=partial(np.copy, pixels)
        )
        seen = Observation(name="w", stamp_ns=now_ns, arrival_ns=now_ns + 1, pixels=((1.0, 2.0),))
        block = block_of(WireProtocol.MAVLINK, "a", [now_ns - 3, now_ns - 2, now_ns - 1], frames)
        take(recorder, one_tick(now_ns + 10, [block, image, seen]))
    recorder.close()


def mutated(content: bytes, dice: random.Random) -> bytes:
    """One kind of damage to one file."""
    data = bytearray(content)
    at = dice.randrange(len(data))
    size = dice.choice([1, 8, 64, 1000, 5000])
    kind = dice.randrange(10)
    if kind <= 2:
        for _ in range(dice.choice([1, 1, 2, 8])):
            data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
    elif kind == 3:
        del data[at:]
    elif kind == 4:
        del data[at : at + size]
    elif kind == 5:
        data[at : at + size] = bytes(dice.randrange(256) for _ in range(size))
    elif kind == 6:
        data[at : at + size] = dice.choice([b"\0", b"\xff"]) * size
    elif kind == 7:
        data[at:at] = data[at : at + size][::-1]
    elif kind == 8:
        data[at : at + 8] = struct.pack("<Q", dice.choice([2**63, 2**40, 2**31, len(data), 2**64 - 1]))
    else:
        data[at:at] = bomb(dice)
    return bytes(data)


def bomb(dice: random.Random) -> bytes:
    """A chunk of a few kilobytes that unpacks to half a gigabyte, and says so or not."""
    stored = BOMB
    claimed = dice.choice([512 << 20, 1000, 30 << 20, 2**62])
    head = struct.pack("<QQQI", 1, 2, claimed, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(stored))
    return struct.pack("<BQ", 6, len(head) + len(stored)) + head + stored


BOMB = b""


def read(folder: Path, counts: Counter[str]) -> list[Message]:
    recording = Recording(folder)
    found = [(each.log_ns, each.channel.topic, each.data) for each in recording.messages()]
    found += [(each.log_ns, each.channel.topic, each.data) for each in recording.image_messages()]
    for event in RecordingSource(recording, pixels=True).events():
        if isinstance(event, Image) and event.pixels is not None:
            try:
                event.pixels()
            except AerodftError:
                counts["lost_images"] += 1
    return found


def stock(folder: Path) -> list[Message]:
    found = []
    for path in folder.glob("*.mcap"):
        with path.open("rb") as file:
            for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
                found.append((message.log_time, channel.topic, message.data))
    return found


def main(folder: Path, mutations: int) -> None:
    global BOMB  # noqa: PLW0603 - made once, and large
    logging.disable()
    compressor = zstandard.ZstdCompressor().compressobj()
    BOMB = b"".join([*(compressor.compress(bytes(1 << 20)) for _ in range(512)), compressor.flush()])
    if not (folder / "whole").exists():
        record(folder / "whole")
    whole = set(stock(folder / "whole"))
    files = sorted((folder / "whole").glob("*.mcap"))
    start_mb = memory_mb("VmRSS")
    counts: Counter[str] = Counter(wrong=0, refused=0, unrecovered=0, lost_images=0)
    for number in range(mutations):
        dice = random.Random(number)  # noqa: S311 - damage, no secrets
        copy = folder / "copy"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(folder / "whole", copy)
        victim = copy / dice.choice(files).name
        victim.write_bytes(mutated(victim.read_bytes(), dice))
        counts["files"] += 1
        try:
            found = read(copy, counts)
            counts["read"] += 1
        except AerodftError:
            found = []
            counts["refused"] += 1
        try:
            recovery = recover_folder(copy)
            counts["recovered"] += 1
            for segment in recovery.segments:
                if segment.state == "unreadable":
                    (copy / segment.name).unlink()
            again = stock(copy)
            counts["wrong"] += len(again) - len(set(again))
        except AerodftError:
            again = []
            counts["unrecovered"] += 1
        counts["messages"] += len(found) + len(again)
        counts["wrong"] += len(set(found) - whole) + len(set(again) - whole)
    sys.stdout.write(json.dumps({**counts, "start_mb": start_mb, "peak_mb": memory_mb("VmHWM")}))


def memory_mb(kind: str) -> float:
    """Not ru_maxrss: that starts with what the process had which started this one."""
    stated = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(kind))
    return int(stated.split()[1]) / 1024


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
