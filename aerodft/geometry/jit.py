"""The compiler of the hot loops, with a type that the checker understands.

Without it (numba is not installed, or NUMBA_DISABLE_JIT is set) loops run as they are written, slowly.
"""

import os
import sys
from collections.abc import Callable
from functools import cached_property, update_wrapper
from importlib.util import find_spec
from time import process_time
from typing import Any, Final, TypeVar, cast

_PATIENCE: Final = 1 << 20  # steps; to lose as many takes about as long as loading the compiler
_PATIENCE_A_SECOND: Final = 160_000  # steps for each second so far: of work that takes long a twelfth may be lost

COMPILES: Final[bool] = find_spec("numba") is not None and os.environ.get("NUMBA_DISABLE_JIT", "0") in {"", "0"}

Function = TypeVar("Function", bound=Callable[..., object])


_done = 0  # steps so far without the compiler
_limit = 0  # so many are lost before the time is looked at again


def is_loaded() -> bool:
    """Whether something compiled has run already; until then small work is better done without."""
    return COMPILES and "numba" in sys.modules


def load_compiler() -> None:
    """Have everything compiled from now on: where something live must not be held up later."""
    if COMPILES:
        import numba  # noqa: PLC0415, F401 - see ``Late``


def expect(steps: int) -> None:
    """Announce steps that are lost without the compiler; once they are many together, it is loaded.

    A step is half a microsecond: a byte or a comparison of a loop as it is written, some dozen bytes over whole arrays.
    """
    global _done, _limit  # noqa: PLW0603 - of the process, as the compiler is
    _done += steps
    if _done > _limit and not is_loaded():
        if _done > max(_PATIENCE, _PATIENCE_A_SECOND * process_time()):
            load_compiler()
        # Where processes are confined, to ask for the time may take half a millisecond.
        _limit = _done + _PATIENCE // 64


class Late:
    """A function that is compiled when it is first called, or when one that calls it is compiled.

    The compiler takes 60 MB and 0.15 s to load; who only copies, checks or prints a recording does without.
    """

    def __init__(self, function: Callable[..., object], *, is_patient: bool = False, **options: Any) -> None:  # noqa: ANN401 - as the compiler has them
        self.py_func = function
        self._is_patient = is_patient
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
        if self._is_patient and not is_loaded():
            return self.py_func(*arguments, **named)
        return self.compiled(*arguments, **named)


def njit(function: Function) -> Function:
    """Compile at the first call and keep the machine code on disk; the interpreter's lock is released inside."""
    return cast("Function", Late(function)) if COMPILES else function


def njit_inline(function: Function) -> Function:
    """As ``njit``, for small parts of a hot loop: they are compiled into whoever calls them.

    A call with arrays passes each as seven numbers; in the simulator's loop that took half of the time.
    """
    return cast("Function", Late(function, forceinline=True)) if COMPILES else function


def njit_late(function: Function) -> Function:
    """As ``njit``, but run as written until the compiler is loaded: who calls it announces the work (``expect``).

    Only for what comes out alike to the last bit: whole numbers, or plain arithmetic in order.
    """
    return cast("Function", Late(function, is_patient=True)) if COMPILES else function


def njit_late_inline(function: Function) -> Function:
    """As ``njit_late``, for what is compiled into whoever calls it, as by ``njit_inline``."""
    return cast("Function", Late(function, is_patient=True, forceinline=True)) if COMPILES else function


def njit_late_ieee(function: Function) -> Function:
    """As ``njit_late``, but a division by zero is infinite; arrays' numbers then warn where it runs as written."""
    return cast("Function", Late(function, is_patient=True, error_model="numpy")) if COMPILES else function


def njit_ieee(function: Function) -> Function:
    """As ``njit`` for dense arrays: a division by zero is infinite, products and sums may be fused.

    Without the check for zero the compiler can take several elements at once.
    """
    if not COMPILES:
        return function
    return cast("Function", Late(function, error_model="numpy", fastmath={"contract", "arcp"}))
