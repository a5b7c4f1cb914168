"""Doing without the search for cyclic garbage where there is none."""

import atexit
import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache


@contextmanager
def without_collector() -> Iterator[None]:
    """No search for cyclic garbage: what is loaded, or a recorded flight that is run, makes next to none.

    Looking for it took a tenth of the start, and a seventh of a run.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def keep_loaded() -> None:
    """Have what is loaded by now never looked through again.

    Among 100,000 objects a search for cyclic garbage, which comes when it likes, stopped a live service for 25 to
    50 ms.
    """
    gc.collect()
    gc.freeze()


@cache
def end_at_once() -> None:
    """Have this process end without another search through all of its libraries: half a second."""
    atexit.register(gc.freeze)
