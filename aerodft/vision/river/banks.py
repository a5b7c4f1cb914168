"""Banks and islands' shores along transects, each located by its own profile in the image.

A profile is a step between two textures. Either side's mean, spread and correlation are taken where the profile surely
is on that side; then every place of the step, sharp or soft, gets its likelihood, the nearer to the mask's outline the
more, and mean and standard deviation over all places are the answer. Neighbouring samples of a texture are alike:
either side is a first-order autoregressive process, and what counts of a sample is its innovation. Last, within a few
pixels of there, either side may be shaded: its level is the straight line that its samples are on. Some bank points
stand out from their neighbours: a post in front of the water, a boat, a mask that leaked. And what stands on a bank and
is seen from behind hides water: how much, the view's geometry says.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr

from aerodft.geometry import robust_std
from aerodft.model import BoolArray, FloatArray, ImageArray, IntArray, Pose
from aerodft.vision.river.centreline import Transects
from aerodft.vision.river.status import RiverStatus
from aerodft.vision.river.water import WaterPlane

_STEP_PX: Final = 0.5
_ASIDE_PX: Final = np.array([-6.0, -4.5, -3.0, -1.5, 0.0, 1.5, 3.0, 4.5, 6.0])  # parallel profiles, along the bank
_PLACE_PX: Final = 0.2
_PLACE_VAR: Final = _PLACE_PX**2 / 12  # of the true place within so much
_NEAR_SHARE: Final = 0.35  # of the window: so well the step's place is known beforehand, one standard deviation
_BLURS_PX: Final = (0.55, 0.75, 1.2)  # of a sharp edge, with interpolation and a lens; of one that leans or is soft
_MEMORY_PX: Final = 4.0  # so far a side's samples tell what comes next
_SHADED_PX: Final = 3.0  # by so much shade may move a step
_SHADED_WINDOW_PX: Final = 8.0  # there either side's texture is taken nearer to the step
_HEIGHT_STD: Final = 0.4  # of a step where either side is shaded; 1 where they are not
_SMOOTH: Final = 2.0  # bank points: a bank's direction is that of the line through so many
_FLANKS: Final = 3.0  # blurs from its place: so far a step reaches
_NOISE: Final = 1.0  # grey levels: no side is known to be smoother
_LEAST_SPREAD: Final = 0.02  # of the step: no side is known to be more even
_TEMPER: Final = 0.5  # of a likelihood: there are two samples a pixel
_MOST_CORRELATED: Final = 0.98  # with its neighbour, no sample is more
_WINDOWS_PX: Final = np.array([16.0, 12.0, 8.0, 6.0])  # how far from a mask's outline the step may be
_OUTLINE_PX: Final = 6.5  # of the small copy: so far off a mask's outline may be
_MOTION_STD_PX: Final = 4.0  # of images of 1080p: the correlation's own blur
_STEP_M: Final = 0.5  # over which directions in the image are taken, at most
_ROOM: Final = 0.3  # of the way to the opposite bank: so far a profile may reach
_REACH: Final = 4  # neighbours to either side
_LEAST: Final = 5  # neighbours without which nothing is said
_STDS: Final = 4.0
_FLOOR: Final = 0.004  # of the width: banks are no smoother
ONE_SIDED: Final = 0.5
"""Metres of water hidden by a metre of growth, from which a width is a bound from below."""


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Steps between water and land.

    Attributes:
        pixels_px: ``(..., 2)``.
        std_px: ``(...)`` along the transect, from the profile.
        contrast: ``(...)`` distance of the two sides in standard deviations of a profile's sample.
        across_px: ``(..., 2)`` unit vectors in the image, from water to land along the transect.
    """

    pixels_px: FloatArray
    std_px: FloatArray
    contrast: FloatArray
    across_px: FloatArray


def locate_edges(
    image: ImageArray,
    near_px: FloatArray,
    across_px: FloatArray,
    along_px: FloatArray,
    window_px: FloatArray,
    *,
    shaded: bool = False,
) -> Edges:
    """Find the steps near pixels.

    Args:
        image: ``(height, width, 3)`` BGR.
        near_px: ``(n, 2)`` where they are about.
        across_px: ``(n, 2)`` unit vectors from water to land along the transects.
        along_px: ``(n, 2)`` unit vectors along the banks.
        window_px: ``(n,)`` how far from there the step may be; as much farther out is on its side surely.
            Where it is 0 nothing is looked for.
        shaded: Whether either side may slowly change towards the step, which then is at most 3 px from there.
    """
    pixels, stds, contrasts = near_px.copy(), window_px.copy(), np.zeros(len(near_px))
    for half in np.unique(window_px[window_px > 0]).tolist():
        rows = np.flatnonzero(window_px == half)
        profiles = _profiles(image, near_px[rows], across_px[rows], along_px[rows], half)
        offsets, stds[rows], contrasts[rows] = _step_at(profiles, half, shaded=shaded)
        pixels[rows] += offsets[:, None] * across_px[rows]
    return Edges(pixels, stds, contrasts, across_px)


def common_bias_px(std_px: FloatArray) -> float:
    """Standard deviation of what all banks of an image are off by together, from those of its bank points ``(...)``.

    What is not the step that is sought, as shade that fades into open water, lies along the whole bank: it spreads
    each point's place, and may move all by as much.
    """
    return math.sqrt(max(float(np.median(std_px)) ** 2 - _PLACE_VAR, 0.0))


def _offsets(half: float) -> FloatArray:
    return np.arange(-2 * half, 2 * half + _STEP_PX / 2, _STEP_PX)


def _profiles(image: ImageArray, near: FloatArray, across: FloatArray, along: FloatArray, half: float) -> FloatArray:
    """Colours ``(n, lines, samples, 3)``."""
    lines = near[:, None, None] + _ASIDE_PX[:, None, None] * along[:, None, None]
    at = (lines + _offsets(half)[:, None] * across[:, None, None]).astype(np.float32)
    flat = np.ascontiguousarray(at.reshape(len(near), -1, 2))
    colours = cv2.remap(image, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(colours, dtype=np.float64).reshape(*at.shape[:-1], 3)


def _step_at(profiles: FloatArray, half: float, *, shaded: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Offset and standard deviation (px), and contrast, each ``(n,)``."""
    offsets = _offsets(half)
    wet, dry = offsets <= -half, offsets >= half
    profile = _steps(profiles, wet, dry)
    before = _straight_on(len(offsets)) if shaded else None
    after = None if before is None else before.swapaxes(1, 2)
    sides = _Side.of(profile, wet, 0.0, before), _Side.of(profile, dry, 1.0, after)
    reach = _SHADED_PX if shaded else half
    places = np.arange(-reach, reach + _PLACE_PX / 2, _PLACE_PX)
    blurs = _BLURS_PX if shaded else _BLURS_PX[::2]
    score = np.stack([_likelihood(profile, offsets, places, sides, blur) for blur in blurs])
    score = _TEMPER * score - 0.5 * np.square(places / (_NEAR_SHARE * half))
    weight = np.exp(score - score.max(axis=(0, 2), keepdims=True)).sum(axis=0)
    weight /= weight.sum(axis=-1, keepdims=True)
    mean = weight @ places
    variance = weight @ places**2 - mean**2
    contrast = 1.0 / np.sqrt(0.5 * (sides[0].variance + sides[1].variance))
    return mean, np.sqrt(np.maximum(variance, 0.0) + _PLACE_VAR), contrast


def _steps(profiles: FloatArray, wet: BoolArray, dry: BoolArray) -> FloatArray:
    """Profiles ``(n, samples)`` in the colour direction that tells the sides apart best: 0 in the water, 1 on land."""
    sides = [profiles[:, :, side].reshape(len(profiles), -1, 3) for side in (wet, dry)]
    means = [side.mean(axis=1) for side in sides]
    centred = [side - mean[:, None] for side, mean in zip(sides, means, strict=True)]
    scatter = sum(np.swapaxes(side, 1, 2) @ side / side.shape[1] for side in centred) + _NOISE * np.eye(3)
    apart = means[1] - means[0]
    direction = np.linalg.solve(scatter, apart[..., None])[..., 0]
    length = np.maximum(np.sum(direction * apart, axis=-1), 1e-9)
    values = np.einsum("nltc,nc->nt", profiles, direction) / profiles.shape[1]
    zero = np.sum(means[0] * direction, axis=-1)
    return np.asarray((values - zero[:, None]) / length[:, None])


def _straight_on(count: int) -> FloatArray:
    """Weights ``(2, count, count)`` by which samples (rows) say each later one (columns), and the slope towards it.

    It is on the straight line through all before it, of which the nearest weigh most (Brown's exponential smoothing).
    """
    share = _STEP_PX / _MEMORY_PX
    age = np.arange(count) - np.arange(count)[:, None] - 1.0
    kept = share * (1.0 - share) ** np.maximum(age, 0.0) * (age >= 0.0)
    bent = kept * (1.0 - share * (age + 1.0)) / (1.0 - share)
    return np.stack([kept + bent, share * bent])


class _Side(NamedTuple):
    """One side of profiles ``(n, samples)``: a texture about a level that may slowly change, as shade does that fades.

    Attributes:
        variance: ``(n,)`` of each profile's samples.
        correlation: Of neighbouring samples, in all profiles.
        level: ``(n or 1, samples)`` of each sample, as those farther from the other side say.
        slope: ``(n or 1, samples)`` of the level there, a sample.
        deviance: ``(n, samples)`` minus twice the log likelihood of all samples from the second to each.
    """

    variance: FloatArray
    correlation: float
    level: FloatArray
    slope: FloatArray
    deviance: FloatArray

    @classmethod
    def of(cls, profile: FloatArray, there: BoolArray, mean: float, before: FloatArray | None) -> "_Side":
        """The side that profiles surely are on where ``there`` is true, with a mean; ``before`` says how it changes."""
        side = profile[:, there]
        rest = side - side.mean(axis=-1, keepdims=True)
        unit = rest / (rest.std(axis=-1, keepdims=True) + 1e-9)
        correlation = float(np.mean(unit[:, 1:] * unit[:, :-1])) / max(float(np.mean(unit * unit)), 1e-9)
        correlation = min(max(correlation, 0.0), _MOST_CORRELATED)
        variance = np.var(side, axis=-1) + _LEAST_SPREAD**2
        steady = np.array([[[mean]], [[0.0]]])
        level, slope = steady * np.ones(profile.shape[1]) if before is None else (profile - mean) @ before + steady
        fresh = variance[:, None] * (1.0 - correlation**2)
        innovation = profile[:, 1:] - level[:, 1:] - correlation * (profile[:, :-1] - level[:, 1:])
        deviance = np.cumsum(np.square(innovation) / fresh + np.log(fresh), axis=-1)
        return cls(variance, correlation, level, slope, np.pad(deviance, ((0, 0), (1, 0))))


def _likelihood(
    profile: FloatArray, offsets: FloatArray, places: FloatArray, sides: Sequence[_Side], blur_px: float
) -> FloatArray:
    """Log likelihood ``(n, places)`` of steps from one side to the other at places, of a blur, in ``(n, samples)``."""
    wet, dry = sides
    first, last = (np.searchsorted(offsets, places + sign * _FLANKS * blur_px) for sign in (-1, 1))
    count = int(np.max(last - first)) + 1  # samples of neither side alone, or after such a one
    first = np.clip(first, 1, len(offsets) - count)
    last, ahead = first + count - 1, np.arange(-1, count)
    within = first[:, None] + ahead
    step = ndtr((offsets[within] - places[:, None]) / blur_px)
    near = wet.level[:, first, None] + wet.slope[:, first, None] * ahead
    far = dry.level[:, last, None] + dry.slope[:, last, None] * (count - 1 - ahead)
    variance = wet.variance[:, None, None] + step * (dry.variance - wet.variance)[:, None, None]
    rest = (profile[:, within] - near - step * (far - near)) / np.sqrt(variance)
    correlation = wet.correlation + step[:, 1:] * (dry.correlation - wet.correlation)
    fresh = 1.0 - np.square(correlation)
    innovation = rest[..., 1:] - correlation * rest[..., :-1]
    deviance = np.einsum("npk,npk,pk->np", innovation, innovation, 1.0 / fresh)
    deviance += np.log(np.prod(variance[..., 1:] * fresh, axis=-1))
    deviance += np.square(((far - near)[..., count // 2] - 1.0) / _HEIGHT_STD)
    return np.asarray(-0.5 * (deviance + wet.deviance[:, first - 1] + dry.deviance[:, -1:] - dry.deviance[:, last]))


@dataclass(frozen=True, slots=True, eq=False)
class Islands:
    """What is dry between the banks.

    Attributes:
        count: ``(n,)`` islands across each transect.
        dry_m: ``(n,)`` their widths together.
        std_m: ``(n,)`` how well that is known, by their shores alone.
    """

    count: IntArray
    dry_m: FloatArray
    std_m: FloatArray


def locate_banks(
    image: ImageArray, plane: WaterPlane, found: Transects, scale: float, by_motion: BoolArray
) -> tuple[Edges, list[RiverStatus]]:
    """The banks of all transects ``(n, 2)``, left then right, NaN where the image ends first; and their statuses.

    Args:
        image: ``(height, width, 3)`` BGR.
        plane: The water's.
        found: The transects.
        scale: Pixels of the small copy per pixel of the image.
        by_motion: ``(n, 2)``: which banks are told by what moves: what looks like an edge there is another one.
    """
    count = len(found.stations_m)
    edges = Edges(*(np.full((count, 2, *tail), np.nan) for tail in ((2,), (), (), (2,))))
    status = np.full(count, "", dtype=object)
    offsets = np.stack([found.left_m, found.right_m], axis=-1)
    for side in range(2):
        rows = np.flatnonzero(np.isfinite(offsets[:, side]))
        opposite = np.nan_to_num(offsets[rows, 1 - side], nan=0.0)
        one = _located(image, plane, found, rows, (offsets[rows, side], opposite), scale)
        moving = by_motion[rows, side] & np.isfinite(one.std_px)
        one.pixels_px[moving] = plane.pixels_px(found.places_en_m(offsets[:, side])[rows[moving]])
        one.std_px[moving] = _MOTION_STD_PX
        told = np.isfinite(one.std_px)
        status[rows[np.isnan(one.std_px)]] = RiverStatus.TOO_COARSE
        kept = rows[told]
        edges.pixels_px[kept, side], edges.std_px[kept, side] = one.pixels_px[told], one.std_px[told]
        edges.contrast[kept, side], edges.across_px[kept, side] = one.contrast[told], one.across_px[told]
    missing: list[bool] = np.any(np.isnan(edges.std_px), axis=-1).tolist()
    return edges, [
        each or (RiverStatus.OUT_OF_IMAGE if lost else RiverStatus.OK)
        for each, lost in zip(status.tolist(), missing, strict=True)
    ]


def islands_across(image: ImageArray, plane: WaterPlane, found: Transects, scale: float) -> Islands:
    """The islands that transects cross; a shore whose profile cannot be told stays where the mask has it."""
    dry, variance = np.zeros(len(found.stations_m)), np.zeros(len(found.stations_m))
    count = np.bincount(found.shores, minlength=len(dry)).astype(np.int64)
    if len(found.shores):
        shores = np.empty((len(found.shores), 2))
        for side in range(2):
            here, there = found.shores_m[:, side], found.shores_m[:, 1 - side]
            # Seen from the water the island lies ahead: from its right shore to the left, from its left to the right.
            water = here + (here - there)
            edges = _located(image, plane, found, found.shores, (here, water), scale)
            places = plane.places_en_m(edges.pixels_px)
            centres, to_left = found.centres_en_m[found.shores], found.to_left[found.shores]
            shores[:, side] = np.sum((places - centres) * to_left, axis=-1)
            moved = plane.places_en_m(edges.pixels_px + edges.across_px)
            metres = np.linalg.norm(moved - places, axis=-1) * np.where(np.isfinite(edges.std_px), edges.std_px, 4.0)
            np.add.at(variance, found.shores, np.nan_to_num(metres) ** 2)
        np.add.at(dry, found.shores, np.maximum(shores[:, 1] - shores[:, 0], 0.0))
    return Islands(count, dry, np.sqrt(variance))


def _located(
    image: ImageArray,
    plane: WaterPlane,
    found: Transects,
    rows: IntArray,
    offsets: tuple[FloatArray, FloatArray],
    scale: float,
) -> Edges:
    """The steps at offsets of some transects, each with the offset of a place on the water's side of it.

    Their std is infinite where the image ends too soon for a profile, NaN where the river is too narrow in it.
    """
    edge_m, water_m = offsets
    centres, to_left = found.centres_en_m[rows], found.to_left[rows]
    sign = np.sign(edge_m - water_m)[:, None]
    places, inner = centres + edge_m[:, None] * to_left, centres + water_m[:, None] * to_left
    near, far = plane.pixels_px(places), plane.pixels_px(inner)
    step = np.minimum(_STEP_M, 0.02 * np.linalg.norm(places - inner, axis=-1))[:, None]
    across = _direction(plane, places, sign * to_left * step)
    along = _direction(plane, places, np.stack([-to_left[:, 1], to_left[:, 0]], axis=-1) * step)
    size = np.array([image.shape[1], image.shape[0]]) - 1
    border = np.min(np.minimum(near, size - near), axis=-1)
    room = _ROOM * np.linalg.norm(far - near, axis=-1)
    window = np.minimum(window_px(np.minimum(room, border) / 2), widest_px(scale))
    edges = locate_edges(image, near, across, along, window)
    edges = locate_edges(image, edges.pixels_px, across, along, window)  # where the first look was off
    if len(rows) > 1 and np.all(np.diff(rows) > 0):  # one line, not the shores of several islands
        along = _along(edges.pixels_px)
    near_window = np.minimum(window, _SHADED_WINDOW_PX)
    fine = locate_edges(image, edges.pixels_px, across, along, near_window, shaded=True)
    elsewhere_var = np.maximum(edges.std_px**2 - _SHADED_PX**2 / 3, 0.0)  # of places out of its reach
    edges = Edges(fine.pixels_px, np.sqrt(fine.std_px**2 + elsewhere_var), edges.contrast, across)
    edges.std_px[(window <= 0) & (border <= room)] = np.inf
    edges.std_px[(window <= 0) & (border > room)] = np.nan
    return edges


def _along(line_px: FloatArray) -> FloatArray:
    """Unit vectors ``(n, 2)`` along the smoothed line through points."""
    along = np.gradient(gaussian_filter1d(line_px, _SMOOTH, axis=0, mode="nearest"), axis=0)
    return np.asarray(along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9))


def widest_px(scale: float) -> float:
    """How far from a mask's outline the step may be, for a small copy of so many pixels per pixel of the image."""
    return float(max(window_px(np.array([_OUTLINE_PX / scale]))[0], _WINDOWS_PX.min()))


def window_px(limit_px: FloatArray) -> FloatArray:
    """The largest window of each limit ``(n,)``; 0 where it has none."""
    return np.asarray(np.max(np.where(limit_px[:, None] >= _WINDOWS_PX, _WINDOWS_PX, 0.0), axis=-1))


def _direction(plane: WaterPlane, places: FloatArray, step_m: FloatArray) -> FloatArray:
    """Unit vectors ``(n, 2)`` in the image of steps ``(n, 2)`` on the water."""
    moved = plane.pixels_px(places + step_m) - plane.pixels_px(places - step_m)
    with np.errstate(invalid="ignore"):
        return np.asarray(moved / np.linalg.norm(moved, axis=-1, keepdims=True))


def flag_outliers(stations_m: FloatArray, offsets_m: FloatArray, std_m: FloatArray, width_m: float) -> BoolArray:
    """Which points of a bank are off the line through their neighbours by more than the bank's own roughness.

    Args:
        stations_m: ``(n,)`` along the river, rising.
        offsets_m: ``(n,)`` from the centreline; NaN where there is no point.
        std_m: ``(n,)`` how well each is known.
        width_m: Of the river.

    Returns:
        ``(n,)``; False where there is no point, or too few others to tell.
    """
    rough = np.full(len(offsets_m), np.nan)
    for row in np.flatnonzero(np.isfinite(offsets_m)).tolist():
        near = np.arange(max(row - _REACH, 0), min(row + _REACH + 1, len(offsets_m)))
        near = near[np.isfinite(offsets_m[near]) & (near != row)]
        if len(near) >= _LEAST:
            rough[row] = offsets_m[row] - _middle_line(stations_m[near], offsets_m[near], stations_m[row])
    told = np.isfinite(rough)
    if np.count_nonzero(told) < _LEAST:
        return np.zeros(len(offsets_m), dtype=bool)
    usual = robust_std(rough[told]) + _FLOOR * width_m
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(rough) > _STDS * np.hypot(usual, std_m))


def _middle_line(stations_m: FloatArray, offsets_m: FloatArray, at_m: float) -> float:
    """Of a few points, the line whose slope is the median of all pairs' (Theil and Sen), at one station."""
    first, second = np.triu_indices(len(stations_m), 1)
    slopes = (offsets_m[second] - offsets_m[first]) / (stations_m[second] - stations_m[first])
    slope = float(np.median(slopes))
    return float(np.median(offsets_m + slope * (at_m - stations_m)))


def hidden_per_metre(pose: Pose, banks_enu_m: FloatArray) -> FloatArray:
    """Length of a transect that each metre of height on its banks hides.

    A bank between the camera and the water hides what is behind it; the opposite one hides none.

    Args:
        pose: Of the camera.
        banks_enu_m: ``(n, 2, 3)`` the two ends of each transect.

    Returns:
        ``(n, 2)``, 0 where the bank is seen from the water's side.
    """
    outward = (banks_enu_m - banks_enu_m[:, ::-1])[..., :2]
    with np.errstate(invalid="ignore", divide="ignore"):
        outward = outward / np.linalg.norm(outward, axis=-1, keepdims=True)
    away = banks_enu_m - pose.position_enu_m
    toward_water = -np.sum(outward * away[..., :2], axis=-1)
    return np.asarray(np.maximum(toward_water / -away[..., 2], 0.0))
