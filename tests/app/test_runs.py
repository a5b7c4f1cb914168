"""Stations, imports and recomputations as a script calls them: callbacks, progress and results."""

import pytest

from aerodft import Station, import_flight, recompute
from aerodft.app.recorded_scenes import recorded_setup
from aerodft.errors import UsageError
from aerodft.reports.recording_series import read_series
from replay.recordings import Recording

FIXED = """
[station]
name = "yard"
[camera]
name = "yard"
width_px = 64
height_px = 48
hfov_deg = 60.0
[pose]
height_agl_m = 8.0
tilt_deg = 60.0
[images]
rate_hz = 50
[zenoh]
enabled = false
[[probe]]
name = "centre"
kind = "range"
pixels = [[31.5, 23.5]]
"""
LOG, STATION = "samples/copter.tlog", "configs/services/river-flight.toml"


@pytest.fixture
def station(tmp_path):
    (tmp_path / "station.toml").write_text(FIXED)
    return Station(tmp_path / "station.toml", output=tmp_path / "rec")


def test_a_station_hands_on_every_measurement_that_it_records(station):
    found = []
    station.on_measurement(found.append)
    with station:
        while len(found) < 4:
            station.wait(seconds=0.05)
    assert {each.name for each in found} == {"centre"}
    assert len(found) == len(list(Recording(station.recording).measurements())) == station.result.statistics.images


def test_what_a_callback_raises_ends_the_station_and_keeps_the_recording(station):
    def fail(measurement):
        raise LookupError(measurement.name)

    station.on_measurement(fail)
    with pytest.raises(LookupError, match="centre"), station:
        station.wait()
    recording = Recording(station.recording)
    assert recording.is_whole
    assert next(recording.measurements(), None) is not None


def test_a_station_that_was_not_entered_has_no_result(station):
    with pytest.raises(ValueError, match="not been entered"):
        _ = station.result


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """The sample as a recording, and the progress that was told."""
    folder, seen = tmp_path_factory.mktemp("imported") / "rec", []
    import_flight(LOG, station=STATION, output=folder, progress=lambda *each: seen.append(each))
    return folder, seen


def test_seconds_count_from_the_first_image_where_the_host_is_ahead_of_utc(imported):
    recording = Recording(imported[0])
    series = read_series(recording)
    assert series.zero_ns == series.poses.stamps_ns[0] == recorded_setup(imported[0], at_s=0.0)[1].stamp_ns
    assert recording.zero_ns - series.zero_ns == pytest.approx(1.2e9, abs=0.01e9)


def test_an_import_tells_its_progress(imported):
    done, totals = zip(*imported[1], strict=True)
    assert list(done) == sorted(done)
    assert (done[0], len(set(totals))) == (0, 1)


def test_what_progress_raises_ends_the_work_and_keeps_what_there_is(tmp_path):
    def stop(done, _):
        if done > 0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        import_flight(LOG, station=STATION, output=tmp_path / "rec", progress=stop)
    assert Recording(tmp_path / "rec").is_whole
    with pytest.raises(KeyboardInterrupt):
        recompute(tmp_path / "rec", tmp_path / "again", progress=stop)
    assert Recording(tmp_path / "again").is_whole


def test_one_source_of_images_is_enough(tmp_path):
    with pytest.raises(UsageError, match="`video` and `rate_hz` together"):
        import_flight(LOG, station=STATION, output=tmp_path, video="flight.mp4", rate_hz=2.0)


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, float("nan"), 1e9])
def test_a_rate_that_no_camera_has_is_refused_before_anything_is_written(rate_hz, tmp_path):
    with pytest.raises(UsageError, match="`rate_hz`: got"):
        import_flight(LOG, station=STATION, output=tmp_path / "rec", rate_hz=rate_hz)
    assert not (tmp_path / "rec").exists()
