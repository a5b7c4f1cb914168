"""Keys of a terminal, one by one, while something else is going on; none of it where stdin is no terminal."""

import os
import select
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec

_HAS_TERMINALS = find_spec("termios") is not None
_POLL_S = 0.1
_LONGEST = 8  # bytes of the sequence that one key sends


def has_keys() -> bool:
    """Whether somebody could press a key: stdin and stderr are a terminal, and this is its foreground."""
    if not _HAS_TERMINALS or not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    return _is_foreground(sys.stdin.fileno())


@contextmanager
def pressed(actions: Mapping[str, Callable[[], None]]) -> Iterator[None]:
    """Call an action for each of its keys, from a thread, until the end; the terminal is left as it was.

    Args:
        actions: By what the key sends, which for an arrow is several characters.
    """
    if not has_keys():
        yield
        return
    import termios
    import tty

    number = sys.stdin.fileno()
    before = termios.tcgetattr(number)
    ending = threading.Event()
    thread = threading.Thread(target=_listen, args=(number, actions, ending), name="keys", daemon=True)
    try:
        tty.setcbreak(number)
        thread.start()
        yield
    finally:
        ending.set()
        if thread.is_alive():
            thread.join()
        termios.tcsetattr(number, termios.TCSADRAIN, before)


def _listen(number: int, actions: Mapping[str, Callable[[], None]], ending: threading.Event) -> None:
    while not ending.is_set():
        ready, _, _ = select.select([number], [], [], _POLL_S)
        # To read from the background would stop the whole process.
        if not ready or not _is_foreground(number):
            continue
        text = os.read(number, _LONGEST)
        if not text:
            return
        found = text.decode(errors="replace")
        for key in [found] if found in actions else found:
            action = actions.get(key)
            if action is not None:
                action()


def _is_foreground(number: int) -> bool:
    try:
        return os.tcgetpgrp(number) == os.getpgrp()
    except OSError:
        return False
