"""What a log covers, read before it is run."""

import numpy as np
import pytest

from aerodft.model import (
    NO_BOOT_TIME,
    ClockTrack,
    GimbalSource,
    GimbalTrack,
    HeightSource,
    HeightTrack,
    PositionTrack,
    VehicleTrack,
    WireProtocol,
)
from aerodft.service import block_of
from aerodft.service.clocks import survey_span

MS, SECOND = 1_000_000, 1_000_000_000
UTC0 = 1_795_221_168 * SECOND
HOST0 = UTC0 + 3 * SECOND


class Log:
    """Frames that are numbers: the time since boot in ms, delayed on their way."""

    def __init__(self, boot_ms, delay_ms):
        self._boot_ms = boot_ms
        self._delay_ms = delay_ms

    def events(self):
        for boot_ms in self._boot_ms:
            arrival_ns = HOST0 + (boot_ms + self._delay_ms(boot_ms)) * MS
            yield block_of(WireProtocol.MAVLINK, "log", [arrival_ns], [boot_ms.to_bytes(8, "big")])


class Decoder:
    """Every frame is a sample of all the tracks that are asked for."""

    def __init__(self, *kinds, jump_ms=0):
        self._kinds, self._jump_ms = kinds, jump_ms  # of UTC, after 30 s

    def decode(self, block):
        numbers = [int.from_bytes(block.data[start : start + 8], "big") for start in block.offset.tolist()]
        boot_ns = np.array(numbers, dtype=np.int64) * MS
        stamps = {"arrival_ns": block.arrival_ns, "boot_ns": boot_ns}
        count = len(boot_ns)
        values, turns = np.zeros(count), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
        made = {
            "clock": lambda: ClockTrack(
                **stamps, unix_ns=boot_ns + UTC0 + (boot_ns >= 30 * SECOND) * self._jump_ms * MS
            ),
            "position": lambda: PositionTrack(
                **stamps, lat_rad=values, lon_rad=values, alt_msl_m=values, height_home_m=values
            ),
            "terrain": lambda: HeightTrack(
                **stamps, source=HeightSource.TERRAIN, value_m=values, slant=False, std_m=values
            ),
            "gimbal": lambda: GimbalTrack(
                arrival_ns=block.arrival_ns,
                boot_ns=np.full(count, NO_BOOT_TIME),
                source=GimbalSource.MOUNT_STATUS,
                wxyz=turns,
                yaw_in_earth=np.zeros(count, dtype=np.bool_),
            ),
            "vehicle": lambda: VehicleTrack(**stamps, wxyz=turns),
        }
        return tuple(made[kind]() for kind in self._kinds)


def test_extent_and_sources():
    decoder = Decoder("clock", "position", "terrain", "gimbal", "vehicle")
    span = survey_span(Log(range(0, 10_000, 100), lambda _: 20), decoder)
    assert (span.first_arrival_ns, span.last_arrival_ns) == (HOST0 + 20 * MS, HOST0 + 9_920 * MS)
    assert UTC0 <= span.first_ns <= UTC0 + SECOND
    assert span.last_ns == UTC0 + 9_900 * MS
    assert span.heights == {HeightSource.HOME, HeightSource.TERRAIN}
    assert span.attitudes == {GimbalSource.MOUNT_STATUS, GimbalSource.FIXED_MOUNT}


def test_lateness_is_the_clocks_difference_and_the_links_worst_delay():
    def delay_ms(boot_ms):
        return 2_000 if 5_000 <= boot_ms < 5_500 else 20

    span = survey_span(Log(sorted({*range(0, 5_000, 100), *range(5_500, 9_000, 100)}), lambda _: 20), Decoder("clock"))
    assert (span.lateness_ns, span.jitter_ns) == (3_020 * MS, 0)
    boots = [b for b in range(0, 9_000, 100) if not 5_500 <= b < 7_600]
    span = survey_span(Log(boots, delay_ms), Decoder("clock"))
    assert (span.lateness_ns, span.jitter_ns) == (5_000 * MS, 1_980 * MS)


@pytest.mark.parametrize("jump_ms", [5_000, -5_000])
def test_lateness_before_a_jump_is_what_it_was_before_it(jump_ms):
    """Images of before the jump meet their telemetry when it came, not when the clock of after the jump says."""
    decoder = Decoder("clock", jump_ms=jump_ms)
    span = survey_span(Log(range(0, 60_000, 100), lambda _: 20), decoder)
    late_ms = [span.lateness_at(UTC0 + boot_ms * MS) // MS for boot_ms in (10_000, 20_000, 58_000 + jump_ms)]
    assert late_ms == pytest.approx([3_020, 3_020, 3_020 - jump_ms], abs=1)


def test_a_clock_that_is_set_while_logging_is_no_flight_of_fifty_years():
    boots = [*range(0, 2_000, 100), *range(2_000, 700_000, 590_000), 2_000_000_000]
    span = survey_span(Log(boots, lambda _: 0), Decoder("vehicle"))
    assert span.arrivals_ns == [(HOST0, HOST0 + 592_000 * MS), (HOST0 + 2_000_000_000 * MS,) * 2]
    assert (span.first_arrival_ns, span.last_arrival_ns) == (HOST0, HOST0 + 2_000_000_000 * MS)


def test_without_utc_the_log_is_on_the_hosts_clock():
    span = survey_span(Log(range(0, 5_000, 100), lambda _: 20), Decoder("vehicle"))
    assert span.last_ns == HOST0 + 4_920 * MS
    assert span.lateness_ns == 0


@pytest.mark.parametrize("decoder", [Decoder(), Decoder("vehicle")])
def test_an_empty_log_covers_nothing(decoder):
    span = survey_span(Log([], lambda _: 0), decoder)
    assert (span.first_arrival_ns, span.last_arrival_ns, span.first_ns, span.last_ns) == (None, None, None, None)
    assert (span.heights, span.attitudes, span.lateness_ns, span.jitter_ns) == (set(), set(), 0, 0)
