"""Photos stamped by the triggers that a log holds, instead of by their own clock."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model import BoolArray, Event, Image, TriggerSource
from aerodft.service import Source

_CLOCK_STD_S: Final = 6 * 3600.0  # of cameras whose clock tells local time, or was set by hand
_COARSE_SHARE: Final = 0.9  # of stamps on whole seconds: the others are those that follow in one second
_BURST_NS: Final = 50_000_000  # within a whole second, by which photos of one are told apart
_FINE_S: Final = 0.01
_MOST_NAMED: Final = 5
_NUMBERS: Final = re.compile(r"(\d+)")


@dataclass(frozen=True, slots=True)
class TriggeredPhotos:
    """Stamps of photos by triggers.

    Attributes:
        stamps_ns: UTC by the photos' index; those without a certain trigger are not in it. None where photos keep their
            own stamps.
        remarks: What was matched and what was not, a sentence each.
    """

    stamps_ns: Mapping[int, int] | None = None
    remarks: tuple[str, ...] = field(default_factory=tuple)


class RestampedPhotos:
    """A source whose images have stamps by their index, and which leaves out the others.

    Args:
        source: Images.
        stamps_ns: UTC by index.
    """

    def __init__(self, source: Source, stamps_ns: Mapping[int, int]) -> None:
        self._source, self._stamps_ns = source, stamps_ns

    def events(self) -> Iterator[Event]:
        """The images that have a stamp."""
        for event in self._source.events():
            if not isinstance(event, Image):
                yield event
            elif (stamp_ns := self._stamps_ns.get(event.index)) is not None:
                yield replace(event, stamp_ns=stamp_ns, arrival_ns=stamp_ns)


def triggered_photos(
    photos: Sequence[tuple[int, Path]], triggers: Mapping[TriggerSource, Sequence[int]]
) -> TriggeredPhotos:
    """Match photos to the triggers of a log's best message.

    Args:
        photos: Stamp (ns, by the camera's clock) and file of each, ascending.
        triggers: UTC (ns) by message.

    Raises:
        InputError: The camera's clock was set in mid-flight, and the parts do not tell their triggers.
    """
    from calibration.sync import match_photos

    source = next((each for each in TriggerSource if triggers.get(each)), None)
    if source is None or not photos:
        return TriggeredPhotos()
    trigger_ns = np.array(sorted(triggers[source]), dtype=np.int64)
    photo_ns = np.array([stamp_ns for stamp_ns, _ in photos], dtype=np.int64)
    is_coarse = np.mean(photo_ns % SECOND_NS < _BURST_NS) >= _COARSE_SHARE
    if is_coarse:
        photo_ns = photo_ns // SECOND_NS * SECOND_NS
    epoch_ns = trigger_ns[0]
    matches = match_photos(
        (photo_ns - epoch_ns) / SECOND_NS,
        (trigger_ns - epoch_ns) / SECOND_NS,
        resolution_s=1.0 if is_coarse else _FINE_S,
        is_ordered=_has_known_place(photo_ns, [path.name for _, path in photos]),
        clock_std_s=_CLOCK_STD_S,
    )
    if matches.why and matches.steps:
        raise InputError(
            f"the camera's clock was set in mid-flight, about {photos[matches.steps[0]][1].name}",
            where=photos[0][1].parent,
            got=matches.why,
            hint="give the photos before and behind that in folders of their own",
        )
    if matches.why:
        said = f"photos are not matched to the log's {len(trigger_ns)} {source} messages: {matches.why}; their own"
        return TriggeredPhotos(None, (f"{said} stamps are taken",))
    certain = np.flatnonzero(matches.trigger >= 0)
    refused = [photos[k][1].name for k in np.flatnonzero(matches.trigger < 0).tolist()]
    clock = f"UTC is the camera's clock {matches.offset_s:+.2f} s (std {matches.offset_std_s:.2f} s)"
    remarks = [f"{len(certain)} of {len(photos)} photos are stamped by {source}: {clock}"]
    remarks += [
        f"the camera's clock was set in mid-flight, about {photos[k][1].name}: each part is matched on its own; the "
        "clock above is that of most photos"
        for k in matches.steps
    ]
    if refused:
        more = ", ..." if len(refused) > _MOST_NAMED else ""
        remarks.append(
            f"{len(refused)} photos without a certain trigger left out: {', '.join(refused[:_MOST_NAMED])}{more}"
        )
    for count, what in ((int(matches.lost.sum()), "without a photo"), (int(matches.doubled.sum()), "doubled")):
        if count:
            remarks.append(f"{count} {source} messages {what}")
    stamps_ns = {int(k): int(trigger_ns[matches.trigger[k]]) for k in certain.tolist()}
    return TriggeredPhotos(stamps_ns, tuple(remarks))


def _has_known_place(photo_ns: np.ndarray, names: Sequence[str]) -> BoolArray:
    """Whether each photo's place among those of one stamp is known ``(p,)``: by numbers that ascend with the stamps."""
    tied = np.zeros(len(names), dtype=np.bool_)
    same = np.diff(photo_ns) == 0
    tied[1:] |= same
    tied[:-1] |= same
    keys = [_natural(name) for name in names]
    ascends = all(keys[k] < keys[k + 1] for k in range(len(keys) - 1) if photo_ns[k] < photo_ns[k + 1])
    return ~tied | ascends


def _natural(name: str) -> list[tuple[int, int | str]]:
    """A name's parts, numbers by their value."""
    return [(0, int(part)) if part.isdigit() else (1, part.lower()) for part in _NUMBERS.split(name) if part]
