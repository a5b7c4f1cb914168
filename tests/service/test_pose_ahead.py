"""What is prepared for many stamps at once is what is found for one after the other, to the last bit."""

from collections import Counter

import numpy as np
import pytest

from aerodft.geometry.interpolation import bracket, brackets
from aerodft.geometry.rotation import from_yaw_pitch_roll
from aerodft.model.pose import GimbalSource
from aerodft.model.telemetry import GimbalTrack, VehicleTrack
from aerodft.service.attitude import AttitudeSources, CameraAttitude
from aerodft.service.pose_ahead import by_tick
from aerodft.service.settings import AttitudeSettings
from aerodft.service.streams import Missing, Stream

SAMPLES_NS = np.cumsum(np.random.default_rng(3).integers(1, 400_000_000, 200))
VALUES = np.random.default_rng(4).normal(size=200)


def test_many_brackets_are_the_single_ones() -> None:
    asked = np.concatenate([SAMPLES_NS[::7], np.random.default_rng(5).integers(-10, SAMPLES_NS[-1] + 10, 500)])
    found = brackets(SAMPLES_NS, asked, 300_000_000)
    values = found.linear(VALUES)
    known = 0
    for row, stamp_ns in enumerate(asked.tolist()):
        single = bracket(SAMPLES_NS, stamp_ns, 300_000_000)
        assert found.is_known[row] == (single is not None)
        if single is not None:
            known += 1
            assert (found.before[row], found.after[row], found.weight[row], found.gap_ns[row]) == (
                single.before,
                single.after,
                single.weight,
                single.gap_ns,
            )
            assert values[row] == single.linear(VALUES)
    assert 100 < known < len(asked)  # both kinds were asked for


@pytest.mark.parametrize("asked_ns", [0, 5])
def test_nothing_is_found_among_no_samples(asked_ns: int) -> None:
    assert not brackets(np.empty(0, dtype=np.int64), np.array([asked_ns]), 10).is_known.any()


def test_a_stream_looks_at_no_sample_that_had_not_come() -> None:
    stream, edges = Stream(10**9), np.array([50, 120, 200])
    stream.append(SAMPLES_NS, edges, value=VALUES)
    rng = np.random.default_rng(6)
    stamps_ns, ticks = rng.integers(0, SAMPLES_NS[-1], 600), rng.integers(0, 3, 600)
    found, newest = stream.find_all(stamps_ns, ticks), stream.last_before(stamps_ns, ticks)
    ages_s = stream.ages_s(stamps_ns, found)
    pending = 0
    for row, (stamp_ns, tick) in enumerate(zip(stamps_ns.tolist(), ticks.tolist(), strict=True)):
        stream.see(tick)
        single = stream.find(stamp_ns, 0)
        assert found.is_known[row] == (not isinstance(single, Missing))
        pending += single is Missing.PENDING
        if not isinstance(single, Missing):
            assert found.linear(stream.all_of("value"))[row] == single.linear(stream.column("value"))
            assert ages_s[row] == stream.age_s(stamp_ns)
        assert newest[row] == np.searchsorted(stream.stamps_ns, stamp_ns, side="right") - 1
    assert pending > 50


def test_what_is_asked_for_waits_for_the_slowest_stream_and_for_its_own_tick() -> None:
    newest = [np.array([10, 20, 30]), np.array([5, 25, 26])]
    asked = np.array([[4, 0], [8, 0], [26, 0], [4, 2], [27, 0]])
    assert by_tick(asked, [*newest, np.empty(0)]).tolist() == [[0, 4], [1, 8], [2, 26], [2, 4]]
    assert not len(by_tick(asked, [np.empty(0)]))


def rows(stamps_ns, **columns):
    return {"arrival_ns": stamps_ns, "boot_ns": stamps_ns, **columns}


def test_many_attitudes_are_the_single_ones_whichever_source_tells_them() -> None:
    """One gimbal falls silent, changes its reference and comes back; another one goes on; each at its own tick."""
    rng = np.random.default_rng(8)
    step_ns, count = 50_000_000, 800
    every = step_ns * np.arange(1, count + 1)
    speaks = (np.arange(count) < 300) | (np.arange(count) > 500)
    settings = AttitudeSettings(order=(GimbalSource.GIMBAL_DEVICE, GimbalSource.MOUNT_STATUS), max_gap_ns=10 * step_ns)
    attitude, edges = AttitudeSources(settings), np.linspace(0, count, 41).astype(np.int64)[1:]

    def turns(number: int) -> np.ndarray:
        return from_yaw_pitch_roll(
            *np.cumsum(rng.normal(0, 0.01, (3, number)), axis=1) - np.array([[0.0], [0.8], [0.0]])
        )

    own = np.flatnonzero(speaks)
    device = {"source": GimbalSource.GIMBAL_DEVICE, "yaw_in_earth": own % 97 > 60}
    other = {"source": GimbalSource.MOUNT_STATUS, "yaw_in_earth": np.zeros(count, dtype=np.bool_)}
    attitude.append(VehicleTrack(**rows(every, wxyz=turns(count))), every, edges)
    attitude.append(
        GimbalTrack(**rows(every[own], wxyz=turns(len(own))), **device), every[own], own.searchsorted(edges)
    )
    attitude.append(GimbalTrack(**rows(every, wxyz=turns(count)), **other), every, edges)
    stamps_ns, ticks = rng.integers(0, every[-1], 400), rng.integers(0, 40, 400)
    found = attitude.at_all(stamps_ns, ticks)
    told = Counter[object]()
    for row, (stamp_ns, tick) in enumerate(zip(stamps_ns.tolist(), ticks.tolist(), strict=True)):
        attitude.see(tick)
        for stream in attitude.streams():
            stream.see(tick)
        single = attitude.at(stamp_ns, max(stream.last_ns or 0 for stream in attitude.streams()))
        if not found.is_known[row]:
            told[None] += 1  # pending, or not that simple
            continue
        many = found.row(row)
        assert isinstance(single, CameraAttitude)
        assert np.array_equal(many.wxyz, single.wxyz)
        assert np.array_equal(many.rate_cam_radps, single.rate_cam_radps)
        assert (many.source, many.age_s, many.report_std_rad) == (single.source, single.age_s, single.report_std_rad)
        assert (many.is_demand, many.reasons) == (single.is_demand, single.reasons)
        told[many.source] += 1
    assert min(told[each] for each in (*settings.order, None)) > 20, told
