"""Several vehicles, autopilots or gimbals on one link: who is followed is said until somebody chooses."""

import logging
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry.mavlink import FollowedIds, MavlinkDecoder
from aerodft.model import Status
from aerodft.service import Pipeline

MS = 1_000_000
DOWN_20 = [math.cos(math.pi / 18), 0.0, math.sin(-math.pi / 18), 0.0]


def _attitude(boot_ms):
    return dialect.MAVLink_attitude_message(boot_ms, 0.4, 0.2, -2.0, 0, 0, 0)


def _gimbal(device):
    def message(boot_ms):
        nan = math.nan
        return dialect.MAVLink_gimbal_device_attitude_status_message(
            0, 0, boot_ms, 44, DOWN_20, nan, nan, nan, 0, gimbal_device_id=device
        )

    return message


def _beat(boot_ms):  # noqa: ARG001 - as the others
    return dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def _beat_of_vehicle(boot_ms):  # noqa: ARG001 - as the others
    return dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)


def _of(bench, system, component, message, *, from_ms=700, until_ms=20_000):
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    return [
        (bench.host0_ns + (boot_ms + 21) * MS, bytes(message(boot_ms).pack(mav)))
        for boot_ms in range(from_ms, until_ms, 100)
    ]


@pytest.fixture
def fly(bench):
    def flown(rivals, **followed):
        lives = _of(bench, 1, 1, _beat_of_vehicle, from_ms=0)
        frames = sorted([*bench.flight(20.0), *lives, *rivals], key=lambda each: each[0])
        images = [bench.image(k, 250 + 500 * k) for k in range(38)]
        made = Pipeline(bench.settings, MavlinkDecoder(FollowedIds(**followed)))
        return bench.poses(bench.run_events(*bench.blocks(frames), *images, made=made))

    return flown


HEARD_FIRST = "was heard first and is followed; choose with telemetry"
VEHICLE = f"system 2 is on the link too: system 1 {HEARD_FIRST}.system"
AUTOPILOT = f"component 2 of system 1 is an autopilot too: component 1 {HEARD_FIRST}.component"
GIMBAL = f"GIMBAL_DEVICE_ATTITUDE_STATUS comes from component 154 too: component 1 {HEARD_FIRST}.gimbal"
DEVICE = f"GIMBAL_DEVICE_ATTITUDE_STATUS of component 1 is of several gimbals: number 0 {HEARD_FIRST}.gimbal"
CASES = [
    ((2, 1, _attitude), VEHICLE, {"system": 1}),
    ((1, 2, _attitude), AUTOPILOT, {"component": 1}),
    ((1, 154, _gimbal(0)), GIMBAL, {"gimbal": 1}),
    ((1, 1, _gimbal(2)), DEVICE, {"gimbal": 2}),
]


@pytest.mark.parametrize(("rival", "sentence", "chosen"), CASES)
def test_who_could_be_meant_as_well_is_named_until_somebody_chooses(fly, bench, caplog, rival, sentence, chosen):
    with caplog.at_level(logging.WARNING):
        poses = fly(_of(bench, *rival))
    assert {each.status for each in poses} == {Status.OK}
    named = [sentence in each.reasons for each in poses]
    assert named == [False] + [True] * 37
    assert [record.message for record in caplog.records] == [sentence]
    caplog.clear()
    assert not any(HEARD_FIRST in reason for each in fly(_of(bench, *rival), **chosen) for reason in each.reasons)
    assert not caplog.records


def test_a_vehicle_that_leaves_is_forgotten_after_ten_seconds(fly, bench):
    poses = fly(_of(bench, 2, 1, _attitude, until_ms=3000))
    assert [VEHICLE in each.reasons for each in poses] == [False] + [True] * 25 + [False] * 12


@pytest.mark.parametrize(
    ("system", "component", "message"), [(255, 190, _beat), (1, 100, _attitude), (2, 154, _attitude)]
)
def test_ground_stations_and_what_a_vehicle_carries_are_no_rivals(fly, bench, system, component, message):
    poses = fly(_of(bench, system, component, message))
    assert not any(HEARD_FIRST in reason for each in poses for reason in each.reasons)
