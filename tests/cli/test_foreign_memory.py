"""Another tool's recording is read piece by piece: what it takes of memory does not grow with the file."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.replay.foreign_files import frames_of, write_foreign

PICTURE_BYTES = 1 << 20
FEW, MANY = 2, 150
MOST_GROWTH_MB = 50
# Not ru_maxrss: that starts with what the process had which started this one.
MEASURED = """
import sys
from aerodft.cli.main import main
try:
    main()
finally:
    peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
    print("peak_kb", peak.split()[1], file=sys.stderr)
"""


def peak_mb(*arguments: object) -> float:
    line = [sys.executable, "-c", MEASURED, *map(str, arguments)]
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return int(done.stderr.split("peak_kb")[1]) / 1024


@pytest.mark.nightly
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peaks are read from /proc")
@pytest.mark.parametrize("command", [("doctor",), ("replay", "--rate", "max", "--listen", "tcp/127.0.0.1:0")])
def test_memory_does_not_grow_with_the_file(desk, tmp_path: Path, command: tuple[str, ...]) -> None:
    frames = frames_of(desk.log)
    noise = np.random.default_rng(0).bytes(PICTURE_BYTES)  # of a JPEG, as far as anybody looks
    peaks = []
    for count in (FEW, MANY):
        pictures = [(frames[0][0] + k * 10_000_000, b"\xff\xd8\xff\xe0" + noise) for k in range(count)]
        path = write_foreign(tmp_path / f"{count}.mcap", frames, pictures, compressed=False)
        peaks.append(peak_mb(command[0], path, *command[1:]))
    assert path.stat().st_size > MANY * PICTURE_BYTES
    print(f"\n{command[0]}: {peaks[0]:.0f} MB of {FEW} MB, {peaks[1]:.0f} MB of {MANY} MB")
    assert peaks[1] < peaks[0] + MOST_GROWTH_MB
