"""What is found again is held against what is recorded, point by point; what others observed is left alone."""

from collections.abc import Iterator

import numpy as np

from aerodft.model import FIXED_POINTS, VISION, Event, Image, Observation
from aerodft.service import ObserverSchedule
from replay.recordings import Redetection


def image(index: int, *, pixels: bool = True) -> Image:
    black = np.zeros((2, 2, 3), np.uint8)
    return Image(
        index=index, stamp_ns=index, arrival_ns=index, width_px=2, height_px=2, pixels=lambda: black if pixels else None
    )


def seen(name: str, index: int, *pixels: tuple[float, float], source: str = VISION) -> Observation:
    return Observation(name=name, stamp_ns=index, arrival_ns=index, pixels=pixels, image=index, source=source)


class Events:
    def __init__(self, *events: Event) -> None:
        self._events = events

    def events(self) -> Iterator[Event]:
        return iter(self._events)


class Finder:
    def __init__(self, *found: Observation) -> None:
        self._found = found

    def observe(self, image: Image) -> tuple[Observation, ...]:
        return tuple(each for each in self._found if each.image == image.index)


def test_points_are_paired_by_name_and_image_and_the_rest_is_lost_new_or_kept() -> None:
    bare = Image(index=3, stamp_ns=3, arrival_ns=3)
    outside, kept = seen("w", 1, (5.0, 5.0), source="file"), seen("a", 3, (1.0, 1.0))
    recorded = Events(
        image(1), seen("a", 1, (10.0, 20.0)), seen("b", 1, (1.0, 1.0)), seen("b", 1, (90.0, 90.0)), outside,
        image(2), seen("a", 2, (10.0, 20.0)), bare, kept,
    )  # fmt: skip
    found = (seen("a", 1, (13.0, 24.0)), seen("b", 1, (90.0, 91.0)), seen("b", 1, (1.0, 1.0)), seen("c", 2, (0.0, 0.0)))
    again = Redetection(recorded, [ObserverSchedule(Finder(*found))])
    events = list(again.events())
    assert again.moved.document() == {
        "found": 3, "lost": 1, "new": 1, "kept": 1, "median_px": 1.0, "max_px": 5.0,
    }  # fmt: skip
    assert [each for each in events if isinstance(each, Observation)] == [*found[:3], outside, found[3], kept]
    assert again.moved.sentence() == (
        "vision: 3 points found again, 1 lost, 1 new; moved by 1.000 px (median), 5.000 px at most;"
        " 1 observations of images without pixels kept as recorded"
    )


def test_steady_points_are_paired_by_where_the_reference_has_them() -> None:
    recorded = Events(image(1), seen(FIXED_POINTS, 1, (0, 0), (1, 1), (50, 50), (52, 50), (90, 90), (90, 90)), image(2))
    found = (
        seen(FIXED_POINTS, 1, (50.4, 50), (52, 54), (0, 0), (1, 4), (20, 20), (20, 20)),
        seen(FIXED_POINTS, 2, (0, 0), (2, 2)),
    )
    again = Redetection(recorded, [ObserverSchedule(Finder(*found))])
    list(again.events())
    assert again.moved.document() == {
        "found": 2, "lost": 1, "new": 2, "kept": 0, "median_px": 3.5, "max_px": 4.0,
    }  # fmt: skip
