"""numba's compiler, with a type that the checker understands.

A function is compiled at its first call and kept on disk; the interpreter's lock is released inside.
"""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def njit(function: Function) -> Function:
    """Compile a loop."""
    return cast("Function", numba.njit(function, cache=True, nogil=True))


def njit_inline(function: Function) -> Function:
    """Compile a small part of a hot loop into whoever calls it.

    A call with arrays passes each as seven numbers; in the simulator's loop that took half of the time.
    """
    return cast("Function", numba.njit(function, cache=True, nogil=True, forceinline=True))


def njit_ieee(function: Function) -> Function:
    """Compile a loop in which a division by zero is infinite.

    Without the check for zero the compiler can take several elements at once.
    """
    return cast("Function", numba.njit(function, cache=True, nogil=True, error_model="numpy"))


def njit_fused(function: Function) -> Function:
    """Compile a loop as ``njit_ieee`` does, with products and sums that may be fused."""
    fastmath = {"contract", "arcp"}
    return cast("Function", numba.njit(function, cache=True, nogil=True, error_model="numpy", fastmath=fastmath))
