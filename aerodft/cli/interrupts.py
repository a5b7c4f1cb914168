"""SIGINT and SIGTERM: the first one ends a command in order, a second one ends it at once.

An exception that a signal raises within the import system can leave a module's lock held. Every thread that imports
that module then waits for ever, and so does the command's end. Signals are therefore held back while modules load. Long
work is ended between two batches for the same reason.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Final, NoReturn

if TYPE_CHECKING:
    from aerodft.app import Progress

INTERRUPTED: Final = 128 + signal.SIGINT  # what a shell says of a program that a signal ended
TERMINATED: Final = 128 + signal.SIGTERM

_ENDING: Final = (signal.SIGINT, signal.SIGTERM)
_WAKE_S: Final = 0.5
_LOOK_AGAIN_S: Final = 0.02  # for the end of an import: nobody feels it, and a longer import is not slowed
_DUPLICATE_S: Final = 0.3  # `timeout` and terminals send one signal twice within milliseconds; people take longer
_IMPORT_S: Final = 1.0  # for a whole import, which takes up to 2 s; beside much other work it takes 20 s
_LEFT_BEHIND_S: Final = 3.0  # for threads at the very end: each has been asked to end before
_IMPORT_CODE: Final = "<frozen importlib"


class _Ending:
    """What the signals of this process do while ``ending_on_signals`` lasts.

    Attributes:
        first: The signal that came first; None before.
        is_import_broken: Whether the first signal ended an import before its end.
        action: Called at the first signal in place of raising; None for raising.
        is_active: Whether the handlers are this object's.
    """

    def __init__(self) -> None:
        self.is_active = False
        self.reset()

    def reset(self) -> None:
        """Forget the signals that came."""
        self.first: int | None = None
        self.is_import_broken = False
        self.action: Callable[[], None] | None = None
        self._first_s = 0.0

    def receive(self, number: int, frame: FrameType | None) -> None:
        """Handle SIGINT or SIGTERM."""
        if self.first is None:
            self.first, self._first_s = number, time.monotonic()
            self.deliver(number, frame)
        elif time.monotonic() - self._first_s > _DUPLICATE_S:
            os.write(2, b"aerodft: ended at once by a second signal\n")
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)

    def deliver(self, _: int, frame: FrameType | None) -> None:
        """Do what the first signal does, or look again in a moment where the main thread loads a module.

        An import that takes long is ended where the main thread runs a module's own code: what the import system holds
        there is freed by its own exception handlers.
        """
        if self.action is not None:
            self.action()
            return
        self.is_import_broken = _is_importing(frame)
        is_patient = time.monotonic() - self._first_s < _IMPORT_S
        if self.is_import_broken and (is_patient or _is_import_system(frame)):
            signal.setitimer(signal.ITIMER_REAL, _LOOK_AGAIN_S)
        else:
            self.end()

    def end(self) -> None:
        """Raise what the first signal raises.

        Raises:
            KeyboardInterrupt: It was SIGINT.
            SystemExit: It was SIGTERM.
        """
        if self.first == signal.SIGINT:
            raise KeyboardInterrupt
        raise SystemExit(TERMINATED)


_ending = _Ending()


def _is_import_system(frame: FrameType | None) -> bool:
    return frame is not None and frame.f_code.co_filename.startswith(_IMPORT_CODE)


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None and not _is_import_system(frame):
        frame = frame.f_back
    return frame is not None


def end_if_signalled() -> None:
    """Raise again what the first signal raised, where a callback or a library has swallowed it.

    Raises:
        KeyboardInterrupt: SIGINT has come.
        SystemExit: SIGTERM has come.
    """
    if _ending.first is not None:
        _ending.end()


def stopped_code() -> int | None:
    """Exit code for an error that follows from a half-loaded module; None where no signal ended an import."""
    return None if not _ending.is_import_broken or _ending.first is None else 128 + _ending.first


@contextmanager
def ending_on_signals() -> Iterator[None]:
    """Have SIGINT raise ``KeyboardInterrupt`` and SIGTERM ``SystemExit`` (143), neither of them in the import system.

    A second signal kills the process, 0.3 s after the first one or later. Blocks within the block change nothing.
    """
    if _ending.is_active:
        yield
        return
    _ending.reset()
    _ending.is_active = True
    before = {number: signal.signal(number, _ending.receive) for number in _ENDING}
    before[signal.SIGALRM] = signal.signal(signal.SIGALRM, _ending.deliver)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)
        _ending.is_active = False


@contextmanager
def calling_on_signal(action: Callable[[], None]) -> Iterator[None]:
    """Have the first SIGINT or SIGTERM call ``action`` in the main thread in place of raising."""
    _ending.action = action
    try:
        if _ending.first is not None:  # it came before, and what it raised was swallowed
            action()
        yield
    finally:
        _ending.action = None


def exit_process(code: object) -> NoReturn:
    """End the process with an exit code; after a signal without waiting longer than 3 s for threads that go on."""
    if _ending.first is not None:
        until_s = time.monotonic() + _LEFT_BEHIND_S
        threads = [each for each in threading.enumerate() if each is not threading.main_thread() and not each.daemon]
        for thread in threads:
            thread.join(max(until_s - time.monotonic(), 0.0))
        if any(thread.is_alive() for thread in threads):
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code if isinstance(code, int) else 1)
    sys.exit(code)  # type: ignore[arg-type]  # what another exit was given


def wait_in_main_thread(done: threading.Event) -> None:
    """Wait until an event is set or the handler of a signal raises.

    Wakes twice a second: Python runs handlers in the main thread alone, which a signal that another thread receives, or
    that comes just before the wait begins, does not wake.
    """
    while not done.wait(_WAKE_S):
        end_if_signalled()


@contextmanager
def interruptible(progress: "Progress") -> Iterator["Progress"]:
    """A progress callback in which the first SIGINT or SIGTERM ends the work; a second one is not waited for.

    Signals are held back from the first call on, and as they were at the end; ignored ones stay ignored.

    Args:
        progress: Called in turn.

    Yields:
        What the work calls between two batches; it raises what the handler of the signal raises that came meanwhile.
    """
    handlers: dict[int, Callable[[int, FrameType | None], object]] = {}
    held: list[tuple[int, FrameType | None]] = []

    def hold(number: int, frame: FrameType | None) -> None:
        held.append((number, frame))
        signal.signal(number, handlers[number])

    def end() -> None:
        for number, frame in held:
            handlers[number](number, frame)

    def between_batches(done: int, total: int) -> None:
        if not handlers:
            for number in (signal.SIGINT, signal.SIGTERM):
                if callable(handler := signal.getsignal(number)):
                    handlers[number] = handler
                    signal.signal(number, hold)
        end()
        end_if_signalled()
        progress(done, total)

    try:
        yield between_batches
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    end()
