"""A page of its own for a test: the real command in a process of its own, and what it opened."""

import re
import subprocess
import sys
from contextlib import contextmanager


@contextmanager
def opened_page(*arguments):
    """``aerodft view`` with these arguments; gives the address that it said."""
    command = [sys.executable, "-m", "aerodft", "view", *map(str, arguments)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            lines = []
            for line in process.stderr:
                lines.append(line)
                if found := re.search(r"open (http://\S+)", line):
                    yield found[1]
                    break
            else:
                raise AssertionError("".join(lines))
        finally:
            process.terminate()
            process.wait(30)
