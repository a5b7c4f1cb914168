"""Sources of the height against each other."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.model.pose import HeightSource

_BEYOND_STDS: Final = 1.96
"""Two sources disagree where their difference lies outside of its 95 % interval."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightDifference:
    """Two sources at one moment.

    Attributes:
        stamp_ns: UTC.
        source: The one.
        other: The other one.
        height_m: What the one says, above the measured plane.
        other_m: What the other one says.
        std_m: Standard deviation of the difference, by what is stated of the two.
    """

    stamp_ns: int
    source: HeightSource
    other: HeightSource
    height_m: float
    other_m: float
    std_m: float

    @property
    def step_m(self) -> float:
        """The other one minus the one."""
        return self.other_m - self.height_m

    @property
    def is_beyond(self) -> bool:
        """Whether that is more than what is stated of the two explains."""
        return bool(self.is_step_beyond(np.array(self.step_m), np.array(self.std_m)))

    @staticmethod
    def is_step_beyond(step_m: FloatArray, std_m: FloatArray) -> BoolArray:
        """Whether steps ``(n,)`` are more than what is stated of the two, standard deviations ``(n,)``, explains."""
        return np.asarray(np.abs(step_m) > _BEYOND_STDS * std_m)

    def turned(self) -> "HeightDifference":
        """The same from the other side."""
        return HeightDifference(
            stamp_ns=self.stamp_ns,
            source=self.other,
            other=self.source,
            height_m=self.other_m,
            other_m=self.height_m,
            std_m=self.std_m,
        )

    def sentence(self) -> str:
        """What the two say."""
        return (
            f"{self.other} says {self.other_m:.2f} m where {self.source} says {self.height_m:.2f} m: "
            f"{abs(self.step_m):.2f} m apart, their std is {self.std_m:.2f} m"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightSwitch:
    """From this stamp (UTC) on heights are of another source.

    ``step`` compares the two (``source`` before, ``other`` after) when both last spoke; None where they never did.
    """

    stamp_ns: int
    before: HeightSource
    after: HeightSource
    step: HeightDifference | None
