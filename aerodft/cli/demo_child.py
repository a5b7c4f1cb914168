"""A process of the demo that ends with it, also where the demo is killed: its standard input ends then.

``python -m aerodft.cli.demo_child -m MODULE ARGUMENTS``, with a pipe that only the demo holds the other end of.
"""

import os
import runpy
import signal
import sys
import threading


def _end_with_parent() -> None:
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)  # which all of the demo's processes take as the end


def main() -> None:
    """Run the module that the arguments name as if it had been started itself."""
    module = sys.argv[2]
    sys.argv = sys.argv[2:]
    threading.Thread(target=_end_with_parent, name="end-with-parent", daemon=True).start()
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
