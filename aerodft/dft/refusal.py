"""Why a point is not known well enough for an answer: by how much, and from what most of it comes."""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from aerodft.dft.answers import Answer
from aerodft.dft.budget import Share, variance_budget
from aerodft.dft.points import ProbePoints
from aerodft.dft.record import Record
from aerodft.dft.seen import Seen
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import PoseSample
from aerodft.model.probe import ProbeKind
from aerodft.model.status import Status

_GRAZING_RAD: Final = math.radians(15)  # below the horizon: from here on, small angles are large errors


def unknown_range(record: Record, seen: Seen, on_ground: ProbePoints, half_m: FloatArray) -> Answer:
    """Say how badly the worst point is known, and why.

    Args:
        record: The request.
        seen: What is seen.
        on_ground: Its ``k`` points on the ground.
        half_m: ``(k,)`` half of the 95 % interval of each one's range.
    """
    index = int(np.argmax(half_m / on_ground.range_m))
    below_rad, range_m = float(on_ground.ground.depression_rad[index]), float(on_ground.range_m[index])
    one = slice(index, index + 1)
    alone = replace(seen, kind=ProbeKind.RANGE, pixels_px=seen.pixels_px[one], ground=seen.ground[one])
    budget = variance_budget(alone, record.sample.std)
    spread = f"+- {half_m[index]:.0f} m (95 %)" if math.isfinite(half_m[index]) else "and may be anything"
    where = f" is {math.degrees(below_rad):.1f} deg below the horizon" if below_rad < _GRAZING_RAD else ""
    cause = _cause(budget[0], record.sample) if budget else "its error is not known"
    sentence = f"point {index}{where}, range {range_m:.0f} m {spread}: {cause}"
    return record.miss(Status.ILL_CONDITIONED, sentence, *record.sample.reasons)


def _cause(first: Share, sample: PoseSample) -> str:
    """The largest part of the variance, how well its input is known, and what to do about it."""
    stds_deg = {name: getattr(sample.std, f"{name}_rad") for name in ("tilt", "pan", "roll", "heading")}
    known = ""
    if first.source in stds_deg:
        known = f" (std {math.degrees(stds_deg[first.source]):.1f} deg)"
    elif first.source == "height":
        of = "" if sample.height_source is None else f" of {sample.height_source}"
        known = f"{of} (std {sample.std.height_agl_m:.1f} m)"
    return f"{100 * first.share:.0f} % of the variance is from {first.source}{known}; {first.remedy}"
