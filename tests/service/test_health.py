"""What a vehicle says of itself, and the statuses, stds and remarks that follow by the stated rules."""

import re
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.geometry import camera_pose
from aerodft.model import EstimatorTrack, GpsTrack, PoseBatch, PoseSample, Status
from aerodft.service import HealthSettings
from aerodft.service.health import HealthSources
from tests.payloads import encode_pose

MS = 1_000_000
SECONDS = 14.0


def _heartbeat():
    return dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)


def _gps(fix=3, h_acc=800, v_acc=1200):
    return dialect.MAVLink_gps_raw_int_message(
        5_000_000, fix, -353_600_000, 1_491_600_000, 0, 80, 120, 0, 0, 14, 0, h_acc, v_acc
    )


def _ekf(flags=831, **ratios):
    values = {"velocity": 0.1, "horizontal": 0.1, "vertical": 0.1, "compass": 0.1} | ratios
    return dialect.MAVLink_ekf_status_report_message(flags, *values.values(), 0.1)


def _px4(vertical):
    return dialect.MAVLink_estimator_status_message(5_000_000, 831, 0.1, 0.1, vertical, 0.1, 0.1, 0.1, 1.0, 1.0)


@pytest.fixture
def fly(bench):
    """Poses every 500 ms of a flight in which the vehicle says ``(boot_ms, message)``; frames are numbered."""

    def flown(said, *, drop=None, health=None, failing=()):
        mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        said = [(bench.host0_ns + ms * MS + 2 * MS, bytes(message.pack(mav))) for ms, message in said]
        frames = sorted([*bench.flight(SECONDS)[1:], *said])
        frames = [(bench.host0_ns, bytes(_heartbeat().pack(mav))), *frames]
        kept = [(k, each) for k, each in enumerate(frames) if drop is None or not drop(k)]
        numbered = [(at, _numbered(raw, k % 256, failing)) for k, (at, raw) in kept]
        telemetry = replace(bench.settings.telemetry, health=health or HealthSettings())
        images = [bench.image(k, 1000 + 500 * k) for k in range(int(2 * SECONDS) - 4)]
        outputs = bench.run_events(*bench.blocks(numbered), *images, made=bench.pipeline(telemetry=telemetry))
        return {(each.stamp_ns - bench.utc0_ns) // MS: each for each in bench.poses(outputs)}

    return flown


def _numbered(raw, sequence, failing):
    """A MAVLink 2 frame with another sequence number; a gimbal's from, to (ms) with these failure flags."""
    message = dialect.MAVLink(None).parse_char(raw)
    if failing and message.get_msgId() == 285 and failing[0] <= message.time_boot_ms < failing[1]:
        message.failure_flags = failing[2]
    mav = dialect.MAVLink(None, srcSystem=message.get_srcSystem(), srcComponent=message.get_srcComponent())
    mav.seq = sequence
    return bytes(message.pack(mav))


def _every(step_ms, message, until_ms=int(SECONDS * 1000)):
    return [(ms, message() if callable(message) else message) for ms in range(0, until_ms, step_ms)]


BEATS = _every(1000, _heartbeat)


def test_a_healthy_vehicle_is_believed_without_a_word(fly):
    poses = fly([*BEATS, *_every(500, _gps()), *_every(500, _ekf())])
    assert {each.status for each in poses.values()} == {Status.OK}
    assert not [r for each in poses.values() for r in each.reasons if "GPS" in r or "estimator" in r or "HEART" in r]


def test_without_a_heartbeat_for_five_seconds_telemetry_is_stale(fly):
    poses = fly(_every(1000, _heartbeat, until_ms=4001))
    for ms, each in poses.items():
        if ms <= 8950:
            assert each.status is Status.OK, ms
        elif ms > 9050:
            assert each.status is Status.STALE_TELEMETRY, ms
            assert each.reasons[0] == "no HEARTBEAT of the autopilot for more than 5 s"


def test_after_a_link_was_dead_a_heartbeat_may_come_in_its_time(fly):
    poses = fly(BEATS, drop=lambda k: 51 * 4.0 < k < 51 * 10.3)  # 51 frames in a second
    assert poses[7000].status is Status.STALE_TELEMETRY
    assert poses[10_500].status is Status.OK


@pytest.mark.parametrize("which", ["velocity", "horizontal", "vertical", "compass"])
def test_an_estimator_at_fault_has_no_answer(fly, which):
    said = [*BEATS, *_every(500, _ekf(), until_ms=5000)]
    said += [(ms, _ekf(**{which: 1.3})) for ms in range(5000, 9000, 500)]
    said += [(ms, _ekf(**{which: 0.85})) for ms in range(9000, 14000, 500)]
    poses = fly(said)
    assert {each.status for ms, each in poses.items() if ms < 4900} == {Status.OK}
    at_fault = [each for ms, each in poses.items() if 5100 < ms < 8900]
    assert {each.status for each in at_fault} == {Status.UNHEALTHY}
    assert all(which in each.reasons[0] and "1.30" in each.reasons[0] for each in at_fault)
    near = [each for ms, each in poses.items() if ms > 9100]
    assert {each.status for each in near} == {Status.OK}
    assert all(any("near its limit" in reason and which in reason for reason in each.reasons) for each in near)


def test_the_estimator_of_px4_is_heard_too(fly):
    poses = fly([*BEATS, *_every(500, _px4(1.2))])
    assert poses[6000].status is Status.UNHEALTHY
    assert "vertical position is 1.20" in poses[6000].reasons[0]


def test_an_estimator_without_attitude_has_no_answer(fly):
    poses = fly([*BEATS, *_every(500, _ekf(flags=1024))])
    assert poses[6000].status is Status.UNHEALTHY
    assert poses[6000].reasons[0] == "the autopilot's estimator says that it has no attitude"


def test_without_a_fix_no_place_is_stated(fly):
    poses = fly([*BEATS, *_every(500, _gps(), until_ms=5000), *((ms, _gps(fix=1)) for ms in range(5000, 14000, 500))])
    assert poses[4000].lat_rad is not None
    assert poses[7000].status is Status.OK
    assert poses[7000].lat_rad is None
    assert poses[7000].origin is None
    assert any("no 3D fix" in reason for reason in poses[7000].reasons)


def test_a_poor_fix_widens_the_place(fly):
    good, poor = fly([*BEATS, *_every(500, _gps())]), fly([*BEATS, *_every(500, _gps(h_acc=12_000))])
    assert poor[7000].std.horizontal_m == 12.0
    assert poor[7000].pose.cov[0, 0] == pytest.approx(144.0)
    assert poor[7000].pose.cov[1, 1] == pytest.approx(144.0)
    np.testing.assert_allclose(good[7000].pose.cov[2:, 2:], poor[7000].pose.cov[2:, 2:], atol=1e-15)
    assert any("accurate to 12.0 m horizontally" in reason for reason in poor[7000].reasons)


def test_a_silent_receiver_is_said(fly):
    poses = fly([*BEATS, *_every(500, _gps(), until_ms=4001)])
    assert not any("silent" in reason for reason in poses[7500].reasons)
    assert "GPS has been silent for more than 4 s" in poses[10500].reasons


def test_an_estimator_that_ends_in_nan_is_not_forgotten_without_a_word(fly):
    said = [*_every(500, _ekf(horizontal=1.2), 4000), *_every(500, _ekf(horizontal=float("nan")))[8:]]
    poses = fly([*BEATS, *said])
    assert poses[8000].status is Status.UNHEALTHY
    assert poses[10_000].status is Status.OK
    (remark,) = [reason for reason in poses[10_000].reasons if "estimator" in reason]
    assert remark == "the autopilot's estimator has said nothing believable for more than 5 s"


@pytest.mark.parametrize(("share", "is_said"), [(0.3, True), (0.02, False)])
def test_a_lossy_link_is_said(fly, share, is_said):
    lost = np.random.default_rng(3).random(2000) < share
    poses = fly(BEATS, drop=lambda k: k > 20 and lost[k])
    said = [reason for reason in poses[11000].reasons if "the link lost" in reason]
    assert bool(said) is is_said
    if is_said:
        percent = int(re.search(r"lost (\d+) % of the autopilot's frames over 10 s", said[0])[1])
        assert percent == pytest.approx(30, abs=6)


def test_limits_are_configured(fly):
    limits = HealthSettings(max_ratio=2.0, heartbeat_ns=60_000_000_000)
    poses = fly([(0, _heartbeat()), *_every(500, _ekf(compass=1.3))], health=limits)
    assert poses[12000].status is Status.OK


MOUNT = dialect.MAVLink_mount_status_message(0, 0, -6000, 0, 0)


def test_a_gimbal_that_fails_is_not_believed_by_another_of_its_messages(fly):
    said = [*BEATS, *_every(100, MOUNT)]
    poses = fly(said, failing=(5000, 9000, 32 | 8))
    assert {each.status for ms, each in poses.items() if ms < 4900 or ms > 10_100} == {Status.OK}
    failed = [each for ms, each in poses.items() if 6000 < ms < 9000]
    assert {each.status for each in failed} == {Status.UNHEALTHY}
    for each in failed:
        assert each.reasons[:2] == tuple(
            f"the gimbal reports a failure ({what}): its other reports are not believed"
            for what in ("encoder error", "motor error")
        )
    assert not any("failure" in reason for ms, each in poses.items() if ms > 10_100 for reason in each.reasons)


def test_why_there_is_no_attitude_of_a_gimbal_that_fails_is_said(fly):
    poses = fly(BEATS, failing=(5000, 9000, 16))
    failed = [each for ms, each in poses.items() if 6100 < ms < 8000]
    assert {each.status for each in failed} == {Status.STALE_TELEMETRY}
    assert all("the gimbal reports a failure (power error)" in each.reasons for each in failed)


def test_a_failure_that_passes_is_a_remark(fly):
    poses = fly(BEATS, failing=(5000, 5100, 64))
    assert {each.status for each in poses.values()} == {Status.OK}
    told = [ms for ms, each in poses.items() if "the gimbal reports a failure (software error)" in each.reasons]
    assert told == [5000, 5500, 6000]


def test_remarks_are_the_same_in_image_after_image(fly):
    poses = fly([*_every(500, _gps(), until_ms=2001), *_every(500, _ekf(), until_ms=2001), (0, _heartbeat())])
    assert len({each.reasons for ms, each in poses.items() if ms > 8000}) == 1


def test_verdicts_on_many_poses_are_those_on_each():
    """Whatever was said again and again, or gives no cause to say anything, is gone through once."""
    rng = np.random.default_rng(3)
    sources, count = HealthSources(HealthSettings()), 400
    stamps_ns = np.cumsum(rng.choice([100, 200, 7000], count, p=[0.6, 0.38, 0.02])) * MS
    ratios = rng.choice([0.1, 0.85, 1.2, np.nan], (count, 4), p=[0.9, 0.05, 0.03, 0.02])
    known = {"arrival_ns": stamps_ns, "boot_ns": stamps_ns}
    sources.append(EstimatorTrack(**known, ratios=ratios, has_attitude=rng.random(count) > 0.1), stamps_ns)
    fixes, same = np.repeat(rng.choice([2, 3, 4], count // 8), 8), np.repeat(rng.random(count // 8) * 9, 8)
    satellites, unknown = np.full(count, 12), np.where(rng.random(count) < 0.1, np.nan, 1.5)
    gps = GpsTrack(**known, fix=fixes, satellites=satellites, horizontal_std_m=same, vertical_std_m=unknown)
    sources.append(gps, stamps_ns)
    asked = np.sort(rng.integers(0, stamps_ns[-1], 900))
    flown = PoseSample(stamp_ns=0, status=Status.OK, pose=camera_pose(height_agl_m=10.0, tilt_rad=0.5))
    poses, ticks = PoseBatch.repeated(flown, asked), np.zeros(len(asked), dtype=np.int64)
    together = sources.with_verdicts(poses, ticks)
    alone = [sources.with_verdicts(poses[row : row + 1], ticks[:1])[0] for row in range(len(asked))]
    assert [encode_pose(each) for each in together] == [encode_pose(each) for each in alone]
    assert len({each.reasons for each in alone}) > 20
    assert len(together.variants) < 400
