"""A simulated flight past a live station's pipeline before the first message comes.

What is compiled, or read from where compiled functions are kept, is so before the service says that it runs: on the
first run after an installation that took 5 s out of the first flight, in which images had no pose and nothing was
flushed to the recording.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from aerodft.adapters.config.station import StationConfig
from aerodft.app.assembly import build_pipeline
from aerodft.conventions import SECOND_NS
from aerodft.model import GeoOrigin, Image, StampClock, WireProtocol
from aerodft.service import Batches, block_of
from aerodft.sim import DEFAULT_RATES_HZ, Autopilot, Waypoint, datagrams, fly

_BEGIN_NS: Final = 1_600_000_000 * SECOND_NS
_UTC_NS: Final = _BEGIN_NS + SECOND_NS // 2  # from then on it says what UTC is
_END_NS: Final = _BEGIN_NS + 3 * SECOND_NS // 2
_BOOTED_NS: Final = 10 * SECOND_NS  # before it begins
_TICK_NS: Final = SECOND_NS // 20
_RATES_HZ: Final = {**DEFAULT_RATES_HZ, "GPS_RAW_INT": 5.0, "DISTANCE_SENSOR": 5.0, "TERRAIN_REPORT": 5.0}


def warm_up(station: StationConfig) -> None:
    """Fly a simulated vehicle for 1.5 s past the station's pipeline, with an image on every tick; nothing is kept."""
    telemetry = station.pipeline.telemetry
    if telemetry is None:
        return
    any_vehicle = replace(telemetry, system=None, component=None, gimbal=None)
    pipeline = build_pipeline(replace(station, pipeline=replace(station.pipeline, telemetry=any_vehicle)))
    for batch in _flight():
        pipeline.advance(batch)
    pipeline.finish()


def _flight() -> Iterator[Batches]:
    """The ticks of a vehicle that sets off and turns its gimbal."""
    begin = Waypoint(
        time_s=0.0, east_m=0.0, north_m=0.0, height_m=30.0, heading_rad=0.0, gimbal_pitch_rad=math.radians(-70.0)
    )
    end = replace(begin, time_s=(_END_NS - _BEGIN_NS) / SECOND_NS, north_m=10.0, gimbal_pitch_rad=math.radians(-50.0))
    way = fly((begin, end), origin=GeoOrigin(lat_rad=0.8, lon_rad=0.1, alt_msl_m=0.0), start_ns=_BEGIN_NS)
    silent = Autopilot(rates_hz={**_RATES_HZ, "SYSTEM_TIME": 0.0}, booted_ns=_BOOTED_NS)
    telling = Autopilot(rates_hz=_RATES_HZ, booted_ns=_BOOTED_NS + _UTC_NS - _BEGIN_NS)
    sent = datagrams(way.cut(_BEGIN_NS, _UTC_NS), silent) + datagrams(way.cut(_UTC_NS, _END_NS), telling)
    for index, now_ns in enumerate(range(_BEGIN_NS, _END_NS, _TICK_NS)):
        received = [each for each in sent if now_ns - _TICK_NS < each.due_ns <= now_ns]
        block = block_of(WireProtocol.MAVLINK, "", [each.due_ns for each in received], [each.data for each in received])
        yield Batches.from_events(
            np.array([now_ns]), (block, Image(index=index, stamp_ns=now_ns, arrival_ns=now_ns, clock=StampClock.HOST))
        )
