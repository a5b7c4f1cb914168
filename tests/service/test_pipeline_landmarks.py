"""Landmarks in the pipeline: learned from in the order of their stamps, and used from the next stamp on."""

from dataclasses import replace

import pytest

from aerodft.adapters.telemetry.mavlink import MavlinkDecoder
from aerodft.model import CalibrationEstimate, PixelSource, Probe, ProbeKind, StampClock
from aerodft.service import Pipeline

from .learning import Counting

PIXEL = ((900.0, 500.0),)


@pytest.fixture
def counting():
    return Counting()


@pytest.fixture
def made(bench, counting):
    mark = Probe(name="mark-p", kind=ProbeKind.POSITION, source=PixelSource.OBSERVED)
    settings = replace(bench.settings, probes=(*bench.settings.probes, mark))
    return Pipeline(settings, MavlinkDecoder(), counting, counting)


def test_measurements_use_what_landmarks_taught_from_the_next_image_on(bench, made, counting):
    outputs = bench.run_events(
        *bench.blocks(bench.flight(3.0)),
        *[bench.image(k, 1_000 + 100 * k) for k in range(4)],
        *[bench.observation(1_000 + 100 * k, name="mark-a", pixels=PIXEL) for k in range(4)],
        made=made,
    )
    assert [m.calibration for m in bench.measured(outputs, "centre")] == ["0", "1", "2", "3"]
    assert [sample.calibration for sample in bench.poses(outputs)] == ["0", "1", "2", "3"]
    assert len(counting.asked) == 4


def test_what_waits_for_the_end_is_still_learned_from_in_order(bench, made, counting):
    """All at once, in the wrong order: each image uses the landmarks of those before it."""
    events = [bench.image(k, 2_900 + 10 * k) for k in range(3)]
    events += [bench.observation(2_900 + 10 * k, name="mark-a", pixels=PIXEL, late_ms=100 - 10 * k) for k in (2, 1, 0)]
    outputs = bench.run_events(*bench.blocks(bench.flight(2.8)), *events, made=made)
    assert [stamp_ns for stamp_ns, _ in counting.asked] == sorted(stamp_ns for stamp_ns, _ in counting.asked)
    assert len(counting.asked) == 3
    estimates = [item for item in outputs if isinstance(item, CalibrationEstimate)]
    assert [each.calibration for each in estimates] == ["1", "2", "3"]


def test_what_was_seen_by_the_hosts_clock_bears_its_images_stamp(bench, made, counting):
    """A faster message than any before comes between the image and what was seen in it: the clocks are known better."""
    image = bench.image(7, 1_000, clock=StampClock.HOST)
    seen = replace(
        bench.observation(1_000, name="mark-a", pixels=PIXEL, late_ms=300, image=7),
        stamp_ns=image.stamp_ns,
        clock=StampClock.HOST,
    )
    outputs = bench.run_events(*bench.blocks(bench.flight(3.0, gap_ms=(0, 300))), image, seen, made=made)
    (sample,) = bench.poses(outputs)
    assert [stamp_ns for stamp_ns, _ in counting.asked] == [sample.stamp_ns]


def test_the_landmarks_of_one_image_are_learned_from_at_once(bench, made, counting):
    bench.run_events(
        *bench.blocks(bench.flight(3.0)),
        *[bench.observation(1_000, name=f"mark-{name}", pixels=PIXEL) for name in "abc"],
        made=made,
    )
    assert [names for _, names in counting.asked] == [("mark-a", "mark-b", "mark-c")]


def test_a_landmark_that_comes_late_counts_from_then_on(bench, made, counting):
    outputs = bench.run_events(
        *bench.blocks(bench.flight(4.0)),
        *[bench.image(k, 1_000 + 200 * k) for k in range(6)],
        bench.observation(1_000, name="mark-a", pixels=PIXEL, late_ms=700),
        made=made,
    )
    assert len(counting.asked) == 1
    used = [m.calibration for m in bench.measured(outputs, "centre")]
    assert used == sorted(used)
    assert (used[0], used[2], used[-1]) == ("0", "0", "1")


def test_a_landmark_may_be_a_probe_as_well(bench, made, counting):
    outputs = bench.run_events(
        *bench.blocks(bench.flight(3.0)), bench.observation(1_000, name="mark-p", pixels=PIXEL), made=made
    )
    assert len(counting.asked) == 1
    assert [m.calibration for m in bench.measured(outputs, "mark-p")] == ["0"]


def test_a_landmark_has_one_pixel(bench, made, counting):
    bench.run_events(
        *bench.blocks(bench.flight(3.0)),
        bench.observation(1_000, name="mark-a", pixels=PIXEL * 2),
        bench.observation(1_100, name="else", pixels=PIXEL),
        made=made,
    )
    assert counting.asked == []
    assert (made.counts.wrong_pixel_count, made.counts.unknown_probe) == (1, 1)
