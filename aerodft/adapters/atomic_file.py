"""Files that are written as a whole or not at all, and folders to write to."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from aerodft.errors import InputError


@contextmanager
def whole_file(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """Write a file as a whole or not at all; where that fails, say so in a sentence.

    Args:
        path: The file.
        overwrite: Whether one that exists is replaced.

    Yields:
        Where to write.

    Raises:
        InputError: It exists and must not be replaced, or it cannot be written.
    """
    if path.is_file() and not overwrite:
        raise InputError("the file exists", where=path, hint="choose another name, or add `overwrite`")
    try:
        with replaced(path, keep=not overwrite) as partial:
            yield partial
    except FileExistsError:
        raise InputError(
            "the file exists", where=path, hint="somebody made it meanwhile: choose another name"
        ) from None
    except OSError as error:
        raise InputError("the file cannot be written", where=path, got=error.strerror or error) from error


@contextmanager
def replaced(path: Path, *, keep: bool = False) -> Iterator[Path]:
    """A file that takes its name when the block is through, and leaves nothing behind when it raises.

    A link stays one; what is no file (a pipe, a device) is written to as it is.

    Args:
        path: The file.
        keep: Whether a file that appeared meanwhile stays.

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
        if keep:
            _take_name(partial, target)
        else:
            partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def write_whole(path: Path, data: bytes) -> None:
    """Write all of a file or none of it, as ``replaced``."""
    with replaced(path) as partial:
        partial.write_bytes(data)


def _take_name(partial: Path, target: Path) -> None:
    """Give a file its name, unless another one has it.

    Raises:
        FileExistsError: One has.
    """
    try:
        target.hardlink_to(partial)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        partial.replace(target)


@contextmanager
def output_folder(folder: Path, what: str, expected: str = "a folder to write to") -> Iterator[None]:
    """A folder, made where it is not there, that something is written to.

    Args:
        folder: The folder.
        what: What is written, for the sentence where that fails.
        expected: What would have been right, for that sentence.

    Raises:
        InputError: The folder cannot be written to.
    """
    with writable(folder, what, expected):
        folder.mkdir(parents=True, exist_ok=True)
        yield


@contextmanager
def writable(path: Path, what: str, expected: str = "a folder to write to") -> Iterator[None]:
    """Errors of the system in this block are an ``InputError`` that says what cannot be written, and where."""
    try:
        yield
    except OSError as error:
        got = error.strerror or error
        raise InputError(f"{what} cannot be written", where=path, got=got, expected=expected) from error
