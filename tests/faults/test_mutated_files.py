"""Recordings with bytes flipped, cut, moved and claimed: what is read was recorded, and nothing else is said than why.

The reading process is one of its own: its memory is measured.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.nights import at_night

MOST_GROWTH_MB = 150  # a bomb unpacks to 512; compiled loops that are loaded take 60

ROOT = Path(__file__).parents[2]


def mutated(folder: Path, count: int) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "tests.faults.mutating", folder, str(count)]
    return subprocess.run(line, cwd=ROOT, check=False, capture_output=True, text=True, timeout=1200)


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("count", [60, *at_night(1500)])
def test_mutated_recordings_are_read_in_part_or_refused(tmp_path: Path, count: int) -> None:
    mutated(tmp_path, 0)  # records, which takes memory of its own
    done = mutated(tmp_path, count)
    assert done.returncode == 0, done.stderr[-5000:]
    found = json.loads(done.stdout)
    print(
        f"\n{found['files']} mutated recordings: {found['read']} read, {found['refused']} refused in a sentence;"
        f" {found['recovered']} recovered, {found['unrecovered']} refused; {found['messages']} messages accepted,"
        f" {found['wrong']} wrong; {found['lost_images']} images cannot be shown;"
        f" {found['start_mb']:.0f} MB at the start, {found['peak_mb']:.0f} at most"
    )
    assert found["files"] == count
    assert found["wrong"] == 0
    assert found["read"] > 0.8 * count
    assert found["recovered"] > 0.8 * count
    assert found["peak_mb"] - found["start_mb"] < MOST_GROWTH_MB
