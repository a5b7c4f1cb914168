"""A recording whose recorder was killed, or whose files were damaged: its segments made whole in place.

A segment is copied as far as it is whole, the copy is read back, and only then takes the segment's name. What is sound
is not touched, and neither is what a recorder is writing.
"""

import fcntl
import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from aerodft.adapters.filetype import check_is_no_pipe
from aerodft.adapters.mcap.file import pieces, sync_folder
from aerodft.adapters.mcap.layout import MAGIC
from aerodft.adapters.mcap.reading import ChunkReader
from aerodft.adapters.mcap.repair import Loss, Survey, survey, write_whole
from aerodft.adapters.mcap.scanning import scan_segment
from aerodft.errors import InputError

SERIES = ("data", "images")
_BEGINNING_BYTES = 1 << 20
_NUMBER = re.compile(r"_(\d+)\.mcap$")

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentRecovery:
    """What became of one segment.

    Attributes:
        name: Of the file.
        state: ``sound`` (not touched), ``completed`` (now ends as it should), ``unfinished`` (not touched: its
            messages are in no chunks), ``unreadable`` (not touched) or ``missing``.
        messages: In it now.
        start_ns: Earliest log time; None where there is no message.
        end_ns: Latest.
        losses: What was in it, or should have been, and is not.
    """

    name: str
    state: str
    messages: int = 0
    start_ns: int | None = None
    end_ns: int | None = None
    losses: tuple[Loss, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """What became of a recording."""

    folder: Path
    segments: tuple[SegmentRecovery, ...]

    @property
    def messages(self) -> int:
        """In all segments."""
        return sum(segment.messages for segment in self.segments)

    @property
    def is_lossy(self) -> bool:
        """Whether anything is lost."""
        return any(segment.losses for segment in self.segments)


def recover_folder(folder: Path) -> Recovery:
    """Make a recording's segments whole.

    Raises:
        InputError: There is no recording, a recorder still writes it, another tool made it, or it cannot be read or
            written; the segments that were not whole are then as they were.
    """
    try:
        paths = {stem: _numbered(folder, stem) for stem in SERIES}
        if not paths["data"] and not paths["images"]:
            got = "a file" if folder.is_file() else "no data_*.mcap" if folder.is_dir() else "nothing"
            raise InputError("there is no recording", where=folder, got=got, expected="a folder with data_000.mcap")
        segments = [each for stem in SERIES for each in _recover_series(stem, paths[stem])]
    except OSError as error:
        where = error.filename or folder
        raise InputError("the recording cannot be recovered", where=where, got=error.strerror) from error
    return Recovery(folder=folder, segments=tuple(segments))


def is_recording(folder: Path) -> bool:
    """Whether there are segments in a folder."""
    return any(True for stem in SERIES for _ in folder.glob(f"{stem}_*.mcap"))


def recordings_in(root: Path) -> dict[Path, bool]:
    """The recordings right below a folder, by name, and whether all of their segments end as they should.

    Raises:
        InputError: The folder cannot be read.
    """
    found: dict[Path, bool] = {}
    try:
        for folder in sorted(root.iterdir()) if root.is_dir() else []:
            segments = [path for stem in SERIES for path in folder.glob(f"{stem}_*.mcap")]
            if segments:
                found[folder] = all(map(_ends, segments))
    except OSError as error:
        raise InputError("the folder cannot be read", where=root, got=error.strerror) from error
    return found


def _ends(path: Path) -> bool:
    check_is_no_pipe(path)
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - len(MAGIC), 0))
        return size > len(MAGIC) and file.read() == MAGIC


def _numbered(folder: Path, stem: str) -> list[tuple[int, Path]]:
    """The segments of a series by number; a copy of one with another name is none.

    Raises:
        OSError: One of them is no file.
    """
    found = [(_NUMBER.search(path.name), path) for path in folder.glob(f"{stem}_*.mcap")]
    for _, path in found:
        check_is_no_pipe(path)
    return sorted((int(match[1]), path) for match, path in found if match is not None)


def _recover_series(stem: str, paths: list[tuple[int, Path]]) -> Iterator[SegmentRecovery]:
    expected, last_ns = 0, None
    for number, path in paths:
        segment = _recover_segment(path)
        for missing in range(expected, number):
            loss = Loss(what="the segment is missing", from_ns=last_ns, to_ns=segment.start_ns)
            yield SegmentRecovery(name=f"{stem}_{missing:03d}.mcap", state="missing", losses=(loss,))
        yield segment
        expected, last_ns = number + 1, segment.end_ns or last_ns


def _recover_segment(path: Path) -> SegmentRecovery:
    with _locked(path) as descriptor:
        found = survey(descriptor)
        if found.is_sound:
            return _outcome(path, "sound", found)
        if not found.is_own and (found.chunks or found.library):
            made_by = f"one made by {found.library or 'another tool'}"
            expected = "a recording of aerodft"
            raise InputError("the file cannot be recovered", where=path, got=made_by, expected=expected)
        if not found.chunks and (bare := _without_chunks(path)) is not None:
            return bare
        lost_bytes = sum(loss.length for loss in found.losses)
        if not found.chunks and not (_is_beginning(descriptor) and lost_bytes <= _BEGINNING_BYTES):
            loss = Loss(what="nothing in it can be read", offset=0, length=os.fstat(descriptor).st_size)
            return SegmentRecovery(name=path.name, state="unreadable", losses=(loss,))
        _replace(path, descriptor, found)
        return _outcome(path, "completed", found)


def _without_chunks(path: Path) -> SegmentRecovery | None:
    """A segment that another tool wrote again without chunks, as it is; None where no message stands outside of one.

    There is no checksum that tells a damaged message from a sound one: it is read as far as it is whole, not rewritten.
    """
    try:
        scan = scan_segment(path)
    except InputError:  # not even its first bytes are those of one
        return None
    bare = [place for place in scan.chunks if place.is_bare]
    messages = sum(1 for _ in ChunkReader(scan.channels.copy()).messages(bare))
    if not messages:
        return None
    end_ns = max(place.end_ns for place in bare)
    read_to = bare[-1].offset + bare[-1].length
    torn = Loss(
        what="it does not end as it should; without chunks there is nothing to make whole",
        from_ns=end_ns,
        offset=read_to,
        length=path.stat().st_size - read_to,
    )
    return SegmentRecovery(
        name=path.name,
        state="sound" if scan.is_whole else "unfinished",
        messages=messages,
        start_ns=min(place.start_ns for place in bare),
        end_ns=end_ns,
        losses=() if scan.is_whole else (torn,),
    )


def _is_beginning(descriptor: int) -> bool:
    """Whether this is the beginning of an MCAP file: one that was just made as the machine died."""
    return MAGIC.startswith(os.pread(descriptor, len(MAGIC), 0))


def _replace(path: Path, descriptor: int, found: Survey) -> None:
    partial = path.with_name(f".{path.name}.recovering")
    partial.unlink(missing_ok=True)  # of a recovery that was killed: the lock says that nobody writes it
    try:
        write_whole(descriptor, found, partial)
        with _opened(partial) as copy:
            again = survey(copy)
        if not again.is_sound or again.messages != found.messages:
            raise InputError("what was written does not read back", where=partial, hint="the segment is as it was")
        _keep_dropped(path, descriptor, found)
        partial.replace(path)
        sync_folder(path.parent)
    finally:
        partial.unlink(missing_ok=True)


def _keep_dropped(path: Path, descriptor: int, found: Survey) -> None:
    """Put damaged bytes into a file beside the segment: somebody may be able to read more of them."""
    damaged = [loss for loss in found.losses if loss.offset is not None and not (loss.is_torn and loss.to_ns is None)]
    if damaged:
        with path.with_name(f"{path.name}.dropped").open("ab") as file:
            for loss in damaged:
                file.writelines(pieces(descriptor, loss.offset or 0, loss.length))
            file.flush()
            os.fsync(file.fileno())


@contextmanager
def _opened(path: Path) -> Iterator[int]:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


@contextmanager
def _locked(path: Path) -> Iterator[int]:
    """A segment, open for reading, that no recorder and no other recovery has.

    Raises:
        InputError: One has.
    """
    with _opened(path) as descriptor:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            hint = "stop the recorder first"
            raise InputError("the recording is still being written", where=path, hint=hint) from None
        except OSError:
            _log.debug("%s: no locks on this file system", path)
        if os.fstat(descriptor).st_ino != path.stat().st_ino:
            raise InputError("the recording is being recovered by somebody else", where=path, hint="try again")
        yield descriptor


def _outcome(path: Path, state: str, found: Survey) -> SegmentRecovery:
    return SegmentRecovery(
        name=path.name,
        state=state,
        messages=found.messages,
        start_ns=found.start_ns,
        end_ns=found.end_ns,
        losses=tuple(found.losses),
    )
