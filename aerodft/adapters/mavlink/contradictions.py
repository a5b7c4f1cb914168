"""Where the sources of a vehicle's height contradict each other."""

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.height import HeightDifference
from aerodft.model.pose import HeightSource

_FEW: Final = 0.1  # share of the comparisons; noise makes one in twenty
_PERIOD_NS: Final = SECOND_NS


@dataclass(slots=True)
class HeightPair:
    """Two sources over a flight.

    Attributes:
        steps_m: The second one minus the first, once a second where both spoke.
        stamps_ns: When (UTC).
        beyond: In how many of these that is more than their stds explain.
    """

    steps_m: list[float] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    beyond: int = 0

    def add(self, difference: HeightDifference) -> None:
        """Count one comparison, at most one a second."""
        if self.stamps_ns and abs(difference.stamp_ns - self.stamps_ns[-1]) < _PERIOD_NS:
            return
        self.steps_m.append(difference.step_m)
        self.stamps_ns.append(difference.stamp_ns)
        self.beyond += difference.is_beyond

    @property
    def disagrees(self) -> bool:
        """Whether the two differ more often than by chance."""
        return self.beyond > _FEW * len(self.steps_m)

    @property
    def far(self) -> str:
        """By how much the second one is above or below, in words."""
        median_m = float(np.median(self.steps_m))
        return f"{abs(median_m):.2f} m {'below' if median_m < 0 else 'above'}"

    def sentence(self, first: str, second: str, advice: str) -> str:
        """How the two differ, and what to do."""
        return (
            f"heights disagree: {second} is {self.far} {first} in the median "
            f"({min(self.steps_m):+.2f} to {max(self.steps_m):+.2f} m), beyond their std in {self.beyond} of "
            f"{len(self.steps_m)} comparisons: {advice}"
        )


class HeightPairs:
    """All pairs of sources that spoke at the same time."""

    def __init__(self) -> None:
        self._pairs: dict[tuple[str, str], HeightPair] = {}

    def add(self, differences: list[HeightDifference]) -> None:
        """Take in what the sources said at one time."""
        for each in differences:
            self._pairs.setdefault((str(each.source), str(each.other)), HeightPair()).add(each)

    def documents(self) -> list[dict[str, Any]]:
        """Plain JSON values, one document a pair."""
        return [
            {
                "source": first,
                "other": second,
                "compared": len(pair.steps_m),
                "beyond_std": pair.beyond,
                "step_median_m": round(float(np.median(pair.steps_m)), 3),
                "step_low_m": round(min(pair.steps_m), 3),
                "step_high_m": round(max(pair.steps_m), 3),
            }
            for (first, second), pair in self._pairs.items()
        ]

    def sentences(self, home_above_plane_m: float = 0.0) -> list[str]:
        """One sentence for each pair that disagrees more often than by chance; one for a source that is alone.

        Args:
            home_above_plane_m: What is added to heights above home, of which a better one may follow.
        """
        apart = {names: pair for names, pair in self._pairs.items() if pair.disagrees}
        for alone in dict.fromkeys(name for names in apart for name in names):
            against = {
                _other(names, alone): _seen_from(names, pair, alone) for names, pair in apart.items() if alone in names
            }
            if len(against) > 1 and self._agree(list(against)):
                rest = {names: pair for names, pair in apart.items() if alone not in names}
                return [_alone(alone, against, home_above_plane_m), *_sentences(rest, home_above_plane_m)]
        return _sentences(apart, home_above_plane_m)

    def _agree(self, names: list[str]) -> bool:
        """Whether these sources were compared, and agree."""
        pairs = [pair for pair_names, pair in self._pairs.items() if set(pair_names) <= set(names)]
        return bool(pairs) and not any(pair.disagrees for pair in pairs)


def _sentences(apart: dict[tuple[str, str], HeightPair], home_above_plane_m: float) -> list[str]:
    """One sentence for each pair."""
    sentences = []
    for names, pair in apart.items():
        alone = str(HeightSource.HOME) if HeightSource.HOME in names else names[1]
        advice = _advice(alone, _seen_from(names, pair, alone).steps_m, home_above_plane_m)
        sentences.append(pair.sentence(*names, f"if {_other(names, alone)} is right, {advice}"))
    return sentences


def _advice(name: str, steps_m: list[float], home_above_plane_m: float) -> str:
    """What to do about a source that is so far above others that speak of the ground below."""
    if name != HeightSource.HOME:
        return "take it out of telemetry.height.order, or see std_m"
    middle_m = float(np.median(steps_m))
    if max(steps_m) - min(steps_m) < abs(middle_m):
        return f"set telemetry.height.home_above_plane_m = {round(home_above_plane_m - middle_m, 1) + 0.0:g}"
    return (
        "the ground below is not level with home: measure by what speaks of it (telemetry.height.order), and describe "
        "ground that is no plane in [ground]"
    )


def _other(names: tuple[str, str], name: str) -> str:
    return names[1] if name == names[0] else names[0]


def _seen_from(names: tuple[str, str], pair: HeightPair, name: str) -> HeightPair:
    """The pair with this source as the second one."""
    if name == names[1]:
        return pair
    return HeightPair(steps_m=[-step_m for step_m in pair.steps_m], stamps_ns=pair.stamps_ns, beyond=pair.beyond)


def _alone(name: str, against: dict[str, HeightPair], home_above_plane_m: float) -> str:
    """That one source contradicts others, which agree; and what to do."""
    others = " and ".join(against)
    steps_m = [step_m for pair in against.values() for step_m in pair.steps_m]
    far = " and ".join(f"{pair.far} {other}" for other, pair in against.items())
    beyond = " and ".join(f"{pair.beyond} of {len(pair.steps_m)}" for pair in against.values())
    return (
        f"heights disagree: {name} is {far} in the median ({min(steps_m):+.2f} to {max(steps_m):+.2f} m), beyond "
        f"their std in {beyond} comparisons, while {others} agree: {_advice(name, steps_m, home_above_plane_m)}"
    )
