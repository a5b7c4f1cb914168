"""A source of heights that nobody here has heard of: an entry of the table, and a decoder that makes its tracks."""

from dataclasses import replace

import numpy as np
import pytest

from aerodft.adapters.telemetry.mavlink import MavlinkDecoder
from aerodft.model import GpsTrack, HeightSource, HeightTrack, PositionTrack, Status
from aerodft.service import HEIGHT_SOURCES, HeightReader, HeightSettings, Pipeline

LIDAR = HeightSource("lidar")


class LidarDecoder(MavlinkDecoder):
    """Says, beside all else, that a lidar sees the ground 48 m below wherever the vehicle is."""

    def decode(self, block):
        tracks = super().decode(block)
        for track in tracks:
            if isinstance(track, PositionTrack) and not isinstance(track, GpsTrack):
                value_m = np.full(len(track.boot_ns), 48.0)
                yield HeightTrack(
                    arrival_ns=track.arrival_ns,
                    boot_ns=track.boot_ns,
                    source=LIDAR,
                    value_m=value_m,
                    slant=False,
                    std_m=np.full_like(value_m, np.nan),
                )
            yield track


@pytest.fixture
def lidar(monkeypatch):
    monkeypatch.setitem(HEIGHT_SOURCES, LIDAR, HeightReader(name=LIDAR, datum="surface", std_m=0.05))


@pytest.mark.usefixtures("lidar")
def test_a_source_from_outside_measures_through_the_pipeline(bench):
    height = HeightSettings(order=(LIDAR, HeightSource.HOME))
    telemetry = replace(bench.settings.telemetry, height=height)
    pipeline = Pipeline(replace(bench.settings, telemetry=telemetry), LidarDecoder())
    outputs = bench.run_events(*bench.blocks(bench.flight(3.0)), bench.image(0, 1_050), made=pipeline)
    (sample,) = bench.poses(outputs)
    assert (sample.status, sample.height_source, sample.height_datum) == (Status.OK, LIDAR, "surface")
    assert (sample.pose.position_enu_m[2], sample.std.height_agl_m) == (pytest.approx(48.0), 0.05)
    assert sample.reasons[-1] == "home says 50.10 m where lidar says 48.00 m: 2.10 m apart, their std is 1.00 m"
    (centre,) = bench.measured(outputs, "centre")
    assert centre.value == pytest.approx(48.0 / np.cos(np.radians(30.0)), abs=1e-4)


@pytest.mark.usefixtures("lidar")
def test_without_its_samples_the_reason_names_it(bench):
    telemetry = replace(bench.settings.telemetry, height=HeightSettings(order=(LIDAR,)))
    pipeline = bench.pipeline(telemetry=telemetry)
    outputs = bench.run_events(*bench.blocks(bench.flight(3.0)), bench.image(0, 1_050), made=pipeline)
    (sample,) = bench.poses(outputs)
    assert (sample.status, sample.reasons) == (Status.NO_HEIGHT, ("no height received yet from lidar",))
