"""Which measurement of one recording stands for which of another."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from aerodft.adapters.config.station import parse_station
from aerodft.conventions import SECOND_NS
from aerodft.errors import AerodftError
from aerodft.model import IntArray
from aerodft.service.clocks import ImageClock
from replay.compare.probe_series import NO_IMAGE, ComparisonInput, ProbeKey, ProbeSeries
from replay.recordings import Recording

_SAME_NS = 1000  # a stamp moved by one clock and back by another is off by nanoseconds
_MOST_SHIFT_S: Final = 60.0  # more than a camera's clock is off
_MOST_STRAYS = 0.01


class PairBy(StrEnum):
    """Key by which measurements are paired."""

    AUTO = "auto"
    IMAGE = "image"
    STAMP = "stamp"


@dataclass(frozen=True, slots=True, kw_only=True)
class Pairing:
    """Rule by which measurements are paired.

    Attributes:
        by: ``IMAGE`` (the same index) or ``STAMP`` (the nearest, within the limit).
        is_same_input: Whether both are of the same images, so that pixels and telemetry are shared.
        max_gap_ns: The limit.
        clocks: The two cameras' clocks, where images are the same: what has no image index is paired by them.
    """

    by: PairBy
    is_same_input: bool
    max_gap_ns: int
    clocks: tuple[ImageClock, ImageClock] = (ImageClock(), ImageClock())

    def pairs(self, first: ProbeSeries, second: ProbeSeries) -> tuple[IntArray, IntArray]:
        """The rows of either that belong together, in order of the first's, ``(k,)`` and ``(k,)``."""
        if self.by is PairBy.STAMP:
            return _in_order(_nearest(first.stamp_ns, second.stamp_ns, self.max_gap_ns))
        one, other = np.flatnonzero(first.image != NO_IMAGE), np.flatnonzero(second.image != NO_IMAGE)
        found = _of_rows(one, other, _equal(first.image[one], second.image[other]))
        one, other = np.flatnonzero(first.image == NO_IMAGE), np.flatnonzero(second.image == NO_IMAGE)
        rest = self._by_clock(first.stamp_ns[one], second.stamp_ns[other])
        more = _of_rows(one, other, rest)
        return _in_order((np.concatenate([found[0], more[0]]), np.concatenate([found[1], more[1]])))

    def _by_clock(self, first_ns: IntArray, second_ns: IntArray) -> tuple[IntArray, IntArray]:
        """Pairs of measurements without an image: of equal stamps by the camera; else, if as many, in their order."""
        was, is_now = self.clocks
        # Far clocks have large terms that cancel: integers all the way.
        moved_ns = np.array([is_now.utc_ns(was.stamp_ns(each)) for each in first_ns.tolist()], dtype=np.int64)
        pairs = _nearest(moved_ns, second_ns, self.max_gap_ns)
        if 2 * len(pairs[0]) < len(first_ns) == len(second_ns) and _is_one_shift(first_ns, second_ns, self.max_gap_ns):
            return np.arange(len(first_ns)), np.arange(len(second_ns))
        return pairs


def pairing(first: ComparisonInput, second: ComparisonInput, by: PairBy, max_stamp_gap_s: float) -> Pairing:
    """The pairing that was chosen; else by image where both are of the same images, else by stamp.

    Where no stamps meet, images of the same index are the same if one time offset explains all their stamps.
    """
    max_gap_ns = round(max_stamp_gap_s * SECOND_NS)
    clocks = _clocks(first.recording, second.recording)
    same = _are_same_images(first, second, clocks)
    if by is PairBy.IMAGE or (by is PairBy.AUTO and same):
        return Pairing(by=PairBy.IMAGE, is_same_input=same, max_gap_ns=max_gap_ns, clocks=clocks)
    stamps = Pairing(by=PairBy.STAMP, is_same_input=same, max_gap_ns=max_gap_ns)
    if by is PairBy.STAMP or any(len(stamps.pairs(*each)[0]) for each in _common(first, second)):
        return stamps
    images = Pairing(by=PairBy.IMAGE, is_same_input=False, max_gap_ns=max_gap_ns)
    return images if _is_shifted(images, first, second) else stamps


def _clocks(first: Recording | None, second: Recording | None) -> tuple[ImageClock, ImageClock]:
    """The cameras' clocks as configured; the same twice where a configuration is missing or cannot be read."""
    found = []
    for recording in (first, second):
        try:
            text = None if recording is None else recording.text("config.toml")
            if text is None or recording is None:
                return ImageClock(), ImageClock()
            station = parse_station(text.encode(), where=str(recording.folder), folder=recording.folder)
            found.append(station.image_clock)
        except AerodftError:
            return ImageClock(), ImageClock()
    return found[0], found[1]


def _are_same_images(first: ComparisonInput, second: ComparisonInput, clocks: tuple[ImageClock, ImageClock]) -> bool:
    """Whether images of the same index arrived at the same time, or have the same stamp by the camera's clock."""
    common = first.images.keys() & second.images.keys()
    strays = 0
    for index in common:
        (stamp, arrival), (other_stamp, other_arrival) = first.images[index], second.images[index]
        moved_ns = clocks[1].utc_ns(clocks[0].stamp_ns(stamp))
        strays += arrival != other_arrival and abs(moved_ns - other_stamp) > _SAME_NS
    return bool(common) and strays <= _MOST_STRAYS * len(common)


def _is_shifted(how: Pairing, first: ComparisonInput, second: ComparisonInput) -> bool:
    """Whether pairs by image have stamps that one clock's offset and drift explain."""
    shifts = []
    for one, other in _common(first, second):
        rows, others = how.pairs(one, other)
        shifts.append(np.column_stack([one.stamp_ns[rows], other.stamp_ns[others]]))
    stamps = np.concatenate(shifts) if shifts else np.zeros((0, 2), dtype=np.int64)
    return len(stamps) > 2 and _is_one_shift(stamps[:, 0], stamps[:, 1], how.max_gap_ns)  # noqa: PLR2004 - a line's two


def _is_one_shift(first_ns: IntArray, second_ns: IntArray, max_gap_ns: int) -> bool:
    """Whether the second stamps are the first ones by a clock that is off by an offset and a drift."""
    if len(first_ns) == 0:
        return False
    shift_s = (second_ns - first_ns) / SECOND_NS
    if np.abs(shift_s).max() > _MOST_SHIFT_S:
        return False
    since_s = (first_ns - first_ns[0]) / SECOND_NS
    line = np.column_stack([np.ones_like(since_s), since_s])
    fitted = line @ np.linalg.lstsq(line, shift_s, rcond=None)[0]
    return bool(np.abs(shift_s - fitted).max() * SECOND_NS <= max_gap_ns)


def _common(first: ComparisonInput, second: ComparisonInput) -> list[tuple[ProbeSeries, ProbeSeries]]:
    keys: list[ProbeKey] = sorted(first.series.keys() & second.series.keys())
    return [(first.series[key], second.series[key]) for key in keys]


def _equal(first: IntArray, second: IntArray) -> tuple[IntArray, IntArray]:
    """Rows with equal keys; of several with one key the first with the first, the second with the second."""
    keys = np.unique(np.concatenate([first, second]), return_inverse=True)[1].astype(np.int64)
    one, other = keys[: len(first)], keys[len(first) :]
    most = len(keys) + 1
    _, rows, others = np.intersect1d(
        one * most + _occurrence(one), other * most + _occurrence(other), assume_unique=True, return_indices=True
    )
    return rows, others


def _occurrence(keys: IntArray) -> IntArray:
    """Number of equal ones before each."""
    order = np.argsort(keys, kind="stable")
    ranked = keys[order]
    count = np.empty(len(keys), dtype=np.int64)
    count[order] = np.arange(len(keys)) - np.searchsorted(ranked, ranked)
    return count


def _nearest(first_ns: IntArray, second_ns: IntArray, max_gap_ns: int) -> tuple[IntArray, IntArray]:
    """Rows with equal stamps; of the rest those that are each other's nearest, within the limit."""
    rows, others = _equal(first_ns, second_ns)
    rest = _unmatched(first_ns, rows), _unmatched(second_ns, others)
    if not max_gap_ns or not len(rest[0]) or not len(rest[1]):
        return rows, others
    one, other = first_ns[rest[0]], second_ns[rest[1]]
    there, back = _closest(one, other), _closest(other, one)
    mine = np.flatnonzero((back[there] == np.arange(len(one))) & (np.abs(other[there] - one) <= max_gap_ns))
    return np.concatenate([rows, rest[0][mine]]), np.concatenate([others, rest[1][there[mine]]])


def _unmatched(stamps: IntArray, matched: IntArray) -> IntArray:
    """Rows without a pair, in order of their stamps."""
    rows = np.setdiff1d(np.arange(len(stamps)), matched)
    return rows[np.argsort(stamps[rows], kind="stable")]


def _closest(stamps: IntArray, among: IntArray) -> IntArray:
    """Index in sorted ``among`` of the stamp closest to each; of two as close, the earlier."""
    after = np.clip(np.searchsorted(among, stamps), 1, max(len(among) - 1, 1))
    if len(among) == 1:
        return np.zeros(len(stamps), dtype=np.int64)
    return after - (stamps - among[after - 1] <= among[after] - stamps)


def _of_rows(one: IntArray, other: IntArray, pairs: tuple[IntArray, IntArray]) -> tuple[IntArray, IntArray]:
    return one[pairs[0]], other[pairs[1]]


def _in_order(pairs: tuple[IntArray, IntArray]) -> tuple[IntArray, IntArray]:
    order = np.argsort(pairs[0], kind="stable")
    return pairs[0][order], pairs[1][order]
