"""A source of attitudes that nobody here has heard of: an entry of the table, and a decoder that makes its tracks."""

from dataclasses import replace

import numpy as np
import pytest

from aerodft.adapters.telemetry.mavlink import MavlinkDecoder
from aerodft.geometry import angles_of_matrix, matrix
from aerodft.model import GimbalSource, GimbalTrack, Status
from aerodft.service import GIMBAL_SOURCES, AttitudeSettings, GimbalReports, Pipeline

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
