"""The tick grid: cutting, merging, and that live and recorded input give the same batches."""

import threading
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.model import (
    Arrival,
    Event,
    Image,
    ImageRows,
    Observation,
    RawBlock,
    StampClock,
    WireProtocol,
    concatenate_images,
)
from aerodft.service import Batches, Inbox, LiveFeed, MergedFeed, block_of, feed, first_arrival_ns
from aerodft.service.batches import tick_after
from aerodft.service.clocks import WallClock
from tests.answers import one_by_one
from tests.batches import one_tick
from tests.clock import VirtualClock

TICK_NS = 50


class ListSource:
    def __init__(self, events: list[Event]) -> None:
        self._events = events

    def events(self) -> Iterator[Event]:
        return iter(self._events)


class GatheredListSource(ListSource):
    """Images that follow one another are given together, up to ``most``, and by their size."""

    def __init__(self, events: list[Event], most: int) -> None:
        super().__init__(events)
        self._most = most

    def gathered(self) -> Iterator[Arrival]:
        found: list[Arrival] = []
        for event in self._events:
            rows = as_rows(event) if isinstance(event, Image) else None
            before = found[-1] if found else None
            if rows is None:
                found.append(event)
            elif isinstance(before, ImageRows) and before.common == rows.common and len(before) < self._most:
                found[-1] = concatenate_images([before, rows])
            else:
                found.append(rows)
        return iter(found)


def as_rows(shot: Image) -> ImageRows:
    columns = (np.array([value]) for value in (shot.index, shot.stamp_ns, shot.arrival_ns))
    return ImageRows(*columns, shot.clock, shot.width_px, shot.height_px)


def frames_of(block: RawBlock) -> list[tuple[int, bytes]]:
    return [
        (int(at), block.data[start : start + size])
        for at, start, size in zip(block.arrival_ns, block.offset, block.length, strict=True)
    ]


def block(sender: str, *frames: tuple[int, bytes]) -> RawBlock:
    return block_of(WireProtocol.MAVLINK, sender, [at for at, _ in frames], [data for _, data in frames])


def image(index: int, arrival_ns: int) -> Image:
    return Image(index=index, stamp_ns=arrival_ns, arrival_ns=arrival_ns)


def observation(name: str, arrival_ns: int) -> Observation:
    return Observation(name=name, stamp_ns=arrival_ns, arrival_ns=arrival_ns, pixels=((1.0, 2.0),))


def flat(batch: Batches) -> tuple[object, ...]:
    """What is in a tick."""
    (now_ns,) = batch.now_ns.tolist()
    return (
        now_ns,
        tuple((raw.protocol, raw.sender, tuple(frames_of(raw))) for raw in batch.raw),
        tuple((shot.index, shot.arrival_ns) for shot in batch.images),
        tuple(batch.observations),
    )


def ticks_of(feed: MergedFeed | LiveFeed) -> Iterator[Batches]:
    for batches in feed.batches():
        yield from one_by_one(batches)


@pytest.mark.parametrize(("arrival_ns", "tick_ns"), [(0, 0), (1, 50), (49, 50), (50, 50), (51, 100)])
def test_an_arrival_on_the_boundary_belongs_to_that_tick(arrival_ns: int, tick_ns: int) -> None:
    assert tick_after(arrival_ns, TICK_NS) == tick_ns


def test_a_block_is_cut_at_ticks_and_senders_are_joined() -> None:
    source = ListSource(
        [
            block("a", (10, b"one"), (50, b"two"), (51, b"three")),
            block("b", (20, b"x")),
            image(0, 50),
            block("a", (60, b"four")),
        ]
    )
    got = list(ticks_of(MergedFeed([source], TICK_NS, idle_ticks_ns=0)))
    assert [flat(batch) for batch in got] == [
        (
            50,
            (
                (WireProtocol.MAVLINK, "a", ((10, b"one"), (50, b"two"))),
                (WireProtocol.MAVLINK, "b", ((20, b"x"),)),
            ),
            ((0, 50),),
            (),
        ),
        (100, ((WireProtocol.MAVLINK, "a", ((51, b"three"), (60, b"four"))),), (), ()),
    ]


def test_ticks_come_on_for_a_while_after_the_last_event_and_no_longer() -> None:
    sources = [ListSource([image(0, 40)]), ListSource([image(1, 1000)])]
    got = np.concatenate(
        [batches.now_ns for batches in MergedFeed(sources, TICK_NS, idle_ticks_ns=100).batches()]
    ).tolist()
    assert got == [50, 100, 150, 1000, 1050, 1100]


def test_a_source_that_goes_back_is_a_broken_contract() -> None:
    source = ListSource([image(0, 200), image(1, 10)])
    with pytest.raises(ValueError, match="must not go back"):
        list(MergedFeed([source], TICK_NS, idle_ticks_ns=0).batches())


EVENTS = st.lists(
    st.tuples(st.integers(0, 700), st.sampled_from("abio"), st.integers(0, 3), st.booleans()), min_size=1, max_size=40
)


@given(EVENTS, st.integers(0, 400), st.integers(0, 200))
def test_batches_are_their_ticks_together_and_pixels_wait_for_nobody(
    given_events: list[tuple[int, str, int, bool]], longest_ns: int, idle_ticks_ns: int
) -> None:
    """What a batch is cut into, and what its ticks are made of, are the same."""
    events: list[Event] = []
    for index, (at, kind, more, has_pixels) in enumerate(sorted(given_events)):
        if kind == "i":
            pixels = (lambda: np.zeros((1, 1, 3), dtype=np.uint8)) if has_pixels else None
            events.append(Image(index=index, stamp_ns=at, arrival_ns=at, pixels=pixels))
        elif kind == "o":
            events.append(observation(str(index), at))
        else:
            events.append(block(kind, *((at + 40 * k, b"%d" % index) for k in range(more + 1))))
    together = list(
        MergedFeed([ListSource(events)], TICK_NS, idle_ticks_ns=idle_ticks_ns, longest_ns=longest_ns).batches()
    )
    ticks = [tick for batches in together for tick in one_by_one(batches)]
    wanted: dict[int, list[Event]] = {}
    for event in events:
        parts = (
            [event.rows(slice(k, k + 1)) for k in range(len(event.length))] if isinstance(event, RawBlock) else [event]
        )
        for part in parts:
            wanted.setdefault(tick_after(first_arrival_ns(part), TICK_NS), []).append(part)
    assert [flat(tick) for tick in ticks if tick.event_count] == [
        flat(one_tick(now_ns, own)) for now_ns, own in sorted(wanted.items())
    ]
    lingering = {now_ns + TICK_NS * k for now_ns in wanted for k in range(idle_ticks_ns // TICK_NS + 1)}
    assert [int(tick.now_ns[0]) for tick in ticks] == sorted(lingering)
    for batches in together:
        assert [flat(tick) for tick in one_by_one(batches[1:3])] == [flat(tick) for tick in one_by_one(batches)[1:3]]
        busy_ns = [int(tick.now_ns[0]) for tick in one_by_one(batches) if tick.event_count]
        assert not busy_ns or busy_ns[-1] - busy_ns[0] <= longest_ns
        assert len(busy_ns) < 2 or all(shot.pixels is None for shot in batches.images)


def test_no_input_gives_no_batch() -> None:
    assert list(MergedFeed([ListSource([]), ListSource([block("a")])], TICK_NS).batches()) == []


@given(
    st.lists(st.tuples(st.integers(0, 999), st.sampled_from("ab"), st.binary(min_size=1, max_size=4)), max_size=40),
    st.lists(st.integers(0, 999), max_size=10),
    st.lists(st.integers(1, 5), min_size=1),
)
def test_batches_do_not_depend_on_how_frames_were_cut_into_blocks(
    frames: list[tuple[int, str, bytes]], shots: list[int], sizes: list[int]
) -> None:
    frames.sort(key=lambda item: item[0])
    single: list[Event] = [block(sender, (at, data)) for at, sender, data in frames]
    cut: list[Event] = []
    for sender in "ab":
        own = [(at, data) for at, who, data in frames if who == sender]
        position = 0
        while position < len(own):
            size = sizes[len(cut) % len(sizes)]
            cut.append(block(sender, *own[position : position + size]))
            position += size
    cut.sort(key=lambda event: int(event.arrival_ns[0]) if isinstance(event, RawBlock) else event.arrival_ns)
    images = ListSource([image(index, at) for index, at in enumerate(sorted(shots))])
    one = [flat(tick) for tick in ticks_of(MergedFeed([ListSource(single), images], TICK_NS, idle_ticks_ns=0))]
    two = [flat(tick) for tick in ticks_of(MergedFeed([ListSource(cut), images], TICK_NS, idle_ticks_ns=0))]
    assert one == two


def test_the_inbox_stamps_strictly_increasing_and_never_into_a_taken_tick() -> None:
    clock = VirtualClock(100)
    inbox = Inbox(clock)
    inbox.put_frames(WireProtocol.MAVLINK, "a", [b"1", b"22"])
    inbox.put_observation(observation("p", 0))
    inbox.put_image(image(0, 0))
    inbox.put_frames(WireProtocol.MAVLINK, "a", [])
    assert flat(inbox.take(101)) == (101, ((WireProtocol.MAVLINK, "a", ((100, b"1"), (101, b"22"))),), (), ())
    rest = inbox.take(150)
    assert [seen.arrival_ns for seen in rest.observations] == [102]
    assert [shot.arrival_ns for shot in rest.images] == [103]
    inbox.put_observation(observation("late", 0))
    assert not inbox.take(150).observations
    assert [seen.arrival_ns for seen in inbox.take(200).observations] == [151]


def test_the_inbox_cuts_a_read_that_spans_a_tick() -> None:
    inbox = Inbox(VirtualClock(49))
    inbox.put_frames(WireProtocol.MAVLINK, "a", [b"1", b"2", b"3"])
    assert [frames_of(raw) for raw in inbox.take(50).raw] == [[(49, b"1"), (50, b"2")]]
    assert [frames_of(raw) for raw in inbox.take(100).raw] == [[(51, b"3")]]


def test_the_inbox_drops_the_oldest_images_and_counts_them() -> None:
    inbox = Inbox(VirtualClock(1), max_images=2)
    for index in range(5):
        inbox.put_image(image(index, 0))
    assert [shot.index for shot in inbox.take(1000).images] == [3, 4]
    assert inbox.dropped_images == 3


def test_recorded_batches_merge_back_into_the_live_ones() -> None:
    clock = VirtualClock(1000)
    inbox = Inbox(clock)
    live: list[Batches] = []
    for step in range(1, 30):
        clock.sleep_until(1000 + 17 * step)
        inbox.put_frames(WireProtocol.MAVLINK, "ab"[step % 2], [bytes([step]), b"x" * step])
        if step % 3 == 0:
            inbox.put_image(image(step, 0))
        if clock.now_ns() // TICK_NS > (clock.now_ns() - 17) // TICK_NS:
            live.append(inbox.take(clock.now_ns() // TICK_NS * TICK_NS))
    live.append(inbox.take(tick_after(clock.now_ns() + 1, TICK_NS)))
    merged: dict[int, list[Event]] = {}
    for batch in live:
        merged.setdefault(int(batch.now_ns[0]), []).extend((*batch.raw, *batch.images))
    expected = [flat(one_tick(now, events)) for now, events in merged.items() if events]
    events = sorted(
        (event for part in merged.values() for event in part),
        key=lambda event: int(event.arrival_ns[0]) if isinstance(event, RawBlock) else event.arrival_ns,
    )
    replayed = [flat(tick) for tick in ticks_of(MergedFeed([ListSource(events)], TICK_NS, idle_ticks_ns=0))]
    assert replayed == expected


@given(EVENTS, st.integers(0, 400), st.integers(1, 5), st.integers(1, 9))
def test_images_that_are_read_together_come_as_if_they_were_not(
    given_events: list[tuple[int, str, int, bool]], longest_ns: int, together: int, most: int
) -> None:
    """Cut by ticks and by batches, of one size or of several, among frames and observations."""
    events: list[Event] = []
    for index, (at, kind, more, is_wide) in enumerate(sorted(given_events)):
        if kind == "b":
            events.append(block(kind, *((at + 40 * k, b"%d" % index) for k in range(more + 1))))
        elif kind == "o":
            events.append(observation(str(index), at))
        else:
            stamp = Image(index=9 * index, stamp_ns=at - 7, arrival_ns=at, clock=StampClock.HOST)
            is_stamp = kind == "i" or not is_wide
            events.append(stamp if is_stamp else replace(stamp, clock=StampClock.UTC, width_px=64, height_px=48))

    def batches_of(source: ListSource) -> list[Batches]:
        return list(MergedFeed([source], TICK_NS, idle_ticks_ns=0, longest_ns=longest_ns).batches())

    def seen(tick: Batches) -> object:
        return flat(tick), [(shot.stamp_ns, shot.clock, shot.width_px, shot.height_px) for shot in tick.images]

    apart = [seen(tick) for batches in batches_of(ListSource(events)) for tick in one_by_one(batches)]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(feed, "_MAX_SUBJECTS", most)
        found = batches_of(GatheredListSource(events, together))
    assert [seen(tick) for batches in found for tick in one_by_one(batches)] == apart
    for batches in found:
        assert [seen(tick) for tick in one_by_one(batches[1:])] == [seen(tick) for tick in one_by_one(batches)[1:]]
        subjects = [len(tick.images) + len(tick.observations) for tick in one_by_one(batches)]
        assert len(subjects) == 1 or sum(subjects) <= most + 2 * together or subjects[0] > most


def test_a_live_feed_ticks_on_the_grid_and_ends_after_the_batch_in_hand() -> None:
    clock = VirtualClock(120)
    inbox = Inbox(clock)
    feed = LiveFeed(inbox, clock, TICK_NS)
    ticks = feed.batches()
    assert next(ticks).now_ns.tolist() == [150]
    inbox.put_frames(WireProtocol.MAVLINK, "a", [b"1"])
    feed.stop()
    last = next(ticks)
    assert (last.now_ns.tolist(), len(last.raw)) == ([200], 1)
    assert list(ticks) == []


def test_what_came_before_the_first_batch_is_on_the_grid_as_well() -> None:
    """A service opens its links some ticks before it runs: what it recorded then gives the same batches again."""
    clock = VirtualClock(110)
    inbox = Inbox(clock)
    came: list[Event] = []
    for at_ns in (110, 140, 220, 310):
        clock.sleep_until(at_ns)
        if at_ns == 140:
            came.append(image(0, at_ns))
            inbox.put_image(image(0, 0))
        else:
            came.append(block_of(WireProtocol.MAVLINK, "a", [at_ns], [b"%d" % at_ns]))
            inbox.put_frames(WireProtocol.MAVLINK, "a", [b"%d" % at_ns])
    clock.sleep_until(320)
    ticks = LiveFeed(inbox, clock, TICK_NS).batches()
    live = [flat(next(ticks)) for _ in range(5)]
    assert [now_ns for now_ns, *_ in live] == [150, 200, 250, 300, 350]
    recorded = [flat(tick) for tick in ticks_of(MergedFeed([ListSource(came)], TICK_NS, idle_ticks_ns=0))]
    assert [each for each in live if any(each[1:])] == recorded


def test_arrivals_stay_unique_when_many_threads_put() -> None:
    inbox = Inbox(WallClock(), max_images=10_000)

    def work(sender: str) -> None:
        for _ in range(200):
            inbox.put_frames(WireProtocol.MAVLINK, sender, [b"1", b"2"])
            inbox.put_image(image(0, 0))

    threads = [threading.Thread(target=work, args=(name,)) for name in "abcd"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    batch = inbox.take(2**62)
    arrivals = np.concatenate([raw.arrival_ns for raw in batch.raw] + [[shot.arrival_ns for shot in batch.images]])
    assert len(np.unique(arrivals)) == 4 * 200 * 3


def test_the_wall_clock_is_utc_and_sleeps_at_least_as_long_as_asked() -> None:
    clock = WallClock()
    start_ns = clock.now_ns()
    clock.sleep_until(start_ns + 5_000_000)
    assert clock.now_ns() >= start_ns + 5_000_000
    clock.sleep_until(start_ns)


def test_the_virtual_clock_never_goes_back() -> None:
    clock = VirtualClock(5)
    clock.sleep_until(10)
    clock.sleep_until(7)
    assert clock.now_ns() == 10
