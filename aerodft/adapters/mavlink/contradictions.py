"""Where a vehicle's telemetry contradicts itself: heights of two sources, and clocks that jump or are two."""

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.height import HeightDifference
from aerodft.service.timing import ClockHealth

_FEW: Final = 0.1  # share of the comparisons; noise makes one in twenty
_PERIOD_NS: Final = SECOND_NS
_MOST_JUMPS: Final = 5


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

    def sentences(self) -> list[str]:
        """One sentence for each pair that disagrees more often than by chance."""
        return [
            f"heights disagree: {second} is {np.median(pair.steps_m):+.2f} m above {first} in the median "
            f"({min(pair.steps_m):+.2f} to {max(pair.steps_m):+.2f} m), beyond their std in {pair.beyond} of "
            f"{len(pair.steps_m)} comparisons; see telemetry.height.order, home_above_plane_m and std_m"
            for (first, second), pair in self._pairs.items()
            if pair.beyond > _FEW * len(pair.steps_m)
        ]


def clock_document(health: ClockHealth) -> dict[str, Any]:
    """Plain JSON values."""
    return {
        "drift_ppm": None if health.drift is None else round(1e6 * health.drift, 2),
        "reboots": health.restarts,
        "wraps": health.wraps,
        "jumps_s": [round(jump_s, 3) for jump_s in health.jumps_s],
        "rows_of_other_clocks": health.left_out,
        "two_clocks": health.rivals,
    }


def clock_sentences(health: ClockHealth) -> list[str]:
    """What happened to the clocks, where something did."""
    sentences = []
    if health.jumps_s:
        jumps = ", ".join(f"{jump_s:+.3f} s" for jump_s in health.jumps_s[:_MOST_JUMPS])
        more = f" and {len(health.jumps_s) - _MOST_JUMPS} more" if len(health.jumps_s) > _MOST_JUMPS else ""
        sentences.append(f"the vehicle's UTC jumped by {jumps}{more}: images stamped meanwhile are CLOCK_JUMPED")
    if health.rivals:
        sentences.append(
            "two autopilots speak with the same ids, each with its own time since boot: the first one heard is "
            f"followed, {health.left_out} messages of the other one are left out; give one of them another system id "
            "(SYSID_THISMAV)"
        )
    if health.restarts:
        times = "once" if health.restarts == 1 else f"{health.restarts} times"
        sentences.append(f"the vehicle rebooted {times}: no pose is made of what came before and after")
    return sentences
