"""What publishing feels of a disk that fills up under the recorder: ``python tests/bench/bench_full_disk.py``.

A real service records to a disk of a few megabytes (a tmpfs where that is permitted, else a limit on the size of its
files) that is filled and emptied again; a subscriber on the bus notes when measurements come.
"""

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import orjson

sys.path.insert(0, str(Path(__file__).parents[2]))

from aerodft.adapters.bus import session_on
from aerodft.adapters.recording.recover import recover_folder
from replay.recordings import Recording
from tests.faults.live_flight import Flight
from tests.ports import free_endpoint

DISK_MB = 3
RATE_HZ, TICK_MS = 50, 10


@contextmanager
def small_disk(folder: Path) -> Iterator[bool]:
    """A small disk at a folder, if this user may mount one."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "tmpfs", str(folder)]
    is_mounted = os.geteuid() == 0 and not subprocess.run(mount, capture_output=True, check=False).returncode
    try:
        yield is_mounted
    finally:
        if is_mounted:
            subprocess.run(["umount", "-l", str(folder)], check=True)


class Disk:
    """Is full or is not."""

    def __init__(self, folder: Path, pid: int, *, is_mounted: bool) -> None:
        self._filler = folder / "filler"
        self._pid = pid
        self._is_mounted = is_mounted
        self._limit = resource.prlimit(pid, resource.RLIMIT_FSIZE)

    def fill(self) -> None:
        if not self._is_mounted:
            resource.prlimit(self._pid, resource.RLIMIT_FSIZE, (4096, self._limit[1]))
            return
        with self._filler.open("wb", buffering=0) as file:
            try:
                while True:
                    file.write(bytes(1 << 12))
            except OSError:
                pass

    def empty(self) -> None:
        if self._is_mounted:
            self._filler.unlink()
        else:
            resource.prlimit(self._pid, resource.RLIMIT_FSIZE, self._limit)


def run(folder: Path, seconds: float) -> None:
    """One flight: ``seconds`` with room, without, and with room again."""
    endpoint = free_endpoint()
    tables = {
        "station": {"name": "full", "tick_ms": TICK_MS},
        "images": {"rate_hz": RATE_HZ},
        "zenoh": {"listen": endpoint},
    }
    flight = Flight(folder / "flight", tables)
    came_s: list[float] = []
    marks_s: list[float] = []
    counts: list[dict[str, int]] = []
    with small_disk(folder / "disk") as is_mounted:
        recording = folder / "disk" / "recording"
        with flight.served(recording) as (process, quiet), session_on(None, (endpoint,)) as session:
            disk = Disk(folder / "disk", process.pid, is_mounted=is_mounted)
            heard = session.declare_subscriber("aerodft/full/measurement/*", lambda _: came_s.append(time.monotonic()))
            status = session.declare_subscriber(
                "aerodft/full/status", lambda s: counts.append(orjson.loads(s.payload.to_bytes())["counts"])
            )
            time.sleep(2.0)
            for change in (None, disk.fill, disk.empty):
                marks_s.append(time.monotonic())
                if change is not None:
                    change()
                time.sleep(seconds)
            marks_s.append(time.monotonic())
            quiet()
            time.sleep(0.2)
            process.send_signal(signal.SIGTERM)
            code = process.wait(30)
            heard.undeclare()
            status.undeclare()
        report(flight, recording, np.array(came_s), marks_s, code, is_mounted=is_mounted)


def report(
    flight: object, recording: Path, came_s: np.ndarray, marks_s: list[float], code: int, *, is_mounted: bool
) -> None:
    pauses_ms = 1000 * np.diff(came_s)
    where = "a tmpfs" if is_mounted else "a limit on its files"
    for name, begin_s, end_s in zip(("room", "none", "room again"), marks_s, marks_s[1:], strict=False):
        part = pauses_ms[(came_s[1:] > begin_s) & (came_s[1:] <= end_s)]
        print(
            f"{name:10}: {len(part):5d} measurements, pauses {np.median(part):.1f} ms in the median,"
            f" {np.percentile(part, 99):.1f} ms at 99 %, {part.max():.1f} ms at most"
        )
    summary = json.loads((flight.folder / "summary.json").read_text())["recorded"]
    recovery = recover_folder(recording)
    found = sum(segment.messages for segment in recovery.segments if segment.name.startswith("data"))
    frames = [message for message in Recording(recording).messages() if message.channel.encoding == "mavlink"]
    print(
        f"{where}: offered {summary['offered_messages']} = stored {summary['recorded_messages']}"
        f" + shed {summary['shed_messages']} + lost {summary['lost_messages']}; in the files {found}; exit code {code}"
    )
    late = sum(message.log_ns > flight.sent[-1][1] - 10**9 for message in frames)
    print(f"recording resumed: {late} of the last second's messages are in {len(recovery.segments)} segments")
    assert summary["offered_messages"] == found + summary["shed_messages"] + summary["lost_messages"]


def main(options: list[str] | None = None) -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each of the three parts")
    given = parser.parse_args(options)
    with tempfile.TemporaryDirectory() as folder:
        run(Path(folder), given.seconds)


if __name__ == "__main__":
    main()
