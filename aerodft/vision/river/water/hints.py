"""What a person says is water or land: points, strokes or a mask, which win over what the network says.

Probabilities spread from the hints by a random walker (Grady, Random Walks for Image Segmentation, 2006, with the
prior of section V): each pixel asks its neighbours, the more alike in colour the more they count, and the network's
probability, together with what the colours of the hints make likely.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter
from scipy.sparse import diags_array
from scipy.sparse.linalg import cg

from aerodft.errors import InputError
from aerodft.model import BoolArray, FloatArray, ImageArray
from aerodft.vision.river.water.plane import Float32Image, SmallCopy, WaterPlane

_MOST_LETTERS: Final = 1 << 24  # of a file of hints
_GRIDS_PX: Final = (48, 96, 192, 384)  # longer sides of the grids that are walked on
_BRUSH: Final = 0.008  # of the longer side: half a stroke's width
_CONTRAST: Final = 80.0
_PRIOR: Final = 0.03
_ROUNDS: Final = 40
_HINT: Final = 1e3
_LEAST_LINK: Final = 1e-4
_DISTRUST: Final = 0.25  # of the longer side: so far from a mistake the network is doubted
_COLOUR_WEIGHT: Final = 1.15  # with what the network is trusted by
_BIN: Final = (10.0, 6.0, 6.0)  # of lightness and the two colour axes, of 256
_BINS: Final = (26, 43, 43)
_SURE: Final = 12.0


@dataclass(frozen=True, slots=True, eq=False)
class RiverHints:
    """What a person says of an image.

    Attributes:
        water: Strokes ``(n, 2)`` of pixels in the water; a point ``(u, v)`` is a stroke of one.
        land: Strokes ``(n, 2)`` on land.
        mask: ``(height, width)``, the image or a copy of it: 255 for water, 0 for land, anything between where nobody
            says; None for none.

    Raises:
        InputError: A stroke is neither.
    """

    water: Sequence[npt.ArrayLike] = ()
    land: Sequence[npt.ArrayLike] = ()
    mask: ImageArray | None = None

    def __post_init__(self) -> None:
        for name in ("water", "land"):
            object.__setattr__(self, name, tuple(map(_stroke, getattr(self, name))))

    def __bool__(self) -> bool:
        return bool(self.water or self.land or self.mask is not None)

    @property
    def tell_land(self) -> bool:
        """Whether they say of anything that it is land."""
        return bool(self.land) or (self.mask is not None and not self.mask.all())

    @staticmethod
    def read(path: Path) -> "RiverHints":
        """Hints from a file: JSON with lists ``water`` and ``land`` of points or strokes, or an image as a mask.

        Raises:
            InputError: It cannot be read, or has something else in it.
        """
        if not path.is_file():  # to open a pipe would wait for somebody who writes
            raise InputError("no file of hints", where=path, expected="JSON, or an image as a mask; check the path")
        if path.suffix.lower() == ".json":
            try:
                with path.open(encoding="utf-8") as file:
                    document = json.loads(file.read(_MOST_LETTERS))
                return RiverHints(document.get("water", []), document.get("land", []))
            except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
                expected = '{"water": [[u, v], ...], "land": [[[u, v], [u, v]], ...]}'
                raise InputError("no hints can be read", where=path, got=error, expected=expected) from error
        try:
            mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        except cv2.error:  # a header that claims more pixels than OpenCV believes
            mask = None
        if mask is None:
            raise InputError("no mask can be read", where=path, expected="an image, white for water, or JSON")
        return RiverHints(mask=np.asarray(mask, dtype=np.uint8))

    def carried(self, there: WaterPlane, here: WaterPlane) -> "RiverHints":
        """The hints of one image in another, carried on the water's plane; those out of its view are left out.

        A mask is not carried: it is of one image.
        """
        return RiverHints(_carried(self.water, there, here), _carried(self.land, there, here))


def _carried(strokes: Sequence[npt.ArrayLike], there: WaterPlane, here: WaterPlane) -> list[FloatArray]:
    moved = []
    for stroke in strokes:
        places = there.places_en_m(np.asarray(stroke))
        pixels = here.pixels_px(places)
        moved.append(pixels[here.in_view(places, pixels)])
    return [stroke for stroke in moved if len(stroke)]


def _stroke(told: Any) -> FloatArray:  # noqa: ANN401 - whatever JSON holds
    try:
        points = np.atleast_2d(np.asarray(told, dtype=np.float64))
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] != 2 or not np.all(np.isfinite(points)):  # noqa: PLR2004 - (n, 2)
        raise InputError("a hint", got=str(told), expected="a pixel (u, v), or a stroke of several")
    return points


def hinted(copy: SmallCopy, hints: RiverHints) -> tuple[BoolArray, BoolArray]:
    """Which pixels of a small copy the hints say to be water, and which land, ``(height, width)`` each."""
    return _drawn(copy, hints.water, hints.mask, 255), _drawn(copy, hints.land, hints.mask, 0)


def _drawn(copy: SmallCopy, strokes: Sequence[npt.ArrayLike], mask: ImageArray | None, level: int) -> BoolArray:
    canvas = np.zeros(copy.shape, dtype=np.uint8)
    half = max(1, round(_BRUSH * max(copy.shape)))
    for stroke in strokes:
        points = np.rint(np.clip(copy.to_small(np.asarray(stroke)), -1e6, 1e6)).astype(np.int32)
        cv2.polylines(canvas, [points.reshape(-1, 1, 2)], isClosed=False, color=1, thickness=2 * half)
        for point in points.tolist():
            cv2.circle(canvas, point, half, 1, -1)
    drawn = canvas > 0
    if mask is not None:
        drawn |= cv2.resize(mask, copy.shape[::-1], interpolation=cv2.INTER_NEAREST) == level
    return np.asarray(drawn)


def with_hints(copy: SmallCopy, logits: Sequence[Float32Image], hints: RiverHints) -> tuple[Float32Image, ...]:
    """The network's looks at a small copy, corrected where the hints contradict it; logits ``(height, width)``."""
    wet, dry = hinted(copy, hints)
    if not (wet.any() or dry.any()):
        return tuple(logits)
    if hints.mask is not None and np.mean(wet | dry) > 0.5:  # noqa: PLR2004 - it says all that there is to say
        said = np.where(wet, _SURE, np.where(dry, -_SURE, 0.0)).astype(np.float32)
        return tuple(said for _ in logits)
    mean = np.asarray(np.mean(logits, axis=0), dtype=np.float32)
    if np.all(mean[wet] > 0) and np.all(mean[dry] < 0):  # the network knows all that the person says
        return tuple(logits)
    changed = _walked(copy, mean, wet, dry) - mean
    changed[wet] = np.maximum(changed, _SURE - mean)[wet]
    changed[dry] = np.minimum(changed, -_SURE - mean)[dry]
    return tuple(np.asarray(each + changed, dtype=np.float32) for each in logits)


def _walked(copy: SmallCopy, logit: Float32Image, wet: BoolArray, dry: BoolArray) -> Float32Image:
    """Logits ``(height, width)`` as the hints change them, from coarse grids to fine ones."""
    colours = np.asarray(cv2.cvtColor(copy.pixels, cv2.COLOR_BGR2LAB), dtype=np.float64)
    share: FloatArray | None = None
    for side in _GRIDS_PX:
        scale = side / max(copy.shape)
        size = max(2, round(copy.shape[1] * scale)), max(2, round(copy.shape[0] * scale))
        lab = _resized(colours, size)
        here, water, land = (_resized(each.astype(np.float64), size) for each in (logit, wet, dry))
        trust = _trust(here, water > 0, land > 0)
        told = trust * here + (_COLOUR_WEIGHT - trust) * _by_colour(lab, trust * here, water > 0, land > 0)
        prior: FloatArray = 1.0 / (1.0 + np.exp(-np.clip(told, -_SURE, _SURE)))
        start = prior if share is None else np.asarray(cv2.resize(share, size), dtype=np.float64)
        share = _screened(lab, prior, water, land, start)
    assert share is not None  # noqa: S101 - there are grids, for the type checker
    corrected = np.log(np.clip(share, 1e-5, 1.0) / np.clip(1.0 - share, 1e-5, 1.0)).astype(np.float32)
    return np.asarray(cv2.resize(corrected, copy.shape[::-1], interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def _trust(logit: FloatArray, water: BoolArray, land: BoolArray) -> FloatArray:
    """How far the network is believed, ``(h, w)`` from 0 to 1: not near to where a person knows better."""
    wrong = (water & (logit < 0)) | (land & (logit > 0))
    if not wrong.any():
        return np.ones(logit.shape)
    away = cv2.distanceTransform((~wrong).astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(1.0 - np.exp(-np.square(away / (_DISTRUST * max(logit.shape)))), dtype=np.float64)


def _resized(values: FloatArray, size: tuple[int, int]) -> FloatArray:
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), dtype=np.float64)


def _by_colour(lab: FloatArray, logit: FloatArray, water: BoolArray, land: BoolArray) -> FloatArray:
    """How much likelier, as a logarithm, each pixel's colour is in water than on land, by the hints and the network."""
    cells = np.minimum(lab.reshape(-1, 3) // _BIN, np.array(_BINS) - 1).astype(np.int64)
    bins = np.ravel_multi_index(tuple(cells.T), _BINS)
    scores = []
    for hint, sure in ((water, logit > 2.0), (land, logit < -2.0)):  # noqa: PLR2004 - 88 %
        weight = sure.astype(np.float64) / max(int(sure.sum()), 1)
        if hint.any():
            weight = weight + 3.0 * hint / int(hint.sum())
        histogram = np.bincount(bins, weight.ravel(), math.prod(_BINS)).reshape(_BINS)
        smooth = gaussian_filter(histogram, 1.0)
        scores.append(smooth.ravel()[bins] / max(float(smooth.sum()), 1e-12) + 1e-5)
    return np.asarray(np.clip(np.log(scores[0] / scores[1]), -4.0, 4.0).reshape(logit.shape))


def _screened(lab: FloatArray, prior: FloatArray, water: FloatArray, land: FloatArray, start: FloatArray) -> FloatArray:
    """Probabilities ``(h, w)`` that are smooth where colours are, near the prior, and as the hints say."""
    height, width = prior.shape
    right, down = np.zeros(prior.shape), np.zeros(prior.shape)
    right[:, :-1] = np.exp(-np.sum(np.square(np.diff(lab, axis=1)), axis=-1) / _CONTRAST) + _LEAST_LINK
    down[:-1] = np.exp(-np.sum(np.square(np.diff(lab, axis=0)), axis=-1) / _CONTRAST) + _LEAST_LINK
    told = _HINT * (water + land)
    degree = right + down + _PRIOR + told
    degree[:, 1:] += right[:, :-1]
    degree[1:] += down[:-1]
    off = right.ravel()[:-1], down.ravel()[:-width]
    diagonals = [degree.ravel(), -off[0], -off[0], -off[1], -off[1]]
    matrix = diags_array(diagonals, offsets=[0, 1, -1, width, -width], format="csr")  # type: ignore[call-overload] # its stubs know no list of arrays
    wanted = (_PRIOR * prior + _HINT * water).ravel()
    jacobi = diags_array(1.0 / degree.ravel(), format="csr")
    share, _ = cg(matrix, wanted, x0=start.ravel(), rtol=1e-3, maxiter=_ROUNDS, M=jacobi)
    return np.asarray(np.clip(share, 0.0, 1.0).reshape(height, width))
