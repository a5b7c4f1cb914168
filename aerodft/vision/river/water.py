"""Which part of an image is water: classical segmentation from one seed, or a user's own network.

Regions around the seed. Few clusters of colour and texture tell water from land at once where the two are of a kind
each; many are needed where water is brown here and mirrors the sky there, or where bushes differ from all the rest by
more than water does from sand. All of it happens on a copy of half the size: which region it is does not need more, and
its outline is drawn again afterwards, by a graph cut; bare ground along it is taken off. Reflections and shade change
water's lightness, seldom its colour against the banks': lightness weighs least.

Bare or grown ground along the water that the water's outline may have taken in: seen by an edge inside.

The middle of the water says what water looks like, and the band along its outline is cut anew. What that takes away
is ground where it has more texture than the water beside it, or is greener. Where it is neither it may be ground, if
its edge is clear, and it is no shade or mirrored bank: those are darker than the water beside them. Glitter is far
brighter, and foam is rough because of what is far brighter in it.

Calm water along a bank, whose colour it mirrors: it fades into the rest of the water, and is the smoothest of all.

Colour and lightness put such a strip on the land's side, for they are the bank's. What tells it from ground, and from
what grows: there is no edge between it and the water, as there is where water ends; it has no more fine detail than
water, and less than land; and it is darker than the water beside it. A beach fades into shallow water as well, but is
brighter: what is brighter may be either.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.errors import InputError
from aerodft.geometry import middle_and_std, robust_std
from aerodft.model import BoolArray, FloatArray, ImageArray, IntArray
from aerodft.vision.river.water_features import (
    BLUE_TO_GREEN,
    LIGHT,
    RED_TO_GREEN,
    TEXTURE,
    Float32Image,
    WaterFeatures,
    clusters_of,
    outline_contrast,
)

_SPECK: Final = 3e-4  # of the image: what is drier and smaller is a wave, or a boat
_DISC: Final = 0.025  # radius of the seed's disc, of the copy's width
_ITERATIONS: Final = 3
_DEEP: Final = 1 / 60  # of the copy's width: so far inside a region is water surely
_SCALE: Final = 3.0  # to bytes, of the two colours and the texture
_MIDDLE: Final = 128.0
_SEED: Final = 1

Bytes = npt.NDArray[np.uint8]
_FEW: Final = (2, 3)
_MANY: Final = (4, 6, 8)
_JOINED: Final = 5
_PLAIN_WEIGHTS: Final = np.array([1.0, 1.0, 0.0, 1.5], dtype=np.float32)  # of the planes: shade is lightness alone
_WEIGHTS: Final = np.array([1.0, 1.0, 0.3, 1.5], dtype=np.float32)
_CLEAR_PERCENT: Final = 25.0  # of an outline's contrasts: most of it has to be clear
_LEAST_OUTLINE: Final = 20  # pixels
_ALIKE: Final = 0.97  # overlap: two such regions are one
_SHARE: Final = 0.2  # of the seed's disc: a cluster with more belongs to the water
_SMOOTH_PX: Final = 1.0
_BAND: Final = 0.35  # of half the water's width: so far from the outline it may be ground
_SCALES: Final = np.array([4.0, 4.0, 2.0, 3.0], dtype=np.float32)  # to bytes, around the water's own middle
_LEAST: Final = 0.001  # of the copy: a smaller piece is foam, or a stone
_THICK_PX: Final = 5  # a thinner piece is the outline's own blur
_CLEAR: Final = 1.45  # standard deviations across the inner edge, lightness left out
_ROUGHER: Final = 2.0  # of twelve times the texture's logarithm: about a sixth more than the water's beside it
_NO_LIGHT: Final = np.array([1.0, 1.0, 0.0, 1.0], dtype=np.float32)
_STRIP: Final = np.ones((11, 11), dtype=np.uint8)  # around a piece: the water next to it
_DARKER: Final = -0.5  # forty times the logarithm of the lightness: about 1 %
GLITTER: Final = 12.0  # about 35 % brighter than the water beside it
_BRIGHTEST: Final = 97.0  # percent of a piece
_FOAM: Final = 15.0  # likewise: its brightest, about 45 %
_UNEVEN: Final = 2.2  # of the standard deviation of the water's lightness beside it; real banks here have up to 2.0
_GREENER: Final = -1.5  # likewise of red to green: the colour of what grows there
_NOT_BLUER: Final = 1.0  # likewise of blue to green: where the sky is mirrored it is more
_LEAST_STRIP: Final = 0.001  # of the water's area
_LEAST_SPREAD: Final = 3.0  # of twelve times the texture's logarithm: 28 %
_GAP_PX: Final = 4  # to the water's outline at most: what the fading strip itself loses to neither
_BESIDE_PX: Final = 12  # so far around it is the water that it is held against
_SURELY_DARKER: Final = -3.0  # forty times the logarithm of the lightness: 7 %
_FADES_PX: Final = 5.0  # at the steepest: edges of banks are 1 to 4 px wide, mirrored banks fade over 6 to 8
_CALM: Final = 1.1  # of the fine detail of the water beside it: no rougher
_NO_LAND: Final = 0.85  # of the fine detail of the smoothest fifth of the land
_SMOOTHEST_PERCENT: Final = 20.0
_STEEPEST_PERCENT: Final = 90.0
_LIKE: Final = 1.5  # standard deviations of a strip's looks
_COLOURS: Final = (RED_TO_GREEN, BLUE_TO_GREEN)
_LOOKS_OF: Final = (*_COLOURS, LIGHT)
_LARGEST_ISLAND: Final = 0.3  # of the water, where the image cuts it
_CUT_ISLAND: Final = 0.6  # of its shore's length: so short is where the image cuts it; a bank's corner has more
_SEVERED: Final = 0.03  # of the water
_MARGINS: Final = 2  # at bare ground along the water: what hid behind the first
_MULTIPLE: Final = 32  # networks halve their input some times
_CONTRACT: Final = (
    "input 1 x 3 x H x W (RGB, 0 to 1), output 1 x 1 x h x w (probability or logit of water) or 1 x 2 x h x w"
)


def disc_around(shape: tuple[int, int], seed_px: tuple[float, float]) -> BoolArray:
    """What a seed says to be water, ``(height, width)``."""
    disc = np.zeros(shape, dtype=np.uint8)
    cv2.circle(disc, (round(seed_px[0]), round(seed_px[1])), max(2, round(_DISC * max(shape))), 1, -1)
    return disc > 0


def opened(region: BoolArray) -> BoolArray:
    """A region without what is thinner than five pixels."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    return np.asarray(cv2.morphologyEx(region.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0)


def piece_around(region: BoolArray, disc: BoolArray) -> BoolArray:
    """The piece of the region that shares most with the disc; the disc itself where none does."""
    _, labels = cv2.connectedComponents(region.astype(np.uint8), connectivity=4)
    shares = np.bincount(labels[disc & region])
    if not shares[1:].any():
        return disc
    return np.asarray(labels == 1 + int(np.argmax(shares[1:])))


def without_specks(water: BoolArray) -> BoolArray:
    """A region with its smallest holes filled."""
    count, labels, facts, _ = cv2.connectedComponentsWithStats((~water).astype(np.uint8), connectivity=4)
    speck = facts[:count, cv2.CC_STAT_AREA] < _SPECK * water.size
    speck[0] = False
    return np.asarray(water | speck[labels])


def overlap(one: BoolArray, other: BoolArray) -> float:
    """Intersection over union of two regions."""
    return float(np.count_nonzero(one & other)) / max(int(np.count_nonzero(one | other)), 1)


def cut(planes: Float32Image, region: BoolArray, disc: BoolArray, ground: BoolArray) -> BoolArray:
    """The region with its outline drawn by a graph cut; what is deep inside stays water.

    What is not looked at is land to the cut, whatever it shows: it is given the colours of what land there is.

    Args:
        planes: ``(height, width, 4)`` of ``WaterFeatures``.
        region: ``(height, width)``.
        disc: Part of it that is water surely.
        ground: What is looked at.
    """
    land = ground & ~region
    if not land.any():
        return region
    seen = _colours(planes)
    seen[~ground] = np.random.default_rng(_SEED).choice(seen[land], np.count_nonzero(~ground))
    deep_px = max(1, round(_DEEP * float(max(region.shape))))
    deep = cv2.erode(region.astype(np.uint8), np.ones((3, 3), dtype=np.uint8), iterations=deep_px)
    labels = np.where(region, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[(deep > 0) | disc] = cv2.GC_FGD
    labels[~ground] = cv2.GC_BGD
    water = _foreground(seen, labels) & ground
    return without_specks(piece_around(opened(water) | disc, disc))


def _foreground(seen: Bytes, labels: Bytes) -> BoolArray:
    """What a graph cut of an image ``(height, width, 3)`` puts with the foreground of ``labels (height, width)``."""
    cv2.setRNGSeed(_SEED)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(seen, labels, (0, 0, 0, 0), *models, _ITERATIONS, cv2.GC_INIT_WITH_MASK)
    return np.asarray((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD))


def _colours(planes: Float32Image) -> Bytes:
    texture = planes[..., TEXTURE] - np.median(planes[..., TEXTURE])
    colours = np.dstack([planes[..., RED_TO_GREEN], planes[..., BLUE_TO_GREEN], texture])
    return np.clip(_SCALE * colours + _MIDDLE, 0, 255).astype(np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A region that may be the water.

    Attributes:
        water: ``(height, width)`` of the copy of half the size, in one piece.
        clearness: Standard deviations between its outline's two sides, along most of it.
    """

    water: BoolArray
    clearness: float


def outlines(planes: Float32Image, seed_px: tuple[float, float], ground: BoolArray) -> list[Outline]:
    """What may be the water around a seed, the clearest first; at least one.

    Args:
        planes: ``(height, width, 4)`` of a copy of half the size.
        seed_px: A pixel of it, in the water.
        ground: ``(height, width)``: what is looked at.
    """
    disc = disc_around(ground.shape, seed_px) & ground
    regions = [_region(_labels(planes, count, ground), disc, ground) for count in (*_FEW, *_MANY)]
    regions.append(_joined_clusters(planes, _labels(planes, _JOINED, ground), disc, ground))
    found = _unlike([cut(planes, region, disc, ground) for region in _unlike(regions)])
    clear = [Outline(water, _clearness(planes, water, ground)) for water in found]
    return sorted(clear, key=lambda each: -each.clearness)


def _unlike(regions: list[BoolArray]) -> list[BoolArray]:
    kept: list[BoolArray] = []
    for region in regions:
        if all(overlap(region, other) <= _ALIKE for other in kept):
            kept.append(region)
    return kept


def _region(labels: IntArray, disc: BoolArray, ground: BoolArray, joined: tuple[int, ...] = ()) -> BoolArray:
    """The region around the disc that consists of the disc's clusters and of more."""
    return piece_around(opened(np.isin(labels, [*_own(labels, disc), *joined]) & ground) | disc, disc)


def _own(labels: IntArray, disc: BoolArray) -> list[int]:
    """The clusters that have a good share of the disc."""
    share = np.bincount(labels[disc]) / max(int(disc.sum()), 1)
    return [int(each) for each in np.flatnonzero(share > _SHARE)]


def _joined_clusters(planes: Float32Image, labels: IntArray, disc: BoolArray, ground: BoolArray) -> BoolArray:
    """The disc's clusters, with others as long as they make the outline clearer."""
    others = [each for each in range(_JOINED) if each not in _own(labels, disc)]
    best = _region(labels, disc, ground)
    joined: tuple[int, ...] = ()
    clearest = _clearness(planes, best, ground)
    while others:
        found = [_region(labels, disc, ground, (*joined, each)) for each in others]
        scores = [_clearness(planes, region, ground) for region in found]
        top = int(np.argmax(scores))
        if scores[top] <= clearest:
            break
        clearest, best, joined = scores[top], found[top], (*joined, others.pop(top))
    return best


def _clearness(planes: Float32Image, region: BoolArray, ground: BoolArray) -> float:
    """How well a region's outline separates its sides, along most of it."""
    _, contrast = outline_contrast(planes, region, ground)
    return float(np.percentile(contrast, _CLEAR_PERCENT)) if len(contrast) >= _LEAST_OUTLINE else 0.0


def _labels(planes: Float32Image, count: int, ground: BoolArray) -> IntArray:
    """The cluster of every pixel, ``(height, width)``."""
    weighted = planes * (_PLAIN_WEIGHTS if count in _FEW else _WEIGHTS)
    labels = clusters_of(weighted, _SMOOTH_PX, ground, count, tries=2)
    return np.zeros(ground.shape, dtype=np.int64) if labels is None else labels


@dataclass(frozen=True, slots=True, eq=False)
class Margin:
    """Ground along the water's outline, and what may be ground there, ``(height, width)`` each."""

    bare: BoolArray
    doubtful: BoolArray


def margin(planes: Float32Image, water: BoolArray, sure: BoolArray, ground: BoolArray) -> Margin:
    """The ground along the outline that was taken for water.

    Args:
        planes: ``(height, width, 4)`` of ``WaterFeatures``.
        water: ``(height, width)``, with that ground.
        sure: Part of it that is water.
        ground: What is looked at.
    """
    found = Margin(np.zeros(water.shape, dtype=bool), np.zeros(water.shape, dtype=bool))
    if not np.any(ground & ~water):
        return found
    inner = _cut(planes, water, sure, ground)
    kernel = np.ones((_THICK_PX, _THICK_PX), dtype=np.uint8)
    taken = cv2.morphologyEx((water & ~inner).astype(np.uint8), cv2.MORPH_OPEN, kernel)
    count, pieces, facts, _ = cv2.connectedComponentsWithStats(taken, connectivity=8)
    share = facts[:count, cv2.CC_STAT_AREA] / water.size
    outline, contrast = outline_contrast(planes * _NO_LIGHT, inner, ground)
    clearness = np.zeros(water.shape)
    clearness[outline] = contrast
    for number in range(1, count):
        piece = np.asarray(pieces == number)
        near = cv2.dilate(piece.astype(np.uint8), kernel) > 0
        edge = clearness[near & outline]
        beside = cv2.dilate(piece.astype(np.uint8), _STRIP) > 0
        beside &= inner
        if share[number] < _LEAST or len(edge) == 0 or not beside.any():
            continue
        apart, clear = planes[piece].mean(axis=0) - planes[beside].mean(axis=0), float(np.median(edge))
        is_rough = _is_rougher(apart) and not _is_foam(planes[piece][:, LIGHT], planes[beside][:, LIGHT])
        if clear > _CLEAR and (is_rough or _is_greener(apart)):
            found.bare[near & water & ~inner] = True
        elif clear > _CLEAR and _may_be_ground(apart):
            found.doubtful[near & water & ~inner] = True
    return found


def _cut(planes: Float32Image, water: BoolArray, sure: BoolArray, ground: BoolArray) -> BoolArray:
    to_land = cv2.distanceTransform(1 - (ground & ~water).astype(np.uint8), cv2.DIST_L2, 5)
    core = water & (to_land >= _BAND * float(np.percentile(to_land[water], 95)))
    middle = np.median(planes[core | sure], axis=0)
    scaled = (planes - middle) * _SCALES
    colours = np.dstack([scaled[..., 0], scaled[..., 1], scaled[..., 2] + scaled[..., 3]]) + _MIDDLE
    labels = np.full(water.shape, cv2.GC_BGD, dtype=np.uint8)
    labels[water] = cv2.GC_PR_BGD
    labels[core | sure] = cv2.GC_FGD
    return _foreground(np.clip(colours, 0, 255).astype(np.uint8), labels)


def _is_rougher(apart: Float32Image) -> bool:
    """Whether a piece has more texture than the water next to it, ``apart (4,)`` of the planes; glitter has it too."""
    return bool(apart[TEXTURE] > _ROUGHER and apart[LIGHT] < GLITTER)


def _is_foam(piece: Float32Image, beside: Float32Image) -> bool:
    """Whether a piece's lightness ``(n,)`` is that of bright spots, far more uneven than the water's next to it."""
    brightest = float(np.percentile(piece, _BRIGHTEST)) - float(beside.mean())
    return brightest > _FOAM and float(piece.std()) > _UNEVEN * float(beside.std())


def _is_greener(apart: Float32Image) -> bool:
    """Whether a piece is greener than the water next to it, and neither darker nor bluer: no shade, and no sky."""
    return bool(apart[RED_TO_GREEN] < _GREENER and apart[BLUE_TO_GREEN] < _NOT_BLUER and _may_be_ground(apart))


def _may_be_ground(apart: Float32Image) -> bool:
    """Whether a piece is neither shade nor glitter: not darker than the water next to it, and not glaring."""
    return bool(_DARKER < apart[LIGHT] < GLITTER)


def with_mirrored_banks(
    features: WaterFeatures, water: BoolArray, disc: BoolArray, ground: BoolArray
) -> tuple[BoolArray, BoolArray | None]:
    """The water, with the calm strips along it in which its banks are mirrored.

    Args:
        features: The small copy.
        water: ``(height, width)``.
        disc: Part of it that is water surely.
        ground: What is looked at.

    Returns:
        The water with darker strips; and with brighter ones too, which may be beaches: None where there are none.
    """
    found = [(each, _fades(features, water, each, ground)) for each in _smooth_pieces(features, water, ground)]
    strips = [(each, lighter) for each, lighter in found if lighter is not None]
    darker = [each for each, lighter in strips if lighter < _SURELY_DARKER]
    surely = _joined(features, water, darker, disc, ground)
    if len(darker) == len(strips):
        return surely, None
    return surely, _joined(features, water, [each for each, _ in strips], disc, ground)


def _joined(
    features: WaterFeatures, water: BoolArray, strips: list[BoolArray], disc: BoolArray, ground: BoolArray
) -> BoolArray:
    if not strips:
        return water
    mirrored = _along(features.planes, np.logical_or.reduce(strips), water, ground)
    kernel = np.ones((2 * _GAP_PX + 1, 2 * _GAP_PX + 1), dtype=np.uint8)
    closed = cv2.morphologyEx((water | mirrored).astype(np.uint8), cv2.MORPH_CLOSE, kernel) > 0
    between = closed & _around(mirrored, _GAP_PX) & ground
    return cut(features.planes, water | between, disc | between, ground)


def _smooth_pieces(features: WaterFeatures, water: BoolArray, ground: BoolArray) -> list[BoolArray]:
    """Pieces of the land beside the water, ``(height, width)`` each, that have no more texture than water has."""
    texture = features.planes[..., TEXTURE]
    inside = texture[water]
    middle = float(np.median(inside))
    spread = max(robust_std(inside - middle), _LEAST_SPREAD)
    smooth = opened(ground & ~water & (texture <= middle + spread)).astype(np.uint8)
    near = _around(water, _GAP_PX)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(smooth, connectivity=4)
    large = facts[:, cv2.CC_STAT_AREA] >= _LEAST_STRIP * np.count_nonzero(water)
    beside = np.bincount(labels[near & (smooth > 0)], minlength=count) > 0
    return [np.asarray(labels == number) for number in range(1, count) if large[number] and beside[number]]


def _fades(features: WaterFeatures, water: BoolArray, piece: BoolArray, ground: BoolArray) -> float | None:
    """How much lighter a piece is than the water that it fades into, being as smooth; None where it does not."""
    beside = water & _around(piece, _BESIDE_PX)
    land = ground & ~water & ~piece
    if not beside.any() or not land.any():
        return None
    apart = features.planes[piece].mean(axis=0) - features.planes[beside].mean(axis=0)
    detail = float(np.median(features.detail[piece]))
    is_water = (
        detail < _CALM * float(np.median(features.detail[beside]))
        and detail < _NO_LAND * float(np.percentile(features.detail[land], _SMOOTHEST_PERCENT))
        and _fading_px(features.planes, water, piece, apart) > _FADES_PX
    )
    return float(apart[LIGHT]) if is_water else None


def _along(planes: Float32Image, strip: BoolArray, water: BoolArray, ground: BoolArray) -> BoolArray:
    """A strip with what runs on along the water in its looks, where it is too narrow for its texture to be seen."""
    middle, std = middle_and_std(planes[strip][:, _LOOKS_OF])
    like = np.all(np.abs(planes[..., _LOOKS_OF] - middle) <= _LIKE * (std + 1.0), axis=-1)
    from_water = cv2.distanceTransform(1 - water.astype(np.uint8), cv2.DIST_L2, 5)
    near = from_water <= float(from_water[strip].max())
    _, labels = cv2.connectedComponents(
        (strip | opened(like & near & ground & ~water)).astype(np.uint8), connectivity=4
    )
    return np.asarray(np.isin(labels, np.unique(labels[strip])))


def _fading_px(planes: Float32Image, water: BoolArray, piece: BoolArray, apart: Float32Image) -> float:
    """Over how many pixels the water's colour becomes that of a piece beside it, where that goes fastest."""
    between = apart[list(_COLOURS)]
    whole = float(np.linalg.norm(between))
    if whole == 0:
        return 0.0
    towards = np.asarray(planes[..., _COLOURS] @ (between / whole), dtype=np.float32)
    slopes = [cv2.Sobel(towards, cv2.CV_32F, 1 - axis, axis, ksize=3, scale=1 / 8) for axis in (0, 1)]
    slope = cv2.magnitude(*slopes)
    border = _around(water, 2 * _GAP_PX) & _around(piece, 2 * _GAP_PX) & _around(~water, 2 * _GAP_PX)
    return whole / max(float(np.percentile(slope[border], _STEEPEST_PERCENT)), 1e-6) if border.any() else 0.0


def _around(region: BoolArray, reach_px: int) -> BoolArray:
    """A region with what is near it, itself included."""
    kernel = np.ones((2 * reach_px + 1, 2 * reach_px + 1), dtype=np.uint8)
    return np.asarray(cv2.dilate(region.astype(np.uint8), kernel) > 0)


@dataclass(frozen=True, slots=True, eq=False)
class WaterMask:
    """Where the water is in the small copy.

    Attributes:
        water: ``(height, width)``, in one piece.
        outline: ``(height, width)``: its pixels beside what is not water, away from the border of what was looked at.
        contrast: ``(k,)``, of the outline's pixels in the order of ``np.nonzero``: how many standard deviations lie
            between the two sides of it.
        doubtful: Share of the outline along which another clear edge lies inside: what is between may be bare ground.
        stayed: ``(height, width)``: what was taken off because it did not move; None where nothing was.
        trimmed: Whether bare ground along it was taken off.
        less: ``(height, width)``: the same without what may be bare ground; None where nothing may.
        more: ``(height, width)``: the same with what may be water that mirrors a bank, or a beach; None likewise.
        regions: ``(height, width)`` each, of half the size: about the water, and what else nearly as clear may be it;
            empty where nothing else may.
        apart: How large the largest other piece is that looks like it, of its own area: another arm?
        agreement: The least share (overlap) that the first has with another of them.
    """

    water: BoolArray
    outline: BoolArray
    contrast: FloatArray
    doubtful: float = 0.0
    stayed: BoolArray | None = None
    trimmed: bool = False
    less: BoolArray | None = None
    more: BoolArray | None = None
    regions: tuple[BoolArray, ...] = ()
    apart: float = 0.0
    agreement: float = 1.0


def find_water(
    features: WaterFeatures, seed_px: tuple[float, float], ground: BoolArray, region: BoolArray
) -> WaterMask:
    """The water around a seed.

    Args:
        features: The small copy.
        seed_px: A pixel of it, in the water.
        ground: ``(height, width)``: which pixels show the ground near enough to be measured; no others are water.
        region: About the water, of any size.
    """
    disc = disc_around(features.shape, seed_px) & ground
    about = cv2.resize(region.astype(np.uint8), features.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    drawn = cut(features.planes, about & ground, disc, ground)
    whole, brighter = with_mirrored_banks(features, drawn, disc, ground)
    water = whole
    along = margin(features.planes, water, disc, ground)
    for _ in range(_MARGINS):
        if not along.bare.any():
            break
        shrunk = _without(water, along.bare, disc)
        if shrunk is None:
            break
        water = shrunk
        along = margin(features.planes, water, disc, ground)
    outline, contrast = outline_contrast(features.planes, water, ground)
    more = None if brighter is None else water | (brighter & ~whole)
    found = WaterMask(water, outline, contrast, trimmed=water is not whole, more=more)
    if not along.doubtful.any():
        return found
    doubtful = float(np.mean(along.doubtful[outline])) if outline.any() else 0.0
    return replace(found, doubtful=doubtful, less=_without(water, along.doubtful, disc))


def _without(water: BoolArray, taken: BoolArray, disc: BoolArray) -> BoolArray | None:
    """The water without a margin; None where that severs it: what spans a river is not along it."""
    left = piece_around(opened(water & ~taken) | disc, disc)
    severed = np.count_nonzero(water & ~taken & ~left)
    return left if severed <= _SEVERED * np.count_nonzero(water) else None


def around_seed(wet: BoolArray, shape: tuple[int, int], seed_px: tuple[float, float], ground: BoolArray) -> BoolArray:
    """The piece of ``wet (height, width)`` around a seed, smoothed, without specks."""
    disc = disc_around(shape, seed_px) & ground
    return without_specks(piece_around(opened(wet) | disc, disc))


def with_islands(water: BoolArray, ground: BoolArray) -> BoolArray:
    """The water with what it surrounds; land that the image's border cuts is an island where it has more shore.

    Args:
        water: ``(height, width)``.
        ground: What was looked at: its border is the image's, or the horizon's.
    """
    count, labels, facts, _ = cv2.connectedComponentsWithStats((ground & ~water).astype(np.uint8), connectivity=4)
    kernel = np.ones((3, 3), dtype=np.uint8)
    shore = cv2.dilate(water.astype(np.uint8), kernel) > 0
    border = cv2.erode(ground.astype(np.uint8), kernel, borderValue=0) == 0
    on_shore = np.bincount(labels[shore], minlength=count)
    on_border = np.bincount(labels[border], minlength=count)
    small = facts[:, cv2.CC_STAT_AREA] < _LARGEST_ISLAND * np.count_nonzero(water)
    island = (on_border == 0) | (small & (on_border < _CUT_ISLAND * on_shore))
    island[0] = False
    return np.asarray(water | island[labels])


@dataclass(frozen=True, slots=True, eq=False)
class WaterNetwork:
    """A network that was read from a file.

    Attributes:
        net: As OpenCV has it.
        where: Its file, for messages.
    """

    net: Any
    where: Path

    @classmethod
    def read(cls, path: Path) -> "WaterNetwork":
        """Read an ONNX file.

        Raises:
            InputError: It is missing, or no network that OpenCV can run.
        """
        try:
            data = np.fromfile(path, dtype=np.uint8)
        except OSError as error:
            raise InputError("the water model cannot be read", where=path, got=error.strerror) from error
        try:
            return cls(cv2.dnn.readNetFromONNX(data), path)
        except cv2.error:
            raise InputError("no network that OpenCV can run", where=path, expected=f"ONNX: {_CONTRACT}") from None

    def find_water(self, features: WaterFeatures, seed_px: tuple[float, float], ground: BoolArray) -> WaterMask:
        """The water mask by a network: what is more likely water than not, in one piece around the seed.

        Raises:
            InputError: The network does not take such an image, or does not say what it should.
        """
        wet = self.probability(features.pixels) > 0.5  # noqa: PLR2004 - more likely than not
        water = around_seed(wet & ground, features.shape, seed_px, ground)
        outline, contrast = outline_contrast(features.planes, water, ground)
        return WaterMask(water, outline, contrast)

    def probability(self, pixels: ImageArray) -> Float32Image:
        """Of water, ``(height, width)``, in an image ``(height, width, 3)`` BGR.

        Raises:
            InputError: See ``find_water``.
        """
        height, width = pixels.shape[:2]
        size = tuple(-(-side // _MULTIPLE) * _MULTIPLE for side in (width, height))
        try:
            self.net.setInput(cv2.dnn.blobFromImage(pixels, 1.0 / 255.0, size, swapRB=True))
            said = np.asarray(self.net.forward(), dtype=np.float32)
        except cv2.error:
            raise InputError("the water model does not take the image", where=self.where, expected=_CONTRACT) from None
        if said.ndim != 4 or said.shape[0] != 1 or said.shape[1] not in (1, 2) or not np.all(np.isfinite(said)):  # noqa: PLR2004
            raise InputError("the water model's output", where=self.where, got=f"{said.shape}", expected=_CONTRACT)
        logit = said[0, 1] - said[0, 0] if said.shape[1] == 2 else said[0, 0]  # noqa: PLR2004 - land, then water
        is_probability = said.shape[1] == 1 and float(logit.min()) >= 0.0 and float(logit.max()) <= 1.0
        wet = logit if is_probability else 1.0 / (1.0 + np.exp(-np.clip(logit, -30.0, 30.0)))
        return np.asarray(cv2.resize(wet, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
