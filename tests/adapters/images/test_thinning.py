"""Images between those that a recording keeps lose their pixels; the recorder finds the same ones due."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from aerodft.adapters.images import ThinnedPixels
from aerodft.adapters.images.rate import is_due
from aerodft.model import Event, Image, ImageArray, StampClock

SECOND_NS = 10**9


def black() -> ImageArray:
    return np.zeros((2, 2, 3), dtype=np.uint8)


@dataclass
class Flight:
    arrivals_ns: list[int]

    def events(self) -> Iterator[Event]:
        for index, arrival_ns in enumerate(self.arrivals_ns):
            yield Image(
                index=index,
                stamp_ns=arrival_ns,
                arrival_ns=arrival_ns,
                clock=StampClock.UTC,
                width_px=2,
                height_px=2,
                pixels=black,
            )


@pytest.mark.parametrize("rate_hz", [0.0, 0.5, 1.0, 7.0, 1000.0])
def test_what_is_thinned_is_what_the_recorder_would_leave_out(rate_hz: float) -> None:
    rng = np.random.default_rng(3)
    steps_ns = rng.choice([SECOND_NS // 30, SECOND_NS // 10, 3 * SECOND_NS], 400) + rng.integers(0, 10**7, 400)
    source = Flight((SECOND_NS + np.cumsum(steps_ns)).tolist())
    kept, last_ns = [], None
    for image in source.events():
        if is_due(last_ns, image.arrival_ns, rate_hz):
            kept.append(image.index)
            last_ns = image.arrival_ns
    thinned = list(ThinnedPixels(source, rate_hz).events())
    assert [image.index for image in thinned] == list(range(400))
    assert [image.index for image in thinned if image.pixels is not None] == kept
    again = [image.arrival_ns for image in thinned if image.pixels is not None]
    assert all(is_due(a, b, rate_hz) for a, b in zip([None, *again], again, strict=False))


def test_a_camera_slower_than_the_rate_keeps_all_though_it_jitters() -> None:
    arrivals_ns = [k * SECOND_NS + (-1) ** k * SECOND_NS // 25 for k in range(1, 101)]
    assert all(image.pixels is not None for image in ThinnedPixels(Flight(arrivals_ns), 1.0).events())
