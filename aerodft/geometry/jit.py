"""The compiler of the hot loops, with a type that the checker understands.

Without it (numba is not installed, or NUMBA_DISABLE_JIT is set) loops run as they are written, slowly.
"""

import os
import sys
from collections.abc import Callable
from functools import cached_property, update_wrapper
from importlib.util import find_spec
from typing import Any, Final, TypeVar, cast

COMPILES: Final[bool] = find_spec("numba") is not None and os.environ.get("NUMBA_DISABLE_JIT", "0") in {"", "0"}

Function = TypeVar("Function", bound=Callable[..., object])


def is_loaded() -> bool:
    """Whether something compiled has run already; until then small work is better done without."""
    return "numba" in sys.modules


class Late:
    """A function that is compiled when it is first called, or when one that calls it is compiled.

    The compiler takes 60 MB and 0.15 s to load; who only copies, checks or prints a recording does without.
    """

    def __init__(self, function: Callable[..., object], **options: Any) -> None:  # noqa: ANN401 - as the compiler has them
        self.py_func = function
        self._options = options
        update_wrapper(self, function)

    @cached_property
    def compiled(self) -> Callable[..., object]:
        """The compiler's own function."""
        import numba  # noqa: PLC0415 - see above

        typeof = numba.extending.typeof_impl
        typeof.register(Late)(lambda late, context: typeof(late.compiled, context))  # as others see it that call it
        function: Callable[..., object] = numba.njit(cache=True, nogil=True, **self._options)(self.py_func)
        return function

    def __call__(self, *arguments: object, **named: object) -> object:
        """As the function itself."""
        return self.compiled(*arguments, **named)


def njit(function: Function) -> Function:
    """Compile at the first call and keep the machine code on disk; the interpreter's lock is released inside."""
    return cast("Function", Late(function)) if COMPILES else function


def njit_ieee(function: Function) -> Function:
    """As ``njit`` for dense arrays: a division by zero is infinite, products and sums may be fused.

    Without the check for zero the compiler can take several elements at once.
    """
    if not COMPILES:
        return function
    return cast("Function", Late(function, error_model="numpy", fastmath={"contract", "arcp"}))
