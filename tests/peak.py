"""What a command takes of memory and of the processor, in a process of its own."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

CAN_MEASURE: Final = Path("/proc/self/status").exists()
# Not ru_maxrss: that starts with what the process had which started this one.
_MEASURED: Final = """
import os, sys
from aerodft.cli.main import main
try:
    main()
finally:
    peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
    print("measured", peak.split()[1], sum(os.times()[:2]), file=sys.stderr)
"""


@dataclass(frozen=True)
class Taken:
    """What a command took, and what it said."""

    code: int
    peak_mb: float
    cpu_s: float
    out: str
    err: str


def taken_by(*arguments: object, timeout_s: float = 120.0) -> Taken:
    """Run ``aerodft`` with these arguments."""
    line = [sys.executable, "-c", _MEASURED, *map(str, arguments)]
    variables = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=timeout_s, env=variables)
    said, _, figures = done.stderr.rpartition("measured ")
    peak_kb, cpu_s = figures.split()
    return Taken(done.returncode, int(peak_kb) / 1024, float(cpu_s), done.stdout, said)
