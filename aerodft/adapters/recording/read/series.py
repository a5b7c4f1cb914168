"""The segments of a recording: whose they are, and in which order they were recorded.

A recomputed recording holds copies of another one's image segments, which keep that one's id. Its own segments list the
copies (``aerodft.adapters.recording.write.CopiedSegment``); recordings made before that list say only that they were
recomputed, and then every image segment is taken for a copy.
"""

import logging
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from aerodft.adapters.recording.read.messages import recording_of
from aerodft.adapters.recording.read.segment_scan import SegmentScan
from aerodft.adapters.recording.write import CopiedSegment

PROVENANCE_NAME: Final = "computed_from.toml"
"""File of a recording that says which one it was computed from."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ownership:
    """Which recording each segment of a folder belongs to.

    Attributes:
        own: Id of the recording, which most data segments have; None where none has any.
        owners: Ids by file, of the segments that hold chunks; None where a segment does not say it.
        copied: The image segments that a recompute copied, in order; they are numbered from 1.
        is_recomputed: Whether the recording was computed from another one.
    """

    own: str | None
    owners: Mapping[Path, str | None]
    copied: tuple[CopiedSegment, ...] = ()
    is_recomputed: bool = False

    @classmethod
    def of(cls, data: Sequence[SegmentScan], images: Sequence[SegmentScan]) -> "Ownership":
        """Read the owners of a folder's segments.

        Raises:
            InputError: A segment cannot be read.
        """
        owners = {each.path: recording_of(each) for each in (*data, *images) if each.chunks}
        ids = Counter(owner for each in data if (owner := owners.get(each.path)) is not None)
        own = ids.most_common(1)[0][0] if ids else None
        mine = [each for each in (*data, *images) if own is not None and each.recording == own]
        folders = {each.path.parent for each in data}
        return cls(
            own=own,
            owners=owners,
            copied=next((each.copied for each in mine if each.copied), ()),
            is_recomputed=any(PROVENANCE_NAME in each.texts for each in mine)
            or any((folder / PROVENANCE_NAME).is_file() for folder in folders),
        )

    @property
    def min_images(self) -> int:
        """How many image segments there are at least: the copies and one of its own; 0 where nothing says it."""
        return len(self.copied) + 1 if self.copied else 0

    def is_foreign(self, segment: SegmentScan, *, is_image: bool) -> bool:
        """Whether a segment belongs to another recording, and is no copy that a recompute made."""
        owner = self.owners.get(segment.path)
        if self.own is None or owner in {None, self.own}:
            return False
        if is_image and self.is_recomputed and not self.copied:
            return False
        return not is_image or owner not in {each.recording for each in self.copied}

    def owner_of(self, segment: SegmentScan) -> str | None:
        """Id of an image segment's recording: as the segment says it, else as its number among the copies says it."""
        copy = self.copy_at(segment.number)
        return self.owners.get(segment.path) or segment.recording or (self.own if copy is None else copy.recording)

    def copy_at(self, number: int | None) -> CopiedSegment | None:
        """The copied image segment with a number; None where there is none."""
        return self.copied[number - 1] if number is not None and 0 < number <= len(self.copied) else None

    def arrange(self, segments: Sequence[SegmentScan]) -> tuple[SegmentScan, ...]:
        """Put the segments of one series into the order of recording.

        Each segment counts the messages before it. Where names and counts contradict, as after a swap of two names, the
        counts decide, and a warning names the segment.
        """
        ranks = {self.own: 0}
        for place, copy in enumerate(self.copied, start=1):
            ranks.setdefault(copy.recording, place)
        for each in sorted(segments, key=_by_number):  # copies in a recording without a list of them
            if (owner := self.owners.get(each.path)) is not None:
                ranks.setdefault(owner, len(self.copied) + 1 + _by_number(each))
        known = [each for each in segments if each.number is not None and self.owners.get(each.path) in ranks]
        known = [each for each in known if each.before is not None]
        numbers = sorted(map(_by_number, known))
        known.sort(key=lambda each: (ranks[self.owners[each.path]], each.before, each.number))
        placed = dict(zip((each.path for each in known), numbers, strict=True))
        moved = {each.path: each for each in segments}
        for each in known:
            if placed[each.path] != each.number:
                name = f"{each.path.stem.rpartition('_')[0]}_{placed[each.path]:03d}.mcap"
                _log.warning("%s: its counts say that it is %s; it is read in that place", each.path, name)
                moved[each.path] = replace(each, renumbered=placed[each.path])
        return tuple(sorted(moved.values(), key=_by_number))

    def runs(self, segments: Sequence[SegmentScan]) -> Iterator[list[SegmentScan]]:
        """Split a series, in order, where the recording changes: what one recorder wrote stays together."""
        run: list[SegmentScan] = []
        for each in segments:
            if run and len({self.owner_of(run[-1]), self.owner_of(each)} - {None}) > 1:
                yield run
                run = []
            run.append(each)
        if run:
            yield run


def unique_segments(segments: Sequence[SegmentScan]) -> tuple[SegmentScan, ...]:
    """Leave out copies: segments that hold the chunks of another one, or its first chunks; and warn of each.

    The longest of several stays, the first of equally long ones, with the lowest of their numbers. A file whose name
    has no number is a copy only if it holds all chunks.
    """
    kept: dict[object, SegmentScan] = {}
    for segment in sorted(segments, key=lambda each: -len(each.chunks)):
        first = _chunk_sizes(segment)[:1]
        key = (segment.recording, segment.before, first) if first else segment.path
        known = kept.setdefault(key, segment)
        if known is segment:
            continue
        sizes, whole = _chunk_sizes(segment), _chunk_sizes(known)
        is_part = segment.number is not None and whole[: len(sizes)] == sizes  # nobody knows what a named one is
        if sizes != whole and not is_part:
            kept[segment.path] = segment
            continue
        name, folder = segment.path.name, segment.path.parent
        _log.warning("%s: %s is %s once more; it is left out", folder, name, known.path.name)
        numbers = [each.number for each in (known, segment) if each.number is not None]
        kept[key] = replace(known, renumbered=min(numbers)) if numbers else known
    paths = {each.path: each for each in kept.values()}
    return tuple(paths[each.path] for each in segments if each.path in paths)


def _chunk_sizes(segment: SegmentScan) -> tuple[tuple[int, int, int], ...]:
    return tuple((chunk.length, chunk.start_ns, chunk.end_ns) for chunk in segment.chunks)


def _by_number(segment: SegmentScan) -> int:
    return -1 if segment.number is None else segment.number
