"""The program itself; at its end it says which functions it compiled, or loaded, once it was running live."""

import atexit
import sys

from aerodft.cli import serve
from aerodft.cli.main import main
from aerodft.geometry.jit import Late

WORD = "late:"
_begin, _before = serve.keep_loaded, set[str]()


def compiled() -> set[str]:
    """All compiled functions with their signatures."""
    names = [name for module in list(sys.modules.values()) for name in vars(module).values()]
    found = {id(each): each for each in names if isinstance(each, Late) and "compiled" in vars(each)}
    return {
        f"{each.py_func.__qualname__} {signature}" for each in found.values() for signature in each.compiled.signatures
    }


def begin() -> None:
    """What the service does last before it runs."""
    _before.update(compiled())
    _begin()


def say() -> None:
    for each in sorted(compiled() - _before):
        print(WORD, each, file=sys.stderr, flush=True)
    print(WORD, f"after {len(_before)}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    serve.keep_loaded = begin
    atexit.register(say)
    main()
