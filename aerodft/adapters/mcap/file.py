"""The file under a segment: unbuffered, locked while it is written, with room reserved for how it ends.

Blocks beyond the end of the file are allocated before they are needed. So a disk that fills up is known *before*
something is written, nothing is torn, and what belongs at the end has its place, whoever else fills the disk. Where the
file system cannot do that, the end has no guaranteed place; recovery then writes it.
"""

import ctypes
import errno
import fcntl
import logging
import os
import resource
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_KEEP_SIZE = 1
_PIECE_BYTES = 1 << 20
_UNLIMITED = 1 << 62
_UNSUPPORTED = frozenset({errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL, errno.EPERM})

_log = logging.getLogger(__name__)


def pieces(descriptor: int, offset: int, length: int) -> Iterator[bytes]:
    """Part of a file, of any size, a megabyte at a time.

    Raises:
        OSError: It cannot be read.
    """
    for at in range(offset, offset + length, _PIECE_BYTES):
        yield os.pread(descriptor, min(_PIECE_BYTES, offset + length - at), at)


class SegmentFile:
    """A new file, open for appending.

    Attributes:
        path: Where.
        size: Bytes in it.
        most_bytes: What this process may write to it.

    Raises:
        OSError: From any method; it cannot be made, or what was written last is torn.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
        self.most_bytes = _UNLIMITED if limit == resource.RLIM_INFINITY else limit
        self._allocated: int | None = 0
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        with suppress(OSError):  # a file system without locks: recovery cannot tell who writes there, nor can we
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def reserve(self, size: int, step: int) -> None:
        """Make sure that the file can grow to ``size``, and if possible by another ``step``.

        Raises:
            OSError: The disk is full, or the file too large for this process; the file is as it was.
        """
        if size > self.most_bytes:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
        if self._allocated is None or size <= self._allocated:
            return
        for wanted in (size + step, size):
            try:
                allocate(self._descriptor, self.size, wanted - self.size)
            except OSError as error:
                if error.errno in _UNSUPPORTED:
                    self._allocated = None
                    return
                if wanted == size:
                    raise
            else:
                self._allocated = wanted
                return

    def write(self, data: bytes) -> None:
        """Append."""
        rest = memoryview(data)
        while rest:
            written = os.write(self._descriptor, rest)
            self.size += written
            rest = rest[written:]

    def cut(self, size: int) -> None:
        """Cut the end off, what is allocated beyond it included."""
        os.ftruncate(self._descriptor, size)
        self.size = size
        self._allocated = None if self._allocated is None else size

    @property
    def is_gone(self) -> bool:
        """Whether somebody has deleted it: what is written to it then is lost."""
        return os.fstat(self._descriptor).st_nlink == 0

    def sync(self) -> None:
        """Wait until the disk has the content."""
        os.fdatasync(self._descriptor)
        if self.is_gone:
            raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))

    def sync_all(self) -> None:
        """Wait until the disk has content and size."""
        os.fsync(self._descriptor)
        if self.is_gone:
            raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))

    def allow(self, mode: int) -> None:
        """Give it the permissions of another file."""
        os.fchmod(self._descriptor, mode & 0o777)

    def close(self) -> None:
        """Close it; what matters is synced before."""
        try:
            os.close(self._descriptor)
        except OSError as error:
            _log.warning("%s: closed with an error (%s)", self.path, error.strerror)


def allocate(descriptor: int, offset: int, length: int) -> None:
    """Allocate blocks for a part of a file without changing its size.

    Raises:
        OSError: There is no room, or the file system cannot.
    """
    if _fallocate is None:
        raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))
    if _fallocate(descriptor, _KEEP_SIZE, offset, length):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def free_bytes(folder: Path) -> int:
    """What this user may still write on a folder's disk.

    Raises:
        OSError: The folder is gone.
    """
    found = os.statvfs(folder)
    return found.f_bavail * found.f_frsize


def sync_folder(folder: Path) -> None:
    """Make new names in a folder survive a power cut.

    Raises:
        OSError: The folder is gone, or the disk fails.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _find_fallocate() -> "ctypes._NamedFuncPointer | None":
    try:
        function = ctypes.CDLL(None, use_errno=True).fallocate
    except (OSError, AttributeError):  # no such function: not Linux
        return None
    function.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_int64, ctypes.c_int64)
    function.restype = ctypes.c_int
    return function


_fallocate = _find_fallocate()
