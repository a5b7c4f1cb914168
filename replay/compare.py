"""Two recordings side by side: the same measurements, and how far apart they are."""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from aerodft.conventions import SECOND_NS
from replay.differences import Difference, Pairs, paired, summarise, together
from replay.pairing import PairBy, Pairing, pairing
from replay.recording import Recording
from replay.series import ProbeKey, read_side
from replay.tolerance import Tolerance

WITHIN_S = 0.01
"""Stamps that are farther apart are not of one image, unless the images say so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Two recordings' measurements, matched by probe and image or stamp.

    Attributes:
        is_identical: Every payload is the same, byte by byte, in the same order.
        paired_by: What made the pairs.
        is_same_input: Whether both are of the same images: pixels and telemetry are shared.
        shift_s: Median of the second's stamps minus the first's; None without a pair.
        common: Measurements in both.
        only_first: Measurements in the first alone.
        only_second: Measurements in the second alone.
        status_changes: How many changed from which status to which, as ``"ok -> NO_HEIGHT"``.
        beyond: Pairs of numbers that are farther apart than the tolerance.
        total: Over all probes.
        probes: By probe.
    """

    is_identical: bool
    paired_by: PairBy
    is_same_input: bool
    shift_s: float | None
    common: int
    only_first: int
    only_second: int
    status_changes: dict[str, int]
    beyond: int
    total: Difference
    probes: dict[str, Difference]

    @property
    def differs(self) -> bool:
        """Whether something is missing, has another status, or is farther apart than the tolerance."""
        return bool(self.only_first or self.only_second or self.status_changes or self.beyond)


class Comparing:
    """Two sides, read and paired; asked for the figures, or for the differences themselves.

    Args:
        first: A recording, or a table that was exported from one.
        second: Another.
        by: What makes a pair.
        within_s: How far apart stamps of one image may be, where stamps make the pairs.

    Raises:
        InputError: One of them is neither, or damaged.
        NoAnswerError: A recording holds nothing.
    """

    def __init__(self, first: Path, second: Path, *, by: PairBy = PairBy.AUTO, within_s: float = WITHIN_S) -> None:
        self._first, self._second = read_side(first), read_side(second)
        self.pairing: Pairing = pairing(self._first, self._second, by, within_s)

    @property
    def is_empty(self) -> bool:
        """Whether neither side holds a measurement."""
        return not self._first.count and not self._second.count

    @cached_property
    def pairs(self) -> dict[str, Pairs]:
        """The pairs of every probe, in order of their names."""
        keys = sorted(self._first.series.keys() | self._second.series.keys())
        names = Counter(key.name for key in keys)
        return {
            key.name if names[key.name] == 1 else f"{key.name} ({key.kind}, {key.unit})": self._pairs(key)
            for key in keys
        }

    def comparison(self, tolerance: Tolerance) -> Comparison:
        """The figures."""
        pairs = self.pairs
        probes = {
            name: summarise(each, tolerance, same_input=self.pairing.is_same_input) for name, each in pairs.items()
        }
        total = together(list(pairs.values()), list(probes.values()), same_input=self.pairing.is_same_input)
        shifts = np.concatenate([np.zeros(0), *(each.shift_ns for each in pairs.values())])
        return Comparison(
            is_identical=self._first.digest == self._second.digest,
            paired_by=self.pairing.by,
            is_same_input=self.pairing.is_same_input,
            shift_s=float(np.median(shifts)) / SECOND_NS if len(shifts) else None,
            common=total.paired,
            only_first=total.only_first,
            only_second=total.only_second,
            status_changes=total.status_changes,
            beyond=total.beyond,
            total=total,
            probes=probes,
        )

    def _pairs(self, key: ProbeKey) -> Pairs:
        one, other = self._first.series.get(key), self._second.series.get(key)
        return paired(key, one, other, self.pairing)


def compare_recordings(first: Recording, second: Recording, tolerance: Tolerance | None = None) -> Comparison:
    """Compare the measurements of two recordings, paired by image or stamp.

    Raises:
        InputError: A recorded measurement is damaged.
    """
    return Comparing(first.folder, second.folder).comparison(tolerance or Tolerance())
