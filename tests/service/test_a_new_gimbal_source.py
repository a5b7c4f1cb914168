"""A source of attitudes that nobody here has heard of: an entry of the table, and a decoder that makes its tracks.

And a mount: a servo for tilt alone, on a wedge of 0.1 rad.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from aerodft.adapters.telemetry.mavlink import MavlinkDecoder
from aerodft.geometry import about_axis, angles_of_matrix, matrix, multiply
from aerodft.model import GimbalSource, GimbalTrack, MountAxes, ReportFrame, Status
from aerodft.service import GIMBAL_SOURCES, AttitudeSettings, GimbalReports, Pipeline
from aerodft.service.attitude import GIMBAL_MOUNTS, Mount

ENCODER = GimbalSource("encoder")


class EncoderDecoder(MavlinkDecoder):
    """Says of every gimbal's report that an encoder has read it."""

    def decode(self, block):
        for track in super().decode(block):
            yield replace(track, source=ENCODER) if isinstance(track, GimbalTrack) else track


def poses_of(bench, entry, monkeypatch):
    monkeypatch.setitem(GIMBAL_SOURCES, ENCODER, entry)
    telemetry = replace(bench.settings.telemetry, attitude=AttitudeSettings(order=(ENCODER,)))
    pipeline = Pipeline(replace(bench.settings, telemetry=telemetry), EncoderDecoder())
    outputs = bench.run_events(*bench.blocks(bench.flight(3.0)), bench.image(0, 1_050), made=pipeline)
    return bench.poses(outputs)


def test_a_source_from_outside_has_its_name_in_poses(bench, monkeypatch):
    (sample,) = poses_of(bench, GimbalReports(name=ENCODER), monkeypatch)
    assert (sample.status, sample.attitude_source) == (Status.OK, ENCODER)
    tilt, _, _ = angles_of_matrix(matrix(sample.pose.wxyz))
    assert np.degrees(tilt) == pytest.approx(30.0, abs=0.1)
    assert any("the std covers both" in reason and "encoder" in reason for reason in sample.reasons)


def test_its_default_is_that_nothing_is_known_of_its_reports(bench, monkeypatch):
    """Against what they are and whether they are demands is estimated, unless the entry says that the camera knows."""
    (unknown,) = poses_of(bench, GimbalReports(name=ENCODER), monkeypatch)
    (stated,) = poses_of(bench, GimbalReports(name=ENCODER, is_own_statement=True), monkeypatch)
    assert stated.std.tilt_rad < unknown.std.tilt_rad
    assert not any("the std covers both" in reason for reason in stated.reasons)


def test_without_its_reports_the_reason_names_it(bench, monkeypatch):
    monkeypatch.setitem(GIMBAL_SOURCES, ENCODER, GimbalReports(name=ENCODER))
    telemetry = replace(bench.settings.telemetry, attitude=AttitudeSettings(order=(ENCODER,)))
    pipeline = bench.pipeline(telemetry=telemetry)
    outputs = bench.run_events(*bench.blocks(bench.flight(3.0)), bench.image(0, 1_050), made=pipeline)
    (sample,) = bench.poses(outputs)
    assert sample.status is Status.NO_ATTITUDE
    assert "encoder" in sample.reasons[0]


class Wedge(Mount):
    def compose(self, yaw_rad, pitch_rad, roll_rad):  # noqa: ARG002
        return multiply(about_axis(2, yaw_rad), about_axis(1, pitch_rad + 0.1))


def test_a_mount_from_outside_composes_its_angles(bench, monkeypatch):
    wedge = MountAxes("wedge")
    monkeypatch.setitem(GIMBAL_MOUNTS, wedge, Wedge(axes=wedge))
    tilts_deg = []
    for axes in (MountAxes.TILT_ONLY, wedge):
        attitude = AttitudeSettings(frame=ReportFrame.BODY, axes=axes)
        outputs = bench.run_events(
            *bench.blocks(bench.flight(3.0)),
            bench.image(0, 1_050),
            made=bench.pipeline(telemetry=replace(bench.settings.telemetry, attitude=attitude)),
        )
        (sample,) = bench.poses(outputs)
        assert sample.status is Status.OK
        tilts_deg.append(math.degrees(angles_of_matrix(matrix(sample.pose.wxyz))[0]))
    assert tilts_deg[1] - tilts_deg[0] == pytest.approx(math.degrees(0.1), abs=0.1)
