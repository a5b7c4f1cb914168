"""Detection repeated in recorded images, and how far what is found lies from what was recorded."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from aerodft.model import FIXED_POINTS, VISION, Event, FloatArray, Image, Observation
from aerodft.service import ImageObserver, ObservedImages, ObserverCounts, ObserverSchedule, Source

_SAME_PX: Final = 1.0  # two references' corners that are one
_Key = tuple[str, int]


@dataclass(slots=True)
class RedetectionStatistics:
    """Differences of points that were detected again from the recorded ones.

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
        """Plain JSON values; px are null where nothing was found again."""
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
        """One sentence for people."""
        counts = f"{len(self.moves_px)} points found again, {self.lost} lost, {self.new} new"
        moves = ""
        if self.moves_px:
            moves = f"; moved by {np.median(self.moves_px):.3f} px (median), {max(self.moves_px):.3f} px at most"
        kept = f"; {self.kept} observations of images without pixels kept as recorded" if self.kept else ""
        return f"vision: {counts}{moves}{kept}"


class _NotingObserver:
    """An observer that notes what it detected in which image."""

    def __init__(self, observer: ImageObserver) -> None:
        self._observer = observer
        self.observed_images: set[int] = set()
        self.detections: dict[_Key, list[FloatArray]] = {}
        self.names: set[str] = set()

    def observe(self, image: Image) -> tuple[Observation, ...]:
        found = self._observer.observe(image)
        self.observed_images.add(image.index)
        for each in found:
            self.names.add(each.name)
            points = _points(each)
            if each.name == FIXED_POINTS or len(points):
                self.detections.setdefault((each.name, image.index), []).append(points)
        return found


class Redetection:
    """A recording's source with aerodft's own detections made again; what others observed stays as it is.

    Args:
        source: The recording's, with pixels.
        schedules: Observers, and how often each looks.
    """

    def __init__(self, source: Source, schedules: Sequence[ObserverSchedule]) -> None:
        self._source = source
        self._noted = [_NotingObserver(each.observer) for each in schedules]
        pairs = zip(self._noted, schedules, strict=True)
        self._looked = ObservedImages(
            _RecordedSource(self), [ObserverSchedule(observer, each.every_s) for observer, each in pairs]
        )
        self.moved = RedetectionStatistics()

    @property
    def counts(self) -> tuple[ObserverCounts, ...]:
        """Counts of each observer's images."""
        return self._looked.counts

    def events(self) -> Iterator[Event]:
        """The source's events; what is seen again comes right behind its image, in place of what was recorded."""
        self.moved = RedetectionStatistics()
        for observer in self._noted:
            observer.observed_images.clear()
            observer.detections.clear()
        yield from self._looked.events()
        self.moved.new += sum(
            len(_current_pixels(name, points))
            for observer in self._noted
            for (name, _), each in observer.detections.items()
            for points in each
        )

    def recorded(self) -> Iterator[Event]:
        """The source's events without what was looked for again."""
        for event in self._source.events():
            if not isinstance(event, Observation) or event.source != VISION or event.image is None:
                yield event
                continue
            observer = next((each for each in self._noted if event.image in each.observed_images), None)
            if observer is None:
                self.moved.kept += 1
                yield event
            else:
                self._compare(event, observer)

    def _compare(self, old: Observation, observer: _NotingObserver) -> None:
        """Pair the points of a recorded observation with what was found; what is left of that is new."""
        key = (old.name, old.image or 0)
        candidates = observer.detections.get(key)
        points = _points(old)
        if not candidates:  # nor is anything lost where there was nothing
            self.moved.lost += len(_current_pixels(old.name, points))
        elif not len(points) and old.name != FIXED_POINTS:
            return
        elif old.name == FIXED_POINTS:
            self._compare_steady(points, candidates[0])
            del observer.detections[key]
        else:
            moves = [_to_nearest_px(points, each) for each in candidates]
            nearest = int(np.argmin([np.median(each) for each in moves]))
            self.moved.moves_px += moves[nearest].tolist()
            candidates.pop(nearest)

    def _compare_steady(self, old: FloatArray, new: FloatArray) -> None:
        """Pairs of pixels, of the reference and of now: points are the same where the reference's are."""
        old_then, old_now, new_then, new_now = old[::2], old[1::2], new[::2], new[1::2]
        matched: set[int] = set()
        for then, now in zip(old_then, old_now, strict=True):
            distances_px = np.linalg.norm(new_then - then, axis=1)
            nearest = int(np.argmin(distances_px)) if len(distances_px) else -1
            if nearest < 0 or distances_px[nearest] > _SAME_PX or nearest in matched:
                self.moved.lost += 1
                continue
            matched.add(nearest)
            self.moved.moves_px.append(float(np.linalg.norm(new_now[nearest] - now)))
        self.moved.new += len(new_then) - len(matched)


class _RecordedSource:
    """The recorded events of a ``Redetection``, as a source."""

    def __init__(self, again: Redetection) -> None:
        self._again = again

    def events(self) -> Iterator[Event]:
        return self._again.recorded()


def _points(detections: Observation) -> FloatArray:
    """An observation's pixels ``(n, 2)``; of an outline the middle of its lowest side."""
    if not detections.contour:
        return np.array(detections.pixels, dtype=np.float64).reshape(-1, 2)
    outline = np.array(detections.contour)
    return np.array([[(outline[:, 0].min() + outline[:, 0].max()) / 2, outline[:, 1].max()]])


def _to_nearest_px(points: FloatArray, others: FloatArray) -> FloatArray:
    """From each point ``(n, 2)`` to the nearest other: a river's banks are seen at more or fewer places."""
    return np.asarray(np.linalg.norm(points[:, None] - others, axis=-1).min(axis=1))


def _current_pixels(name: str, points: FloatArray) -> FloatArray:
    """An observation's pixels ``(n, 2)`` in its own image: of steady points every second one."""
    return points[1::2] if name == FIXED_POINTS else points
