"""One segment that was not finished, or is damaged: what is wrong with it, and the same segment made whole."""

import os
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

from mcap.opcode import Opcode

from aerodft.adapters.codec.wire import SOFTWARE
from aerodft.adapters.mcap.attachments import CRC_BYTES
from aerodft.adapters.mcap.chunks import records_in
from aerodft.adapters.mcap.definitions import Definitions
from aerodft.adapters.mcap.ending import Summary
from aerodft.adapters.mcap.file import SegmentFile, pieces
from aerodft.adapters.mcap.layout import (
    MESSAGE_HEAD,
    RECORD_HEAD,
    BuiltChunk,
    ChunkBuffer,
    compressor,
    encoded,
)
from aerodft.adapters.mcap.salvage import BadBytes, GoodChunk, Salvage
from aerodft.adapters.mcap.segment import METADATA_NAME, PROFILE

RECOVERED_NAME = "recovered"
_UNFINISHED = "it was not finished: what came last is missing, half a second at most"
_OWN_TOPICS = ("aerodft/", "mavlink", "dataflash")


@dataclass(frozen=True, slots=True, kw_only=True)
class Loss:
    """Something that is not in a recording.

    Attributes:
        what: In words.
        from_ns: After this log time; None where nothing came before it.
        to_ns: Before this log time; None where nothing came after it.
        offset: Where it was in the file; None where it was in none.
        length: How many bytes that were.
        messages: How many messages that were; None where nobody knows.
        is_torn: Whether it is the end of a file that was not written to its end.
    """

    what: str
    from_ns: int | None = None
    to_ns: int | None = None
    offset: int | None = None
    length: int = 0
    messages: int | None = None
    is_torn: bool = False


@dataclass(slots=True)
class Survey:
    """What one segment holds, and what it lacks.

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
        definitions: Of all channels.
        lacks_definitions: Whether channels are used before they are defined.
        undefined: Ids of channels that are defined nowhere.
    """

    messages: int = 0
    chunks: int = 0
    start_ns: int | None = None
    end_ns: int | None = None
    losses: list[Loss] = field(default_factory=list)
    is_sound: bool = True
    is_own: bool = False
    library: str = ""
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    definitions: Definitions = field(default_factory=Definitions)
    lacks_definitions: bool = False
    undefined: set[int] = field(default_factory=set)


def survey(descriptor: int) -> Survey:
    """Read a segment from its beginning to its end.

    Raises:
        OSError: It cannot be read.
    """
    salvage, found = Salvage(descriptor), Survey()
    used: Counter[int] = Counter()
    defined: set[int] = set()
    for item in salvage.items():
        if isinstance(item, GoodChunk):
            _add(found, item, used, defined)
            continue
        found.is_sound = False
        is_beginning = item.offset == 0 and not item.is_torn
        if not (is_beginning or (item.is_torn and salvage.has_end)):
            place = {"offset": item.offset, "length": item.length}
            found.losses.append(Loss(what=_words(item), from_ns=found.end_ns, **place, is_torn=item.is_torn))
    if not salvage.has_end and not any(loss.to_ns is None for loss in found.losses):
        found.losses.append(Loss(what=_UNFINISHED, from_ns=found.end_ns))
    found.definitions = salvage.definitions
    if salvage.stated_messages is not None:
        found.losses = _counted(found.losses, salvage.stated_messages - found.messages)
    _leave_undefined(found, used)
    found.is_sound &= salvage.is_whole and not found.lacks_definitions
    _tell_maker(found, salvage)
    return found


def _words(bad: BadBytes) -> str:
    if bad.is_torn:
        return f"{_UNFINISHED}; a torn end was cut off"
    return f"a damaged chunk ({bad.why})" if bad.is_chunk else f"damaged bytes ({bad.why})"


def _add(found: Survey, item: GoodChunk, used: Counter[int], defined: set[int]) -> None:
    built = item.built
    defined |= item.defines
    found.lacks_definitions |= not built.counts.keys() <= defined
    found.is_sound &= item.is_as_built
    found.messages += built.messages
    found.chunks += 1
    used.update(built.counts)
    if built.counts:
        found.losses = [_before(loss, built.start_ns) for loss in found.losses]
        found.start_ns = built.start_ns if found.start_ns is None else min(found.start_ns, built.start_ns)
        found.end_ns = built.end_ns if found.end_ns is None else max(found.end_ns, built.end_ns)


def _before(loss: Loss, start_ns: int) -> Loss:
    """A loss whose end is known, now that something comes behind it."""
    return loss if loss.to_ns is not None else replace(loss, to_ns=start_ns)


def _counted(losses: list[Loss], missing: int) -> list[Loss]:
    """The losses of a file that says how many messages it had."""
    if missing <= 0:  # what is damaged held none: indexes, or what the file says of itself
        return [replace(loss, messages=0) for loss in losses if loss.from_ns is None]
    return [replace(loss, messages=missing) for loss in losses] if len(losses) == 1 else losses


def _leave_undefined(found: Survey, used: Counter[int]) -> None:
    """Count messages of channels that nothing defines as lost: no reader can tell what they are."""
    found.undefined = used.keys() - found.definitions.channels.keys()
    if found.undefined:
        messages = sum(used[identity] for identity in found.undefined)
        found.messages -= messages
        what = f"messages of {len(found.undefined)} channels whose definitions are lost"
        found.losses.append(Loss(what=what, from_ns=found.start_ns, to_ns=found.end_ns, messages=messages))


def _tell_maker(found: Survey, salvage: Salvage) -> None:
    found.metadata = [(each.name, each.metadata) for each in salvage.metadata]
    if salvage.header is not None:
        found.is_own, found.library = salvage.header.profile == PROFILE, salvage.header.library
    if not found.is_own:  # the header may be what is damaged
        topics = [channel.topic for channel in found.definitions.channels.values()]
        by_topics = salvage.header is None and bool(topics) and all(each.startswith(_OWN_TOPICS) for each in topics)
        found.is_own = by_topics or any(name == METADATA_NAME for name, _ in found.metadata)


def write_whole(descriptor: int, found: Survey, path: Path) -> None:
    """Write what a segment still holds into a new file that ends as it should, and wait until the disk has it.

    Args:
        descriptor: The segment.
        found: What ``survey`` said of it.
        path: The new file; deleted again where it cannot be written.

    Raises:
        OSError: The segment cannot be read, or the new file cannot be written.
    """
    file = SegmentFile(path)
    try:
        file.allow(os.fstat(descriptor).st_mode)
        _write(file, descriptor, found)
        file.sync_all()
    except OSError:
        path.unlink(missing_ok=True)
        raise
    finally:
        file.close()


def _write(file: SegmentFile, descriptor: int, found: Survey) -> None:
    definitions = found.definitions
    metadata = list(found.metadata)
    if found.losses:
        said = {f"loss {number}": loss.what for number, loss in enumerate(found.losses)}
        metadata.append((RECOVERED_NAME, {"software": SOFTWARE, **said}))
    summary = Summary(PROFILE, found.library or SOFTWARE, metadata, definitions.schemas, definitions.channels)
    file.write(summary.beginning)
    front = encoded(*definitions.schemas.values(), *definitions.channels.values()) if found.lacks_definitions else b""
    salvage = Salvage(descriptor)
    for item in salvage.items():
        if isinstance(item, BadBytes):
            continue
        chunk = item.built
        if front or not found.undefined.isdisjoint(chunk.counts):
            chunk, front = _built_again(item, front, found.undefined), b""
        offset = file.size
        for part in (chunk.head, chunk.content, chunk.indexes):
            file.write(part)
        summary.add(offset, chunk)
    for start, head in salvage.attachments:
        offset, length = file.size, RECORD_HEAD.size + head.data_at + head.data_bytes + CRC_BYTES
        for piece in pieces(descriptor, start, length):
            file.write(piece)
        summary.attach(offset, length, head.about, head.data_bytes)
    file.write(summary.ending(file.size))


def _built_again(item: GoodChunk, front: bytes, undefined: set[int]) -> BuiltChunk:
    """A chunk with definitions in front, and without the messages of undefined channels."""
    buffer, content = ChunkBuffer(front), item.content
    for opcode, begin, end in records_in(content):
        if opcode != Opcode.MESSAGE:
            buffer.define(content[begin - RECORD_HEAD.size : end])
            continue
        channel_id, sequence, log_ns, _ = MESSAGE_HEAD.unpack_from(content, begin)
        if channel_id not in undefined:
            buffer.add(channel_id, log_ns, content[begin + MESSAGE_HEAD.size : end], sequence)
    return buffer.built(compressor() if item.built.compression else None)
