"""The pipeline's answers are a function of its input: not of how bytes are cut, nor of which empty ticks come."""

import struct
from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from aerodft.adapters.telemetry.mavlink import MavlinkDecoder
from aerodft.model import Status
from aerodft.service import Batches, MergedFeed, Pipeline, feed
from aerodft.service.pose import PoseSource
from tests.answers import cut_at, one_by_one, timed
from tests.nights import at_night

from .eventful import Happenings, events_of, settings_of
from .learning import Counting, Following

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
def test_it_does_not_matter_which_empty_ticks_come(bench, reference, idle_ticks_ns, share):
    """A live run has every empty tick; a recording those within ``idle_ticks_ns`` of an event, or fewer."""
    rng = np.random.default_rng(7)
    events = (*bench.blocks(reference.frames), *reference.images, *reference.seen)
    batches = bench.batches(*events, idle_ticks_ns=idle_ticks_ns)
    ticks = [tick for each in batches for tick in one_by_one(each) if tick.event_count or rng.random() < share]
    assert bench.encoded(bench.run(ticks)) == reference.answers


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 40), st.integers(1, 30), st.integers(0, 2_500))
def test_sparse_input_does_not_depend_on_empty_ticks_either(bench, silence_at, silence, wait_ms):
    """Silences, short and long waits: whole seconds pass in which only deadlines happen."""
    start_ms, stop_ms = 100 * silence_at, 100 * (silence_at + silence)
    frames, images, seen = bench.events_of(4.0, gap_ms=(start_ms, stop_ms))
    images, seen = images[:: 1 + silence % 5], seen[:: 1 + silence_at % 3]
    telemetry = replace(bench.settings.telemetry, wait_ns=wait_ms * MS)
    events = (*bench.blocks(frames), *images, *seen)
    every = bench.run_events(*events, made=bench.pipeline(telemetry=telemetry), idle_ticks_ns=20 * SECOND)
    none = bench.run_events(*events, made=bench.pipeline(telemetry=telemetry), idle_ticks_ns=0)
    assert bench.encoded(every) == bench.encoded(none)


FLIGHTS = {
    "nothing but gaps": Happenings(),
    "UTC jumps ahead": Happenings(jump_s=3.0, seed=2),
    "UTC jumps back": Happenings(jump_s=-3.0, seed=3),
    "a reboot": Happenings(reboots=True, seed=4),
    "UTC comes late, jumps, and a reboot": Happenings(is_utc_late=True, jump_s=3.0, reboots=True, seed=5),
    # Before UTC is said and after; and for so long that the clock counts as set.
    "telemetry is late": Happenings(is_utc_late=True, late_s=((1.5, 6.0), (14.0, 25.5)), seed=7),
    "several senders": Happenings(has_companion=True, jump_s=3.0, seed=6),
}


@dataclass(frozen=True, repr=False)
class Eventful:
    """A flight in which something happens all the time, by ticks; and when it is answered how, tick by tick."""

    happenings: Happenings
    batches: Batches
    answers: list


def answered(bench, steps):
    """Times of the answers, and these as bytes."""
    counting = Counting()
    made = Pipeline(settings_of(bench), MavlinkDecoder(), counting, counting, Following())
    times, answers = zip(*timed(made, steps), strict=True)
    return list(zip(times, bench.encoded(answers), strict=True))


BY_DAY = "UTC comes late, jumps, and a reboot"
BY_DAY_AND_NIGHT = [BY_DAY, *at_night(*(name for name in FLIGHTS if name != BY_DAY))]


@pytest.fixture(scope="module", params=BY_DAY_AND_NIGHT)
def eventful(bench, request):
    happenings = FLIGHTS[request.param]
    source = bench.source(*events_of(bench, happenings))
    with patch.object(feed, "_MAX_FRAMES", 10**9):
        whole, _ = MergedFeed([source], bench.tick_ns, longest_ns=100 * SECOND).batches()
    return Eventful(happenings, whole, answered(bench, one_by_one(whole)))


def test_the_eventful_flights_have_everything_in_them(eventful):
    said = b"".join(encoded for _, encoded in eventful.answers)
    for word in (
        b"CAMERA_SETTINGS",
        b"MOUNT_STATUS",
        b"rangefinder",
        b"terrain",
        b"home",
        b"UNHEALTHY",
        b"objects",
        b"mark-p",
    ):
        assert word in said, word
    assert b"all telemetry arrives" in said or not eventful.happenings.late_s
    assert len(eventful.answers) > 450
    assert len({now_ns for now_ns, _ in eventful.answers}) > 150


def test_all_ticks_may_be_taken_at_once(bench, eventful):
    append, sizes = PoseSource.append, []

    def noting(poses, ticks):
        shift_ns = append(poses, ticks)
        sizes.extend([ticks.count] * (shift_ns is not None))
        return shift_ns

    with patch.object(PoseSource, "append", noting):
        assert answered(bench, [eventful.batches]) == eventful.answers
    assert sizes.count(1) < 40 or eventful.happenings.has_companion  # whose frames take turns


@pytest.mark.parametrize("count", [2, *at_night(6)])
def test_it_does_not_matter_which_ticks_are_taken_together(bench, eventful, count):
    @settings(max_examples=count, deadline=None)
    @given(st.sets(st.integers(1, len(eventful.batches) - 1), max_size=60))
    def answers_are_the_same(cuts):
        assert answered(bench, cut_at(eventful.batches, cuts)) == eventful.answers

    answers_are_the_same()


@pytest.mark.nightly
def test_a_tick_that_cannot_be_taken_with_others_costs_only_those_next_to_it(bench):
    frames, images, seen = bench.events_of(30.0)
    batches, _ = bench.batches(*bench.blocks(frames), *images, *seen, idle_ticks_ns=SECOND)
    append, odd_ns, sizes = PoseSource.append, int(batches.now_ns[len(batches) // 3]), []

    def refusing(poses, ticks):
        arrivals_ns = np.concatenate([[0], *(track.arrival_ns for track in ticks.tracks)])
        is_odd = np.any((arrivals_ns > odd_ns - bench.tick_ns) & (arrivals_ns <= odd_ns))
        shift_ns = None if ticks.count > 1 and is_odd else append(poses, ticks)
        if shift_ns is not None:
            sizes.append(ticks.count)
        return shift_ns

    wanted = bench.encoded(bench.run(one_by_one(batches)))
    with patch.object(PoseSource, "append", refusing):
        assert bench.encoded(bench.run([batches])) == wanted
    assert sum(sizes) == len(batches)
    assert max(sizes) > len(batches) / 4
    assert sizes.count(1) < 30  # until clocks were known, and around the odd one


def test_sources_can_be_read_twice(bench, reference):
    source = bench.source(*bench.blocks(reference.frames), *reference.images, *reference.seen)
    merged = MergedFeed([source], bench.tick_ns)
    assert bench.encoded(bench.run(merged.batches())) == reference.answers
    assert bench.encoded(bench.run(merged.batches())) == reference.answers


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
    live = bench.run_events(*given_events, made=bench.pipeline(telemetry=telemetry), idle_ticks_ns=0)
    recorded = bench.run_events(*given_events, made=bench.pipeline(telemetry=telemetry), idle_ticks_ns=20 * SECOND)
    assert len(bench.poses(live)) == len(images)
    assert len(bench.measured(live, "width")) == len(seen)
    assert bench.encoded(live) == bench.encoded(recorded)
