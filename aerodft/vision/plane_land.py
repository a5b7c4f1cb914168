"""Which group of points is the plane itself, where another one may be water that flows over it."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.vision.keyframes import Keyframe, PlaneImage
from aerodft.vision.plane_groups import Matched, PlaneGroup
from aerodft.vision.stillness import Gone, Stillness, share_moving
from aerodft.vision.straight import carried

_UNTOLD_S: Final = 2.0  # without telemetry for longer than this, land cannot be told from water
_NEVER_TOLD_S: Final = 0.5  # likewise, before it has said anything
_STEP_STD_PX: Final = 8.0  # of going on as before, without telemetry
_MOST_DOUBT: Final = 9.2  # squared stds of two coordinates, of which 99 % are less
_CERTAIN: Final = 10.0  # log odds: the others are not the plane
_LARGER: Final = 0.5  # how much for a group speaks that it has more points, by the logarithm of their number
_AHEAD_M: Final = 0.5  # over which derivatives on the plane are taken


@dataclass(frozen=True, slots=True, eq=False)
class Land:
    """What is taken for the plane.

    Attributes:
        group: Its points.
        astray: ``(n,)``: which points are certainly not of it.
        log_odds: That it lies still.
        doubt_px: What the chance of being wrong adds to the std.
        gone: Where it has gone, by telemetry; None where that does not tell.
    """

    group: PlaneGroup
    astray: BoolArray
    log_odds: float
    doubt_px: float
    gone: Gone | None


def land_among(
    groups: list[PlaneGroup],
    seen: Matched,
    keyframe: Keyframe,
    rows: IntArray,
    now: PlaneImage,
    last: PlaneImage,
    last_told_s: float,
) -> Land | None:
    """The group that lies still, or goes on as before where telemetry does not tell; None where none is likely.

    Args:
        groups: One or more.
        seen: Their points.
        keyframe: What they are held against.
        rows: ``(n,)`` which of its points they are.
        now: The image.
        last: The one before, in which the plane was found.
        last_told_s: Time of the last image with a standpoint, or of the first.
    """
    middles = [np.mean(seen.then[group.members], axis=0) for group in groups]
    places = [carried(group.homography, middle) for group, middle in zip(groups, middles, strict=True)]
    if not np.all(np.isfinite(places)):
        return None
    gone = [_gone(keyframe, now, last, middle, place) for middle, place in zip(middles, places, strict=True)]
    known = [each for each in gone if each is not None]
    if len(known) < len(groups):
        steps = [place - carried(seen.foretold, middle) for middle, place in zip(middles, places, strict=True)]
        stills = [keyframe.stillness_of(rows[group.members]) for group in groups]
        if abs(now.time_s - last_told_s) > (_UNTOLD_S if stills[0].is_watched else _NEVER_TOLD_S):
            return None
        return _as_before(groups, steps, stills, now.time_s)
    stills = [keyframe.stillness_of(rows[group.members]) for group in groups]
    likely = [
        still.likelihood(each) + _LARGER * math.log(np.count_nonzero(group.members))
        for each, group, still in zip(known, groups, stills, strict=True)
    ]
    first = int(np.argmax(likely))
    log_odds = stills[first].with_evidence(known[first])
    if log_odds < 0:
        return None
    doubts_px = [known[first].px * math.sqrt(share_moving(log_odds))]
    astray = np.zeros_like(groups[first].members)
    for each, group, chance in zip(known, groups, likely, strict=True):
        if group is not groups[first]:
            apart_px = float(np.linalg.norm(known[first].px_by_m @ (each.by_m - known[first].by_m)))
            doubts_px.append(apart_px * math.sqrt(share_moving(likely[first] - chance)))
            astray |= group.members & (likely[first] - chance > _CERTAIN)
    return Land(groups[first], astray & ~groups[first].members, log_odds, math.hypot(*doubts_px), known[first])


def _as_before(
    groups: list[PlaneGroup], steps_px: list[FloatArray], stills: list[Stillness], time_s: float
) -> Land | None:
    """Without telemetry: what is where it was expected."""
    doubts = [float(step @ step) / _STEP_STD_PX**2 for step in steps_px]
    first = int(np.argmin(doubts))
    if doubts[first] > _MOST_DOUBT:
        return None
    doubt_px = stills[first].unwatched_px(time_s)
    if len(groups) > 1:
        other = int(np.argsort(doubts)[1])
        share = share_moving((doubts[other] - doubts[first]) / 2)
        doubt_px = math.hypot(doubt_px, float(np.linalg.norm(steps_px[other] - steps_px[first])) * math.sqrt(share))
    return Land(groups[first], np.zeros_like(groups[first].members), stills[first].log_odds, doubt_px, None)


def _gone(
    keyframe: Keyframe, now: PlaneImage, last: PlaneImage, then_px: FloatArray, now_px: FloatArray
) -> Gone | None:
    """Where a place of the keyframe ``(2,)`` that is seen at ``now_px (2,)`` has gone over the ground, by telemetry."""
    before, after = keyframe.taken.standpoint, now.standpoint
    if before is None or after is None:
        return None
    onto = after.from_plane()
    was_m, is_m = _on_plane(before.from_plane(), then_px), _on_plane(onto, now_px)
    ahead = carried(onto, is_m + _AHEAD_M * np.eye(2))
    px_by_m = (ahead - now_px).T / _AHEAD_M
    sweep_mps = np.zeros(2)
    if last.standpoint is not None and now.time_s > last.time_s:
        sweep_mps = (is_m - _on_plane(last.standpoint.from_plane(), now_px)) / (now.time_s - last.time_s)
    gone = Gone(now.time_s, is_m - was_m, px_by_m, sweep_mps, float(after.lens[0, 0]))
    return gone if np.all(np.isfinite([*gone.by_m, *px_by_m.ravel(), *sweep_mps])) else None


def _on_plane(from_plane: FloatArray, px: FloatArray) -> FloatArray:
    """East and north ``(2,)`` of what is seen at ``px (2,)``; NaN above the horizon."""
    return carried(np.asarray(np.linalg.inv(from_plane), dtype=np.float64), px)
