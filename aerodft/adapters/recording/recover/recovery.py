"""A recording whose recorder was killed, or whose files were damaged: its segments made whole in place.

A segment is copied as far as it is whole, the copy is read back, and only then takes the segment's name. What is sound
is not touched, and neither is what a recorder is writing.
"""

import fcntl
import logging
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from mcap.opcode import Opcode

from aerodft.adapters.files import check_is_no_pipe
from aerodft.adapters.recording.channels import Channels
from aerodft.adapters.recording.layout import (
    MAGIC,
    MESSAGE_HEAD,
    RECORD_HEAD,
    ChunkBuffer,
    EncodedChunk,
    compressor,
    encode_records,
)
from aerodft.adapters.recording.read import (
    CRC_BYTES,
    ChunkReader,
    Ownership,
    SegmentScan,
    records_in,
    scan_segment,
    unique_segments,
)
from aerodft.adapters.recording.recover.chunk_scanner import ChunkScanner, DamagedBytes, WholeChunk
from aerodft.adapters.recording.write import (
    METADATA_NAME,
    PROFILE,
    RECOVERED_NAME,
    SegmentFile,
    Summary,
    count_record,
    pieces,
    sync_folder,
)
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, os_errors_as
from aerodft.version import SOFTWARE

SERIES = ("data", "images")
_BEGINNING_BYTES = 1 << 20
_NUMBER = re.compile(r"_(\d+)\.mcap$")
_UNFINISHED = "it does not end as it should: a kill costs half a second at most, what else cut it nobody knows how much"
_CUT = "it was cut: later messages show that more was recorded"
_NO_NEXT = "more was recorded behind it, in a segment that is not there"
_MISSING = "the segment is missing"
_GONE = "chunks that are not there any more"
_MOST_UNSYNCED_NS = 2 * SECOND_NS  # a power cut costs one series so much more than another
_OWN_TOPICS = ("aerodft/", "mavlink", "dataflash")

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class DataLoss:
    """Something that is not in a recording.

    Attributes:
        what: In words.
        from_ns: After this log time; None where nothing came before it.
        to_ns: Before this log time; None where nothing came after it.
        offset: Where it was in the file; None where it was in none.
        length: How many bytes that were.
        messages: How many messages that were; None where nobody knows.
        is_torn: Whether it is the end of a file that was not written to its end.
        is_extra: Whether it is a chunk that is not the file's own; what of its own is not there then is ``messages``.
    """

    what: str
    from_ns: int | None = None
    to_ns: int | None = None
    offset: int | None = None
    length: int = 0
    messages: int | None = None
    is_torn: bool = False
    is_extra: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentRecovery:
    """Outcome of the recovery of one segment.

    Attributes:
        name: Of the file.
        state: ``sound`` (not touched), ``completed`` (now ends as it should), ``unfinished`` (not touched: its
            messages are in no chunks), ``unreadable`` (not touched), ``foreign`` (not touched: it belongs to another
            recording), ``copy`` (not touched: of another segment) or ``missing``.
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
    losses: tuple[DataLoss, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """Outcome of the recovery of a recording."""

    folder: Path
    segments: tuple[SegmentRecovery, ...]

    @property
    def messages(self) -> int:
        """In all segments."""
        return sum(segment.messages for segment in self.segments)

    @property
    def is_lossy(self) -> bool:
        """Whether any message is lost, or nobody knows; damage that is known to have held none is no loss."""
        return any(loss.messages != 0 for segment in self.segments for loss in segment.losses)


def recover_folder(folder: Path) -> Recovery:
    """Make a recording's segments whole.

    Raises:
        InputError: There is no recording, a recorder still writes it, another tool made it, or it cannot be read or
            written; the segments that were not whole are then as they were.
    """
    try:
        paths = {stem: _numbered(folder, stem) for stem in SERIES}
        if not paths["data"] and not paths["images"]:
            if not folder.exists():
                raise InputError("no such file or folder", where=folder)
            got = "a file" if folder.is_file() else "no data_*.mcap"
            raise InputError("there is no recording", where=folder, got=got, expected="a folder with data_000.mcap")
        scans = {stem: [_scanned(path) for path in paths[stem]] for stem in SERIES}
        owners = Ownership.of(scans["data"], scans["images"])
        segments = [each for stem in SERIES for each in _recover_series(stem, scans, owners)]
    except OSError as error:
        where = error.filename or folder
        raise InputError("the recording cannot be recovered", where=where, got=error) from error
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
    with os_errors_as("the folder cannot be read", where=root):
        for folder in sorted(root.iterdir()) if root.is_dir() else []:
            segments = [path for stem in SERIES for path in folder.glob(f"{stem}_*.mcap")]
            if segments:
                found[folder] = all(map(_ends, segments))
    return found


def _ends(path: Path) -> bool:
    check_is_no_pipe(path)
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - len(MAGIC), 0))
        return size > len(MAGIC) and file.read() == MAGIC


def _numbered(folder: Path, stem: str) -> list[Path]:
    """The segments of a series by number; a copy of one with another name is none.

    Raises:
        OSError: One of them is no file.
    """
    found = [(_NUMBER.search(path.name), path) for path in folder.glob(f"{stem}_*.mcap")]
    for _, path in found:
        check_is_no_pipe(path)
    numbered = sorted((int(match[1]), path) for match, path in found if match is not None)
    return [path for _, path in numbered]


def _scanned(path: Path) -> SegmentScan:
    """Scan of a segment as readers see it; one without chunks where they cannot read it."""
    try:
        return scan_segment(path)
    except InputError:
        return SegmentScan(path=path, chunks=(), station=None, is_whole=False)


def _recover_series(
    stem: str, scans: Mapping[str, Sequence[SegmentScan]], owners: Ownership
) -> Iterator[SegmentRecovery]:
    """Make the segments of a series whole.

    Args:
        stem: Name of the series.
        scans: What the segments of each series hold.
        owners: Whose they are.
    """
    left_alone, segments = _left_alone(scans[stem], owners, is_image=stem == "images")
    yield from left_alone
    others_ns = max((each.end_ns or 0 for other in SERIES if other != stem for each in scans[other]), default=0)
    is_only = sum(map(len, scans.values())) == 1
    expected, last_ns = 0, None
    for run in owners.runs(owners.arrange(segments)):
        for place, scan in enumerate(run):
            number, previous = scan.number or 0, run[place - 1] if place else None
            known = [scan.channels, *(each.channels for each in run if each is not scan and each.chunks)]
            has_previous = previous is not None and previous.number == number - 1
            end = _end_of(run[place:], previous if has_previous else None, owners, others_ns)
            segment = _recover_segment(scan, previous if has_previous else None, replace(end, is_only=is_only), known)
            for missing in range(expected, number):
                yield _missing(stem, missing, owners, DataLoss(what=_MISSING, from_ns=last_ns, to_ns=segment.start_ns))
            yield segment
            expected, last_ns = number + 1, segment.end_ns or last_ns
    for missing in range(expected, owners.min_images if stem == "images" else 0):
        yield _missing(stem, missing, owners, DataLoss(what=_MISSING, from_ns=last_ns))


def _missing(stem: str, number: int, owners: Ownership, loss: DataLoss) -> SegmentRecovery:
    """Outcome of a segment that is not there; of a copied one with how many messages it held."""
    copy = owners.copy_at(number) if stem == "images" else None
    loss = loss if copy is None else replace(loss, messages=copy.messages)
    return SegmentRecovery(name=f"{stem}_{number:03d}.mcap", state="missing", losses=(loss,))


def _left_alone(
    segments: Sequence[SegmentScan], owners: Ownership, *, is_image: bool
) -> tuple[list[SegmentRecovery], list[SegmentScan]]:
    """Outcomes of the segments that belong to other recordings or are copies of others; and the other segments."""
    alone, kept = [], unique_segments(segments)
    paths = {each.path for each in kept}
    for each in segments:
        if owners.is_foreign(each, is_image=is_image):
            what = f"it belongs to recording {owners.owners[each.path]}, not to {owners.own}"
            loss = DataLoss(what=what, messages=0)
            alone.append(SegmentRecovery(name=each.path.name, state="foreign", losses=(loss,)))
        elif each.path not in paths:
            alone.append(SegmentRecovery(name=each.path.name, state="copy"))
    names = {each.name for each in alone}
    return alone, [each for each in kept if each.path.name not in names]


@dataclass(frozen=True, slots=True)
class _End:
    """Evidence of how much a segment held at its end.

    Attributes:
        start_ns: Earliest log time of the next segment of its series that holds anything; None where none does.
        first: How many chunks and messages the series holds before the segment; None where nothing says it.
        after: How many it holds before the segment with the next number; None where nothing says it.
        others_ns: Latest log time of the other series; 0 where it has none.
        is_last: Whether no segment of its series follows.
        is_only: Whether the recording has no other segment.
    """

    start_ns: int | None
    first: tuple[int, int] | None
    after: tuple[int, int] | None
    others_ns: int
    is_last: bool
    is_only: bool = False


def _end_of(run: Sequence[SegmentScan], previous: SegmentScan | None, owners: Ownership, others_ns: int) -> _End:
    """Evidence of how much the first segment of a run held.

    Args:
        run: It and the segments that the same recorder wrote after it.
        previous: The segment with the number before, of the same recorder; None where there is none.
        owners: Whose the segments are.
        others_ns: Latest log time of the other series; 0 where it has none.
    """
    scan, later = run[0], run[1:]
    copy = owners.copy_at(scan.number) if owners.owner_of(scan) != owners.own else None
    earlier = owners.copy_at(None if scan.number is None else scan.number - 1)
    is_first = scan.number == 0 or (copy is not None and (earlier is None or earlier.recording != copy.recording))
    first = (0, 0) if is_first else None if previous is None else previous.after
    after = later[0].before if later and scan.number is not None and later[0].number == scan.number + 1 else None
    if after is None and first is not None and copy is not None and copy.messages is not None:
        after = first[0] + copy.chunks, first[1] + copy.messages
    following = owners.copy_at(None if scan.number is None else scan.number + 1)
    return _End(
        start_ns=next((each.start_ns for each in later if each.chunks), None),
        first=first,
        after=after,
        others_ns=others_ns,
        is_last=not later and (copy is None or following is None or following.recording != copy.recording),
    )


def _recover_segment(
    scan: SegmentScan, previous: SegmentScan | None, end: _End, known: Sequence[Channels]
) -> SegmentRecovery:
    """Make a segment whole.

    Args:
        scan: What readers see of it.
        previous: The segment with the number before, of the same recorder; None where there is none.
        end: What shows how much it held.
        known: Channels by what readers see of it, and by other segments, which have the same ids.
    """
    path = scan.path
    with _locked(path) as descriptor:
        found = _examine(descriptor, known)
        _tell_end(found, end)
        _tell_start(found, previous, end.first)
        if found.is_sound:
            return _outcome(path, "sound", found)
        if not found.is_own and (found.chunks or found.library):
            made_by = f"one made by {found.library or 'another tool'}"
            expected = "a recording of aerodft"
            raise InputError("the file cannot be recovered", where=path, got=made_by, expected=expected)
        if not found.chunks and (bare := _without_chunks(path)) is not None:
            return bare
        lost_bytes = sum(loss.length for loss in found.losses)
        if not found.chunks and not (_is_beginning(descriptor, is_only=end.is_only) and lost_bytes <= _BEGINNING_BYTES):
            loss = DataLoss(what="nothing in it can be read", offset=0, length=os.fstat(descriptor).st_size)
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
    torn = DataLoss(
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


def _is_beginning(descriptor: int, *, is_only: bool) -> bool:
    """Whether this begins an MCAP file that was just made as the machine died: zeros do, beside other segments."""
    head = os.pread(descriptor, len(MAGIC), 0)
    return MAGIC.startswith(head) or (not is_only and not any(head))


def _replace(path: Path, descriptor: int, found: "_SegmentReport") -> None:
    partial = path.with_name(f".{path.name}.recovering")
    partial.unlink(missing_ok=True)  # of a recovery that was killed: the lock says that nobody writes it
    try:
        _write_whole(descriptor, found, partial)
        with _opened(partial) as copy:
            again = _examine(copy)
        if not again.is_sound or again.messages != found.messages:
            raise InputError("what was written does not read back", where=partial, hint="the segment is as it was")
        _keep_dropped(path, descriptor, found)
        partial.replace(path)
        sync_folder(path.parent)
    finally:
        partial.unlink(missing_ok=True)


def _keep_dropped(path: Path, descriptor: int, found: "_SegmentReport") -> None:
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


def _outcome(path: Path, state: str, found: "_SegmentReport") -> SegmentRecovery:
    return SegmentRecovery(
        name=path.name,
        state=state,
        messages=found.messages,
        start_ns=found.start_ns,
        end_ns=found.end_ns,
        losses=tuple(found.losses),
    )


def _tell_start(found: "_SegmentReport", previous: SegmentScan | None, first: tuple[int, int] | None) -> None:
    """Say what is missing at the start of a segment, before which the series held ``first`` chunks and messages."""
    if found.before is None or found.is_recovered or first is None:
        return
    early = [loss for loss in found.losses if loss.from_ns is None]
    later = found.losses[len(early) :]
    missing = found.before[1] - first[1] - sum(loss.messages or 0 for loss in early)
    if missing > 0 and not early and found.before[0] <= first[0]:
        return  # every chunk holds messages: a count is damaged
    if missing > 0 and not early:
        found.is_sound = False
        early = [DataLoss(what=_GONE, to_ns=found.start_ns)]
    if missing <= 0 or len(early) == 1:
        early = [replace(loss, messages=(loss.messages or 0) + max(missing, 0)) for loss in early]
    from_ns = None if previous is None else previous.end_ns
    found.losses = [*(replace(loss, from_ns=from_ns) for loss in early), *later]


def _tell_end(found: "_SegmentReport", end: _End) -> None:
    """Say what is missing at the end of a segment by what was recorded after it."""
    inside, torn = (
        [loss for loss in found.losses if loss.to_ns is not None],
        [loss for loss in found.losses if loss.to_ns is None],
    )
    if found.after is not None and end.is_last:
        found.is_sound, found.after = False, None
        found.losses.append(DataLoss(what=_NO_NEXT, from_ns=found.end_ns))
        return
    before, after = found.before or end.first, found.after or end.after
    if before is not None and after is not None and not found.is_recovered:
        missing = after[1] - before[1] - found.all_messages - sum(loss.messages or 0 for loss in inside)
        is_denied = not found.losses and after[0] <= before[0] + found.chunks  # every chunk holds messages
        if missing <= 0 or is_denied:  # what is torn was written again into the next one; or a count is damaged
            found.losses = [
                loss if loss.from_ns is None else replace(loss, messages=loss.messages or 0) for loss in inside
            ]
        elif all(loss.messages is not None for loss in inside):
            place = torn[0] if torn else DataLoss(what=_CUT, from_ns=found.end_ns)
            found.losses = [*inside, replace(_more_followed(place), to_ns=end.start_ns, messages=missing)]
        return
    followed = found.end_ns is not None and end.others_ns > found.end_ns + _MOST_UNSYNCED_NS
    if torn and (end.start_ns is not None or followed) and not found.has_end:
        found.losses = [*inside, *(replace(_more_followed(loss), to_ns=end.start_ns) for loss in torn)]


def _more_followed(loss: DataLoss) -> DataLoss:
    """A loss at a segment's end, behind which more was recorded: what seemed unfinished was cut; damage stays so."""
    return replace(loss, what=_CUT) if loss.is_torn else loss


@dataclass(slots=True)
class _SegmentReport:
    """Contents and losses of one segment.

    Attributes:
        messages: In chunks that are whole, on channels that are defined.
        chunks: How many these are.
        start_ns: Earliest log time; None where there is no message.
        end_ns: Latest.
        losses: In the order of the file.
        is_sound: Whether nothing needs to be done.
        is_own: Whether aerodft made it.
        library: Who did, in its own words; empty where that is not known.
        metadata: Names and values.
        channels: All that are defined.
        lacks_definitions: Whether channels are used before they are defined.
        undefined: Ids of channels that are defined nowhere.
        before: How many chunks and messages the series holds before it, by its own count; None where it has none.
        after: How many chunks and messages the series holds before the next segment, by its own count; None where it
            says of no next one.
        all_messages: In chunks that are whole, on whatever channels.
        has_end: Whether the data is known to end where the file says so.
    """

    messages: int = 0
    chunks: int = 0
    start_ns: int | None = None
    end_ns: int | None = None
    losses: list[DataLoss] = field(default_factory=list)
    is_sound: bool = True
    is_own: bool = False
    library: str = ""
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    channels: Channels = field(default_factory=Channels)
    lacks_definitions: bool = False
    undefined: set[int] = field(default_factory=set)
    before: tuple[int, int] | None = None
    after: tuple[int, int] | None = None
    all_messages: int = 0
    has_end: bool = False

    @property
    def is_recovered(self) -> bool:
        """Whether the segment has been recovered before, and lists what it lost then."""
        return any(name == RECOVERED_NAME for name, _ in self.metadata)


def _examine(descriptor: int, known: Sequence[Channels] = ()) -> _SegmentReport:
    """Read a segment from its beginning to its end; channels that it does not define are taken from ``known``.

    Raises:
        OSError: It cannot be read.
    """
    scanner, found = ChunkScanner(descriptor), _SegmentReport()
    used: Counter[int] = Counter()
    defined: set[int] = set()
    rebuilt = Summary("", "", (), {}, {})
    for item in scanner.items():
        if isinstance(item, WholeChunk):
            found.metadata = [(each.name, each.metadata) for each in scanner.metadata]
            _count_lost(found, item)
            _add(found, item, used, defined)
            rebuilt.add(item.offset, item.chunk)
            continue
        found.is_sound = False
        is_beginning = item.offset == 0 and not item.is_torn
        if not (is_beginning or (item.is_torn and scanner.has_end)):
            loss = DataLoss(what=_message(item), from_ns=found.end_ns, offset=item.offset, length=item.length)
            found.losses.append(replace(loss, is_torn=item.is_torn, is_extra=item.is_extra))
    if not scanner.has_end and not any(loss.to_ns is None for loss in found.losses):
        found.losses.append(DataLoss(what=_UNFINISHED, from_ns=found.end_ns, is_torn=True))
    found.channels, found.has_end = scanner.channels, scanner.has_end
    found.after = scanner.count if scanner.has_end else None
    found.is_sound &= rebuilt.indexes == scanner.indexes and scanner.stated_messages == found.messages
    if scanner.stated_messages is not None:
        found.losses = _stated_losses(found.losses, scanner.stated_messages - found.messages)
    for channels in known:
        for identity in used.keys() & channels.records.keys() - found.channels.by_id.keys():
            record = channels.records[identity]
            if record.schema_id in channels.schemas:
                found.channels.add(channels.schemas[record.schema_id])
            found.channels.add(record)
            found.lacks_definitions = True
    _leave_undefined(found, used)
    found.is_sound &= scanner.is_whole and not found.lacks_definitions
    _tell_maker(found, scanner)
    return found


def _message(bad: DamagedBytes) -> str:
    if bad.is_torn:
        return f"{_UNFINISHED}; a torn end was cut off"
    kind = "an extra chunk" if bad.is_extra else "a damaged chunk" if bad.is_chunk else "damaged bytes"
    return f"{kind} ({bad.why})"


def _count_lost(found: _SegmentReport, item: WholeChunk) -> None:
    """See by the count before a chunk what is missing before it."""
    if item.before is None or found.is_recovered:
        return
    if found.before is None:  # what is lost before it, the segment before tells
        found.before = item.before[0] - found.chunks, item.before[1] - found.all_messages
        return
    known = sum(loss.messages or 0 for loss in found.losses)
    missing = item.before[1] - found.before[1] - found.all_messages - known
    if not found.losses or found.losses[-1].messages is not None or found.losses[-1].from_ns is None:
        if missing <= 0 or item.before[0] <= found.before[0] + found.chunks:  # every chunk holds messages
            return
        found.is_sound = False
        found.losses.append(DataLoss(what=_GONE, from_ns=found.end_ns))
    found.losses[-1] = replace(found.losses[-1], messages=max(missing, 0))


def _add(found: _SegmentReport, item: WholeChunk, used: Counter[int], defined: set[int]) -> None:
    chunk = item.chunk
    defined |= item.defines
    found.lacks_definitions |= not chunk.counts.keys() <= defined
    found.is_sound &= item.is_as_built
    found.messages += chunk.messages
    found.all_messages += chunk.messages
    found.chunks += 1
    used.update(chunk.counts)
    if chunk.counts:
        found.losses = [_before(loss, chunk.start_ns) for loss in found.losses]
        found.start_ns = chunk.start_ns if found.start_ns is None else min(found.start_ns, chunk.start_ns)
        found.end_ns = chunk.end_ns if found.end_ns is None else max(found.end_ns, chunk.end_ns)


def _before(loss: DataLoss, start_ns: int) -> DataLoss:
    """A loss whose end is known, now that something comes behind it."""
    return loss if loss.to_ns is not None else replace(loss, to_ns=start_ns)


def _stated_losses(losses: list[DataLoss], missing: int) -> list[DataLoss]:
    """The losses of a file that says how many messages it had."""
    if missing < 0:  # something was put in, and what may be missing besides nobody can tell
        return losses
    if missing == 0:  # what is damaged held none: indexes, or what the file says of itself
        return [replace(loss, messages=0) for loss in losses if loss.from_ns is None or loss.is_extra]
    return [replace(loss, messages=missing) for loss in losses] if len(losses) == 1 else losses


def _leave_undefined(found: _SegmentReport, used: Counter[int]) -> None:
    """Count messages of channels that nothing defines as lost: no reader can tell what they are."""
    found.undefined = used.keys() - found.channels.by_id.keys()
    if found.undefined:
        messages = sum(used[identity] for identity in found.undefined)
        found.messages -= messages
        what = f"messages of {len(found.undefined)} channels whose definitions are lost"
        found.losses.append(DataLoss(what=what, from_ns=found.start_ns, to_ns=found.end_ns, messages=messages))


def _tell_maker(found: _SegmentReport, scanner: ChunkScanner) -> None:
    found.metadata = [(each.name, each.metadata) for each in scanner.metadata]
    if scanner.header is not None:
        found.is_own, found.library = scanner.header.profile == PROFILE, scanner.header.library
    if not found.is_own:  # the header may be what is damaged
        topics = [channel.topic for channel in found.channels.by_id.values()]
        by_topics = scanner.header is None and bool(topics) and all(each.startswith(_OWN_TOPICS) for each in topics)
        found.is_own = by_topics or any(name == METADATA_NAME for name, _ in found.metadata)


def _write_whole(descriptor: int, found: _SegmentReport, path: Path) -> None:
    """Write what a segment still holds into a new file that ends as it should, and wait until the disk has it.

    Args:
        descriptor: The segment.
        found: What ``_examine`` said of it.
        path: The new file; deleted again where it cannot be written.

    Raises:
        OSError: The segment cannot be read, or the new file cannot be written.
    """
    file = SegmentFile(path)
    try:
        file.allow(os.fstat(descriptor).st_mode)
        _write(file, descriptor, found)
        file.sync(size=True)
    except OSError:
        path.unlink(missing_ok=True)
        raise
    finally:
        file.close()


def _write(file: SegmentFile, descriptor: int, found: _SegmentReport) -> None:
    metadata = list(found.metadata)
    if found.losses:
        said = {f"loss {number}": loss.what for number, loss in enumerate(found.losses)}
        metadata.append((RECOVERED_NAME, {"software": SOFTWARE, **said}))
    summary = Summary(PROFILE, found.library or SOFTWARE, metadata, found.channels.schemas, found.channels.records)
    file.write(summary.header)
    front = (
        encode_records(*found.channels.schemas.values(), *found.channels.records.values())
        if found.lacks_definitions
        else b""
    )
    scanner = ChunkScanner(descriptor)
    for item in scanner.items():
        if isinstance(item, DamagedBytes):
            continue
        chunk = item.chunk
        if front or not found.undefined.isdisjoint(chunk.counts):
            chunk, front = _rewritten(item, front, found.undefined), b""
        if item.before is not None:
            file.write(count_record(*item.before))
        offset = file.size
        for part in (chunk.head, chunk.content, chunk.indexes):
            file.write(part)
        summary.add(offset, chunk)
    if found.after is not None:
        file.write(count_record(*found.after))
    for start, head in scanner.attachments:
        offset, length = file.size, RECORD_HEAD.size + head.data_at + head.data_bytes + CRC_BYTES
        for piece in pieces(descriptor, start, length):
            file.write(piece)
        summary.attach(offset, length, head.about, head.data_bytes)
    file.write(summary.footer(file.size))


def _rewritten(item: WholeChunk, front: bytes, undefined: set[int]) -> EncodedChunk:
    """A chunk with definitions in front, and without the messages of undefined channels."""
    buffer, content = ChunkBuffer(front), item.content
    for opcode, begin, end in records_in(content):
        if opcode != Opcode.MESSAGE:
            buffer.define(content[begin - RECORD_HEAD.size : end])
            continue
        channel_id, sequence, log_ns, _ = MESSAGE_HEAD.unpack_from(content, begin)
        if channel_id not in undefined:
            buffer.add(channel_id, log_ns, content[begin + MESSAGE_HEAD.size : end], sequence)
    return buffer.build(compressor() if item.chunk.compression else None)
