"""How far apart two measurements may be: in a unit, in combined standard deviations, in per cent of the first."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from aerodft.errors import UsageError
from aerodft.model.arrays import FloatArray

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
        raise UsageError("--tolerance", got=repr(text), expected="like 0.01m, 0.1deg, 2m2, 0.5std, 1% or 0.01")
    return value, found[2].rstrip("s")
