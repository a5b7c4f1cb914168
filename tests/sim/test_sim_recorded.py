from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil

from aerodft.errors import InputError, NoAnswerError
from aerodft.geometry import camera_angles
from aerodft.sim import Autopilot, datagrams, default_camera
from aerodft.sim.scenario import EPOCH_NS, scenario_from_log, thin_log, trajectory_from_log
from aerodft.sim.telemetry import write_tlog
from aerodft.sim.trajectory import Trajectory, survey
from aerodft.sim.world import DEFAULT_ORIGIN, River

SITL = Path(__file__).parents[2].parent / "shared" / "data" / "sitl"
RATES = {
    "HEARTBEAT": 1.0,
    "SYSTEM_TIME": 1.0,
    "ATTITUDE": 10.0,
    "GLOBAL_POSITION_INT": 10.0,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": 10.0,
}


@pytest.fixture(scope="module")
def flight() -> Trajectory:
    river = River(origin_en_m=(0.0, -26.0))
    return survey(river, origin=DEFAULT_ORIGIN, duration_s=10.0, height_m=40.0, start_ns=EPOCH_NS)


def log_of(flight: Trajectory, path: Path, **rates_hz: float) -> Path:
    write_tlog(path, datagrams(flight, Autopilot(rates_hz=RATES | rates_hz)))
    return path


def counts(path: Path) -> dict[str, int]:
    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    found: dict[str, int] = {}
    while (message := log.recv_match()) is not None:
        found[message.get_type()] = found.get(message.get_type(), 0) + 1
    log.close()
    return found


def test_a_flight_comes_back_from_its_own_log(tmp_path: Path, flight: Trajectory) -> None:
    again = trajectory_from_log(log_of(flight, tmp_path / "flight.tlog"))
    truth = flight.at(again.stamp_ns)
    assert len(again.stamp_ns) == pytest.approx(100, abs=3)
    np.testing.assert_allclose(again.position_enu_m, truth.position_enu_m, atol=0.02)
    off_rad = 2 * np.arccos(np.clip(np.abs(np.sum(again.enu_wxyz_cam * truth.enu_wxyz_cam, axis=-1)), 0, 1))
    assert np.degrees(off_rad).max() < 0.1  # the heading is interpolated over 100 ms of a turn


@pytest.mark.parametrize("silent", ["SYSTEM_TIME", "ATTITUDE", "GLOBAL_POSITION_INT", "GIMBAL_DEVICE_ATTITUDE_STATUS"])
def test_a_log_that_lacks_something_says_what(tmp_path: Path, flight: Trajectory, silent: str) -> None:
    path = log_of(flight, tmp_path / "flight.tlog", **{silent: 0.0})
    with pytest.raises(NoAnswerError, match=r"flight\.tlog.*expected"):
        trajectory_from_log(path)


def test_a_gimbal_without_a_clock_is_no_truth(tmp_path: Path, flight: Trajectory) -> None:
    path = log_of(flight, tmp_path / "flight.tlog", GIMBAL_DEVICE_ATTITUDE_STATUS=0.0, MOUNT_STATUS=10.0)
    with pytest.raises(NoAnswerError, match="no time of their own"):
        trajectory_from_log(path)


def test_a_missing_log_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        trajectory_from_log(tmp_path / "none.tlog")


def test_thinning_keeps_every_second_sample(tmp_path: Path, flight: Trajectory) -> None:
    path = log_of(flight, tmp_path / "flight.tlog")
    thin_log(path, tmp_path / "thin.tlog", keep_every=2)
    whole, thin = counts(path), counts(tmp_path / "thin.tlog")
    assert thin["SYSTEM_TIME"] == whole["SYSTEM_TIME"]
    assert thin["HEARTBEAT"] == whole["HEARTBEAT"]
    assert thin["ATTITUDE"] == (whole["ATTITUDE"] + 1) // 2
    stamps = trajectory_from_log(path).stamp_ns
    assert set(trajectory_from_log(tmp_path / "thin.tlog").stamp_ns) <= set(stamps)


def test_an_interval_outside_the_log_says_how_long_it_is(tmp_path: Path, flight: Trajectory) -> None:
    path = log_of(flight, tmp_path / "flight.tlog")
    with pytest.raises(NoAnswerError, match="expected 0 to"):
        scenario_from_log(default_camera(640, 480), path, interval_s=(500.0, 5.0))


@pytest.mark.skipif(not SITL.is_dir(), reason="the recorded flights (../shared/data/sitl) are not here")
def test_a_real_autopilots_flight() -> None:
    scenario = scenario_from_log(default_camera(1920, 1080), SITL / "brushless_consumer.tlog", fps=1.0)
    flight = scenario.trajectory
    tilt = np.degrees(camera_angles(flight.enu_wxyz_cam)[0])
    airborne = flight.position_enu_m[:, 2] > 45
    for leg in (60.0, 30.0, 0.0):
        assert np.count_nonzero(np.abs(tilt[airborne] - leg) < 0.5) > 30
    assert flight.position_enu_m[:, 2].max() == pytest.approx(50.0, abs=0.5)
    np.testing.assert_allclose(flight.position_enu_m[0], 0.0, atol=0.1)
    assert np.median(np.diff(scenario.image_stamps_ns)) == pytest.approx(1e9, rel=0.02)
    assert len(scenario.observing.stations_m) == 3
