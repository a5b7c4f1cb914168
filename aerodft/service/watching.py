"""How a fixed camera is watched for bumps, in SI units; ``adapters.config`` makes it from TOML."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchSettings:
    """What is looked for, and what counts as moved.

    Attributes:
        limit_rad: A camera that looks farther than this from where it looked has moved.
        every_s: Least time between two looks.
        confirm: So many looks in a row must agree.
        lever_arm_m: From the lens to the joint that it turns about, at the most: a bump moves the lens along.
        ignore: Polygons of pixels of the reference image that move by themselves: water, trees, roads.
    """

    limit_rad: float = math.radians(0.2)
    every_s: float = 1.0
    confirm: int = 3
    lever_arm_m: float = 0.2
    ignore: tuple[tuple[tuple[float, float], ...], ...] = ()
