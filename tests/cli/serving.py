"""The program itself; at its end it says which functions it compiled, or loaded, once it was running live."""

import atexit
import sys
from typing import Any

from numba.core.dispatcher import Dispatcher

from aerodft.app import assembly
from aerodft.cli.main import main

WORD = "late:"
_run, _before = assembly.run, set[str]()


def compiled() -> set[str]:
    """All compiled functions with their signatures."""
    ours = [module for name, module in list(sys.modules.items()) if name.startswith("aerodft.")]
    found = {each for module in ours for each in vars(module).values() if isinstance(each, Dispatcher)}
    return {f"{each.py_func.__qualname__} {signature}" for each in found for signature in each.signatures}


def run(*arguments: Any, **named: Any) -> None:
    """Note what is compiled when the service begins to run."""
    _before.update(compiled())
    _run(*arguments, **named)


def say() -> None:
    for each in sorted(compiled() - _before):
        print(WORD, each, file=sys.stderr, flush=True)
    print(WORD, f"after {len(_before)}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    assembly.run = run
    atexit.register(say)
    main()
