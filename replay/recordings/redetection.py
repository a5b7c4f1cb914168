"""What aerodft saw in the images, found again in the recorded ones, and how far it is from where it was."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from aerodft.model import STEADY, VISION, Event, FloatArray, Image, Observation
from aerodft.service import ImageObserver, ObservedImages, ObserverCounts, ObserverSchedule, Source

_SAME_PX: Final = 1.0  # two references' corners that are one
_Key = tuple[str, int]


@dataclass(slots=True)
class Moved:
    """How points that were found again lie to the recorded ones.

    Attributes:
        moves_px: Of each point that is in both.
        lost: Points that are recorded and were not found again, in images that were looked at.
        new: Points that were found, and are not recorded.
        kept: Recorded observations of images without recorded pixels: they are taken as they were.
    """

    moves_px: list[float] = field(default_factory=list)
    lost: int = 0
    new: int = 0
    kept: int = 0

    def document(self) -> dict[str, object]:
        """For the summary; px are null where nothing was found again."""
        moves: FloatArray = np.array(self.moves_px)
        return {
            "found": len(moves),
            "lost": self.lost,
            "new": self.new,
            "kept": self.kept,
            "median_px": float(np.median(moves)) if len(moves) else None,
            "max_px": float(np.max(moves)) if len(moves) else None,
        }

    def sentence(self) -> str:
        """The same for people."""
        counts = f"{len(self.moves_px)} points found again, {self.lost} lost, {self.new} new"
        moves = ""
        if self.moves_px:
            moves = f"; moved by {np.median(self.moves_px):.3f} px (median), {max(self.moves_px):.3f} px at most"
        kept = f"; {self.kept} observations of images without pixels kept as recorded" if self.kept else ""
        return f"vision: {counts}{moves}{kept}"


class _Noted:
    """An observer, and what it saw in which image."""

    def __init__(self, observer: ImageObserver) -> None:
        self._observer = observer
        self.looked: set[int] = set()
        self.seen: dict[_Key, list[FloatArray]] = {}
        self.names: set[str] = set()

    def observe(self, image: Image) -> tuple[Observation, ...]:
        found = self._observer.observe(image)
        self.looked.add(image.index)
        for each in found:
            self.names.add(each.name)
            points = _points(each)
            if each.name == STEADY or len(points):
                self.seen.setdefault((each.name, image.index), []).append(points)
        return found


class Redetection:
    """A recording's source with what aerodft saw looked for again; what others observed stays as it is.

    Args:
        source: The recording's, with pixels.
        lookouts: Who looks.
    """

    def __init__(self, source: Source, lookouts: Sequence[ObserverSchedule]) -> None:
        self._source = source
        self._noted = [_Noted(each.observer) for each in lookouts]
        pairs = zip(self._noted, lookouts, strict=True)
        self._looked = ObservedImages(_Without(self), [ObserverSchedule(noted, each.every_s) for noted, each in pairs])
        self.moved = Moved()

    @property
    def counts(self) -> tuple[ObserverCounts, ...]:
        """What became of the images, one for each lookout."""
        return self._looked.counts

    def events(self) -> Iterator[Event]:
        """The source's events; what is seen again comes right behind its image, in place of what was recorded."""
        self.moved = Moved()
        for noted in self._noted:
            noted.looked.clear()
            noted.seen.clear()
        yield from self._looked.events()
        self.moved.new += sum(
            len(_now(name, points))
            for noted in self._noted
            for (name, _), each in noted.seen.items()
            for points in each
        )

    def recorded(self) -> Iterator[Event]:
        """The source's events without what was looked for again."""
        for event in self._source.events():
            if not isinstance(event, Observation) or event.source != VISION or event.image is None:
                yield event
                continue
            noted = next((each for each in self._noted if event.image in each.looked), None)
            if noted is None:
                self.moved.kept += 1
                yield event
            else:
                self._compare(event, noted)

    def _compare(self, old: Observation, noted: _Noted) -> None:
        """Pair the points of a recorded observation with what was found; what is left of that is new."""
        key = (old.name, old.image or 0)
        candidates = noted.seen.get(key)
        points = _points(old)
        if not candidates:  # nor is anything lost where there was nothing
            self.moved.lost += len(_now(old.name, points))
        elif not len(points) and old.name != STEADY:
            return
        elif old.name == STEADY:
            self._compare_steady(points, candidates[0])
            del noted.seen[key]
        else:
            moves = [_to_nearest_px(points, each) for each in candidates]
            nearest = int(np.argmin([np.median(each) for each in moves]))
            self.moved.moves_px += moves[nearest].tolist()
            candidates.pop(nearest)

    def _compare_steady(self, old: FloatArray, new: FloatArray) -> None:
        """Pairs of pixels, of the reference and of now: points are the same where the reference's are."""
        old_then, old_now, new_then, new_now = old[::2], old[1::2], new[::2], new[1::2]
        taken: set[int] = set()
        for then, now in zip(old_then, old_now, strict=True):
            apart = np.linalg.norm(new_then - then, axis=1)
            nearest = int(np.argmin(apart)) if len(apart) else -1
            if nearest < 0 or apart[nearest] > _SAME_PX or nearest in taken:
                self.moved.lost += 1
                continue
            taken.add(nearest)
            self.moved.moves_px.append(float(np.linalg.norm(new_now[nearest] - now)))
        self.moved.new += len(new_then) - len(taken)


class _Without:
    """The recorded events of a ``Redetection``, as a source."""

    def __init__(self, again: Redetection) -> None:
        self._again = again

    def events(self) -> Iterator[Event]:
        return self._again.recorded()


def _points(seen: Observation) -> FloatArray:
    """Its pixels ``(n, 2)``; of an outline the middle of its lowest side, and nothing where nothing was seen."""
    if not seen.contour:
        return np.array(seen.pixels, dtype=np.float64).reshape(-1, 2)
    outline = np.array(seen.contour)
    return np.array([[(outline[:, 0].min() + outline[:, 0].max()) / 2, outline[:, 1].max()]])


def _to_nearest_px(points: FloatArray, others: FloatArray) -> FloatArray:
    """From each point ``(n, 2)`` to the nearest other: a river's banks are seen at more or fewer places."""
    return np.asarray(np.linalg.norm(points[:, None] - others, axis=-1).min(axis=1))


def _now(name: str, points: FloatArray) -> FloatArray:
    """Of an observation's pixels those of the image."""
    return points[1::2] if name == STEADY else points
