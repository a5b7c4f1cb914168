import math

import numpy as np
import pytest

from aerodft.geometry import camera_angles, yaw_pitch_roll
from aerodft.sim import Waypoint, fly
from aerodft.sim.trajectory import GRAVITY_MPS2, survey
from aerodft.sim.world import DEFAULT_ORIGIN, River

RIVER = River(origin_en_m=(0.0, -26.0))
DEGREE = math.radians(1.0)


def line(times_s: list[float], norths_m: list[float], **angles: float) -> tuple[Waypoint, ...]:
    settings = {"heading_rad": 0.0, "gimbal_pitch_rad": -math.pi / 3, **angles}
    return tuple(
        Waypoint(time_s=time, east_m=0.0, north_m=north, height_m=30.0, **settings)
        for time, north in zip(times_s, norths_m, strict=True)
    )


def test_gimbal_pitch_of_minus_60_is_a_tilt_of_30() -> None:
    flight = fly(line([0.0, 5.0], [0.0, 0.0], gimbal_yaw_rad=0.4), origin=DEFAULT_ORIGIN)
    tilt, roll, heading = camera_angles(flight.enu_wxyz_cam)
    np.testing.assert_allclose(np.degrees(tilt), 30.0, atol=1e-6)
    np.testing.assert_allclose(roll, 0.0, atol=1e-9)
    np.testing.assert_allclose(heading, 0.4, atol=1e-9)


def test_the_vehicle_leans_into_its_acceleration() -> None:
    flight = fly(line([0.0, 4.0, 8.0], [0.0, 20.0, 40.0]), origin=DEFAULT_ORIGIN)
    _, pitch, _ = yaw_pitch_roll(flight.ned_wxyz_body)
    seconds = (flight.stamp_ns - flight.start_ns) / 1e9
    acceleration = np.gradient(np.gradient(flight.position_enu_m[:, 1], seconds), seconds)
    inner = slice(5, -5)
    np.testing.assert_allclose(np.tan(pitch[inner]), -acceleration[inner] / GRAVITY_MPS2, atol=1e-4)
    assert pitch[50] < -DEGREE  # nose down to go faster


def test_a_right_turn_banks_right() -> None:
    angle = np.linspace(0, np.pi, 13)
    waypoints = tuple(
        Waypoint(
            time_s=float(a * 4),
            east_m=float(20 - 20 * np.cos(a)),
            north_m=float(20 * np.sin(a)),
            height_m=30.0,
            heading_rad=float(a),
            gimbal_pitch_rad=-1.0,
        )
        for a in angle
    )
    flight = fly(waypoints, origin=DEFAULT_ORIGIN)
    _, _, roll = yaw_pitch_roll(flight.ned_wxyz_body)
    expected = math.atan((20 / 4**2) / GRAVITY_MPS2)  # v^2/r
    assert roll[len(roll) // 2] == pytest.approx(expected, abs=0.5 * DEGREE)


def test_the_survey_is_smooth_and_starts_on_the_ground() -> None:
    flight = survey(RIVER, origin=DEFAULT_ORIGIN, duration_s=20.0, height_m=40.0, start_ns=5)
    assert flight.start_ns == 5
    assert flight.end_ns - flight.start_ns == 20_000_000_000
    assert np.all(flight.position_enu_m[:100, 2] < 0.05)
    assert np.all(flight.position_enu_m[:, 2] >= 0)
    assert flight.position_enu_m[:, 2].max() == pytest.approx(40.0, abs=0.1)
    acceleration = np.diff(flight.position_enu_m, n=2, axis=0) / 0.01**2
    assert np.all(np.abs(np.diff(acceleration, axis=0)) < 2.0)
    tilt = np.degrees(camera_angles(flight.enu_wxyz_cam)[0])
    assert tilt.min() < 1.0
    assert np.any(np.abs(tilt - 30) < 0.5)


def test_the_survey_banks_visibly() -> None:
    flight = survey(RIVER, origin=DEFAULT_ORIGIN)
    _, pitch, roll = yaw_pitch_roll(flight.ned_wxyz_body)
    assert np.degrees(np.abs(roll)).max() > 10
    assert np.degrees(np.hypot(pitch, roll)).max() < 45


@pytest.mark.parametrize("times", [[0.0], [0.0, 0.0], [1.0, 0.0]])
def test_times_must_increase(times: list[float]) -> None:
    with pytest.raises(ValueError, match="increasing"):
        fly(line(times, [0.0] * len(times)), origin=DEFAULT_ORIGIN)


def test_motion_between_samples_is_even() -> None:
    flight = survey(RIVER, origin=DEFAULT_ORIGIN)
    stamps = flight.stamp_ns[500:502]
    middle = flight.at([int(stamps.mean())])
    np.testing.assert_allclose(middle.position_enu_m[0], flight.position_enu_m[500:502].mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(flight.at(stamps).enu_wxyz_cam, flight.enu_wxyz_cam[500:502], atol=1e-12)


def test_a_cut_keeps_the_samples_of_a_half_open_interval() -> None:
    flight = survey(RIVER, origin=DEFAULT_ORIGIN)
    part = flight.cut(1_000_000_000, 2_000_000_000)
    assert (part.start_ns, part.end_ns) == (1_000_000_000, 1_990_000_000)
    assert len(part.enu_wxyz_cam) == 100
