"""Use cases, one room each: what a command, a notebook or a page asks for; values out, progress through a callback."""

from collections.abc import Callable
from typing import TypeAlias

Progress: TypeAlias = Callable[[int, int], None]
"""Called with how much is done, and of how much: nanoseconds of a flight, images, starts of a solver."""


def no_progress(done: int, total: int) -> None:
    """Say nothing."""
