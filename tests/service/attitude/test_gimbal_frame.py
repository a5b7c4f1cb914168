"""Verdicts on what a gimbal reports against: when there is one, when it changes, and when there can be none."""

import math
from dataclasses import replace
from itertools import groupby, pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerodft.geometry import from_yaw_pitch_roll
from aerodft.model import ReportFrame
from aerodft.service.attitude.gimbal_frame import (
    BODY_READINGS,
    PRIOR_BODY,
    FrameDetector,
    GravitySample,
    GravitySamples,
    gravity_samples,
)
from aerodft.service.streams import Stream

STEP_NS = 100_000_000
SWAY_RAD = math.radians(8)


def down(pitch_rad):
    """Gravity in axes that are pitched up by this much."""
    return np.array([-math.sin(pitch_rad), 0.0, math.cos(pitch_rad)])


class Flight:
    """A vehicle that rocks, and a camera that keeps its pitch; fed to a detector report by report."""

    def __init__(self):
        self.detector = FrameDetector()
        self.now_ns = 0

    def rock(self, seconds, pitch_deg, *, undone=1.0, sway_rad=SWAY_RAD):
        """Reports of ``pitch_deg`` minus a share of the vehicle's pitch."""
        for _ in range(round(seconds * 10)):
            sway = sway_rad * math.sin(self.now_ns / 1e9 * 2)
            report = math.radians(pitch_deg) - undone * sway
            if_body = np.tile(down(report + sway), (BODY_READINGS, 1))
            self.detector.update(GravitySample(self.now_ns, report, down(sway), down(report), if_body))
            self.now_ns += STEP_NS
        return self.detector.evidence


def vary(flight, seconds, undone):
    """Half of the time at each of several pitches, so that no report is at the end of its range."""
    for pitch_deg in (0, -80, -40):
        evidence = flight.rock(seconds / 3, pitch_deg, undone=undone)
    return evidence


@pytest.mark.parametrize(("undone", "frame"), [(0.0, ReportFrame.EARTH), (1.0, ReportFrame.BODY)])
def test_a_rocking_vehicle_tells(undone, frame):
    evidence = vary(Flight(), 60, undone)
    assert (evidence.frame, evidence.contradictory) == (frame, False)
    assert evidence.undone == pytest.approx(undone * evidence.motions, abs=4)
    assert abs(evidence.body_probability - undone) < 1e-3


def test_without_motion_there_is_no_verdict():
    evidence = Flight().rock(600, -30, undone=0.0, sway_rad=math.radians(0.5))
    assert (evidence.frame, evidence.motions) == (None, 0)
    assert evidence.body_probability == pytest.approx(0.25)


def test_a_report_at_the_end_of_its_range_may_be_a_servo_at_its_limit():
    flight = Flight()
    assert flight.rock(600, 10, undone=0.0).frame is None
    assert flight.rock(30, -45, undone=1.0).frame is ReportFrame.BODY


def test_no_limit_has_a_camera_look_beyond_straight_down():
    """A servo that is held straight down leaves its limit as soon as the vehicle's nose goes down."""
    assert Flight().rock(60, -90, undone=0.0).frame is ReportFrame.EARTH


def test_what_a_limit_explains_is_not_forgotten_for_chances():
    """A camera that holds its pitch in gusts: every other motion happens to fit the vehicle of a moment ago."""
    detector = FrameDetector()
    for k in range(6000):
        sway = SWAY_RAD * math.sin(k / 5)
        report = math.radians(-45) + SWAY_RAD / 30 * math.sin(k / 5)
        if_body = np.tile(down(report + sway), (BODY_READINGS, 1))
        if k // 60 % 2:
            if_body[2] = down(math.radians(-45))
        detector.update(GravitySample(k * STEP_NS, report, down(sway), down(report), if_body))
    assert detector.evidence.motions > 500
    assert detector.evidence.frame is not ReportFrame.BODY
    assert detector.evidence.body_probability < PRIOR_BODY


def test_what_a_slow_noisy_attitude_does_is_no_motion():
    """In a hover the vehicle's attitude comes four times a second with 0.6 degrees of noise, the gimbal's without."""
    rng = np.random.default_rng(5)
    vehicle = Stream(1_000_000_000)
    attitudes = Rotation.from_rotvec(np.radians(0.6) * rng.standard_normal((440, 3)))
    vehicle.append(np.arange(440) * 250_000_000, wxyz=attitudes.as_quat(scalar_first=True))
    gimbal = Stream(1_000_000_000)
    reports = np.tile(from_yaw_pitch_roll(0.0, math.radians(-45), 0.0), (1000, 1))
    gimbal.append(10**9 + np.arange(1000) * STEP_NS, wxyz=reports, yaw_in_earth=np.zeros(1000))
    detector = FrameDetector()
    found = gravity_samples(gimbal, vehicle, after_ns=0, until_ns=101 * 10**9)
    assert len(found) > 900
    assert list(detector.update_all(found)) == []
    assert detector.evidence.motions == 0


def flown(rng, count):
    """A vehicle that rocks at times, with a camera that holds its pitch, and gaps in what is known of it."""
    elapsed_ns = np.cumsum(rng.choice([STEP_NS, STEP_NS, STEP_NS, 3 * STEP_NS, 30 * STEP_NS], count))
    rocks = np.repeat(rng.random(count // 50 + 1) < 0.4, 50)[:count]
    sways = np.where(rocks, SWAY_RAD, SWAY_RAD / 50) * np.sin(elapsed_ns / 1e9 * 2) + 1e-3 * rng.standard_normal(count)
    reports = math.radians(-40) - rng.choice([0.0, 1.0]) * sways
    if_body = np.array([[down(report + sway)] * BODY_READINGS for report, sway in zip(reports, sways, strict=True)])
    own, seen = (np.array([down(each) for each in angles]) for angles in (sways, reports))
    stamps_ns, bends = 1_795_000_000 * 10**9 + elapsed_ns, 1e-4 * rng.random(count)
    silence_ns = np.diff(stamps_ns, prepend=stamps_ns[0]) + np.where(rng.random(count) < 2 / count, 10 * 10**9, 0)
    return GravitySamples(rng.random(count) > 0.01, stamps_ns, reports, own, seen, if_body, bends, silence_ns)


@pytest.mark.parametrize("seed", range(6))
def test_reports_may_be_weighed_together_or_one_by_one(seed):
    """What is known, and from when on, is the same however they are cut."""
    rng = np.random.default_rng(seed)
    found = flown(rng, 2000)
    alone, together = FrameDetector(), FrameDetector()
    wanted = []
    for row in range(len(found)):
        before = alone.evidence
        if found.silence_ns[row] >= 10 * 10**9:
            alone.forget()
        if found.is_known[row]:
            alone.update(found.row(row))
        else:
            alone.end_motion()
        if alone.evidence is not before:
            wanted.append((int(found.stamp_ns[row]), alone.evidence))
    cuts = [0, *np.sort(rng.choice(2000, 20, replace=False)).tolist(), 2000]
    got = [each for a, b in pairwise(cuts) if b > a for each in together.update_all(found.rows(slice(a, b)))]
    assert got == wanted
    assert len(wanted) > 20
    after = flown(rng, 300).rows(slice(0, 1)).row(0)
    later = replace(after, stamp_ns=int(found.stamp_ns[-1]) + STEP_NS)
    alone.update(later)
    together.update(later)
    assert alone.evidence == together.evidence


def test_the_parts_of_one_motion_are_no_verdict():
    """The vehicle leans by 20 degrees within a second, and the camera is commanded up by as much at the same time."""
    flight = Flight()
    vary(flight, 30, 0.5)  # which tells nothing
    before = flight.detector.evidence.body_probability
    flight.detector.end_motion()
    for lean in np.radians(np.linspace(0, 20, 11)):
        report = math.radians(-40) - lean
        if_body = np.tile(down(report + lean), (BODY_READINGS, 1))
        flight.detector.update(GravitySample(flight.now_ns, report, down(lean), down(report), if_body))
        flight.now_ns += STEP_NS
    evidence = flight.detector.evidence
    assert evidence.frame is None
    assert evidence.body_probability / (1 - evidence.body_probability) <= 101 * before / (1 - before)


def test_a_verdict_is_doubted_and_then_reversed_when_the_reports_change():
    """However long the flight before: the gimbal may be another one."""
    flight = Flight()
    vary(flight, 120, 1.0)
    frames = [flight.rock(1, -40, undone=0.0).frame for _ in range(60)]
    assert [frame for frame, _ in groupby(frames)] == [ReportFrame.BODY, None, ReportFrame.EARTH]
    assert frames.index(None) <= 6
    assert frames.index(ReportFrame.EARTH) <= 20
    assert not flight.detector.evidence.contradictory
    assert flight.rock(60, -40, undone=1.0).contradictory


def test_half_of_a_motion_undone_is_no_evidence():
    assert vary(Flight(), 60, 0.5).frame is None


def test_nothing_is_compared_over_a_gap():
    whole, broken = Flight(), Flight()
    for flight in (whole, broken):
        flight.rock(2.0, -40)
    broken.detector.end_motion()
    counts = [flight.rock(0.2, -40).motions for flight in (whole, broken)]
    assert counts[1] <= counts[0]
    before = broken.detector.evidence.motions
    broken.detector.end_motion()
    broken.now_ns += 800_000_000
    assert broken.rock(0.1, -40).motions == before
