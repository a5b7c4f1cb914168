"""The compiler of the hot loops, with a type that the checker understands."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def njit(function: Function) -> Function:
    """Compile at the first call and keep the machine code on disk; the interpreter's lock is released inside."""
    return cast("Function", numba.njit(cache=True, nogil=True)(function))
