"""Two autopilots with the same ids and times since boot, told apart by the addresses that they send from."""

from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry import CompositeDecoder
from aerodft.adapters.telemetry.mavlink import FrameCounts
from aerodft.diagnosis import LogDiagnosis, problems
from aerodft.service import Pipeline, TelemetrySettings

MS = 1_000_000
OTHER_ROLL_RAD = 0.4


def _blocks(bench, frames, address):
    return [replace(block, sender=address) for block in bench.blocks(frames)]


def _other(bench, seconds, *, from_ms=0, late_ms=3):
    """Another vehicle of the same ids, powered on at the same time, 30 m lower, that looks elsewhere."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    return [
        (bench.host0_ns + (boot_ms + 20 + late_ms) * MS, bytes(message.pack(mav)))
        for boot_ms in range(from_ms, int(seconds * 1000), 100)
        for message in (
            dialect.MAVLink_attitude_message(boot_ms, OTHER_ROLL_RAD, 0.2, -2.0, 0, 0, 0),
            dialect.MAVLink_distance_sensor_message(boot_ms, 20, 10_000, 2_000, 0, 0, 25, 0),
        )
    ]


@pytest.mark.parametrize("from_ms", [200, 2000])
def test_what_the_second_says_leaves_no_trace(bench, from_ms) -> None:
    images = [bench.image(k, 2_500 + 150 * k) for k in range(16)]
    first = _blocks(bench, bench.flight(6.0), "10.0.0.1:5000")
    second = _blocks(bench, _other(bench, 6.0, from_ms=from_ms), "10.0.0.2:5000")
    decoder = CompositeDecoder()
    alone = bench.encoded(bench.run_events(*first, *images))
    both = bench.encoded(bench.run_events(*first, *second, *images, made=Pipeline(bench.settings, decoder)))
    assert both == alone
    ((reason, count),) = decoder.rejected.items()
    assert reason == "frames: with the autopilot's ids, from another address than 10.0.0.1:5000"
    assert count == len(second)


def test_doctor_says_so(bench) -> None:
    survey = LogDiagnosis("udpin:14550", settings=TelemetrySettings())
    events = [
        *_blocks(bench, bench.flight(3.0), "10.0.0.1:5000"),
        *_blocks(bench, _other(bench, 3.0, from_ms=500), "10.0.0.2:5000"),
    ]
    for block in sorted(events, key=lambda block: int(block.arrival_ns[0])):
        survey.add(block)
    found = problems(survey.report(counts=FrameCounts()))
    assert any("two autopilots speak as system 1, component 1" in each for each in found)
    assert any("frames from another address than 10.0.0.1:5000 are left out" in each for each in found)


def test_a_vehicle_whose_address_changes_is_one(bench) -> None:
    """A port for every datagram, or a new one after a break: nothing is left out."""
    frames, images = bench.flight(4.0, gap_ms=(1500, 2800)), [bench.image(k, 300 + 150 * k) for k in range(6)]
    ports = [replace(block, sender=f"10.0.0.1:{k}") for k, block in enumerate(bench.blocks(frames))]
    switched = [
        replace(block, sender="a" if block.arrival_ns[0] < bench.host0_ns + 2_000 * MS else "b")
        for block in bench.blocks(frames)
    ]
    alone = bench.encoded(bench.run_events(*bench.blocks(frames), *images))
    assert len(alone) > 0
    for blocks in (ports, switched):
        decoder = CompositeDecoder()
        told = bench.encoded(bench.run_events(*blocks, *images, made=Pipeline(bench.settings, decoder)))
        assert told == alone
        assert not decoder.rejected


def test_the_second_takes_over_when_the_first_falls_silent(bench) -> None:
    first = _blocks(bench, bench.flight(2.0), "a")
    second = _blocks(bench, _other(bench, 5.0, from_ms=1000), "b")
    decoder, rolls = CompositeDecoder(), []
    for block in sorted([*first, *second], key=lambda block: int(block.arrival_ns[0])):
        for track in decoder.decode(block):
            if type(track).__name__ == "VehicleTrack":
                roll = 2 * np.arctan2(track.wxyz[-1, 1], track.wxyz[-1, 0])
                rolls.append((int(track.arrival_ns[-1] - bench.host0_ns) / 1e9, abs(roll) > 0.2))
    late = [is_other for at_s, is_other in rolls if at_s > 3.2]
    assert late
    assert all(late)
    assert not any(is_other for at_s, is_other in rolls if 1.5 < at_s < 2.9)
