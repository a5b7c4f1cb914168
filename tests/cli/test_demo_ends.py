"""What the demo has started ends with it, also where it is killed and cannot say so."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

CHILD = "import time; print('up', flush=True); time.sleep(600)"
PARENT = """
import sys, time
from pathlib import Path
from aerodft.cli.demo import _process
with _process(Path(sys.argv[1]), "child", ("-m", "sleeper")) as child:
    print(child.pid, flush=True)
    time.sleep(600)
"""


def is_running(pid: int) -> bool:
    """Not so where it has ended and nobody asked how: its new parent need not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
def test_children_of_a_killed_demo_end(tmp_path: Path) -> None:
    (tmp_path / "sleeper.py").write_text(CHILD)
    variables = {**os.environ, "PYTHONPATH": str(tmp_path)}
    line = [sys.executable, "-c", PARENT, str(tmp_path)]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=variables) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        log = tmp_path / "child.log"
        for _ in range(600):
            if "up" in log.read_text():
                break
            time.sleep(0.05)
        assert is_running(child)
        parent.send_signal(signal.SIGKILL)
    for _ in range(600):
        if not is_running(child):
            break
        time.sleep(0.05)
    assert not is_running(child)
