"""The compiler of the hot loops, with a type that the checker understands.

Without it (numba is not installed, or NUMBA_DISABLE_JIT is set) loops run as they are written, slowly.
"""

from collections.abc import Callable
from typing import Final, TypeVar, cast

try:
    import numba
except ImportError:
    _enabled = False
else:
    _enabled = not getattr(numba.config, "DISABLE_JIT", False)

COMPILES: Final[bool] = _enabled

Function = TypeVar("Function", bound=Callable[..., object])


def njit(function: Function) -> Function:
    """Compile at the first call and keep the machine code on disk; the interpreter's lock is released inside."""
    if not COMPILES:
        return function
    return cast("Function", numba.njit(cache=True, nogil=True)(function))


def njit_ieee(function: Function) -> Function:
    """As ``njit`` for dense arrays: a division by zero is infinite, products and sums may be fused.

    Without the check for zero the compiler can take several elements at once.
    """
    if not COMPILES:
        return function
    compiled = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp"})(function)
    return cast("Function", compiled)
