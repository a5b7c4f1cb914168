"""Two recordings side by side: the same measurements, and how far apart they are."""

import hashlib
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median

import orjson

from aerodft.errors import InputError
from aerodft.model.status import Status
from replay.recording import Recording

Key = tuple[str, str, int]


@dataclass(frozen=True, slots=True)
class _Value:
    value: float | None
    std: float | None
    status: str
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """How far apart the numbers of one probe (or of all) are; None where no two numbers could be compared.

    Attributes:
        count: Pairs of numbers.
        unit: Of the differences; empty where probes of several units are put together.
        max_abs: Largest difference of two values.
        median_abs: Median of them.
        max_std_abs: Largest difference of two standard deviations.
        max_sigmas: Largest difference over the root of the summed variances.
        median_sigmas: Median of them.
    """

    count: int
    unit: str
    max_abs: float | None
    median_abs: float | None
    max_std_abs: float | None
    max_sigmas: float | None
    median_sigmas: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Two recordings' measurements, matched by probe and stamp.

    Attributes:
        is_identical: Every payload is the same, byte by byte, in the same order.
        common: Measurements in both.
        only_first: Measurements in the first alone.
        only_second: Measurements in the second alone.
        status_changes: How many changed from which status to which, as ``"ok -> NO_HEIGHT"``.
        total: Over all probes.
        probes: By probe.
    """

    is_identical: bool
    common: int
    only_first: int
    only_second: int
    status_changes: dict[str, int]
    total: Difference
    probes: dict[str, Difference]

    def differs(self, tolerance: float) -> bool:
        """Whether something is missing, has another status, or a value or std more than ``tolerance`` away."""
        farthest = max(self.total.max_abs or 0.0, self.total.max_std_abs or 0.0)
        return bool(self.only_first or self.only_second or self.status_changes) or farthest > tolerance


@dataclass(slots=True)
class _Differences:
    units: set[str] = field(default_factory=set)
    values: list[float] = field(default_factory=list)
    stds: list[float] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)

    def add(self, first: _Value, second: _Value) -> None:
        if first.value is None or second.value is None:
            return
        self.units |= {first.unit, second.unit}
        difference = abs(first.value - second.value)
        if first.unit == "deg":
            difference = min(difference, 360.0 - difference)
        self.values.append(difference)
        if first.std is not None and second.std is not None:
            self.stds.append(abs(first.std - second.std))
            if (combined := math.hypot(first.std, second.std)) > 0:
                self.sigmas.append(difference / combined)

    def extend(self, other: "_Differences") -> None:
        self.units |= other.units
        self.values += other.values
        self.stds += other.stds
        self.sigmas += other.sigmas

    def summary(self) -> Difference:
        return Difference(
            count=len(self.values),
            unit=next(iter(self.units)) if len(self.units) == 1 else "",
            max_abs=max(self.values, default=None),
            median_abs=median(self.values) if self.values else None,
            max_std_abs=max(self.stds, default=None),
            max_sigmas=max(self.sigmas, default=None),
            median_sigmas=median(self.sigmas) if self.sigmas else None,
        )


class _Side:
    """One recording's measurements, read once; knows the digest of all payloads when it is through."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._digest = hashlib.sha256()

    def values(self) -> Iterator[tuple[Key, _Value]]:
        seen: Counter[tuple[str, str]] = Counter()
        for payload in self._recording.measurements():
            self._digest.update(len(payload).to_bytes(8, "little") + payload)
            try:
                item = orjson.loads(payload)
                key = (item["name"], item["stamp_ns"])
                value = _Value(item["value"], item["std"], item["status"], item["unit"])
            except (orjson.JSONDecodeError, KeyError, TypeError) as error:
                raise InputError(
                    "a recorded measurement is none", where=self._recording.folder, got=repr(payload[:60])
                ) from error
            yield (*key, seen[key]), value
            seen[key] += 1

    def digest(self) -> bytes:
        return self._digest.digest()


def compare_recordings(first: Recording, second: Recording) -> Comparison:
    """Compare the measurements of two recordings.

    Raises:
        InputError: A recorded measurement is damaged.
    """
    one, other = _Side(first), _Side(second)
    rest = dict(one.values())
    by_probe: dict[str, _Differences] = {}
    changes: Counter[str] = Counter()
    common = only_second = 0
    for key, value in other.values():
        found = rest.pop(key, None)
        if found is None:
            only_second += 1
            continue
        common += 1
        if found.status != value.status:
            changes[f"{Status(found.status)} -> {Status(value.status)}"] += 1
        by_probe.setdefault(key[0], _Differences()).add(found, value)
    total = _Differences()
    for differences in by_probe.values():
        total.extend(differences)
    return Comparison(
        is_identical=one.digest() == other.digest(),
        common=common,
        only_first=len(rest),
        only_second=only_second,
        status_changes=dict(changes),
        total=total.summary(),
        probes={name: differences.summary() for name, differences in sorted(by_probe.items())},
    )
