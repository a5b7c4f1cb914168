"""The pipeline over real MAVLink bytes: the same answers however input is cut, and an answer to everything."""

import math
import struct
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.codec.events import encode_image, encode_observation
from aerodft.adapters.codec.measurement import encode_measurement
from aerodft.adapters.codec.pose import encode_pose
from aerodft.adapters.mavlink.decoding import MavlinkDecoder
from aerodft.dft.measure import Request
from aerodft.geometry.poses import camera_pose
from aerodft.model.batch import Batch
from aerodft.model.calibration import Calibration
from aerodft.model.camera import Camera
from aerodft.model.image import Image, StampClock
from aerodft.model.measurement import Measurement
from aerodft.model.observation import Observation
from aerodft.model.pose import HeightSource, PoseSample
from aerodft.model.probe import PixelSource, Probe, ProbeKind
from aerodft.model.status import Status
from aerodft.model.telemetry import WireProtocol
from aerodft.service.feed import MergedFeed, batch_of, block_of, first_arrival_ns, tick_after
from aerodft.service.pipeline import Pipeline
from aerodft.service.settings import HeightSettings, PipelineSettings, TelemetrySettings
from calibration.biases import BiasCalibrator

MS, SECOND = 1_000_000, 1_000_000_000
UTC0 = 1_795_221_168 * SECOND
HOST0 = UTC0 + 1_300 * MS
TICK = 50 * MS
CAMERA = Camera.from_fov(name="c", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.66)
WIDTH = Probe(name="width", kind=ProbeKind.DISTANCE, source=PixelSource.OBSERVED, std_px=2.0)
CENTRE = Probe(name="centre", kind=ProbeKind.RANGE, pixels=((959.5, 539.5),))
SETTINGS = PipelineSettings(
    station="s",
    camera=CAMERA,
    probes=(WIDTH, CENTRE),
    telemetry=TelemetrySettings(height=HeightSettings(order=(HeightSource.RANGEFINDER, HeightSource.HOME))),
    tick_ns=TICK,
)
DOWN_60 = [math.cos(math.pi / 6), 0.0, -math.sin(math.pi / 6), 0.0]  # a gimbal pitch of -60 deg


class ListSource:
    def __init__(self, events):
        self._events = sorted(events, key=first_arrival_ns)

    def events(self):
        return iter(self._events)


def flight(seconds, *, gap_ms=(0, 0)):
    """``(arrival, frame)`` of a flight at 50 m, gimbal at -60 deg, telemetry at 10 Hz, 20 to 100 ms on the link."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    frames = [(HOST0, bytes(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(mav)))]
    for k, boot_ms in enumerate(range(0, int(seconds * 1000), 100)):
        if gap_ms[0] <= boot_ms < gap_ms[1]:
            continue
        messages = [
            dialect.MAVLink_system_time_message((UTC0 // 1000) + boot_ms * 1000, boot_ms),
            dialect.MAVLink_attitude_message(boot_ms, 0.02, -0.1 + 0.01 * math.sin(k), 0.5 + 0.01 * k, 0, 0, 0),
            dialect.MAVLink_global_position_int_message(
                boot_ms, -353_600_000 + 30 * k, 1_491_600_000, 634_000 + 10 * k, 50_000 + 10 * k, 0, 0, 0, 0
            ),
            dialect.MAVLink_gimbal_device_attitude_status_message(
                0, 0, boot_ms, 44, DOWN_60, math.nan, math.nan, math.nan, 0
            ),
            dialect.MAVLink_distance_sensor_message(boot_ms, 20, 10_000, 5_000 + k, 0, 0, 25, 0),
        ]
        for j, message in enumerate(messages):
            arrival_ns = HOST0 + boot_ms * MS + (20 + 8 * (k % 11)) * MS + j * 100_000
            frames.append((arrival_ns, bytes(message.pack(mav))))
    return sorted(frames)


def blocks(frames, cuts=None):
    """The frames as blocks, cut after every index in ``cuts``; None for one a frame."""
    edges = [0, *sorted(cuts), len(frames)] if cuts is not None else list(range(len(frames) + 1))
    parts = [frames[a:b] for a, b in pairwise(edges) if b > a]
    return [block_of(WireProtocol.MAVLINK, "udp", [at for at, _ in part], [raw for _, raw in part]) for part in parts]


def image(index, boot_ms, *, late_ms=0, clock=StampClock.UTC):
    base = UTC0 if clock is StampClock.UTC else HOST0
    return Image(
        index=index,
        stamp_ns=base + boot_ms * MS,
        arrival_ns=HOST0 + (boot_ms + late_ms) * MS,
        clock=clock,
        width_px=1920,
        height_px=1080,
    )


def observation(boot_ms, *, name="width", late_ms=30, pixels=((600.0, 500.0), (1300.0, 520.0)), **rest):
    stamp_ns = UTC0 + round(boot_ms * MS)
    return Observation(name=name, stamp_ns=stamp_ns, arrival_ns=HOST0 + (boot_ms + late_ms) * MS, pixels=pixels, **rest)


def events_of(seconds=4.0, **kind):
    images = [image(k, 37 + 150 * k, late_ms=k % 4 * 20) for k in range(int(seconds / 0.15))]
    seen = [observation(37 + 150 * k, late_ms=11 * k) for k in range(0, len(images), 2)]
    return flight(seconds, **kind), images, seen


def pipeline(**changes):
    return Pipeline(replace(SETTINGS, **changes), MavlinkDecoder())


def encoded(outputs):
    encoders = {
        Measurement: encode_measurement,
        PoseSample: encode_pose,
        Image: encode_image,
        Observation: encode_observation,
    }
    return [encoders[type(item)](item) for item in outputs]


def run(batches, made=None):
    made = made or pipeline()
    outputs = []
    for batch in batches:
        outputs += made.step(batch)
    return [*outputs, *made.finish()]


def run_events(*events, made=None, **feed):
    return run(MergedFeed([ListSource(events)], TICK, **feed).batches(), made)


def poses_of(outputs):
    return [item for item in outputs if isinstance(item, PoseSample)]


def of(outputs, name):
    return [item for item in outputs if isinstance(item, Measurement) and item.name == name]


FRAMES, IMAGES, SEEN = events_of(gap_ms=(1_900, 3_300))
REFERENCE = encoded(run_events(*blocks(FRAMES), *IMAGES, *SEEN))


def test_the_reference_flight_has_answers_and_gaps():
    outputs = run_events(*blocks(FRAMES), *IMAGES, *SEEN)
    statuses = [sample.status for sample in poses_of(outputs)]
    assert len(statuses) == len(IMAGES)
    assert {status: statuses.count(status) for status in set(statuses)} == {
        Status.OK: 16,
        Status.STALE_TELEMETRY: 10,  # 1.8 s to 3.3 s: longer than an attitude is interpolated over
    }
    assert len(of(outputs, "width")) == len(SEEN)
    assert len(of(outputs, "centre")) == len(IMAGES)


@settings(max_examples=25, deadline=None)
@given(st.sets(st.integers(1, len(FRAMES) - 1)))
def test_it_does_not_matter_how_frames_are_cut_into_blocks(cuts):
    assert encoded(run_events(*blocks(FRAMES, cuts), *IMAGES, *SEEN)) == REFERENCE


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 3 * SECOND), st.floats(0.0, 1.0))
def test_it_does_not_matter_which_empty_ticks_come(linger_ns, share):
    """A live run has every empty tick, a recording has some: the ones within ``linger_ns`` of an event, or fewer."""
    rng = np.random.default_rng(7)
    feed = MergedFeed([ListSource([*blocks(FRAMES), *IMAGES, *SEEN])], TICK, linger_ns=linger_ns)
    batches = [b for b in feed.batches() if b.raw or b.images or b.observations or rng.random() < share]
    assert encoded(run(batches)) == REFERENCE


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 40), st.integers(1, 30), st.integers(0, 2_500))
def test_sparse_input_does_not_depend_on_empty_ticks_either(silence_at, silence, wait_ms):
    """Silences, short and long waits: whole seconds pass in which only deadlines happen."""
    start_ms, stop_ms = 100 * silence_at, 100 * (silence_at + silence)
    frames, images, seen = events_of(4.0, gap_ms=(start_ms, stop_ms))
    images, seen = images[:: 1 + silence % 5], seen[:: 1 + silence_at % 3]
    telemetry = replace(SETTINGS.telemetry, wait_ns=wait_ms * MS)
    events = (*blocks(frames), *images, *seen)
    every = run_events(*events, made=pipeline(telemetry=telemetry), linger_ns=20 * SECOND)
    none = run_events(*events, made=pipeline(telemetry=telemetry), linger_ns=0)
    assert encoded(every) == encoded(none)


def test_sources_can_be_read_twice():
    source = ListSource([*blocks(FRAMES), *IMAGES, *SEEN])
    feed = MergedFeed([source], TICK)
    assert encoded(run(feed.batches())) == REFERENCE
    assert encoded(run(feed.batches())) == REFERENCE


def test_an_image_before_its_telemetry_waits_for_it():
    made = pipeline()
    early, frames = image(0, 1_050), flight(1.5)
    batches = MergedFeed([ListSource(blocks(frames))], TICK).batches()
    arrived_at = tick_after(early.arrival_ns, TICK)
    answered_at = None
    for batch in batches:
        outputs = made.step(replace(batch, images=(early,)) if batch.now_ns == arrived_at else batch)
        if poses_of(outputs):
            assert answered_at is None
            answered_at = batch.now_ns
            assert poses_of(outputs)[0].status is Status.OK
    needed = max(at for at, raw in frames if boot_ms_of(raw) == 1_100)
    assert answered_at == tick_after(needed, TICK)


def boot_ms_of(frame):
    return getattr(dialect.MAVLink(None).parse_char(frame), "time_boot_ms", None)


def test_an_image_is_given_up_at_its_deadline_and_not_before():
    made = pipeline()
    lost = image(0, 5_000)
    run_batches = list(MergedFeed([ListSource(blocks(flight(1.0)))], TICK, linger_ns=0).batches())
    for batch in run_batches:
        made.step(batch)
    now_ns = tick_after(lost.arrival_ns, TICK)
    deadline_ns = tick_after(lost.arrival_ns + 2 * SECOND, TICK)
    assert made.step(Batch(now_ns=now_ns, images=(lost,))) == ()
    while now_ns < deadline_ns - TICK:
        now_ns += TICK
        assert made.step(Batch(now_ns=now_ns)) == ()
    outputs = made.step(Batch(now_ns=deadline_ns))
    assert [sample.status for sample in poses_of(outputs)] == [Status.STALE_TELEMETRY]
    assert [(m.status, m.value) for m in of(outputs, "centre")] == [(Status.STALE_TELEMETRY, None)]
    assert made.finish() == ()


def test_finish_answers_everything_that_waits():
    made = pipeline()
    made.step(Batch(now_ns=tick_after(HOST0 + SECOND, TICK), images=(image(0, 900), image(1, 950))))
    outputs = made.finish()
    assert [sample.status for sample in poses_of(outputs)] == [Status.NO_TELEMETRY] * 2
    assert made.finish() == ()


def test_without_waiting_every_image_is_answered_in_its_own_tick():
    impatient = pipeline(telemetry=replace(SETTINGS.telemetry, wait_ns=0))
    outputs = run_events(*blocks(flight(2.0)), image(0, 1_000, late_ms=20), made=impatient)
    assert len(poses_of(outputs)) == 1


def test_an_observation_is_linked_to_the_image_that_was_looked_at():
    outputs = run_events(
        *blocks(flight(3.0)),
        *[image(k, 1_000 + 40 * k) for k in range(10)],
        observation(1_120),
        observation(1_161.9),
        observation(1_200, image=77),
        observation(2_000),
    )
    linked = [item.image for item in outputs if isinstance(item, Observation)]
    assert linked == [3, 4, 77, None]
    assert [m.image for m in of(outputs, "width")] == linked


def test_an_observations_own_std_counts_else_the_probes():
    outputs = run_events(*blocks(flight(3.0)), observation(1_100), observation(1_200, std_px=0.25))
    assert [m.std_px for m in of(outputs, "width")] == [2.0, 0.25]


def test_what_cannot_be_used_is_counted():
    made = pipeline()
    outputs = run_events(
        *blocks(flight(3.0)),
        observation(1_100, name="who"),
        observation(1_150, name="centre", pixels=((1.0, 1.0),)),  # a fixed probe is not observed
        observation(1_200, pixels=((1.0, 1.0),)),
        observation(1_300),
        image(0, 1_000),
        made=made,
    )
    counts = made.counts
    assert (counts.images, counts.observations, counts.unknown_probe, counts.wrong_pixel_count) == (1, 4, 2, 1)
    assert len(of(outputs, "width")) == 1


def test_host_stamps_are_looked_up_on_the_vehicles_clock():
    """A stamp of this machine's clock is the vehicle's UTC plus the clocks' difference and the fastest link."""
    outputs = run_events(*blocks(flight(3.0)), image(0, 2_000, clock=StampClock.HOST))
    (taken,) = [item for item in outputs if isinstance(item, Image)]
    assert taken.clock is StampClock.UTC
    assert abs(taken.stamp_ns - (UTC0 + 2_000 * MS - 20 * MS)) < 2 * MS


def test_the_numbers_are_those_of_the_flight():
    outputs = run_events(*blocks(flight(3.0)), image(0, 1_050))
    (sample,) = poses_of(outputs)
    k, pitch = 10.5, -0.1 + 0.01 * (math.sin(10) + math.sin(11)) / 2
    slant_m = 50.0 + 0.01 * k
    height_m = slant_m * math.cos(0.02) * math.cos(pitch)
    assert sample.height_source is HeightSource.RANGEFINDER
    assert sample.pose.position_enu_m[2] == pytest.approx(height_m, abs=1e-4)
    (centre,) = of(outputs, "centre")
    assert centre.value == pytest.approx(height_m / math.cos(math.radians(30.0)), abs=1e-4)
    assert (centre.stamp_ns, centre.image, centre.config) == (UTC0 + 1_050 * MS, 0, None)


def test_the_calibrator_corrects_every_pose():
    calibrator = BiasCalibrator(Calibration(id="sha256:c", height_bias_m=-5.0))
    made = Pipeline(SETTINGS, MavlinkDecoder(), calibrator)
    plain = run_events(*blocks(flight(3.0)), image(0, 1_050))
    better = run_events(*blocks(flight(3.0)), image(0, 1_050), made=made)
    difference = poses_of(plain)[0].pose.position_enu_m - poses_of(better)[0].pose.position_enu_m
    np.testing.assert_allclose(difference, [0.0, 0.0, 5.0], atol=1e-9)
    assert of(better, "centre")[0].calibration == "sha256:c"


def test_a_fixed_camera_needs_no_telemetry():
    fixed = PoseSample(stamp_ns=0, status=Status.OK, pose=camera_pose(height_agl_m=10.0, tilt_rad=math.radians(60.0)))
    made = pipeline(telemetry=None, fixed_pose=fixed)
    outputs = run_events(image(0, 100), image(1, 200), made=made)
    assert [m.value for m in of(outputs, "centre")] == pytest.approx([20.0, 20.0])
    assert [sample.stamp_ns for sample in poses_of(outputs)] == [UTC0 + 100 * MS, UTC0 + 200 * MS]
    request = Request(probe=CENTRE, pixels=CENTRE.pixels, std_px=1.0)
    assert made.measure_at([request], UTC0)[0].value == pytest.approx(20.0)


def test_questions_are_answered_at_the_newest_pose_or_at_a_stamp():
    made = pipeline()
    request = Request(probe=CENTRE, pixels=CENTRE.pixels, std_px=1.0)
    (too_early,) = made.measure_at([request])
    assert (too_early.status, too_early.reasons) == (Status.NO_TELEMETRY, ("no image has been measured yet",))
    outputs = run_events(*blocks(flight(3.0)), image(0, 1_050), made=made)
    (newest,) = made.measure_at([request])
    assert newest.value == of(outputs, "centre")[0].value
    (asked,) = made.measure_at([request], UTC0 + 2_050 * MS)
    assert asked.stamp_ns == UTC0 + 2_050 * MS
    assert asked.value != newest.value
    assert made.pose_at(UTC0 + 60 * SECOND).status is Status.STALE_TELEMETRY


@settings(max_examples=15, deadline=None)
@given(st.binary(min_size=1, max_size=60), st.integers(1, len(FRAMES) - 1))
def test_noise_between_frames_changes_no_answer(noise, at):
    """What the framer would never pass on does no harm if it comes all the same."""
    junk = (FRAMES[at][0], struct.pack("<B", 0xFD) + noise)
    outputs = run_events(*blocks([*FRAMES[:at], junk, *FRAMES[at:]]), *IMAGES, *SEEN)
    assert encoded(outputs) == REFERENCE


def test_a_batch_is_the_same_whatever_order_its_events_are_given_in():
    now_ns = tick_after(HOST0 + 100 * MS, TICK)
    events = [*blocks(FRAMES[:8]), image(0, 60), image(1, 70), observation(60, late_ms=0)]
    one, two = batch_of(now_ns, events), batch_of(now_ns, events[::-1])
    assert [shot.index for shot in one.images] == [shot.index for shot in two.images]
    assert frames_of(one.raw[0]) == frames_of(two.raw[0]) == [raw for _, raw in FRAMES[:8]]


def frames_of(block):
    spans = zip(block.offset, block.length, strict=True)
    return [block.data[start : start + size] for start, size in spans]
