"""What is asked of vehicles and cameras, against ArduPilot's own description of its parameters."""

import re
from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.diagnosis.message_requests import (
    ARDUPILOT,
    PX4,
    SWITCHED_OFF_BY,
    MessageRequest,
    missing_camera_messages,
    missing_messages,
)
from aerodft.diagnosis.streams import Parameters, Stream
from aerodft.model import ZoomSource
from aerodft.service import ZoomSettings

# What ArduPilot's parameter documentation says that each rate is of.
ARDUPILOTS_GROUPS = {
    "EXT_STAT": "SYS_STATUS, POWER_STATUS, MCU_STATUS, MEMINFO, CURRENT_WAYPOINT, GPS_RAW_INT, GPS_RTK, GPS2_RAW_INT",
    "POSITION": "GLOBAL_POSITION_INT, LOCAL_POSITION_NED",
    "EXTRA1": "ATTITUDE, SIMSTATE, AHRS2, RPM, AOA_SSA, LANDING, ESC_TELEMETRY, EFI_STATUS, PID_TUNING",
    "EXTRA3": (
        "AHRS, SYSTEM_TIME, WIND, RANGEFINDER, DISTANCE_SENSOR, TERRAIN_REQUEST, TERRAIN_REPORT, BATTERY2,"
        " GIMBAL_DEVICE_ATTITUDE_STATUS, OPTICAL_FLOW, MAG_CAL_REPORT, MAG_CAL_PROGRESS, EKF_STATUS_REPORT, VIBRATION"
    ),
}
SETTINGS, FOV, VIDEO, *_ = map(str, ZoomSource)


def _answer_to(
    autopilot: int | None, streams: tuple[Stream, ...] = (), parameters: dict[str, tuple[float, ...]] | None = None
) -> tuple[MessageRequest, ...]:
    said = Parameters(parameters or {})
    return missing_messages(streams, system=1, component=1, autopilot=autopilot, parameters=said)


def test_ardupilots_messages_are_set_by_the_parameter_that_they_belong_to() -> None:
    rates: dict[str, set[str]] = {}
    for each in _answer_to(ARDUPILOT):
        group, rate_hz = re.match(r"SRn_(\w+) = (\d+) ", each.parameters["ardupilot"]).groups()
        assert each.name in ARDUPILOTS_GROUPS[group].split(", ")
        assert each.rate_hz is not None
        assert float(rate_hz) >= each.rate_hz
        rates.setdefault(group, set()).add(rate_hz)
    assert rates == {"EXT_STAT": {"1"}, "POSITION": {"5"}, "EXTRA1": {"10"}, "EXTRA3": {"10"}}


def test_a_parameter_is_set_to_what_is_missing_of_its_group() -> None:
    gimbal = Stream("GIMBAL_DEVICE_ATTITUDE_STATUS", 1, 1, 0, 10**10, count=101)
    extra3 = [each.parameters["ardupilot"] for each in _answer_to(ARDUPILOT, (gimbal,)) if each.group == "EXTRA3"]
    assert len(extra3) == 4
    assert all(
        each.startswith("SRn_EXTRA3 = 5 of the port that this link is on (SR0 USB, SR1 TELEM1") for each in extra3
    )


RATES = {
    f"SR{port}_{group}": (rate_hz,)
    for port, rate_hz in enumerate((0.0, 4.0, 1.0))
    for group in ("EXTRA1", "EXTRA3", "POSITION", "EXT_STAT")
}


@pytest.mark.parametrize(
    ("came_hz", "rates", "port"),
    [
        (3.0, RATES, "SR1"),
        (1.1, RATES, "SR2"),
        (2.0, RATES, ""),  # as near to the one as to the other
        (30.0, RATES, ""),  # somebody asked for these
        (30.0, {name: rate for name, rate in RATES.items() if "SR2" not in name}, "SR1"),  # no other one speaks
        (3.0, {}, ""),
        (9.0, {**RATES, "SR1_EXTRA1": (4.0, 10.0)}, ""),
    ],
)
def test_the_links_port_is_the_one_whose_rates_come(came_hz, rates, port) -> None:
    streams = tuple(
        Stream(name, 1, 1, 0, 10**10, count=round(10 * came_hz) + 1)
        for name in ("ATTITUDE", "GLOBAL_POSITION_INT", "SYSTEM_TIME", "GPS_RAW_INT")
    )
    (gimbal,) = [each for each in _answer_to(ARDUPILOT, streams, rates) if each.name == "GIMBAL_DEVICE_ATTITUDE_STATUS"]
    assert gimbal.port == port
    assert gimbal.parameters["ardupilot"].startswith(f"{port or 'SRn'}_EXTRA3 = 10 ")


@pytest.mark.parametrize(
    ("parameters", "missing", "setting"),
    [
        ({"RNGFND_TYPE": (0.0,), "RNGFND2_TYPE": (0.0,)}, "DISTANCE_SENSOR", "RNGFND_TYPE = 0"),
        ({"RNGFND1_TYPE": (0.0,), "RNGFND2_TYPE": (10.0,)}, "", ""),
        ({"RNGFND1_TYPE": (10.0, 0.0)}, "DISTANCE_SENSOR", "RNGFND1_TYPE = 0"),
        ({"MNT1_TYPE": (0.0,)}, "GIMBAL_DEVICE_ATTITUDE_STATUS", "MNT1_TYPE = 0"),
        ({"TERRAIN_ENABLE": (0.0,)}, "TERRAIN_REPORT", "TERRAIN_ENABLE = 0"),
        ({"MNT1_TYPE": (8.0,)}, "", ""),
    ],
)
def test_what_is_switched_off_is_not_asked_for(parameters, missing, setting) -> None:
    asked = {each.name for each in _answer_to(ARDUPILOT, parameters=parameters)}
    assert {each.name for each in _answer_to(ARDUPILOT)} - asked == {missing} - {""}
    assert [found for each in SWITCHED_OFF_BY.values() if (found := Parameters(parameters).switch_off(*each))][:1] == [
        setting
    ][: bool(setting)]


def test_an_old_firmware_is_asked_for_the_gimbal_message_that_it_knows() -> None:
    old = {each.name for each in _answer_to(ARDUPILOT, parameters={"MNT_TYPE": (1.0,)})}
    assert "MOUNT_STATUS" in old
    assert "GIMBAL_DEVICE_ATTITUDE_STATUS" not in old


def test_px4_is_told_its_streams() -> None:
    ways = {each.name: each.parameters for each in _answer_to(PX4)}
    assert {"ATTITUDE", "ALTITUDE", "ESTIMATOR_STATUS"} < ways.keys()
    assert not {"TERRAIN_REPORT", "EKF_STATUS_REPORT"} & ways.keys()
    assert all(each["px4"].startswith(f"mavlink stream -d DEVICE -s {name} -r ") for name, each in ways.items())


@pytest.mark.parametrize(
    ("heard", "autopilot", "zoom", "expected"),
    [
        ((), ARDUPILOT, ZoomSettings(), []),  # no camera is known of, and none is needed
        (((1, SETTINGS),), ARDUPILOT, ZoomSettings(), []),
        (((1, FOV),), ARDUPILOT, ZoomSettings(), [(1, SETTINGS, 511)]),
        (((1, FOV),), PX4, ZoomSettings(), []),
        (((101, "HEARTBEAT"),), PX4, ZoomSettings(), [(101, SETTINGS, 512), (101, FOV, 512), (101, VIDEO, 512)]),
        (((101, VIDEO),), None, ZoomSettings(), [(101, SETTINGS, 512), (101, FOV, 512)]),
        (((100, SETTINGS), (101, VIDEO)), PX4, ZoomSettings(camera=100), []),
        ((), PX4, ZoomSettings(camera=154, order=(ZoomSource.VIDEO_STREAM_INFORMATION,)), [(154, VIDEO, 512)]),
        ((), ARDUPILOT, ZoomSettings(camera=2), [(1, SETTINGS, 511), (1, FOV, 511)]),
        ((), PX4, ZoomSettings(camera=2), []),
        ((), ARDUPILOT, ZoomSettings(curve=((0, 1), (1, 2))), [(1, SETTINGS, 511), (1, FOV, 511)]),
        ((), PX4, ZoomSettings(curve=((0, 1), (1, 2)), order=(ZoomSource.CAMERA_SETTINGS,)), [(100, SETTINGS, 512)]),
    ],
)
def test_cameras_are_asked_where_there_are_some_or_one_is_needed(
    heard: tuple[tuple[int, str], ...],
    autopilot: int | None,
    zoom: ZoomSettings,
    expected: list[tuple[int, str, int]],
) -> None:
    streams = [Stream(name, 1, component, 0, 0, count=1) for component, name in heard]
    streams.append(Stream(SETTINGS, 7, 100, 0, 0, count=1))  # another vehicle's
    found = tuple(missing_camera_messages(streams, system=1, component=1, autopilot=autopilot, zoom=zoom))
    assert [(each.component, each.name, each.command_id) for each in found] == expected
    assert all(f"from component {each.component} (" in each.sentence(is_live=True) for each in found)


def test_what_is_asked_for_once_is_a_request_of_the_message(parse: Callable[[bytes], dialect.MAVLink_message]) -> None:
    (request,) = missing_camera_messages(
        [Stream("HEARTBEAT", 1, 100, 0, 0, count=1)],
        system=1,
        component=1,
        autopilot=PX4,
        zoom=ZoomSettings(order=(ZoomSource.VIDEO_STREAM_INFORMATION,)),
    )
    sent = parse(request.command(1))
    assert (sent.command, sent.target_system, sent.target_component) == (dialect.MAV_CMD_REQUEST_MESSAGE, 1, 100)
    assert (sent.param1, sent.param2, sent.confirmation) == (269, 0, 1)
    assert "MAV_CMD_REQUEST_MESSAGE with 269)" in request.sentence(is_live=True)


@pytest.fixture
def parse() -> Callable[[bytes], dialect.MAVLink_message]:
    """Decodes one frame as pymavlink does."""
    return lambda frame: dialect.MAVLink(None).parse_buffer(frame)[0]
