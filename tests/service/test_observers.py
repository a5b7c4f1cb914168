"""Observers over recorded and live images: what is due, what is left out, and that nobody waits for them."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model import Image, Observation, StampClock
from aerodft.service import Inbox, LiveObservers, MergedFeed, ObservedImages, ObserverSchedule
from tests.clock import VirtualClock

PATIENCE_S = 30.0


def black():
    return np.zeros((2, 2, 3), dtype=np.uint8)


def shown(index, stamp_ns, **other):
    arrival_ns = other.pop("arrival_ns", stamp_ns)
    return Image(index=index, stamp_ns=stamp_ns, arrival_ns=arrival_ns, width_px=2, height_px=2, pixels=black, **other)


class Namer:
    """Sees each image's own index; ``before`` is called first."""

    def __init__(self, before=lambda _: None):
        self._before = before
        self.seen = []

    def observe(self, image):
        self._before(image)
        self.seen.append(image.index)
        pixel = (float(image.index), float(image.pixels()[0, 0, 0]))
        return (
            Observation(
                name="it",
                stamp_ns=image.stamp_ns,
                arrival_ns=0,
                pixels=(pixel,),
                clock=image.clock,
                image=image.index,
                source="vision",
            ),
        )


class ListSource:
    def __init__(self, *events):
        self._events = events

    def events(self):
        return iter(self._events)


def test_what_is_seen_comes_with_its_image():
    images = [shown(k, 1000 * k, arrival_ns=1000 * k + 70) for k in range(4)]
    events = list(ObservedImages(ListSource(*images), [ObserverSchedule(Namer())]).events())
    assert [type(each) for each in events] == [Image, Observation] * 4
    for image, seen in zip(events[::2], events[1::2], strict=True):
        assert (seen.image, seen.stamp_ns, seen.arrival_ns) == (image.index, image.stamp_ns, image.arrival_ns)
    (batch,) = MergedFeed(
        [ObservedImages(ListSource(images[1]), [ObserverSchedule(Namer())])], 5000, idle_ticks_ns=0
    ).batches()
    assert (len(batch.images), len(batch.observations)) == (1, 1)


@given(fps=st.integers(2, 60), every_s=st.sampled_from([0.0, 0.25, 1.0]), jitter=st.floats(0, 0.08))
def test_an_observer_looks_at_its_own_rate(fps, every_s, jitter):
    rng = np.random.default_rng(fps)
    at_s = np.arange(4 * fps) / fps + rng.uniform(0, jitter / fps, 4 * fps)
    observer = Namer()
    source = ListSource(*(shown(k, round(s * SECOND_NS)) for k, s in enumerate(at_s.tolist())))
    list(ObservedImages(source, [ObserverSchedule(observer, every_s)]).events())
    looks_s = at_s[observer.seen]
    if every_s <= 1 / fps:
        assert len(looks_s) == len(at_s)
    else:
        assert np.all(np.diff(looks_s) >= 0.9 * every_s - 1e-9)
        assert np.all(np.diff(looks_s) <= every_s + 2 / fps)


def test_a_clock_that_goes_back_does_not_stop_the_looking():
    observer = Namer()
    source = ListSource(shown(0, 10 * SECOND_NS), shown(1, 2 * SECOND_NS), shown(2, 2 * SECOND_NS + 1))
    list(ObservedImages(source, [ObserverSchedule(observer, 1.0)]).events())
    assert observer.seen == [0, 1]


def test_no_pixels_no_look_and_damage_is_counted():
    def damaged():
        raise InputError("image cannot be decoded")

    observer = Namer()
    bad = replace(shown(1, 1), pixels=damaged)
    looked = ObservedImages(
        ListSource(replace(shown(0, 0), pixels=None), bad, shown(2, 2)), [ObserverSchedule(observer)]
    )
    assert len(list(looked.events())) == 4
    (counts,) = looked.counts
    assert (counts.looked, counts.unreadable, counts.skipped) == (1, 1, 0)


def test_a_slow_observer_gets_the_newest_image_and_holds_nobody_up():
    busy, go_on, got, done = threading.Event(), threading.Event(), [], threading.Event()

    def before(image):
        if image.index == 0:
            busy.set()
            assert go_on.wait(PATIENCE_S)

    def on_seen(seen):
        got.extend(seen)
        if seen[0].image == 9:
            done.set()

    with LiveObservers([ObserverSchedule(Namer(before))], on_seen) as look:
        look(shown(0, 0))
        assert busy.wait(PATIENCE_S)
        for index in range(1, 10):  # returns at once, though the first look is not over
            look(shown(index, index))
        go_on.set()
        assert done.wait(PATIENCE_S)
        (counts,) = look.counts
    assert [each.image for each in got] == [0, 9]
    assert (counts.looked, counts.skipped) == (2, 8)


def test_an_observer_that_breaks_is_heard_of_at_the_end():
    asked, seen = threading.Event(), threading.Event()

    def broken(image):
        asked.set()
        raise RuntimeError(image.index)

    look = LiveObservers(
        [ObserverSchedule(Namer(broken)), ObserverSchedule(Namer(lambda _: seen.set()))], lambda _: None
    )
    look(shown(7, 0))
    assert asked.wait(PATIENCE_S)
    assert seen.wait(PATIENCE_S)
    with pytest.raises(RuntimeError, match="7"):
        look.stop()


def test_what_is_seen_live_is_in_the_inbox_with_later_arrivals_in_its_order():
    clock = VirtualClock(1000)
    inbox = Inbox(clock)
    inbox.put_image(image := shown(3, 900, clock=StampClock.HOST))
    inbox.put_observations([*Namer().observe(image), *Namer().observe(image)])
    batch = inbox.take(2000)
    arrivals = [batch.images[0].arrival_ns, *(each.arrival_ns for each in batch.observations)]
    assert arrivals == sorted(set(arrivals))
    assert {(each.image, each.stamp_ns, each.clock) for each in batch.observations} == {(3, 900, StampClock.HOST)}
