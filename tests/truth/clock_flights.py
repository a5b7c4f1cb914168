"""Flights north at 10 m/s as real MAVLink frames, with clocks that drift, jump, wrap and begin anew: time is place.

A vehicle's latitude tells when it was there: a pose that is 1 ms off in time is 1 cm off in place.
"""

import math
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry.mavlink import MavlinkDecoder
from aerodft.model import Camera, HeightSource, Image, PoseSample, StampClock, WireProtocol
from aerodft.service import (
    HeightSettings,
    MergedFeed,
    Pipeline,
    PipelineSettings,
    TelemetrySettings,
    block_of,
    first_arrival_ns,
)
from aerodft.service.clocks import ClockMap, Ticks
from tests.answers import ImageAnswer, answers_of, one_by_one

MS, SECOND = 1_000_000, 1_000_000_000
UTC0 = 1_795_221_168 * SECOND
SPEED_MPS = 10.0
WRAP_MS = 1 << 32
DEGE7_PER_M = 1e7 / 110_922.0  # near enough: places are compared with those of messages
SETTINGS = PipelineSettings(
    station="s",
    camera=Camera.from_fov(name="c", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.66),
    probes=(),
    telemetry=TelemetrySettings(height=HeightSettings(order=(HeightSource.HOME,))),
)


@dataclass(frozen=True, kw_only=True)
class Clocks:
    """What the clocks do, by true seconds since the flight's start.

    Attributes:
        booted_s: Time since boot at the start.
        boot_drift: Seconds that time since boot gains per second.
        host_ahead_s: This machine's clock minus UTC at the start.
        host_drift: Seconds that it gains per second.
        utc_wrong_s: The vehicle's UTC minus the true one, before ``utc_right_at_s``.
        utc_right_at_s: When that is set right; 0 for never wrong.
        utc_known_at_s: Before, SYSTEM_TIME has no UTC.
        reboot_at_s: Time since boot begins anew; the vehicle is silent for two seconds. None for never.
        delay_s: Mean of an exponential delay beside the least one of 20 ms.
        rival_booted_s: A second autopilot with the same ids flies 1 km farther east, up for so long. None for none.
        seed: Of the delays.
    """

    booted_s: float = 60.0
    boot_drift: float = 0.0
    host_ahead_s: float = 0.0
    host_drift: float = 0.0
    utc_wrong_s: float = 0.0
    utc_right_at_s: float = 0.0
    utc_known_at_s: float = 0.0
    reboot_at_s: float | None = None
    delay_s: float = 0.01
    rival_booted_s: float | None = None
    seed: int = 1

    def boot_ms(self, true_s):
        """Time since boot as a message says it."""
        if self.reboot_at_s is not None and true_s >= self.reboot_at_s:
            return math.floor((true_s - self.reboot_at_s) * 1000)
        return math.floor((self.booted_s + true_s * (1 + self.boot_drift)) * 1000) % WRAP_MS

    def host_ns(self, true_s):
        """This machine's clock."""
        return UTC0 + round((self.host_ahead_s + true_s * (1 + self.host_drift)) * SECOND)

    def utc_us(self, true_s):
        """The vehicle's UTC as it says it."""
        if true_s < self.utc_known_at_s:
            return 0
        wrong_s = self.utc_wrong_s if true_s < self.utc_right_at_s else 0.0
        return round((UTC0 / SECOND + true_s + wrong_s) * 1e6)


@dataclass(frozen=True)
class Taken:
    """A pose, when its image was truly taken, and how far off in time it is by its place."""

    sample: PoseSample
    true_s: float
    off_s: float = field(default=math.nan)


def flown(clocks, seconds, *, by=StampClock.UTC, rate_hz=10.0, image_hz=4.0, rest=0.37, wait_s=2.0):
    """The poses of a flight's images, and the clocks' health as a decoder and a map of their own say when asked."""
    events = [*_frames(clocks, seconds, rate_hz), *_images(clocks, seconds, by, image_hz, rest)]
    assert SETTINGS.telemetry is not None
    telemetry = replace(SETTINGS.telemetry, wait_ns=round(wait_s * SECOND))
    pipeline = Pipeline(replace(SETTINGS, telemetry=telemetry), MavlinkDecoder())
    steps = list(MergedFeed([_List(events)], 50 * MS).batches())
    samples = [answer.sample for answer in answers_of(pipeline, steps) if isinstance(answer, ImageAnswer)]
    blocks = [block for step in steps for tick in one_by_one(step) for block in tick.raw]
    times_s = [(k + rest) / image_hz for k in range(len(samples))]
    return [_taken(sample, true_s) for sample, true_s in zip(samples, times_s, strict=True)], partial(_health, blocks)


def _health(blocks):
    decoder, clock = MavlinkDecoder(), ClockMap()
    for block in blocks:
        clock.update(Ticks.one(decoder.decode(block)))
    return clock.health


def _taken(sample, true_s):
    if sample.lat_rad is None:
        return Taken(sample, true_s)
    here_m = (math.degrees(sample.lat_rad) * 1e7 + 353_600_000) / DEGE7_PER_M
    return Taken(sample, true_s, here_m / SPEED_MPS - true_s)


class _List:
    def __init__(self, events):
        self._events = sorted(events, key=first_arrival_ns)

    def events(self):
        return iter(self._events)


def _images(clocks, seconds, by, image_hz, rest):
    for k in range(int(seconds * image_hz)):
        true_s = (k + rest) / image_hz
        stamp_ns = UTC0 + round(true_s * SECOND) if by is StampClock.UTC else clocks.host_ns(true_s)
        arrival_ns = clocks.host_ns(true_s + 0.1)
        yield Image(index=k, stamp_ns=stamp_ns, arrival_ns=arrival_ns, clock=by, width_px=1920, height_px=1080)


def _frames(clocks, seconds, rate_hz):
    rng = np.random.default_rng(clocks.seed)
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    arrived_s, frames = 0.0, []
    for k in range(int(seconds * rate_hz)):
        true_s = k / rate_hz
        if clocks.reboot_at_s is not None and 0 <= true_s - clocks.reboot_at_s < 2:
            continue
        arrived_s = max(arrived_s, true_s + 0.02 + rng.exponential(clocks.delay_s))
        messages = _messages(clocks.boot_ms(true_s), clocks.utc_us(true_s), true_s, east_m=0.0, k=k)
        if clocks.rival_booted_s is not None:
            boot_ms = math.floor((clocks.rival_booted_s + true_s) * 1000)
            messages += _messages(boot_ms, clocks.utc_us(true_s), true_s, east_m=1000.0, k=k)
        for j, message in enumerate(messages):
            arrival_ns = clocks.host_ns(arrived_s) + j * 10_000
            frames.append(block_of(WireProtocol.MAVLINK, "udp", [arrival_ns], [bytes(message.pack(mav))]))
    return frames


def _messages(boot_ms, utc_us, true_s, *, east_m, k):
    lat = -353_600_000 + round(SPEED_MPS * true_s * DEGE7_PER_M)
    lon = 1_491_600_000 + round(east_m * DEGE7_PER_M)
    down = [math.cos(math.pi / 6), 0.0, -math.sin(math.pi / 6), 0.0]
    messages = [
        dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.5, 0, 0, 0),
        dialect.MAVLink_global_position_int_message(boot_ms, lat, lon, 634_000, 50_000, 0, 0, 0, 0),
        dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, boot_ms, 44, down, 0, 0, 0, 0),
    ]
    if k % 10 == 0:
        messages.append(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
        messages.append(dialect.MAVLink_system_time_message(utc_us, boot_ms))
    return messages
