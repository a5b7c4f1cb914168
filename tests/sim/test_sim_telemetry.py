import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.geometry import camera_angles, camera_from_gimbal, east_north, multiply, yaw_pitch_roll
from aerodft.model import BiasValues, PoseStd
from aerodft.sim import Autopilot, datagrams
from aerodft.sim.scenario import EPOCH_NS
from aerodft.sim.telemetry import Datagram, Radio, draw_biases, through_radio, write_tlog
from aerodft.sim.trajectory import Trajectory, camera_attitude_from_gimbal, heading_wxyz, survey
from aerodft.sim.world import DEFAULT_ORIGIN, River

FLIGHT = survey(
    River(origin_en_m=(0.0, -26.0)), origin=DEFAULT_ORIGIN, duration_s=10.0, height_m=40.0, start_ns=EPOCH_NS
)
ALL_RATES = {
    "HEARTBEAT": 1.0,
    "SYSTEM_TIME": 1.0,
    "ATTITUDE": 10.0,
    "GLOBAL_POSITION_INT": 10.0,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": 10.0,
    "MOUNT_ORIENTATION": 5.0,
    "MOUNT_STATUS": 5.0,
    "DISTANCE_SENSOR": 5.0,
    "TERRAIN_REPORT": 2.0,
    "GPS_RAW_INT": 5.0,
}
BOOTED_MS = 60_000


def parsed(sent: list[Datagram]) -> list[Any]:
    """What pymavlink makes of the datagrams; every frame must be one good message."""
    link = dialect.MAVLink(None)
    return [link.parse_char(datagram.data) for datagram in sent]


def of_type(name: str, sent: list[Datagram]) -> list[Any]:
    return [message for message in parsed(sent) if message.get_type() == name]


def truth(message: Any) -> Trajectory:
    return FLIGHT.at([EPOCH_NS + (message.time_boot_ms - BOOTED_MS) * 1_000_000])


@pytest.fixture(scope="module")
def sent() -> list[Datagram]:
    return datagrams(FLIGHT, Autopilot(rates_hz=ALL_RATES))


@pytest.mark.parametrize(("name", "rate_hz"), ALL_RATES.items())
def test_messages_come_at_their_rates(sent: list[Datagram], name: str, rate_hz: float) -> None:
    assert len(of_type(name, sent)) == pytest.approx(rate_hz * 10, abs=1)


def test_frames_are_mavlink_2_with_running_sequence(sent: list[Datagram]) -> None:
    assert {datagram.data[0] for datagram in sent} == {0xFD}
    assert [datagram.data[4] for datagram in sent] == [i % 256 for i in range(len(sent))]
    assert all(b.due_ns >= a.due_ns for a, b in itertools.pairwise(sent))


def test_position_and_height_are_the_true_ones(sent: list[Datagram]) -> None:
    for message in of_type("GLOBAL_POSITION_INT", sent):
        at = truth(message).position_enu_m[0]
        found = east_north(DEFAULT_ORIGIN, math.radians(message.lat / 1e7), math.radians(message.lon / 1e7))
        np.testing.assert_allclose(found, at[:2], atol=0.02)  # degE7 is 1.1 cm
        assert message.relative_alt / 1000 == pytest.approx(at[2], abs=0.001)
        assert message.alt / 1000 == pytest.approx(at[2] + 584.0, abs=0.001)


def test_attitude_and_gimbal_compose_to_the_true_camera(sent: list[Datagram]) -> None:
    attitudes = {message.time_boot_ms: message for message in of_type("ATTITUDE", sent)}
    for message in of_type("GIMBAL_DEVICE_ATTITUDE_STATUS", sent):
        assert message.flags == 44
        at = truth(message)
        heading = heading_wxyz(at.ned_wxyz_body)
        camera = camera_from_gimbal(multiply(heading, np.array([message.q])))
        assert abs(np.sum(camera * at.enu_wxyz_cam)) == pytest.approx(1.0, abs=1e-7)
    for message in attitudes.values():
        yaw, pitch, roll = yaw_pitch_roll(truth(message).ned_wxyz_body)
        np.testing.assert_allclose([message.yaw, message.pitch, message.roll], [yaw[0], pitch[0], roll[0]], atol=1e-6)


def test_the_old_mount_messages_say_the_same(sent: list[Datagram]) -> None:
    status, orientation = of_type("MOUNT_STATUS", sent), of_type("MOUNT_ORIENTATION", sent)
    assert orientation
    for old, new in zip(status, orientation, strict=True):
        tilt = np.degrees(camera_angles(truth(new).enu_wxyz_cam)[0][0])
        assert new.pitch + 90 == pytest.approx(tilt, abs=1e-3)
        assert old.pointing_a / 100 == pytest.approx(new.pitch, abs=0.2)  # a millisecond later, in centidegrees


def test_the_rangefinder_measures_along_the_body(sent: list[Datagram]) -> None:
    for message in of_type("DISTANCE_SENSOR", sent):
        at = truth(message)
        _, pitch, roll = yaw_pitch_roll(at.ned_wxyz_body[0])
        height = message.current_distance / 100 * math.cos(pitch) * math.cos(roll)
        assert height == pytest.approx(at.position_enu_m[0, 2], abs=0.006)
        assert message.orientation == dialect.MAV_SENSOR_ROTATION_PITCH_270


def test_the_clock_says_the_autopilots_utc() -> None:
    sent = datagrams(FLIGHT, Autopilot(rates_hz={"SYSTEM_TIME": 5.0}, clock_offset_ns=2_500_000_000))
    for message, datagram in zip(parsed(sent), sent, strict=True):
        assert message.time_unix_usec * 1000 - datagram.due_ns == 2_500_000_000
        assert message.time_boot_ms - BOOTED_MS == (datagram.due_ns - EPOCH_NS) // 1_000_000


def test_mavlink_1_needs_the_old_gimbal_message() -> None:
    rates = {"HEARTBEAT": 1.0, "ATTITUDE": 5.0, "MOUNT_STATUS": 5.0}
    sent = datagrams(FLIGHT, Autopilot(rates_hz=rates, mavlink1=True, system=7))
    assert {datagram.data[0] for datagram in sent} == {0xFE}
    assert {message.get_srcSystem() for message in parsed(sent)} == {7}
    with pytest.raises(ValueError, match="does not exist in MAVLink 1"):
        datagrams(FLIGHT, Autopilot(mavlink1=True))
    with pytest.raises(ValueError, match="cannot send NONSENSE"):
        datagrams(FLIGHT, Autopilot(rates_hz={"NONSENSE": 1.0}))


@pytest.mark.parametrize(
    ("field", "angle"), [("tilt_rad", 0), ("roll_rad", 1), ("heading_rad", 2)], ids=["tilt", "roll", "heading"]
)
def test_a_bias_is_what_is_said_minus_what_is_true(field: str, angle: int) -> None:
    bias_rad = math.radians(0.7)
    sent = datagrams(FLIGHT, Autopilot(biases=BiasValues(**{field: bias_rad, "height_m": 1.5})))
    message = of_type("GIMBAL_DEVICE_ATTITUDE_STATUS", sent)[64]
    at = truth(message)
    reported_body = at.ned_wxyz_body
    if field == "heading_rad":
        attitude = min(of_type("ATTITUDE", sent), key=lambda m: abs(m.time_boot_ms - message.time_boot_ms))
        yaw, _, _ = yaw_pitch_roll(truth(attitude).ned_wxyz_body[0])
        assert (attitude.yaw - float(yaw) + math.pi) % (2 * math.pi) - math.pi == pytest.approx(bias_rad, abs=1e-6)
        return
    said = camera_angles(camera_attitude_from_gimbal(reported_body, np.array([message.q])))[angle][0]
    true = camera_angles(at.enu_wxyz_cam)[angle][0]
    assert said - true == pytest.approx(bias_rad, abs=1e-4)
    position = of_type("GLOBAL_POSITION_INT", sent)[50]
    assert position.relative_alt / 1000 - truth(position).position_enu_m[0, 2] == pytest.approx(1.5, abs=0.001)


def test_biases_are_drawn_from_their_stds() -> None:
    std = PoseStd(height_agl_m=0.5, tilt_rad=0.01, roll_rad=0.02, heading_rad=0.03, pan_rad=0.04)
    drawn = [draw_biases(std, seed) for seed in range(2000)]
    for field, expected in (("height_m", 0.5), ("tilt_rad", 0.01), ("roll_rad", 0.02), ("pan_rad", 0.04)):
        assert np.std([getattr(biases, field) for biases in drawn]) == pytest.approx(expected, rel=0.06)
    assert draw_biases(std, 3) == drawn[3]


def test_noise_has_its_std_and_the_gimbal_runs_ahead_of_the_camera() -> None:
    rates = {"GLOBAL_POSITION_INT": 100.0, "GIMBAL_DEVICE_ATTITUDE_STATUS": 50.0}
    noisy = datagrams(FLIGHT, Autopilot(rates_hz=rates, noise=PoseStd(height_agl_m=0.2), gimbal_lag_ns=200_000_000))
    errors = [
        message.relative_alt / 1000 - truth(message).position_enu_m[0, 2]
        for message in of_type("GLOBAL_POSITION_INT", noisy)
    ]
    assert np.std(errors) == pytest.approx(0.2, rel=0.1)
    for message in of_type("GIMBAL_DEVICE_ATTITUDE_STATUS", noisy):
        stamp = EPOCH_NS + (message.time_boot_ms - BOOTED_MS + 200) * 1_000_000
        ahead = FLIGHT.at([stamp]).level_wxyz_gimbal[0]
        assert abs(np.dot(ahead, message.q)) == pytest.approx(1.0, abs=1e-6)


def test_a_perfect_radio_changes_nothing(sent: list[Datagram]) -> None:
    assert through_radio(sent, Radio()) == sent
    assert through_radio([], Radio()) == []


def test_the_radio_delays_drops_doubles_and_reorders(sent: list[Datagram]) -> None:
    ideal = datagrams(FLIGHT, Autopilot(rates_hz={"ATTITUDE": 200.0}))
    radio = Radio(latency_ns=20_000_000, jitter_ns=3_000_000, drop=0.1, duplicate=0.2, reorder=0.05)
    got = through_radio(ideal, radio)
    unique = {datagram.data for datagram in got}
    assert len(unique) / len(ideal) == pytest.approx(0.9, abs=0.03)
    assert len(got) / len(unique) == pytest.approx(1.2, abs=0.05)
    due = {datagram.data: datagram.due_ns for datagram in ideal}
    delays = [datagram.due_ns - due[datagram.data] for datagram in got]
    assert min(delays) >= 20_000_000
    assert [d.due_ns for d in got] == sorted(d.due_ns for d in got)
    assert [due[d.data] for d in got] != sorted(due[d.data] for d in got)
    assert through_radio(sent, radio) == through_radio(sent, radio)


def test_nothing_comes_through_an_outage(sent: list[Datagram]) -> None:
    got = through_radio(sent, Radio(outages_ns=((3_000_000_000, 5_000_000_000),)))
    elapsed = np.array([datagram.due_ns - EPOCH_NS for datagram in got]) / 1e9
    assert not np.any((elapsed >= 3) & (elapsed < 5))
    assert np.any(elapsed < 3)
    assert np.any(elapsed >= 5)


def test_pymavlink_reads_the_log(tmp_path: Path, sent: list[Datagram]) -> None:
    write_tlog(tmp_path / "flight.tlog", sent)
    log = mavutil.mavlink_connection(str(tmp_path / "flight.tlog"), dialect="ardupilotmega")
    messages = []
    while (message := log.recv_match()) is not None:
        messages.append(message)
    log.close()
    assert len(messages) == len(sent)
    assert "BAD_DATA" not in {message.get_type() for message in messages}
    for message, datagram in zip(messages, sent, strict=True):
        assert message._timestamp * 1e6 == pytest.approx(datagram.due_ns / 1000, abs=1)  # noqa: SLF001 (its only stamp)
