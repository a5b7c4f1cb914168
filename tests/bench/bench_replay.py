"""Opening, seeking in and replaying a large recording: ``python tests/bench/bench_replay.py [--megabytes 1000]``.

What it costs to open it and to reach its last second is measured in a process of its own: processor time, memory, and
bytes read. ``--rate max`` is the player with the bus that nobody listens to, against the stock reader on the same file.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

sys.path.insert(0, str(Path(__file__).parents[2]))

from aerodft.adapters.bus import session_on
from aerodft.adapters.wire.events import IMAGE_SCHEMA, encode_image
from aerodft.adapters.wire.measurement import MEASUREMENT_SCHEMA, encode_measurement
from aerodft.geometry import camera_attitude
from aerodft.model import Image, Measurement, Pose, PoseSample, ProbeKind, ProjectionModel, Status
from replay.player import Player, Republisher, is_published, timeline
from replay.recordings import Recording
from tests.clock import VirtualClock

START_NS, STEP_NS = 1_795_221_278_000_000_000, 5_000_000
FRAME_BYTES = 1200  # a frame among measurements; as noise, so that no compression makes the file small
LAST_SECOND = """
import resource, sys, time
from pathlib import Path
from replay.recordings.recording import Recording
from replay.player.publish import is_published
from replay.player.player import timeline
def chars(): return int(open("/proc/self/io").read().split()[1])
before, start_s = chars(), time.process_time()
recording = Recording(Path(sys.argv[1]))
opened_s = time.process_time() - start_s
items = sum(1 for _ in timeline([recording], recording.end_ns - 10**9, None, lambda _, __: True))
print(items, opened_s, time.process_time() - start_s, chars() - before,
      resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def _measurement() -> bytes:
    pose = Pose(position_enu_m=np.zeros(3), wxyz=camera_attitude(0.5, 0.0, 1.0))
    return encode_measurement(
        Measurement(
            name="w", kind=ProbeKind.DISTANCE, status=Status.OK, reasons=(), stamp_ns=START_NS, value=22.7, std=0.2,
            pixels=((1.0, 2.0), (3.0, 4.0)), std_px=1.0, camera="c", model=ProjectionModel.PINHOLE,
            pose=PoseSample(stamp_ns=START_NS, status=Status.OK, pose=pose),
        )
    )  # fmt: skip


def _write(folder: Path, megabytes: int) -> int:
    """Frames, measurements and image stamps at 200 Hz until the file is that large; returns the messages."""
    folder.mkdir()
    payload, noise = _measurement(), np.random.default_rng(1).bytes(1 << 20)
    with (folder / "data_000.mcap").open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()

        def channel(topic: str, schema: str) -> int:
            return writer.register_channel(topic, "json", writer.register_schema(schema, "jsonschema", b"{}"))

        measured = channel("aerodft/s/measurement/w", MEASUREMENT_SCHEMA)
        images = channel("aerodft/s/image", IMAGE_SCHEMA)
        frames = writer.register_channel("mavlink", "mavlink", 0)
        count = 0
        while file.tell() < megabytes << 20:
            at_ns = START_NS + count * STEP_NS
            start = count * 997 % (len(noise) - FRAME_BYTES)
            writer.add_message(frames, at_ns, noise[start : start + FRAME_BYTES], at_ns)
            writer.add_message(measured, at_ns, payload, at_ns)
            if count % 40 == 0:
                image = encode_image(Image(index=count, stamp_ns=at_ns, arrival_ns=at_ns))
                writer.add_message(images, at_ns, image, at_ns, count)
            count += 1
        writer.finish()
    return 2 * count


def _stock_s(folder: Path) -> float:
    start_s = time.process_time()
    with (folder / "data_000.mcap").open("rb") as file:
        for _ in make_reader(file).iter_messages(log_time_order=False):
            pass
    return time.process_time() - start_s


def _replay_s(folder: Path) -> tuple[float, int]:
    recording = Recording(folder)
    with session_on(None) as session:
        publisher = Republisher(session)
        start_s = time.process_time()
        player = Player(outlets=[publisher], clock=VirtualClock(), rate=None, is_now=True)
        player.play(lambda: timeline([recording], None, None, is_published))
        took_s = time.process_time() - start_s
        publisher.close()
    return took_s, publisher.published.measurements


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=int, default=1000)
    megabytes = parser.parse_args(arguments).megabytes
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "r"
        messages = _write(folder, megabytes)
        print(f"{megabytes} MB, {messages} messages")
        found = subprocess.run(
            [sys.executable, "-c", LAST_SECOND, str(folder)], capture_output=True, text=True, check=True
        ).stdout.split()
        items, opened_s, seek_s, read, peak_kb = map(float, found)
        print(
            f"open {opened_s:.2f} s, its last second ({items:.0f} messages) after {seek_s:.2f} s of processor time;"
            f" {read / 1e6:.1f} MB read, {peak_kb / 1e3:.0f} MB of memory in all"
        )
        stock_s = _stock_s(folder)
        replay_s, measurements = _replay_s(folder)
        print(
            f"replay --rate max --stamps now: {measurements / replay_s / 1e3:.0f} thousand measurements/s;"
            f" {replay_s / stock_s:.2f} of the time that the stock reader takes to read the file"
        )


if __name__ == "__main__":
    main()
