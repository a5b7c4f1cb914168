"""The pipeline over real MAVLink bytes: waiting, deadlines, links, counts and numbers."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry.mavlink import MavlinkDecoder
from aerodft.dft import PROBE_KINDS, Request
from aerodft.dft.monte_carlo import standard_draws
from aerodft.geometry import camera_pose
from aerodft.model import (
    BiasValues,
    Calibration,
    HeightSource,
    HeightSwitch,
    PoseSample,
    Probe,
    ProbeKind,
    StampClock,
    Status,
)
from aerodft.service import Batches, Pipeline
from aerodft.service.batches import tick_after
from calibration.flight import BiasCalibrator
from tests.answers import ImageAnswer, ObservationAnswer, in_order, timed
from tests.batches import one_tick

MS, SECOND = 1_000_000, 1_000_000_000
CENTRE = Probe(name="centre", kind=ProbeKind.RANGE, pixels=((959.5, 539.5),))


def test_what_draws_errors_is_loaded_before_a_flight(bench):
    standard_draws.cache_clear()
    bench.pipeline().warm_up()
    pixels = {takes for kind in PROBE_KINDS.values() for takes in range(1, 4) if kind.takes_pixels(takes)}
    assert standard_draws.cache_info().currsize == len(pixels)


def test_an_image_before_its_telemetry_waits_for_it(bench):
    early, frames = bench.image(0, 1_050), bench.flight(1.5)
    batches = bench.batches(*bench.blocks(frames), early, longest_ns=0)
    ((answered_at, answer),) = timed(bench.pipeline(), batches)
    assert answer.sample.status is Status.OK
    needed = max(at for at, raw in frames if boot_ms_of(raw) == 1_100)
    assert answered_at == tick_after(needed, bench.tick_ns) > tick_after(early.arrival_ns, bench.tick_ns)


def boot_ms_of(frame):
    return getattr(dialect.MAVLink(None).parse_char(frame), "time_boot_ms", None)


def test_an_image_is_given_up_at_its_deadline_and_not_before(bench):
    made = bench.pipeline()
    lost = bench.image(0, 5_000)
    for batches in bench.batches(*bench.blocks(bench.flight(1.0)), idle_ticks_ns=0):
        made.advance(batches)
    now_ns = tick_after(lost.arrival_ns, bench.tick_ns)
    deadline_ns = tick_after(lost.arrival_ns + 2 * SECOND, bench.tick_ns)
    assert in_order(made.advance(one_tick(now_ns, [lost]))) == []
    while now_ns < deadline_ns - bench.tick_ns:
        now_ns += bench.tick_ns
        assert in_order(made.advance(one_tick(now_ns, []))) == []
    answers = [answer for _, answer in in_order(made.advance(one_tick(deadline_ns, [])))]
    assert [sample.status for sample in bench.poses(answers)] == [Status.STALE_TELEMETRY]
    assert [(m.status, m.value) for m in bench.measured(answers, "centre")] == [(Status.STALE_TELEMETRY, None)]
    assert in_order(made.finish()) == []


def test_finish_answers_everything_that_waits(bench):
    made = bench.pipeline()
    now_ns = tick_after(bench.host0_ns + SECOND, bench.tick_ns)
    made.advance(one_tick(now_ns, [bench.image(0, 900), bench.image(1, 950)]))
    answers = [answer for _, answer in in_order(made.finish())]
    assert [sample.status for sample in bench.poses(answers)] == [Status.NO_TELEMETRY] * 2
    assert in_order(made.finish()) == []


def test_without_waiting_every_image_is_answered_in_its_own_tick(bench):
    impatient = bench.pipeline(telemetry=replace(bench.settings.telemetry, wait_ns=0))
    outputs = bench.run_events(*bench.blocks(bench.flight(2.0)), bench.image(0, 1_000, late_ms=20), made=impatient)
    assert len(bench.poses(outputs)) == 1


def test_an_observation_is_linked_to_the_image_that_was_looked_at(bench):
    outputs = bench.run_events(
        *bench.blocks(bench.flight(3.0)),
        *[bench.image(k, 1_000 + 40 * k) for k in range(10)],
        bench.observation(1_120),
        bench.observation(1_161.9),
        bench.observation(1_200, image=77),
        bench.observation(2_000),
    )
    linked = [item.observation.image for item in outputs if isinstance(item, ObservationAnswer)]
    assert linked == [3, 4, 77, None]
    assert [m.image for m in bench.measured(outputs, "width")] == linked


def test_an_observation_that_is_faster_than_its_image_waits_for_it(bench):
    images = [bench.image(0, 500), *(bench.image(k, 1_000 + 40 * k, late_ms=400) for k in range(1, 5))]
    outputs = bench.run_events(*bench.blocks(bench.flight(3.0)), *images, bench.observation(1_120, late_ms=200))
    assert [m.image for m in bench.measured(outputs, "width")] == [3]


def test_an_observations_own_std_counts_else_the_probes(bench):
    outputs = bench.run_events(
        *bench.blocks(bench.flight(3.0)), bench.observation(1_100), bench.observation(1_200, std_px=0.25)
    )
    assert [m.std_px for m in bench.measured(outputs, "width")] == [2.0, 0.25]


def test_what_cannot_be_used_is_counted(bench):
    made = bench.pipeline()
    outputs = bench.run_events(
        *bench.blocks(bench.flight(3.0)),
        bench.observation(1_100, name="who"),
        bench.observation(1_150, name="centre", pixels=((1.0, 1.0),)),  # a fixed probe is not observed
        bench.observation(1_200, pixels=((1.0, 1.0),)),
        bench.observation(1_300),
        bench.image(0, 1_000),
        made=made,
    )
    counts = made.counts
    assert (counts.images, counts.observations, counts.unknown_probe, counts.wrong_pixel_count) == (1, 4, 2, 1)
    assert len(bench.measured(outputs, "width")) == 1


def test_host_stamps_are_looked_up_on_the_vehicles_clock(bench):
    """A stamp of this machine's clock is the vehicle's UTC plus the clocks' difference and the fastest link."""
    outputs = bench.run_events(*bench.blocks(bench.flight(3.0)), bench.image(0, 2_000, clock=StampClock.HOST))
    (taken,) = bench.poses(outputs)
    assert abs(taken.stamp_ns - (bench.utc0_ns + 2_000 * MS - 20 * MS)) < 2 * MS


def test_the_numbers_are_those_of_the_flight(bench):
    outputs = bench.run_events(*bench.blocks(bench.flight(3.0)), bench.image(0, 1_050))
    (sample,) = bench.poses(outputs)
    ends_m = [(50.0 + 0.01 * end) * math.cos(0.02) * math.cos(-0.1 + 0.01 * math.sin(end)) for end in (10, 11)]
    height_m = sum(ends_m) / 2
    assert sample.height_source == HeightSource.RANGEFINDER
    assert sample.pose.position_enu_m[2] == pytest.approx(height_m, abs=1e-4)
    (centre,) = bench.measured(outputs, "centre")
    assert centre.value == pytest.approx(height_m / math.cos(math.radians(30.0)), abs=1e-4)
    assert (centre.stamp_ns, centre.image, centre.config) == (bench.utc0_ns + 1_050 * MS, 0, None)


def test_the_calibrator_corrects_every_pose(bench):
    calibrator = BiasCalibrator(Calibration(id="sha256:c", bias=BiasValues(height_m=-5.0)))
    made = Pipeline(bench.settings, MavlinkDecoder(), calibrator)
    plain = bench.run_events(*bench.blocks(bench.flight(3.0)), bench.image(0, 1_050))
    better = bench.run_events(*bench.blocks(bench.flight(3.0)), bench.image(0, 1_050), made=made)
    difference = bench.poses(plain)[0].pose.position_enu_m - bench.poses(better)[0].pose.position_enu_m
    np.testing.assert_allclose(difference, [0.0, 0.0, 5.0], atol=1e-9)
    assert bench.measured(better, "centre")[0].calibration == "sha256:c"


def test_a_fixed_camera_needs_no_telemetry(bench):
    fixed = PoseSample(stamp_ns=0, status=Status.OK, pose=camera_pose(height_agl_m=10.0, tilt_rad=math.radians(60.0)))
    made = bench.pipeline(telemetry=None, fixed_pose=fixed)
    outputs = bench.run_events(bench.image(0, 100), bench.image(1, 200), made=made)
    assert [m.value for m in bench.measured(outputs, "centre")] == pytest.approx([20.0, 20.0])
    assert [sample.stamp_ns for sample in bench.poses(outputs)] == [bench.utc0_ns + 100 * MS, bench.utc0_ns + 200 * MS]
    request = Request(probe=CENTRE, pixels=CENTRE.pixels, std_px=1.0)
    assert made.measure_at([request], bench.utc0_ns)[0].value == pytest.approx(20.0)


def test_questions_are_answered_at_the_newest_pose_or_at_a_stamp(bench):
    made = bench.pipeline()
    request = Request(probe=CENTRE, pixels=CENTRE.pixels, std_px=1.0)
    (too_early,) = made.measure_at([request])
    assert (too_early.status, too_early.reasons) == (Status.NO_TELEMETRY, ("no image has been measured yet",))
    outputs = bench.run_events(*bench.blocks(bench.flight(3.0)), bench.image(0, 1_050), made=made)
    (newest,) = made.measure_at([request])
    assert newest.value == bench.measured(outputs, "centre")[0].value
    (asked,) = made.measure_at([request], bench.utc0_ns + 2_050 * MS)
    assert asked.stamp_ns == bench.utc0_ns + 2_050 * MS
    assert asked.value != newest.value
    assert made.pose_at(bench.utc0_ns + 60 * SECOND).status is Status.STALE_TELEMETRY


def test_a_batch_is_the_same_whatever_order_its_events_are_given_in(bench):
    now_ns = tick_after(bench.host0_ns + 100 * MS, bench.tick_ns)
    frames = bench.flight(1.0)[:8]
    events = [*bench.blocks(frames), bench.image(0, 60), bench.image(1, 70), bench.observation(60, late_ms=0)]
    one, two = (Batches.from_events(np.array([now_ns]), given) for given in (events, events[::-1]))
    assert [shot.index for shot in one.images] == [shot.index for shot in two.images]
    assert frames_of(one.raw[0]) == frames_of(two.raw[0]) == [raw for _, raw in frames]


def frames_of(block):
    spans = zip(block.offset, block.length, strict=True)
    return [block.data[start : start + size] for start, size in spans]


def test_a_switch_of_the_heights_source_is_an_event_with_its_step(bench):
    """The rangefinder (50 m, slant on a vehicle that leans) falls silent; home-relative heights say 50 m too."""
    silent_ns, distance_sensor = bench.host0_ns + 2_000 * MS, b"\x84\x00\x00"
    frames = [(at, raw) for at, raw in bench.flight(6.0) if raw[7:10] != distance_sensor or at < silent_ns]
    images = [bench.image(k, 500 * k + 40) for k in range(11)]
    outputs = bench.run_events(*bench.blocks(frames), *images)
    (switch,) = [item for item in outputs if isinstance(item, HeightSwitch)]
    sources = [sample.height_source for sample in bench.poses(outputs) if sample.height_source]
    assert sources == sorted(sources, key=lambda source: source == HeightSource.HOME)
    first = next(sample for sample in bench.poses(outputs) if sample.height_source == HeightSource.HOME)
    assert (switch.stamp_ns, switch.before, switch.after) == (
        first.stamp_ns,
        HeightSource.RANGEFINDER,
        HeightSource.HOME,
    )
    k = (switch.step.stamp_ns - bench.utc0_ns) // (100 * MS)
    slant_m, home_m = 50.0 + 0.01 * k, 50.0 + 0.01 * k
    leaning = math.cos(0.02) * math.cos(-0.1 + 0.01 * math.sin(k))
    assert switch.step.step_m == pytest.approx(home_m - slant_m * leaning, abs=1e-4)
    (later,) = [k for k, item in enumerate(outputs) if isinstance(item, ImageAnswer) and item.sample is first]
    assert outputs.index(switch) + 1 == later
