import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry import open_log
from aerodft.adapters.telemetry.mavlink import FollowedIds, FrameCounts
from aerodft.adapters.telemetry.mavlink.signing import sign
from aerodft.conventions import SECOND_NS
from aerodft.diagnosis import DiagnosisReport, LogDiagnosis, document, notes, problems
from aerodft.diagnosis.flight_checks import PoseSampler
from aerodft.model import BoolArray, IntArray, PoseBatch, PoseSample, RawBlock, Status, WireProtocol
from aerodft.service import block_of
from aerodft.service.clocks import ClockMap

if TYPE_CHECKING:
    from aerodft.service.pose import PoseSource

MakeBlock = Callable[[list[bytes]], RawBlock]

UTC_US = 1_800_000_000_000_000


def _survey(path: Path) -> DiagnosisReport:
    source = open_log(path)
    survey = LogDiagnosis(path.name)
    for event in source.events():
        assert isinstance(event, RawBlock)
        survey.add(event)
    return survey.report(counts=source.counts, warnings=source.warnings())


def _says(report: DiagnosisReport, *words: str) -> bool:
    return any(all(word in sentence for word in words) for sentence in problems(report))


def test_counts_are_pymavlinks(data_folder: Path) -> None:
    path = data_folder / "sitl/cold_boot.tlog"
    log = mavutil.mavlink_connection(str(path))
    theirs: dict[str, int] = {}
    while (message := log.recv_msg()) is not None:
        theirs[message.get_type()] = theirs.get(message.get_type(), 0) + 1
    log.close()
    report = _survey(path)
    assert {s.name: s.count for s in report.streams} == theirs
    assert {(s.system, s.component) for s in report.streams} == {(1, 1)}
    assert next(s for s in report.streams if s.name == "ATTITUDE").rate_hz == pytest.approx(10, abs=0.1)


def test_a_cold_boot(data_folder: Path) -> None:
    report = _survey(data_folder / "sitl/cold_boot.tlog")
    assert {source.name for source in report.heights} == {"home"}
    assert _says(report, "above home only")
    assert _says(report, "TERRAIN_REPORT", "spacing is 0", "102 of 178")
    assert _says(report, "RANGEFINDER never says more than 0.00 m")
    assert _says(report, "no image could be measured: BELOW_MIN_HEIGHT in 11 s", "home says 0.00 m, the minimum is 1 m")
    assert not report.usable
    assert report.clock.known_after_s == pytest.approx(9.0, abs=0.2)


def test_an_old_quad(data_folder: Path) -> None:
    report = _survey(data_folder / "logs/dronekit_quad.tlog")
    assert report.usable
    gap = next(gap for gap in report.gaps if gap.message == "GLOBAL_POSITION_INT" and gap.duration_s > 10)
    assert (gap.start_s, gap.duration_s) == (pytest.approx(235.6, abs=0.05), pytest.approx(18.8, abs=0.05))
    assert _says(report, "MOUNT_STATUS has no time stamp")
    assert _says(report, "telemetry ends at 1051.7 s")
    assert _says(report, "cut off")
    assert _says(report, "1314 frames", "not known", "1314 of 142 (RESOURCE_REQUEST of another length)")
    (gimbal,) = report.attitudes
    assert (gimbal.low, gimbal.high) == (pytest.approx(-20.9, abs=0.05), pytest.approx(48.6, abs=0.05))


def test_a_plane_without_gimbal(data_folder: Path) -> None:
    report = _survey(data_folder / "logs/vtol.tlog")
    assert report.attitudes == ()
    assert not report.usable
    assert _says(report, "no gimbal attitude (switched off by MNT_TYPE = 0", 'order = ["fixed"] and fixed_mount')
    assert _says(report, "EKF_STATUS_REPORT", "812 of 812", "(AHRS_EKF_TYPE = 10)")
    assert _says(report, "TERRAIN_REPORT) is silent 145 times for more than a second, the longest time for 6.0 s")
    assert sum("silent" in sentence and "HEARTBEAT" not in sentence for sentence in problems(report)) == 1
    assert _says(report, "clock is 15.9 s ahead")


def test_an_on_board_log(data_folder: Path) -> None:
    report = _survey(data_folder / "sitl/brushless_cut.BIN")
    assert {source.name for source in report.heights} == {"home", "rangefinder", "terrain"}
    assert [source.name for source in report.attitudes] == ["MNT"]
    assert {"ATT", "FMT", "GPS"} <= {stream.name for stream in report.streams}
    assert _says(report, "cut off")


@pytest.fixture
def made(pack: Callable[..., bytes]) -> Callable[..., DiagnosisReport]:
    """The report on messages ``(seconds, message, system)``."""

    def report(*messages: tuple[float, dialect.MAVLink_message, int]) -> DiagnosisReport:
        survey = LogDiagnosis("made")
        survey.add(
            block_of(
                WireProtocol.MAVLINK,
                "made",
                [UTC_US * 1000 + int(at_s * 1e9) for at_s, _, _ in messages],
                [pack(message, system=system) for _, message, system in messages],
            )
        )
        return survey.report(counts=FrameCounts(frames=len(messages)))

    return report


def test_problems_of_a_made_log(made: Callable[..., DiagnosisReport]) -> None:
    attitude = dialect.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0)
    rangefinder = dialect.MAVLink_rangefinder_message(0.04, 0)
    times_s = np.r_[np.arange(0, 5, 0.1), np.arange(9, 12, 0.1)]
    report = made(
        *[(t, attitude, 1) for t in times_s],
        (12.0, attitude, 2),
        (12.1, rangefinder, 1),
        (30.0, dialect.MAVLink_statustext_message(6, b"hello"), 1),
    )
    assert report.systems == (1, 2)
    assert _says(report, "more than one vehicle")
    assert _says(report, "RANGEFINDER never says more than 0.04 m")
    assert _says(report, "no UTC")
    assert _says(report, "ATTITUDE is silent for 4.1 s at 4.9 s")
    assert _says(report, "telemetry ends at 12.1 s, 17.9 s before")
    assert _says(report, "bolted to the vehicle")


def test_what_stops_before_the_rest_is_said(made: Callable[..., DiagnosisReport]) -> None:
    attitude = dialect.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0)
    fix = dialect.MAVLink_gps_raw_int_message(1, 3, 1, 1, 1, 120, 150, 0, 0, 12)
    report = made(*sorted([(t / 2, attitude, 1) for t in range(120)] + [(t / 2, fix, 1) for t in range(60)], key=_time))
    assert _says(report, "GPS_RAW_INT stops at 29.5 s, 30.0 s before the telemetry does", "how good the fix is")
    assert not _says(report, "ATTITUDE stops")


def test_what_was_worst_is_said_with_its_time(made: Callable[..., DiagnosisReport]) -> None:
    beats = [(t, dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3), 1) for t in (0, 1, 2, 9, 10)]
    ratios = [
        (t + 0.1, dialect.MAVLink_ekf_status_report_message(831, 0, 0, 0, 0.1 + 0.1 * t, 0), 1) for t in range(10)
    ]
    fixes = [
        (t + 0.2, dialect.MAVLink_gps_raw_int_message(1, 1 + (t < 3) * 2, 1, 1, 1, 9, 9, 0, 0, 9), 1) for t in range(6)
    ]
    report = made(*sorted(beats + ratios + fixes, key=_time))
    assert _says(report, "HEARTBEAT of the autopilot is silent for up to 7.0 s (2 s after the start)")
    assert _says(report, "ratio of compass reaches 1.00", "9 s after the start")
    assert _says(report, "no 3D fix in 3 of 6 reports, from 3 to 5 s after the start")
    assert document(report)["health"]["estimator"]["worst_at_s"]["compass"] == pytest.approx(9.1)


def _time(row: tuple[float, dialect.MAVLink_message, int]) -> float:
    return row[0]


def test_a_vehicle_that_is_not_heard_is_one_sentence(pack: Callable[..., bytes], block: MakeBlock) -> None:
    report = _surveyed(block([pack(_position(1000)) for _ in range(5)]), system=7)
    assert problems(report) == ["`system` = 7 is not heard, systems 1 are: nothing would be measured"]


def test_an_autopilot_or_gimbal_that_is_not_heard_is_named(pack: Callable[..., bytes], block: MakeBlock) -> None:
    (sentence,) = problems(_surveyed(block([pack(_position(1000))]), component=9))
    assert sentence.startswith("`component` = 9 is not heard, components 1 are")
    q = (1.0, 0.0, 0.0, 0.0)
    message = dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, 4000, 44, q, 0, 0, 0, 0, gimbal_device_id=1)
    report = _surveyed(block([pack(_position(1000)), *[pack(message)] * 3]), gimbal=3)
    assert _says(report, "of gimbal number 3 is not heard")
    assert not _says(report, "no gimbal attitude")


def test_signed_frames_of_a_link_without_a_key_are_said(pack: Callable[..., bytes], block: MakeBlock) -> None:
    frames = [sign(pack(_position(1000)), bytes(32), link_id=0, stamp=k) for k in range(3)] + [pack(_position(1000))]
    survey = LogDiagnosis("udpin:14550")
    survey.add(block(frames))
    report = survey.report(counts=FrameCounts(frames=4))
    assert _says(report, "this link is signed (3 of 4 frames): without `signing_key`", "would ignore requests")
    assert document(report)["frames"]["signed"] == 3


def test_what_gimbals_are_and_tell_is_said(data_folder: Path) -> None:
    report = _survey(data_folder / "sitl/brushless_consumer.tlog")
    (kept,) = [each for each in notes(report) if "earth-frame" in each]
    assert "against the horizon, as the standard says" in kept
    assert _says(report, "may be what the gimbal was told", "at least 1 deg", 'feedback = "measured"')
    assert document(report)["attitudes"][0]["feedback"] == "demand"


def test_landing_is_no_problem(data_folder: Path) -> None:
    report = _survey(data_folder / "sitl/brushless_consumer.tlog")
    assert report.usable
    assert not _says(report, "lowest")
    assert not _says(report, "BELOW_MIN_HEIGHT")
    assert any("BELOW_MIN_HEIGHT in 4" in each for each in notes(report))


def test_nothing_received(made: Callable[..., DiagnosisReport]) -> None:
    report = LogDiagnosis("udpin:14550").report(counts=FrameCounts())
    assert not report.usable
    assert problems(report) == ["nothing was received: is the sender on, and does it send to this address?"]
    unusable = made((0.0, dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3), 1))
    assert _says(unusable, "no height")
    assert _says(unusable, "no attitude")


def test_the_document_is_json(data_folder: Path) -> None:
    report = _survey(data_folder / "sitl/brushless_consumer.tlog")
    found = json.loads(json.dumps(document(report), allow_nan=False))
    assert found["schema"] == "aerodft.doctor/1"
    assert found["usable"] is True
    assert {source["source"] for source in found["heights"]} == {"home", "rangefinder", "terrain"}
    assert found["attitudes"][0]["source"] == "GIMBAL_DEVICE_ATTITUDE_STATUS"
    assert found["attitudes"][0]["low"] == pytest.approx(-90, abs=0.5)
    assert found["first_ns"] == str(report.first_ns)


def _surveyed(block: RawBlock, **followed: int) -> DiagnosisReport:
    survey = LogDiagnosis("link", followed=FollowedIds(**followed))
    survey.add(block)
    return survey.report(counts=FrameCounts())


def test_of_two_vehicles_one_is_followed_and_named(pack: Callable[..., bytes], block: MakeBlock) -> None:
    frames = [pack(_position(1000 * system), system=system) for system in (3, 4) for _ in range(5)]
    report = _surveyed(block(frames))
    assert (report.system, report.component) == (3, 1)
    assert _says(report, "more than one vehicle (systems 3, 4): system 3 is followed; choose with telemetry.system")
    chosen = _surveyed(block(frames), system=4)
    assert [(h.low, h.high) for h in chosen.heights] == [(4.0, 4.0)]
    assert _says(chosen, "system 4 is followed")


def test_of_two_autopilots_with_one_system_id_one_is_followed_and_named(
    pack: Callable[..., bytes], block: MakeBlock
) -> None:
    frames = [pack(_position(1000 * component), component=component) for component in (1, 2) * 5]
    report = _surveyed(block(frames))
    assert [(h.count, h.low, h.high) for h in report.heights] == [(5, 1.0, 1.0)]
    assert _says(report, "system 1 has more than one autopilot (components 1, 2): component 1 is followed")
    chosen = _surveyed(block(frames), component=2)
    assert [(h.count, h.low, h.high) for h in chosen.heights] == [(5, 2.0, 2.0)]
    assert document(chosen)["followed"] == {"system": 1, "component": 2}


def test_of_two_gimbals_one_is_followed_and_named(pack: Callable[..., bytes], block: MakeBlock) -> None:
    mounts = {154: -30.0, 171: -60.0}
    frames = [pack(_position(1000))]
    for _ in range(5):
        frames += [
            pack(dialect.MAVLink_mount_orientation_message(1000, 0.0, pitch, 0.0), component=component)
            for component, pitch in mounts.items()
        ]
    for followed, pitch in (({}, -30.0), ({"gimbal": 171}, -60.0), ({"gimbal": 154}, -30.0)):
        report = _surveyed(block(frames), **followed)
        ((count, low, high),) = [(a.count, a.low, a.high) for a in report.attitudes]
        assert count == 5
        assert low == pytest.approx(pitch)
        assert high == pytest.approx(pitch)
        assert _says(
            report, "MOUNT_ORIENTATION comes from more than one gimbal (components 154, 171): component", " is followed"
        )
        assert _says(report, f"component {171 if pitch == -60 else 154} is followed; choose with telemetry.gimbal")


def test_of_two_gimbals_behind_one_autopilot_the_one_asked_for_is_followed(
    pack: Callable[..., bytes], block: MakeBlock
) -> None:
    frames = [pack(_position(1000))]
    for device, pitch_rad in ((1, -0.5), (2, -1.0)) * 3:
        q = (math.cos(pitch_rad / 2), 0, math.sin(pitch_rad / 2), 0)
        message = dialect.MAVLink_gimbal_device_attitude_status_message(
            0, 0, 4000, 44, q, math.nan, math.nan, math.nan, 0, gimbal_device_id=device
        )
        frames.append(pack(message))
    report = _surveyed(block(frames), gimbal=2)
    (attitude,) = report.attitudes
    assert attitude.count == 3
    assert attitude.high == pytest.approx(math.degrees(-1.0), abs=1e-3)
    assert report.rejected == {"GIMBAL_DEVICE_ATTITUDE_STATUS: of another gimbal than number 2": 3}
    assert _says(report, "number 2 is followed, 3 messages of others are left out; choose with telemetry.gimbal")
    assert not _says(report, "of another gimbal than")


def _position(height_mm: int) -> dialect.MAVLink_message:
    return dialect.MAVLink_global_position_int_message(
        1000, -353_632_621, 1_491_652_374, 584_090, height_mm, 0, 0, 0, 65535
    )


class _Silent:
    """Telemetry of which nothing is known; counts how often it is asked."""

    def __init__(self) -> None:
        self.clock = ClockMap()
        self.asked = 0

    def at(
        self,
        stamps_ns: IntArray,
        ticks: IntArray,  # noqa: ARG002 - as the real one
        *,
        is_final: BoolArray,  # noqa: ARG002
        by_utc: BoolArray,
    ) -> tuple[PoseBatch, BoolArray]:
        self.asked += len(stamps_ns)
        unknown = PoseSample(stamp_ns=0, status=Status.NO_TELEMETRY)
        return PoseBatch.repeated(unknown, stamps_ns), np.zeros_like(by_utc)


def test_a_clock_that_jumps_again_and_again_is_asked_about_seldom() -> None:
    source = _Silent()
    survey, day_ns = PoseSampler(cast("PoseSource", source)), 86_400 * SECOND_NS
    for jump in range(1, 101):
        survey.add(jump * day_ns, jump * day_ns + SECOND_NS)
    assert survey.poses().seconds == pytest.approx(99 * 86_400 + 1, abs=10.0)
    assert source.asked < 10_000
