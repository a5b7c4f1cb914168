"""A fixed camera over a tide of closed form, and how well levels between readings are known, by Monte-Carlo."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.dft import Request, measure
from aerodft.geometry import camera_pose
from aerodft.model import (
    Camera,
    Image,
    LevelSeries,
    PoseBatch,
    PoseSample,
    PoseStd,
    Probe,
    ProbeKind,
    Status,
)
from aerodft.service import Batches, Pipeline, PipelineSettings
from aerodft.service.pose import over_water

HOUR_NS = 3_600_000_000_000
T0_NS = 1_777_629_600_000_000_000
HEIGHT_M, TILT_RAD = 9.0, math.radians(55.0)
CAMERA = Camera.from_fov(name="c", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.66)
ENDS = ((400.0, 700.0), (1500.0, 720.0))
PROBE = Probe(name="width", kind=ProbeKind.DISTANCE, pixels=ENDS, std_px=0.0)


def tide_m(hours, phase=0.0, amplitude_m=1.6):
    """The level of a semidiurnal tide with a shallow-water overtide."""
    turn = 2 * math.pi * np.asarray(hours) / 12.42 + phase
    return amplitude_m * np.sin(turn) + 0.1 * amplitude_m * np.sin(2 * turn)


def series_of(hours, levels_m, std_m, **more):
    stamps_ns = T0_NS + np.round(np.asarray(hours) * HOUR_NS).astype(np.int64)
    stds_m = np.broadcast_to(std_m, len(stamps_ns)).astype(float)
    known = {"max_gap_ns": 3 * HOUR_NS, "datum": "gauge", "source": "gauge.csv"} | more
    return LevelSeries(stamps_ns=stamps_ns, level_m=np.asarray(levels_m, dtype=float), std_m=stds_m, **known)


def stamps(hours):
    return T0_NS + np.round(np.asarray(hours) * HOUR_NS).astype(np.int64)


class _NoTelemetry:
    rejected: dict[str, int] = {}  # noqa: RUF012 - of the port

    def decode(self, block):  # noqa: ARG002 - of the port
        return ()


def test_a_fixed_camera_measures_the_water_of_the_day_through_the_pipeline():
    zero_m, rng = 0.35, np.random.default_rng(5)
    hours = np.arange(0.0, 26.0, 0.25)
    series = series_of(hours, tide_m(hours) + rng.normal(0.0, 0.02, len(hours)), 0.02, zero_m=zero_m)
    pose = camera_pose(height_agl_m=HEIGHT_M, tilt_rad=TILT_RAD, std=PoseStd())
    fixed = PoseSample(stamp_ns=0, status=Status.OK, pose=pose)
    settings = PipelineSettings(station="s", camera=CAMERA, probes=(PROBE,), fixed_pose=fixed, level=series)
    at = np.sort(rng.uniform(0.0, 25.7, 400))
    pipeline, found = Pipeline(settings, _NoTelemetry()), []
    for index, stamp_ns in enumerate(stamps(at).tolist()):
        image = Image(index=index, stamp_ns=stamp_ns, arrival_ns=stamp_ns)
        outputs = pipeline.advance(Batches.from_events(np.array([stamp_ns]), [image]))
        found += [row[0] for block in outputs.images for row in block.measurements]
    level_plane = measure(settings.setup, PoseBatch.from_samples([fixed]), (request(),))[0][0].value
    truth_m = level_plane * (HEIGHT_M - (tide_m(at) - zero_m)) / HEIGHT_M
    assert [each.status for each in found] == [Status.OK] * len(at)
    inside = [low <= true <= high for (low, high), true in zip((m.ci95 for m in found), truth_m, strict=True)]
    assert np.mean(inside) >= 0.95
    # The std is that of the level, by the closed form, and no wider than 3 cm of level.
    assert max(each.std for each in found) < level_plane / HEIGHT_M * 0.03
    assert_allclose([each.pose.level.level_m for each in found], tide_m(at), atol=0.08)


def request():
    return Request(probe=PROBE, pixels=PROBE.pixels, std_px=PROBE.std_px)


def coverage(truth, hours, at, std_m, rng, draws=300):
    """Share of levels at hours ``at`` within 1.96 std of a series read at ``hours``, and all stds, over draws."""
    inside, stds = [], []
    for _ in range(draws):
        level_at = truth(np.concatenate([hours, at]), rng)
        read = level_at[: len(hours)] + rng.normal(0.0, std_m, len(hours))
        level_m, level_std_m = series_of(hours, read, std_m).at(stamps(at))
        known = np.isfinite(level_m)
        inside.append((np.abs(level_m - level_at[len(hours) :]) <= 1.96 * level_std_m)[known])
        stds.append(level_std_m)
    return np.mean(np.concatenate(inside)), np.array(stds)


def walk(hours, rng, std_m=0.1):
    """A random walk of 10 cm per root hour at any hours."""
    order = np.argsort(hours, kind="stable")
    steps = rng.normal(0.0, 1.0, len(hours)) * std_m * np.sqrt(np.diff(hours[order], prepend=hours[order][0]))
    level = np.empty(len(hours))
    level[order] = np.cumsum(steps)
    return level


def any_tide(hours, rng):
    return tide_m(hours, rng.uniform(0.0, 2 * math.pi), rng.uniform(0.3, 4.0))


def ramp(hours, rng):
    """A flood wave: quiet, then a rise of up to a metre an hour that bends over some hours."""
    start, rise = rng.uniform(-2.0, 10.0), rng.uniform(0.1, 1.0)
    return rise * 3.0 * np.logaddexp(0.0, (hours - start) / 3.0)


@pytest.mark.parametrize("truth", [walk, any_tide, ramp])
@pytest.mark.parametrize("step_h", [0.25, 1.0])
@pytest.mark.parametrize("std_m", [0.005, 0.03])
def test_intervals_hold_between_readings_and_in_gaps(truth, step_h, std_m):
    rng = np.random.default_rng(11)
    hours = np.arange(0.0, 12.01, step_h)
    hours = hours[(hours <= 5.0) | (hours >= 7.5)]  # the gauge failed for 2.5 h
    at = np.concatenate([np.linspace(0.1, 4.9, 25), np.linspace(5.1, 7.4, 25)])
    share, stds = coverage(truth, hours, at, std_m, rng)
    assert share >= 0.95
    middle, usual = stds[:, 37].mean(), stds[:, 12].mean()
    assert middle > 1.2 * usual  # a gap is never as narrow as the rest
    assert np.all(stds >= std_m)


def test_beyond_its_ends_a_series_is_wide_and_then_refused():
    hours = np.arange(0.0, 6.01, 0.25)
    series = series_of(hours, np.full(len(hours), 2.0), 0.01)
    after = np.array([6.0, 6.1, 6.2, 6.25, 6.3, 7.0, 1000.0])
    level_m, std_m = series.at(stamps(after))
    assert np.isnan(level_m).tolist() == [False] * 4 + [True] * 3
    assert np.all(np.diff(std_m[:4]) > 0)
    assert std_m[0] == 0.01
    assert std_m[3] > 0.025  # 15 minutes after a level that never changed it may have, by 2.5 cm
    before_m, before_std_m = series.at(stamps(-after + 6.0))
    assert_allclose(before_m, level_m)
    assert_allclose(before_std_m, std_m)


def test_in_a_gap_too_long_only_the_readings_beside_it_speak_and_not_for_long():
    hours = np.concatenate([np.arange(0.0, 3.01, 0.25), np.arange(9.0, 12.01, 0.25)])
    series = series_of(hours, tide_m(hours), 0.01)
    level_m, std_m = series.at(stamps([3.0, 3.2, 3.5, 6.0, 8.5, 8.9, 9.0]))
    assert np.isnan(level_m).tolist() == [False, False, True, True, True, False, False]
    assert std_m[1] > 3 * std_m[0]
    with_more = series_of(hours, tide_m(hours), 0.01, max_gap_ns=8 * HOUR_NS).at(stamps([6.0]))
    assert abs(with_more[0][0] - tide_m(6.0)) <= 1.96 * with_more[1][0]


def test_daily_readings_say_nothing_of_the_tide_between_them():
    days = 24.0 * np.arange(10)
    level_m, _ = series_of(days, tide_m(days), 0.01).at(stamps([24.0, 24.1, 27.0, 36.0]))
    assert np.isnan(level_m).tolist() == [False, True, True, True]


def test_extrapolation_holds_for_a_tide_and_a_walk():
    rng = np.random.default_rng(3)
    hours, at = np.arange(0.0, 12.01, 0.5), 12.0 + np.linspace(0.02, 0.5, 20)
    for truth in (walk, any_tide, ramp):
        assert coverage(truth, hours, at, 0.01, rng)[0] >= 0.95


def test_poses_without_a_level_are_refused_and_others_know_theirs():
    hours = np.arange(0.0, 2.01, 0.25)
    series = series_of(hours, 1.0 + 0.0 * hours, 0.01, zero_m=0.25, zero_std_m=0.04)
    pose = camera_pose(height_agl_m=HEIGHT_M, tilt_rad=TILT_RAD)
    fixed = PoseSample(stamp_ns=0, status=Status.OK, pose=pose)
    poses = over_water(PoseBatch.repeated(fixed, stamps([1.0, 30.0])), series)
    assert [each.status for each in poses] == [Status.OK, Status.NO_LEVEL]
    assert poses[0].level.elevation_m == pytest.approx(0.75)
    assert poses[0].level.std_m == pytest.approx(math.hypot(0.01, 0.04))
    assert poses[0].pose.position_enu_m[2] == pytest.approx(HEIGHT_M - 0.75)
    assert poses[1].level is None
    assert over_water(poses, None) is poses
