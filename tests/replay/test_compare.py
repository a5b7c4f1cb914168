"""What is paired, what differences are in units and in standard deviations, and where a tolerance ends."""

from pathlib import Path

import numpy as np
import pytest

from aerodft.errors import UsageError
from aerodft.model import CODE_OF, Status
from replay.compare import PairBy, Tolerance, parse_tolerance
from replay.compare.comparison import pair_probe, position_deviations, summarise, value_deviations
from replay.compare.pairing import Pairing, pairing
from replay.compare.probe_series import NO_IMAGE, ComparisonInput, ProbeKey, ProbeSeries

KEY = ProbeKey("w", "distance", "m")
BY_STAMP = Pairing(by=PairBy.STAMP, is_same_input=False, max_gap_ns=10)
BY_IMAGE = Pairing(by=PairBy.IMAGE, is_same_input=True, max_gap_ns=10)


def a_series(stamps, images=None, value=None, std=None, place=None):
    n = len(stamps)
    return ProbeSeries(
        stamp_ns=np.array(stamps, dtype=np.int64),
        image=np.full(n, NO_IMAGE) if images is None else np.array(images, dtype=np.int64),
        value=np.zeros(n) if value is None else np.asarray(value, dtype=float),
        std=np.ones(n) if std is None else np.asarray(std, dtype=float),
        status=np.full(n, CODE_OF[Status.OK]),
        place=np.zeros((n, 0)) if place is None else np.asarray(place, dtype=float),
    )


def pairs_of(how, first, second):
    return list(zip(*(each.tolist() for each in how.pairs(first, second)), strict=True))


@pytest.mark.parametrize("seed", range(20))
def test_nearest_stamps_are_paired_once_and_within_the_limit(seed):
    rng = np.random.default_rng(seed)
    first, second = (a_series(rng.integers(0, 300, size=rng.integers(0, 40))) for _ in range(2))
    got = pairs_of(BY_STAMP, first, second)
    one, other = first.stamp_ns.tolist(), second.stamp_ns.tolist()
    assert len({i for i, _ in got}) == len({j for _, j in got}) == len(got)
    assert all(abs(one[i] - other[j]) <= 10 for i, j in got)
    # Equal stamps always meet, as often as they are on both sides.
    equal = sum(min(one.count(stamp), other.count(stamp)) for stamp in set(one))
    assert sum(one[i] == other[j] for i, j in got) == equal
    # Nothing that is left has a neighbour that is left and nearer to it than to anything else.
    left = [i for i in range(len(one)) if i not in {i for i, _ in got}]
    rest = [j for j in range(len(other)) if j not in {j for _, j in got}]
    for i in left:
        near = [j for j in rest if abs(one[i] - other[j]) <= 10]
        for j in near:
            own = abs(one[i] - other[j])
            assert any(abs(one[k] - other[j]) <= own for k in range(len(one)) if k != i) or any(
                abs(one[i] - other[k]) <= own for k in range(len(other)) if k != j
            )


def test_images_are_paired_by_their_index_wherever_their_stamps_are():
    first = a_series([0, 200, 400, 600], [0, 1, 2, 3])
    second = a_series([200, 400, 800, 810], [0, 1, 3, 3])  # one image period later: stamps would pair the wrong ones
    assert pairs_of(BY_IMAGE, first, second) == [(0, 0), (1, 1), (3, 2)]
    assert pairs_of(BY_STAMP, first, second) == [(1, 0), (2, 1)]


def test_what_has_no_image_is_paired_by_the_camera_s_clocks_or_in_order():
    shifted = a_series(np.arange(5) * 1000 + 300)
    assert pairs_of(BY_IMAGE, a_series(np.arange(5) * 1000), shifted) == [(k, k) for k in range(5)]
    # As many, but not by one clock: another one is missing on each side.
    uneven = a_series([0, 1000, 2000, 3000, 9000])
    assert pairs_of(BY_IMAGE, a_series([0, 1000, 2000, 3000, 4000]), uneven) == [(k, k) for k in range(4)]


def a_side(name, series, images):
    return ComparisonInput(where=Path(name), series={KEY: series}, digest=name, images=images, recording=None)


def test_how_pairs_are_made_follows_from_the_images():
    stamps = np.arange(10) * 10**8
    one, late = a_series(stamps, range(10)), a_series(stamps + 3 * 10**8, range(10))
    arrived = {k: (int(stamps[k]), 5000 + k) for k in range(10)}
    first = a_side("a", one, arrived)
    same = pairing(
        first, a_side("b", late, {k: (stamp + 3 * 10**8, at) for k, (stamp, at) in arrived.items()}), PairBy.AUTO, 0.01
    )
    assert (same.by, same.is_same_input) == (PairBy.IMAGE, True)
    # Other images with the same indexes: stamps say which belong together.
    other = pairing(
        first, a_side("b", late, {k: (stamp, at + 7) for k, (stamp, at) in arrived.items()}), PairBy.STAMP, 0.01
    )
    assert (other.by, len(other.pairs(one, late)[0])) == (PairBy.STAMP, 7)
    # Tables say nothing of arrivals; where no stamps meet, one offset that explains all of them does.
    table = a_side("b", a_series(stamps + 123_456_789, range(10)), {})
    assert pairing(first, table, PairBy.AUTO, 0.01).by is PairBy.IMAGE
    strange = a_side("b", a_series(np.random.default_rng(1).integers(10**12, 10**13, 10), range(10)), {})
    assert pairing(first, strange, PairBy.AUTO, 0.01).by is PairBy.STAMP


def test_combined_stds_are_those_of_independent_errors_and_shared_ones_those_of_what_was_learned():
    """The worse of two estimates has what is told to the better one, and an error of its own less."""
    rng = np.random.default_rng(5)
    n, telemetry, learned = 40_000, 0.4, 0.1
    errors = rng.normal(0, (telemetry, learned), size=(n, 2))
    weights = np.array([1 / telemetry**2, 1 / learned**2])
    better, better_std = errors @ weights / weights.sum(), weights.sum() ** -0.5
    independent = rng.normal(0, better_std, n)
    for second, name in ((independent, "sigmas"), (better, "shared")):
        one = a_series(np.arange(n), value=10 + errors[:, 0], std=np.full(n, telemetry))
        other = a_series(np.arange(n), value=10 + second, std=np.full(n, better_std))
        found = value_deviations("m", one, other)
        ratio = np.abs(found.change) / found.shared_std if name == "shared" else found.sigmas
        assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.015), name
        assert np.quantile(ratio, 0.95) == pytest.approx(1.96, abs=0.04), name


def test_bearings_differ_the_short_way_round():
    one, other = a_series([0, 1], value=[359.5, 1.0]), a_series([0, 1], value=[0.5, 358.0])
    np.testing.assert_allclose(value_deviations("deg", one, other).change, [1.0, -3.0])


def test_positions_differ_by_metres_on_the_ground_and_in_the_ellipse_s_stds():
    north_deg = 1.0 / 111_132.954  # a metre at 45 degrees, from the series for the meridian
    cov = [4.0, 0.0, 1.0]
    one = a_series(
        [0, 1, 2], place=[[45.0, 7.0, *cov, 50.0, 0, 0], [*[np.nan] * 2, *cov, 50.0, 1, 1], [45, 7, *cov, 50, 0, 0]]
    )
    moved = [[45.0 + north_deg, 7.0, *cov, 50.0, 9, 9], [*[np.nan] * 2, *cov, 50.0, 4, 5], [45, 7, *cov, 50, 0, 0]]
    found = position_deviations(one, a_series([0, 1, 2], place=moved))
    np.testing.assert_allclose(found.change, [1.0, 5.0, 0.0], atol=1e-3)
    # 1 m north against a variance of 1 + 1; (3, 4) m against variances of 8 and 2.
    np.testing.assert_allclose(found.sigmas, [1 / np.sqrt(2), np.sqrt(9 / 8 + 16 / 2), 0.0], atol=1e-3)
    np.testing.assert_allclose(found.combined[:2], [np.sqrt(2), np.sqrt(0.36 * 8 + 0.64 * 2)], atol=1e-3)
    np.testing.assert_allclose(found.std_change, 0)


def test_figures_are_numpy_s():
    rng = np.random.default_rng(2)
    value, change = rng.uniform(10, 20, 101), rng.normal(0, 1, 101)
    one, other = (
        a_series(range(101), value=value, std=[2.0] * 101),
        a_series(range(102), value=[*(value + change), 3.0]),
    )
    got = summarise(pair_probe(KEY, one, other, BY_STAMP), Tolerance(), same_input=False)
    assert (got.paired, got.count, got.only_first, got.only_second, got.beyond) == (101, 101, 0, 1, 101)
    assert got.mean == pytest.approx(change.mean())
    assert got.rms == pytest.approx(np.sqrt((change**2).mean()))
    assert got.median_abs == pytest.approx(np.median(np.abs(change)))
    assert got.p95_abs == pytest.approx(np.quantile(np.abs(change), 0.95))
    assert got.max_abs_stamp_ns == str(np.argmax(np.abs(change)))
    assert got.max_sigmas == pytest.approx(np.abs(change).max() / np.sqrt(5))
    assert (got.max_std_abs, got.median_shared_sigmas) == (1.0, None)


@pytest.mark.parametrize(
    ("terms", "change", "std", "ok"),
    [
        ([], 0.0, 1.0, True),
        ([], 1e-12, 1.0, False),
        (["0.5m"], 0.5, 1.0, True),
        (["500mm"], 0.5001, 1.0, False),
        (["0.5"], 0.1, 1.6, False),  # the std is 0.6 larger
        (["0.5m"], 0.1, 1.4, True),
        (["1m2"], 0.1, 1.0, False),  # of areas alone
        (["0.4std"], 0.5, 1.0, True),  # of 1.414 m
        (["0.3std"], 0.5, 1.0, False),
        (["0.3std"], 0.1, 9.0, True),
        (["5%"], 0.5, 1.0, True),  # of 10 m
        (["4.9%"], 0.5, 1.0, False),
        (["5%,0.4m"], 0.5, 1.0, False),  # each holds
        (["5%", "0.1"], 0.05, 1.0, True),
    ],
)
def test_a_tolerance_holds_up_to_its_limit(terms, change, std, ok):
    one, other = a_series([0], value=[10.0]), a_series([0], value=[10.0 + change], std=[std])
    got = summarise(pair_probe(KEY, one, other, BY_STAMP), parse_tolerance(terms), same_input=False)
    assert (got.beyond == 0) is ok


def test_a_std_that_is_gone_is_a_difference():
    one, other = a_series([0]), a_series([0], std=[np.nan])
    assert summarise(pair_probe(KEY, one, other, BY_STAMP), parse_tolerance(["9m"]), same_input=False).beyond == 1


@pytest.mark.parametrize("term", ["", "m", "-1m", "nan", "inf", "1 furlong", "1e400", "0.1m;0.2m", "1%%"])
def test_what_is_no_tolerance_is_refused(term):
    with pytest.raises(UsageError, match="`tolerance`"):
        parse_tolerance([term])
