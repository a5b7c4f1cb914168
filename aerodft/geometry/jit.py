"""The compiler of the hot loops, with a type that the checker understands."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def njit(function: Function) -> Function:
    """Compile at the first call and keep the machine code on disk; the interpreter's lock is released inside."""
    return cast("Function", numba.njit(cache=True, nogil=True)(function))


def njit_ieee(function: Function) -> Function:
    """As ``njit`` for dense arrays: a division by zero is infinite, products and sums may be fused.

    Without the check for zero the compiler can take several elements at once.
    """
    compiled = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp"})(function)
    return cast("Function", compiled)
