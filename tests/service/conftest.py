"""A bench for the pipeline: a flight as real MAVLink bytes, images and observations, and what comes of them."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry.mavlink import MavlinkDecoder
from aerodft.adapters.wire.events import encode_observation
from aerodft.adapters.wire.measurement import encode_measurements
from aerodft.adapters.wire.pose import encode_height_switch
from aerodft.adapters.wire.status import encode_estimate
from aerodft.model import (
    CalibrationEstimate,
    Camera,
    HeightSource,
    HeightSwitch,
    Image,
    Observation,
    PixelSource,
    Probe,
    ProbeKind,
    StampClock,
    WireProtocol,
)
from aerodft.service import (
    HeightSettings,
    MergedFeed,
    Pipeline,
    PipelineSettings,
    TelemetrySettings,
    block_of,
    first_arrival_ns,
)
from tests.answers import ImageAnswer, ObservationAnswer, answers_of, measurements_of
from tests.payloads import encode_pose

MS = 1_000_000
DOWN_60 = [math.cos(math.pi / 6), 0.0, -math.sin(math.pi / 6), 0.0]  # a gimbal pitch of -60 deg
SETTINGS = PipelineSettings(
    station="s",
    camera=Camera.from_fov(name="c", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.66),
    probes=(
        Probe(name="width", kind=ProbeKind.DISTANCE, source=PixelSource.OBSERVED, std_px=2.0),
        Probe(name="centre", kind=ProbeKind.RANGE, pixels=((959.5, 539.5),)),
    ),
    telemetry=TelemetrySettings(height=HeightSettings(order=(HeightSource.RANGEFINDER, HeightSource.HOME))),
    tick_ns=50 * MS,
)
ENCODERS = {
    ImageAnswer: lambda answer: (
        b"%d" % answer.image + encode_pose(answer.sample) + encode_measurements(answer.measurements)
    ),
    ObservationAnswer: lambda answer: encode_observation(answer.observation) + encode_measurements(answer.measurements),
    Observation: encode_observation,
    CalibrationEstimate: encode_estimate,
    HeightSwitch: encode_height_switch,
    list: encode_measurements,
}


class ListSource:
    def __init__(self, events):
        self._events = sorted(events, key=first_arrival_ns)

    def events(self):
        return iter(self._events)


@dataclass(frozen=True)
class Bench:
    """Makes input, and runs pipelines over it.

    Attributes:
        utc0_ns: The vehicle's UTC at power-on.
        host0_ns: This machine's clock at the same moment.
        settings: The pipeline's.
    """

    utc0_ns: int = 1_795_221_168_000_000_000
    host0_ns: int = 1_795_221_169_300_000_000
    settings: PipelineSettings = SETTINGS

    @property
    def tick_ns(self):
        return self.settings.tick_ns

    def flight(self, seconds, *, gap_ms=(0, 0)):
        """``(arrival, frame)`` of a flight at 50 m, gimbal at -60 deg, telemetry at 10 Hz, 20 to 100 ms on the link."""
        mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        frames = [(self.host0_ns, bytes(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(mav)))]
        for k, boot_ms in enumerate(range(0, int(seconds * 1000), 100)):
            if gap_ms[0] <= boot_ms < gap_ms[1]:
                continue
            messages = [
                dialect.MAVLink_system_time_message((self.utc0_ns // 1000) + boot_ms * 1000, boot_ms),
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
                arrival_ns = self.host0_ns + boot_ms * MS + (20 + 8 * (k % 11)) * MS + j * 100_000
                frames.append((arrival_ns, bytes(message.pack(mav))))
        return sorted(frames)

    def blocks(self, frames, cuts=None):
        """The frames as blocks, cut after every index in ``cuts``; None for one a frame."""
        edges = [0, *sorted(cuts), len(frames)] if cuts is not None else list(range(len(frames) + 1))
        parts = [frames[a:b] for a, b in pairwise(edges) if b > a]
        return [
            block_of(WireProtocol.MAVLINK, "udp", [at for at, _ in part], [raw for _, raw in part]) for part in parts
        ]

    def image(self, index, boot_ms, *, late_ms=0, clock=StampClock.UTC):
        base = self.utc0_ns if clock is StampClock.UTC else self.host0_ns
        return Image(
            index=index,
            stamp_ns=base + boot_ms * MS,
            arrival_ns=self.host0_ns + (boot_ms + late_ms) * MS,
            clock=clock,
            width_px=1920,
            height_px=1080,
        )

    def observation(self, boot_ms, *, name="width", late_ms=30, pixels=((600.0, 500.0), (1300.0, 520.0)), **rest):
        stamp_ns = self.utc0_ns + round(boot_ms * MS)
        return Observation(
            name=name, stamp_ns=stamp_ns, arrival_ns=self.host0_ns + (boot_ms + late_ms) * MS, pixels=pixels, **rest
        )

    def events_of(self, seconds=4.0, **kind):
        images = [self.image(k, 37 + 150 * k, late_ms=k % 4 * 20) for k in range(int(seconds / 0.15))]
        seen = [self.observation(37 + 150 * k, late_ms=11 * k) for k in range(0, len(images), 2)]
        return self.flight(seconds, **kind), images, seen

    def pipeline(self, **changes):
        return Pipeline(replace(self.settings, **changes), MavlinkDecoder())

    def encoded(self, answers):
        return [ENCODERS[type(each)](each) for each in answers]

    def source(self, *events):
        return ListSource(events)

    def poses(self, answers):
        return [each.sample for each in answers if isinstance(each, ImageAnswer)]

    def measured(self, answers, name):
        return [each for each in measurements_of(answers) if each.name == name]

    def run(self, steps, made=None):
        return answers_of(made or self.pipeline(), steps)

    def batches(self, *events, **feed):
        return MergedFeed([self.source(*events)], self.tick_ns, **feed).batches()

    def run_events(self, *events, made=None, **feed):
        return self.run(self.batches(*events, **feed), made)


@pytest.fixture(scope="session")
def bench():
    return Bench()
