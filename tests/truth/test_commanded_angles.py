"""Camera attitudes of recorded flights against the angles that the pilot commanded."""

import numpy as np
import pytest

from aerodft.model import MountAxes, ReportFrame

from .commanded_flights import DEG, SAMPLE, SITL, flown, held

EARTH, SERVO = {"frame": ReportFrame.EARTH}, {"frame": ReportFrame.BODY, "axes": MountAxes.ROLL_OUTER}
UNKNOWN_AXES = {"frame": ReportFrame.BODY}
WIND = "servo_wind_ctl.json"
kept_apart = pytest.mark.skipif(not SITL.is_dir(), reason=f"{SITL} is not there: the recorded flights are kept apart")
FLIGHTS = [
    pytest.param(SAMPLE, "servo_wind.tlog", WIND, id="sample"),
    *(
        pytest.param(SITL, name, control, id=name, marks=kept_apart)
        for name, control in (
            ("servo_wind.tlog", WIND),
            ("servo_consumer.tlog", "servo_ctl.json"),
            ("brushless_consumer.tlog", "brushless_ctl.json"),
            ("brushless_ctl.tlog", "brushless_ctl.json"),
            ("brushless_cut.BIN", "brushless_ctl.json"),
        )
    ),
]


def angles(folder, name, control, **attitude):
    """What was found of each command, printed."""
    commands, by_boot = held(folder, control)
    found = flown(folder / name, commands, by_boot=by_boot, **attitude)
    print()
    for each in found:
        error, std = np.max(np.abs(each.errors_rad), axis=0) / DEG, np.median(each.stds_rad, axis=0) / DEG
        print(f"{name} {each.held.what}: off by {error.round(2)} deg, std {std.round(2)}, {set(each.reasons)}")
    return found


@pytest.mark.parametrize(("folder", "name", "control"), FLIGHTS)
def test_commanded_angles_are_held_within_their_std(folder, name, control):
    """The tilt within half a degree too; the heading is as good as the autopilot knows its own."""
    found = angles(folder, name, control)
    assert len(found) >= 3
    for each in found:
        assert np.all(np.abs(each.errors_rad) <= 2 * each.stds_rad), each.held.what
        assert np.max(np.abs(each.errors_rad[:, 0])) < 0.5 * DEG, each.held.what


@pytest.mark.parametrize(("folder", "name", "control"), [FLIGHTS[0], FLIGHTS[2]])
@pytest.mark.parametrize("stated", [SERVO, UNKNOWN_AXES], ids=["axes stated", "axes open"])
def test_a_servo_mount_that_is_stated_needs_no_evidence(folder, name, control, stated):
    """Where its axes are stated too, no std is wider than the configuration's and that of a new command."""
    for each in angles(folder, name, control, **stated):
        assert np.all(np.abs(each.errors_rad) <= 2 * each.stds_rad), each.held.what
        assert np.max(np.abs(each.errors_rad[:, 0])) < 0.5 * DEG, each.held.what
        if stated is SERVO:
            assert np.median(each.stds_rad) < 2.5 * DEG


def test_what_was_told_of_a_gimbal_ends_with_the_boot():
    """The mount is against the vehicle until the autopilot restarts with another, which keeps to the horizon."""
    found = angles(SAMPLE, "servo_wind.tlog", WIND)
    said = [any("-frame" in reason for reasons in each.reasons for reason in reasons) for each in found]
    assert said[:2] == [True, True]
    assert said[2:] == [False] * len(said[2:])
    assert all(np.median(each.stds_rad) < 2.5 * DEG for each in found[2:])
