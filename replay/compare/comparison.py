"""Comparison of two recordings: deviations of paired measurements, in units and in standard deviations.

Differences of paired measurements are in units and in standard deviations. Combined standard deviations take two
measurements as independent: the root of the sum of their variances. Two of the same pixels and telemetry are not: their
errors are shared, and the same difference is more of a surprise than it says. There a second figure takes all that the
surer one does not know as unknown to the other too (what a better calibration leaves open, the worse one did not know
either): the variance of the difference is then the difference of variances.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.errors import UsageError
from aerodft.geometry import east_north
from aerodft.model import CODES, BoolArray, FloatArray, GeoOrigin, IntArray, ProbeKind
from replay.compare.pairing import PairBy, Pairing, pairing
from replay.compare.probe_series import ProbeKey, ProbeSeries, read_input

_TERM: Final = re.compile(r"([-+.\w]*?)\s*(mm|cm|m2|m|deg|stds?|%|)")
_METRES: Final = {"mm": 0.001, "cm": 0.01, "m": 1.0}
_SLACK = 1e-9  # of a limit: 0.5 m apart is not past 0.5 m because of the last digit


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """Limits, of which each holds that is of a measurement's kind; without one, nothing but equality does.

    Those in units are of values and of standard deviations, the others of values alone.

    Attributes:
        units: Largest difference by unit (``m``, ``m2``, ``deg``); under an empty one, in each measurement's own.
        stds: Largest difference in combined standard deviations.
        percent: Largest difference in per cent of the first value (of a position: of its range).
    """

    units: dict[str, float] = field(default_factory=dict)
    stds: float | None = None
    percent: float | None = None

    def of_values(self, unit: str, size: FloatArray, combined: FloatArray) -> FloatArray:
        """The limit of each pair in its unit, ``(k,)``; NaN where it is not known.

        Args:
            unit: Of the measurements.
            size: What per cent are of, ``(k,)``.
            combined: Combined standard deviations, ``(k,)``.
        """
        limits = [np.full(size.shape, each) for each in self._own(unit)]
        if self.stds is not None:
            limits.append(self.stds * combined)
        if self.percent is not None:
            limits.append(self.percent / 100 * np.abs(size))
        return np.asarray(np.min(limits or [np.zeros(size.shape)], axis=0) * (1 + _SLACK), dtype=np.float64)

    def of_stds(self, unit: str) -> float:
        """The limit of changes of a standard deviation: those in units, none where only others are stated."""
        is_relative = self.stds is not None or self.percent is not None
        return min(self._own(unit), default=math.inf if is_relative else 0.0) * (1 + _SLACK)

    def _own(self, unit: str) -> list[float]:
        return [self.units[each] for each in (unit, "") if each in self.units]


def parse_tolerance(terms: Iterable[str]) -> Tolerance:
    """Read ``0.01m``, ``0.5std``, ``1%``, ``0.1deg,2m2``, ``0.01``; of two of one kind the stricter holds.

    Raises:
        UsageError: A term is none of these.
    """
    units: dict[str, float] = {}
    others: dict[str, float] = {}
    for term in (part.strip() for text in terms for part in text.split(",")):
        value, unit = _term(term)
        if unit in _METRES:
            value, unit = value * _METRES[unit], "m"
        into = others if unit in {"%", "std"} else units
        into[unit] = min(value, into.get(unit, math.inf))
    return Tolerance(units=units, stds=others.get("std"), percent=others.get("%"))


def _term(text: str) -> tuple[float, str]:
    found = _TERM.fullmatch(text)
    try:
        value = float(found[1]) if found else math.nan
    except ValueError:
        value = math.nan
    if found is None or not 0 <= value < math.inf:
        raise UsageError("`tolerance`", got=repr(text), expected="like 0.01m, 0.1deg, 2m2, 0.5std, 1% or 0.01")
    return value, found[2].rstrip("s")


_TURN_DEG = 360.0
_EQUAL = 1e-6  # variances that are closer than this part of themselves do not tell what was learned


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deviations:
    """Deviations of ``k`` pairs; NaN where one of the two has no number.

    Attributes:
        change: Second minus first; of a ``position`` how far it moved, horizontally, and never below 0.
        size: What per cent are of: the first value, of a ``position`` its range.
        std_change: Second standard deviation minus first; of a ``position`` of the longer axis.
        combined: Combined standard deviation; of a ``position`` in the direction in which it moved.
        sigmas: Change in combined standard deviations, not below 0; of a ``position`` Mahalanobis' distance.
        shared_std: Standard deviation of the change where errors are shared; NaN where both are equally sure.
        is_one_sided: One has a standard deviation or a value, the other has none under the same status.
    """

    change: FloatArray
    size: FloatArray
    std_change: FloatArray
    combined: FloatArray
    sigmas: FloatArray
    shared_std: FloatArray
    is_one_sided: BoolArray


def value_deviations(unit: str, first: ProbeSeries, second: ProbeSeries) -> Deviations:
    """Deviations of the values of paired rows."""
    change = second.value - first.value
    if unit == "deg":
        change = (change + _TURN_DEG / 2) % _TURN_DEG - _TURN_DEG / 2
    combined = np.hypot(first.std, second.std)
    return Deviations(
        change=change,
        size=first.value,
        std_change=np.where(np.isnan(change), np.nan, second.std - first.std),
        combined=combined,
        sigmas=_ratio(np.abs(change), combined),
        shared_std=_shared(first.std**2, second.std**2),
        is_one_sided=_one_sided(first, second, change, (first.std, second.std)),
    )


def position_deviations(first: ProbeSeries, second: ProbeSeries) -> Deviations:
    """Deviations of the places of paired rows of a ``position``."""
    places = first.place, second.place
    moved = _moved(*places)
    change = np.hypot(*moved.T)
    covs = _cov(places[0]), _cov(places[1])
    both = covs[0] + covs[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = np.nan_to_num(moved / change[:, None])
    along = np.einsum("ki,kij,kj->k", ahead, both, ahead)
    stds = np.sqrt(_longest(covs[0])), np.sqrt(_longest(covs[1]))
    return Deviations(
        change=change,
        size=places[0][:, 5],
        std_change=stds[1] - stds[0],
        combined=np.sqrt(np.where(change > 0, along, _longest(both))),
        sigmas=_mahalanobis(moved, both),
        shared_std=_shared(*(np.einsum("ki,kij,kj->k", ahead, cov, ahead) for cov in covs)),
        is_one_sided=_one_sided(first, second, change, stds),
    )


def _one_sided(
    first: ProbeSeries, second: ProbeSeries, change: FloatArray, stds: tuple[FloatArray, FloatArray]
) -> BoolArray:
    """Mask of pairs in which one has a standard deviation, or a value, that the other lacks at the same status."""
    values = (np.isnan(first.value) != np.isnan(second.value)) & (first.status == second.status)
    is_sided = (np.isnan(stds[0]) != np.isnan(stds[1])) & ~np.isnan(change)
    return np.asarray(values | is_sided, dtype=np.bool_)


def _moved(first: FloatArray, second: FloatArray) -> FloatArray:
    """East and north of the second places from the first, m: on the map, else from the stations' origins."""
    lat, lon = np.radians(first[:, 0]), np.radians(first[:, 1])
    offset = np.full((len(first), 2), np.nan)
    known = np.flatnonzero(~np.isnan(first[:, :2] + second[:, :2]).any(axis=1))
    if len(known):
        home = GeoOrigin(lat_rad=float(lat[known[0]]), lon_rad=float(lon[known[0]]), alt_msl_m=0.0)
        then = east_north(home, np.radians(second[known, 0]), np.radians(second[known, 1]))
        offset[known] = then - east_north(home, lat[known], lon[known])
    return np.where(np.isnan(offset), second[:, 6:8] - first[:, 6:8], offset)


def _cov(place: FloatArray) -> FloatArray:
    """``(k, 2, 2)`` of east and north."""
    return place[:, [2, 3, 3, 4]].reshape(-1, 2, 2)


def _longest(cov: FloatArray) -> FloatArray:
    """The larger eigenvalue, ``(k,)``."""
    mean = (cov[:, 0, 0] + cov[:, 1, 1]) / 2
    return mean + np.hypot((cov[:, 0, 0] - cov[:, 1, 1]) / 2, cov[:, 0, 1])


def _mahalanobis(moved: FloatArray, cov: FloatArray) -> FloatArray:
    east, north = moved.T
    determinant = cov[:, 0, 0] * cov[:, 1, 1] - cov[:, 0, 1] ** 2
    square = cov[:, 1, 1] * east**2 - 2 * cov[:, 0, 1] * east * north + cov[:, 0, 0] * north**2
    return np.sqrt(np.maximum(_ratio(square, determinant), 0))


def _shared(variance: FloatArray, other: FloatArray) -> FloatArray:
    gap = np.abs(variance - other)
    root: FloatArray = np.sqrt(gap)
    return np.where(gap > _EQUAL * (variance + other), root, np.nan)


def _ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    """NaN where nothing is below."""
    ratio = np.full(above.shape, np.nan)
    np.divide(above, below, out=ratio, where=below > 0)
    return ratio


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pairs:
    """One probe's pairs; rows ``(k,)`` of pairs, NaN where one of the two has no number.

    Attributes:
        key: The probe.
        only_first: Measurements in the first alone.
        only_second: Measurements in the second alone.
        status_changes: How many changed from which status to which.
        stamp_ns: Of the first.
        shift_ns: The second's stamp minus the first's.
        deviations: Of the numbers.
    """

    key: ProbeKey
    only_first: int
    only_second: int
    status_changes: dict[str, int]
    stamp_ns: IntArray
    shift_ns: FloatArray
    deviations: Deviations


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Deviations of one probe's numbers (or of all); None where no two numbers could be compared.

    Attributes:
        paired: Measurements in both.
        only_first: Measurements in the first alone.
        only_second: Measurements in the second alone.
        status_changes: How many changed from which status to which, as ``"ok -> NO_HEIGHT"``.
        count: Pairs of numbers.
        beyond: Of these, farther apart than the tolerance.
        unit: Of the differences; empty where probes of several units are put together.
        mean: Second minus first; None for positions.
        median_abs: Median of the differences without their signs.
        p95_abs: 95 of 100 are not larger.
        max_abs: Largest.
        max_abs_stamp_ns: When it was, by the first.
        rms: Root of their mean square.
        max_std_abs: Largest difference of two standard deviations.
        median_sigmas: Median of differences in combined standard deviations.
        p95_sigmas: 95 of 100 are not larger.
        max_sigmas: Largest.
        median_shared_sigmas: Where both are of the same input: in standard deviations of the difference, errors shared.
        p95_shared_sigmas: 95 of 100 are not larger.
    """

    paired: int
    only_first: int
    only_second: int
    status_changes: dict[str, int]
    count: int
    beyond: int
    unit: str
    mean: float | None
    median_abs: float | None
    p95_abs: float | None
    max_abs: float | None
    max_abs_stamp_ns: str | None
    rms: float | None
    max_std_abs: float | None
    median_sigmas: float | None
    p95_sigmas: float | None
    max_sigmas: float | None
    median_shared_sigmas: float | None
    p95_shared_sigmas: float | None


def pair_probe(key: ProbeKey, first: ProbeSeries | None, second: ProbeSeries | None, how: Pairing) -> Pairs:
    """The pairs of one probe, which one of the two may lack."""
    one, other = first or second, second or first
    if one is None or other is None:
        raise ValueError("a probe that neither side has")
    none = np.zeros(0, dtype=np.int64)
    one, other = first or one.rows(none), second or other.rows(none)
    rows, others = how.pairs(one, other)
    matched = one.rows(rows), other.rows(others)
    is_position = key.kind == ProbeKind.POSITION
    codes = Counter(zip(one.status[rows].tolist(), other.status[others].tolist(), strict=True))
    changes = {f"{CODES[a]} -> {CODES[b]}": count for (a, b), count in sorted(codes.items()) if a != b}
    return Pairs(
        key=key,
        only_first=len(one.stamp_ns) - len(rows),
        only_second=len(other.stamp_ns) - len(others),
        status_changes=changes,
        stamp_ns=one.stamp_ns[rows],
        shift_ns=(other.stamp_ns[others] - one.stamp_ns[rows]).astype(np.float64),
        deviations=position_deviations(*matched) if is_position else value_deviations(key.unit, *matched),
    )


def summarise(pairs: Pairs, tolerance: Tolerance, *, same_input: bool) -> Difference:
    """The figures of one probe."""
    found = pairs.deviations
    unit = "m" if pairs.key.kind == ProbeKind.POSITION else pairs.key.unit
    limit, std_limit = tolerance.of_values(unit, found.size, found.combined), tolerance.of_stds(unit)
    is_near = (np.abs(found.change) <= limit) & ~(np.abs(found.std_change) > std_limit)
    beyond = (~np.isnan(found.change) & ~is_near) | found.is_one_sided
    return _figures([pairs], unit=unit, beyond=int(beyond.sum()), same_input=same_input)


def _total(pairs: Sequence[Pairs], parts: Sequence[Difference], *, same_input: bool) -> Difference:
    """The figures of all probes; those in units only where there is one unit."""
    units = {part.unit for part in parts}
    unit = units.pop() if len(units) == 1 else ""
    return _figures(pairs, unit=unit, beyond=sum(part.beyond for part in parts), same_input=same_input)


def _figures(pairs: Sequence[Pairs], *, unit: str, beyond: int, same_input: bool) -> Difference:
    change, std_change, sigmas, shared = (
        _all(pairs, name) for name in ("change", "std_change", "sigmas", "shared_std")
    )
    known = ~np.isnan(change)
    shared = np.abs(change[known]) / shared[known] if same_input else np.zeros(0)
    stamps = np.concatenate([np.zeros(0, dtype=np.int64), *(each.stamp_ns for each in pairs)])
    statuses: Counter[str] = Counter()
    for each in pairs:
        statuses.update(each.status_changes)
    is_signed = not any(each.key.kind == ProbeKind.POSITION for each in pairs)
    inside = np.abs(change[known]) if unit else np.zeros(0)
    return Difference(
        paired=len(change),
        only_first=sum(each.only_first for each in pairs),
        only_second=sum(each.only_second for each in pairs),
        status_changes=dict(sorted(statuses.items())),
        count=int(known.sum()),
        beyond=beyond,
        unit=unit,
        mean=float(np.mean(change[known])) if len(inside) and is_signed else None,
        median_abs=_quantile(inside, 0.5),
        p95_abs=_quantile(inside, 0.95),
        max_abs=_quantile(inside, 1.0),
        max_abs_stamp_ns=str(stamps[known][np.argmax(inside)]) if len(inside) else None,
        rms=float(np.sqrt(np.mean(inside**2))) if len(inside) else None,
        max_std_abs=_quantile(np.abs(std_change[known]), 1.0) if unit else None,
        median_sigmas=_quantile(sigmas[known], 0.5),
        p95_sigmas=_quantile(sigmas[known], 0.95),
        max_sigmas=_quantile(sigmas[known], 1.0),
        median_shared_sigmas=_quantile(shared, 0.5),
        p95_shared_sigmas=_quantile(shared, 0.95),
    )


def _all(pairs: Sequence[Pairs], name: str) -> FloatArray:
    return np.concatenate([np.zeros(0), *(getattr(each.deviations, name) for each in pairs)])


def _quantile(values: FloatArray, part: float) -> float | None:
    """Linearly between neighbours; None without a value."""
    known = values[~np.isnan(values)]
    return float(np.quantile(known, part)) if len(known) else None


MAX_STAMP_GAP_S: Final = 0.01
"""Stamps that are farther apart are not of one image, unless the images say so."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """Two recordings' measurements, matched by probe and image or stamp.

    Attributes:
        first: The recording or table that was compared.
        second: The one that it was compared with.
        is_identical: Every payload is the same, byte by byte, in the same order.
        is_empty: Neither holds a measurement.
        paired_by: What made the pairs.
        is_same_input: Whether both are of the same images: pixels and telemetry are shared.
        shift_s: Median of the second's stamps minus the first's; None without a pair.
        total: Over all probes.
        probes: By probe.
        pairs: The pairs themselves, by probe, in order of their names.
    """

    first: Path
    second: Path
    is_identical: bool
    is_empty: bool
    paired_by: PairBy
    is_same_input: bool
    shift_s: float | None
    total: Difference
    probes: dict[str, Difference]
    pairs: dict[str, Pairs]

    @property
    def differs(self) -> bool:
        """Whether something is missing, has another status, or is farther apart than the tolerance."""
        total = self.total
        return bool(total.only_first or total.only_second or total.status_changes or total.beyond)

    def to_dict(self) -> dict[str, object]:
        """The JSON document of ``aerodft compare --json``."""
        total = asdict(self.total)
        return {
            "first": str(self.first),
            "second": str(self.second),
            "differs": self.differs,
            "paired_by": self.paired_by,
            "shift_s": self.shift_s,
            "common": total["paired"],
            **{name: total[name] for name in ("only_first", "only_second", "status_changes", "beyond")},
            "total": total,
            "probes": {name: asdict(each) for name, each in self.probes.items()},
            "identical": self.is_identical,
            "same_input": self.is_same_input,
        }


def compare_measurements(
    first: Path,
    second: Path,
    tolerance: Tolerance | None = None,
    *,
    by: PairBy = PairBy.AUTO,
    max_stamp_gap_s: float = MAX_STAMP_GAP_S,
) -> Comparison:
    """Compare two recordings, or tables that were exported from some, measurement by measurement.

    Args:
        first: A recording, or a table.
        second: What it is compared with.
        tolerance: What counts as equal; None for nothing but equality.
        by: What makes a pair.
        max_stamp_gap_s: How far apart stamps of one image may be, where stamps make the pairs.

    Raises:
        InputError: One of them is neither, or damaged.
        NoAnswerError: A recording holds nothing.
    """
    one, other = read_input(first), read_input(second)
    how = pairing(one, other, by, max_stamp_gap_s)
    keys = sorted(one.series.keys() | other.series.keys())
    names = Counter(key.name for key in keys)
    pairs = {
        key.name if names[key.name] == 1 else f"{key.name} ({key.kind}, {key.unit})": pair_probe(
            key, one.series.get(key), other.series.get(key), how
        )
        for key in keys
    }
    limits, same = tolerance or Tolerance(), how.is_same_input
    probes = {name: summarise(each, limits, same_input=same) for name, each in pairs.items()}
    shifts = np.concatenate([np.zeros(0), *(each.shift_ns for each in pairs.values())])
    return Comparison(
        first=first,
        second=second,
        is_identical=one.digest == other.digest,
        is_empty=not one.count and not other.count,
        paired_by=how.by,
        is_same_input=same,
        shift_s=float(np.median(shifts)) / SECOND_NS if len(shifts) else None,
        total=_total(list(pairs.values()), list(probes.values()), same_input=same),
        probes=probes,
        pairs=pairs,
    )
