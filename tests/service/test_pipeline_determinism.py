"""The pipeline's answers are a function of its input: not of how bytes are cut, nor of which empty ticks come."""

import struct
from dataclasses import dataclass, replace
from itertools import cycle
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from aerodft.model.image import StampClock
from aerodft.model.status import Status
from aerodft.service.feed import MergedFeed
from aerodft.service.poses import PoseSource

MS, SECOND = 1_000_000, 1_000_000_000
FRAMES = 131


@dataclass(frozen=True, repr=False)  # as long as the flight
class Reference:
    """A flight with a silence in it, its images and observations, and their answers as bytes."""

    frames: list
    images: list
    seen: list
    answers: list


@pytest.fixture(scope="module")
def reference(bench):
    frames, images, seen = bench.events_of(gap_ms=(1_900, 3_300))
    answers = bench.encoded(bench.run_events(*bench.blocks(frames), *images, *seen))
    return Reference(frames, images, seen, answers)


def test_the_reference_flight_has_answers_and_gaps(bench, reference):
    assert len(reference.frames) == FRAMES
    outputs = bench.run_events(*bench.blocks(reference.frames), *reference.images, *reference.seen)
    statuses = [sample.status for sample in bench.poses(outputs)]
    assert len(statuses) == len(reference.images)
    assert {status: statuses.count(status) for status in set(statuses)} == {
        Status.OK: 16,
        Status.STALE_TELEMETRY: 10,  # 1.8 s to 3.3 s: longer than an attitude is interpolated over
    }
    assert len(bench.measured(outputs, "width")) == len(reference.seen)
    assert len(bench.measured(outputs, "centre")) == len(reference.images)


@settings(max_examples=25, deadline=None)
@given(st.sets(st.integers(1, FRAMES - 1)))
def test_it_does_not_matter_how_frames_are_cut_into_blocks(bench, reference, cuts):
    assert (
        bench.encoded(bench.run_events(*bench.blocks(reference.frames, cuts), *reference.images, *reference.seen))
        == reference.answers
    )


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 3 * SECOND), st.floats(0.0, 1.0))
def test_it_does_not_matter_which_empty_ticks_come(bench, reference, linger_ns, share):
    """A live run has every empty tick, a recording has some: the ones within ``linger_ns`` of an event, or fewer."""
    rng = np.random.default_rng(7)
    feed = MergedFeed(
        [bench.source(*bench.blocks(reference.frames), *reference.images, *reference.seen)],
        bench.tick_ns,
        linger_ns=linger_ns,
    )
    batches = [b for b in feed.batches() if b.raw or b.images or b.observations or rng.random() < share]
    assert bench.encoded(bench.run(batches)) == reference.answers


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 40), st.integers(1, 30), st.integers(0, 2_500))
def test_sparse_input_does_not_depend_on_empty_ticks_either(bench, silence_at, silence, wait_ms):
    """Silences, short and long waits: whole seconds pass in which only deadlines happen."""
    start_ms, stop_ms = 100 * silence_at, 100 * (silence_at + silence)
    frames, images, seen = bench.events_of(4.0, gap_ms=(start_ms, stop_ms))
    images, seen = images[:: 1 + silence % 5], seen[:: 1 + silence_at % 3]
    telemetry = replace(bench.settings.telemetry, wait_ns=wait_ms * MS)
    events = (*bench.blocks(frames), *images, *seen)
    every = bench.run_events(*events, made=bench.pipeline(telemetry=telemetry), linger_ns=20 * SECOND)
    none = bench.run_events(*events, made=bench.pipeline(telemetry=telemetry), linger_ns=0)
    assert bench.encoded(every) == bench.encoded(none)


@pytest.fixture(scope="module")
def long_flight(bench):
    """Half a minute: batches of all kinds of telemetry with a silence, images on two clocks, and observations."""
    frames, images, seen = bench.events_of(30.0, gap_ms=(21_000, 22_700))
    images = [
        replace(image, clock=StampClock.HOST, stamp_ns=image.arrival_ns) if k % 3 else image
        for k, image in enumerate(images)
    ]
    images = [image for image in images if not 20_500 <= (image.arrival_ns - bench.host0_ns) / MS < 23_500]
    events = (*bench.blocks(frames), *images, *seen)
    batches = list(MergedFeed([bench.source(*events)], bench.tick_ns, linger_ns=0).batches())
    return batches, bench.encoded(bench.run(batches))


@settings(max_examples=10, deadline=None)
@given(st.lists(st.integers(1, 60), min_size=1, max_size=20))
def test_it_does_not_matter_which_ticks_are_taken_together(bench, long_flight, sizes):
    batches, answers = long_flight
    groups, first = [], 0
    for size in cycle(sizes):
        groups.append(batches[first : first + size])
        first += size
        if first >= len(batches):
            break
    taken = []
    with patch.object(PoseSource, "append_ticks", noting(PoseSource.append_ticks, taken)):
        assert bench.encoded(bench.run_groups(groups)) == answers
    assert max(sizes) == 1 or any(taken)


def test_a_tick_that_cannot_be_taken_with_others_costs_only_those_next_to_it(bench, long_flight):
    batches, answers = long_flight
    odd_ns = batches[len(batches) // 3].now_ns
    append_ticks, sizes, alone = PoseSource.append_ticks, [], []

    def refusing(poses, tracks, ticks_ns):
        if ticks_ns[0] <= odd_ns <= ticks_ns[-1]:
            return False
        sizes.append(len(ticks_ns))
        return append_ticks(poses, tracks, ticks_ns)

    with (
        patch.object(PoseSource, "append_ticks", refusing),
        patch.object(PoseSource, "append", noting(PoseSource.append, alone)),
    ):
        assert bench.encoded(bench.run_groups([batches])) == answers
    assert max(sizes) > len(batches) / 2  # all that came later, at once
    assert len(alone) < 50  # until clocks were known, and around the odd one


def noting(function, results):
    def noted(*arguments):
        results.append(function(*arguments))
        return results[-1]

    return noted


def test_sources_can_be_read_twice(bench, reference):
    source = bench.source(*bench.blocks(reference.frames), *reference.images, *reference.seen)
    feed = MergedFeed([source], bench.tick_ns)
    assert bench.encoded(bench.run(feed.batches())) == reference.answers
    assert bench.encoded(bench.run(feed.batches())) == reference.answers


@settings(max_examples=15, deadline=None)
@given(st.binary(min_size=1, max_size=60), st.integers(1, FRAMES - 1))
def test_noise_between_frames_changes_no_answer(bench, reference, noise, at):
    """What the framer would never pass on does no harm if it comes all the same."""
    junk = (reference.frames[at][0], struct.pack("<B", 0xFD) + noise)
    outputs = bench.run_events(
        *bench.blocks([*reference.frames[:at], junk, *reference.frames[at:]]), *reference.images, *reference.seen
    )
    assert bench.encoded(outputs) == reference.answers


EVENTS = st.lists(st.tuples(st.integers(0, 4_000), st.integers(0, 1_500), st.booleans()), min_size=1, max_size=25)


@settings(max_examples=35, deadline=None)
@given(EVENTS, st.integers(0, 3_000), st.integers(0, 4_000))
@example([(0, 501, False), (0, 502, True)], 99, 0)  # two in one tick, whose waits end in two
def test_what_a_live_run_leaves_to_its_end_comes_in_the_same_order_later(bench, reference, events, wait_ms, last_ms):
    """A live run ends with what still waits; the recording of it runs on until the last wait is over."""
    images = [bench.image(k, at, late_ms=late) for k, (at, late, is_image) in enumerate(events) if is_image]
    seen = [bench.observation(at, late_ms=late) for at, late, is_image in events if not is_image]
    frames = [frame for frame in reference.frames if frame[0] <= bench.host0_ns + last_ms * MS]
    telemetry = replace(bench.settings.telemetry, wait_ns=wait_ms * MS)
    given_events = (*bench.blocks(frames), *images, *seen)
    live = bench.run_events(*given_events, made=bench.pipeline(telemetry=telemetry), linger_ns=0)
    recorded = bench.run_events(*given_events, made=bench.pipeline(telemetry=telemetry), linger_ns=20 * SECOND)
    assert len(bench.poses(live)) == len(images)
    assert len(bench.measured(live, "width")) == len(seen)
    assert bench.encoded(live) == bench.encoded(recorded)
