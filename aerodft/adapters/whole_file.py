"""Files that are written as a whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from aerodft.errors import InputError


@contextmanager
def whole_file(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """As ``replaced``, in a sentence where it fails.

    Args:
        path: The file.
        overwrite: Whether one that exists is replaced.

    Yields:
        Where to write.

    Raises:
        InputError: It exists and must not be replaced, or it cannot be written.
    """
    if path.is_file() and not overwrite:
        raise InputError("the file exists", where=path, hint="choose another name, or add --overwrite")
    try:
        with replaced(path) as partial:
            yield partial
    except OSError as error:
        raise InputError("the file cannot be written", where=path, got=error.strerror or error) from error


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """A file that takes its name when the block is through, and leaves nothing behind when it raises.

    A link stays one; what is no file (a pipe, a device) is written to as it is.

    Yields:
        Where to write.

    Raises:
        OSError: It cannot be written.
    """
    target = path.resolve()
    if target.is_dir():
        raise IsADirectoryError(None, "Is a directory")
    if target.exists() and not target.is_file():
        yield target
        return
    partial = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        yield partial
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)
