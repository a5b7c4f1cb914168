"""Surveyed markers (ArUco, AprilTag) in images: their ids, corners and centres, how well known, and as observations.

Detectors decide module by module whether it is black or white, and so read a marker into textures now and then, the
more so the larger the dictionary is. In a true marker black is black and white is white all over: what does not look
like the marker that it was taken for is left out.

Corners and centres are found to a few hundredths of a pixel, by lines fitted to the edges of the black square. Straight
edges are straight lines only without distortion, so with a known lens lines are fitted to rays. A corner is where two
lines meet, and the centre where the diagonals do: it is the image of the square's centre from any side, which the mean
of the corners is not.
"""

import logging
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np

from aerodft.geometry import pixels_from_rays, rays_from_pixels, robust_stds
from aerodft.model import (
    Batch,
    BoolArray,
    Camera,
    FloatArray,
    Image,
    ImageArray,
    IntArray,
    MarkerSighting,
    MarkerSurvey,
    Observation,
    Px,
    SurveyedMarker,
    marker_name,
)
from aerodft.vision.common import grey_of
from calibration.lens import dictionary, dictionary_names
from calibration.markers.geometry import SIZE, STDS, apparent_side

_SAMPLES: Final = 24  # along an edge
_ENDS: Final = 0.1  # of an edge, next to its corners: not used
_TAPS: Final = 17  # across it
_PLATEAU: Final = 3  # taps at either end that tell black and white
_REACH: Final = 0.75  # of a module, across the edge to either side
_MIN_REACH_PX, _MAX_REACH_PX = 1.2, 6.0
_CONTRAST: Final = 10.0  # grey values: less is no edge
_ROUNDS: Final = 3
_TOLERATED: Final = 3.0  # times the scatter
_MIN_SCATTER_PX: Final = 0.05
_SHARE: Final = 0.4  # of an edge that must be seen
_CORRELATED_PX: Final = 1.5  # samples that are closer say the same: blur and the camera's own sharpening
_AT_END: Final = (1 + 12 * (0.5 / (1 - 2 * _ENDS)) ** 2) ** 0.5  # a fitted line's std at its corner over that of a mean
_ROUGH_STD_PX: Final = 1.0
_STRAYED_PX, _STRAYED = 2.0, 0.1  # or share of the longest side: corners that move farther have left their marker
_PARALLEL: Final = 1e-3  # sine of the angle between lines that never meet
_AHEAD: Final = 0.1  # cosine: rays farther from the axis are on no plane before the camera
MIN_STD_PX: Final = 0.2
"""What no sharpness takes away: paper is not flat, prints have no exact edges, lenses differ from their model."""

MIN_SIDE_PX: Final = 10
"""Markers are looked for down to this size."""

_LARGEST_PX: Final = 40_000_000  # of a picture that is looked into
_SAME: Final = 0.25  # of a marker's side: detections whose centres are closer are of one marker
_MIN_CORRELATION: Final = (
    0.78  # correlation: textures in a photo reached 0.72, its markers 0.96, blurred ones of 10 px 0.79
)
_WITHIN: Final = np.array([0.3, 0.5, 0.7])  # of a module: clear of its neighbours
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class Squares(Batch):
    """Refined markers.

    Attributes:
        corners_px: ``(m, 4, 2)``.
        corner_std_px: ``(m,)`` of each coordinate.
        centres_px: ``(m, 2)``.
        centre_std_px: ``(m,)`` of each coordinate.
    """

    corners_px: FloatArray
    corner_std_px: FloatArray
    centres_px: FloatArray
    centre_std_px: FloatArray


def refine_edges(grey: ImageArray, rough_px: FloatArray, modules: int, camera: Camera | None = None) -> Squares:
    """Find the edges of markers anew, next to where a detector saw them.

    Where edges are not clear, the detector's corners stay, with a std of one pixel.

    Args:
        grey: ``(h, w)``.
        rough_px: ``(m, 4, 2)`` corners in order around each square, at least one.
        modules: Along a side, with the border's two.
        camera: Whose lens bends the edges; None to take them as straight.
    """
    nearer = _once(grey, rough_px, modules, camera)
    return _once(grey, nearer.corners_px, modules, camera)


def _once(grey: ImageArray, rough_px: FloatArray, modules: int, camera: Camera | None) -> Squares:
    edges_px, seen = _edges(grey, rough_px, modules)
    plane = _Plane(camera, np.concatenate([edges_px, rough_px[:, :, None]], axis=2))
    points, rough = plane.points[:, :, :-1], plane.points[:, :, -1]
    middles, along, scatter_px, clear = _lines(points, seen)
    corners, sines = _crossings(np.roll(middles, 1, 1), np.roll(along, 1, 1), middles, along)
    sides_px = np.linalg.norm(np.roll(rough_px, -1, 1) - rough_px, axis=-1)
    limit_px = np.maximum(_STRAYED_PX, _STRAYED * sides_px.max(axis=1, keepdims=True))
    good = np.all(clear & (np.linalg.norm(corners - rough, axis=-1) < limit_px), axis=1)
    corners = np.where(good[:, None, None], corners, rough)
    independent = np.clip(sides_px * (1 - 2 * _ENDS) / _CORRELATED_PX, 2.0, _SAMPLES)
    line_std_px = _AT_END * scatter_px / np.sqrt(independent)
    each_px = np.sqrt((line_std_px**2 + np.roll(line_std_px, 1, 1) ** 2) / 2) / np.maximum(np.abs(sines), _PARALLEL)
    corner_std_px = np.where(good, np.sqrt(np.mean(each_px**2, axis=1)), _ROUGH_STD_PX)
    diagonals = corners[:, 2:] - corners[:, :2]
    diagonals /= np.linalg.norm(diagonals, axis=-1, keepdims=True)
    centres, sines = _crossings(corners[:, 0], diagonals[:, 0], corners[:, 1], diagonals[:, 1])
    found_px = plane.pixels(np.concatenate([corners, centres[:, None]], axis=1))
    return Squares(
        corners_px=found_px[:, :4],
        corner_std_px=corner_std_px,
        centres_px=found_px[:, 4],
        centre_std_px=corner_std_px / np.sqrt(2) / np.maximum(np.abs(sines), _PARALLEL),
    )


class _Plane:
    """Points of markers where straight edges are straight, in pixels of the lens without its distortion."""

    def __init__(self, camera: Camera | None, pixels: FloatArray) -> None:
        self._camera = camera
        self.points = pixels
        self._flat = np.zeros(len(pixels), dtype=bool)
        if camera is None or not any(camera.distortion):
            return
        rays = rays_from_pixels(camera, pixels)
        ahead = rays[..., 2] > _AHEAD * np.linalg.norm(rays, axis=-1)
        self._flat = np.all(ahead | np.isnan(pixels[..., 0]), axis=(1, 2))
        with np.errstate(invalid="ignore", divide="ignore"):
            flat = rays[..., :2] / rays[..., 2:] * [camera.fx_px, camera.fy_px]
        self.points = np.where(self._flat[:, None, None, None], flat, pixels)

    def pixels(self, points: FloatArray) -> FloatArray:
        """Pixels ``(m, k, 2)`` of points given without the lens's distortion."""
        if self._camera is None or not self._flat.any():
            return points
        flat = points / [self._camera.fx_px, self._camera.fy_px]
        bent = pixels_from_rays(self._camera, np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1))
        return np.asarray(np.where(self._flat[:, None, None], bent, points))


def _edges(grey: ImageArray, corners_px: FloatArray, modules: int) -> tuple[FloatArray, BoolArray]:
    """``(m, 4, n, 2)`` pixels where black turns white, sample by sample along each edge, and where it does."""
    ends_px = np.roll(corners_px, -1, axis=1)
    along = ends_px - corners_px
    length_px = np.maximum(np.linalg.norm(along, axis=-1), 1e-9)
    turn = np.sign(_area(corners_px))[:, None, None]
    outward = np.stack([along[..., 1], -along[..., 0]], axis=-1) / length_px[..., None] * turn
    module_px = np.abs(_area(corners_px))[:, None] / length_px / modules
    reach_px = np.clip(_REACH * module_px, _MIN_REACH_PX, _MAX_REACH_PX)
    shares = np.linspace(_ENDS, 1 - _ENDS, _SAMPLES)
    starts = corners_px[:, :, None] + shares[:, None] * along[:, :, None]
    steps = np.linspace(-1.0, 1.0, _TAPS)
    at = starts[..., None, :] + (reach_px[..., None, None, None] * steps[:, None]) * outward[:, :, None, None]
    flat = at.reshape(len(at) * 4, -1, 2).astype(np.float32)
    profiles = cv2.remap(grey, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR).astype(np.float64)
    offset, seen = _crossing(profiles.reshape(at.shape[:-1]), steps)
    edges = starts + (reach_px[..., None] * offset)[..., None] * outward[:, :, None]
    height, width = grey.shape
    inside = np.all((at >= 0) & (at <= [width - 1, height - 1]), axis=(-1, -2))
    seen &= inside
    return np.where(seen[..., None], edges, starts), seen


def _area(corners_px: FloatArray) -> FloatArray:
    """``(m,)``, above 0 where corners go clockwise on the image."""
    x, y = corners_px[..., 0], corners_px[..., 1]
    return np.asarray(0.5 * np.sum(x * np.roll(y, -1, -1) - y * np.roll(x, -1, -1), axis=-1))


def _crossing(profiles: FloatArray, steps: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Positions at which profiles ``(..., taps)`` cross the middle of their ends, nearest to 0; and whether they do."""
    black, white = profiles[..., :_PLATEAU].mean(axis=-1), profiles[..., -_PLATEAU:].mean(axis=-1)
    above = profiles - ((black + white) / 2)[..., None]
    crosses = (above[..., :-1] < 0) & (above[..., 1:] >= 0)
    rise = np.where(crosses, above[..., 1:] - above[..., :-1], 1.0)
    offsets = steps[:-1] - above[..., :-1] / rise * (steps[1] - steps[0])
    nearest = np.argmin(np.where(crosses, np.abs(offsets), np.inf), axis=-1)[..., None]
    offset = np.take_along_axis(offsets, nearest, axis=-1)[..., 0]
    seen = crosses.any(axis=-1) & (white - black > _CONTRAST)
    return np.where(seen, offset, 0.0), seen


def _lines(points: FloatArray, seen: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Lines through points ``(m, 4, n, 2)``: a point on each, its direction, the scatter about it, whether it is clear.

    Points that stand off by more than chance are left out.
    """
    weights = seen.astype(np.float64)
    for _ in range(_ROUNDS):
        count = np.maximum(weights.sum(axis=-1), 1.0)
        middles = np.sum(weights[..., None] * points, axis=-2) / count[..., None]
        off = points - middles[..., None, :]
        xx, yy, xy = (np.sum(weights * off[..., a] * off[..., b], axis=-1) for a, b in ((0, 0), (1, 1), (0, 1)))
        angle = 0.5 * np.arctan2(2 * xy, xx - yy)
        along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        away = np.abs(off[..., 0] * along[..., None, 1] - off[..., 1] * along[..., None, 0])
        scatter_px = np.sqrt(np.sum(weights * away**2, axis=-1) / np.maximum(count - 2, 1.0))
        typical = robust_stds(np.where(seen, away, np.inf))
        limit = _TOLERATED * np.maximum(np.minimum(typical, scatter_px), _MIN_SCATTER_PX)
        kept, weights = weights, (seen & (away <= limit[..., None])).astype(np.float64)
    clear = kept.sum(axis=-1) >= _SHARE * _SAMPLES
    return middles, along, np.maximum(scatter_px, _MIN_SCATTER_PX), clear


def _crossings(a: FloatArray, along_a: FloatArray, b: FloatArray, along_b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Intersections of lines ``(..., 2)``, and the sine of the angle between them; not finite for parallel ones."""
    sine = along_a[..., 0] * along_b[..., 1] - along_a[..., 1] * along_b[..., 0]
    gap = b - a
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (gap[..., 0] * along_b[..., 1] - gap[..., 1] * along_b[..., 0]) / sine
        return a + share[..., None] * along_a, sine


@dataclass(frozen=True, slots=True)
class _Look:
    """One way to look into an image: how large, and what differs from OpenCV's own settings."""

    scale: float
    change: Callable[[cv2.aruco.DetectorParameters], None] | None = None


def _patient(parameters: cv2.aruco.DetectorParameters) -> None:
    """Many thresholds, weak contrasts, blunt corners: for uneven light, shallow views, bent edges."""
    parameters.adaptiveThreshWinSizeMax = 53
    parameters.adaptiveThreshWinSizeStep = 5
    parameters.adaptiveThreshConstant = 4
    parameters.polygonalApproxAccuracyRate = 0.05


def _by_gradients(parameters: cv2.aruco.DetectorParameters) -> None:
    """The AprilTag library's own search for squares, which needs no threshold but much time."""
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG


_LOOKS: Final = (_Look(1.0), _Look(1.0, _patient), _Look(2.0), _Look(0.5, _patient), _Look(1.0, _by_gradients))


def find_markers(
    image: ImageArray,
    survey: MarkerSurvey,
    camera: Camera | None = None,
    *,
    thorough: bool = False,
) -> list[MarkerSighting]:
    """Markers of the survey's dictionary in an image, by id.

    The first look also reports ids that are not surveyed, and one that is there twice, twice. Whether a sighting can be
    true is for ``judge`` to say.

    Args:
        image: ``(h, w)`` grey or ``(h, w, 3)`` BGR, uint8.
        survey: What to look for.
        camera: Whose lens bends the edges; None to take them as straight.
        thorough: Look on, in other ways and at other scales, until every surveyed marker is found; otherwise look
            once, as video needs it.
    """
    grey = grey_of(image)
    wanted = set(survey.by_id)
    ids, squares = _look(grey, survey.dictionary, camera, 0)
    for index in range(1, len(_LOOKS) if thorough else 1):
        if wanted <= set(ids.tolist()):
            break
        more_ids, more = _look(grey, survey.dictionary, camera, index)
        missing = np.isin(more_ids, list(wanted - set(ids.tolist())))
        ids, squares = _with_new(ids, squares, more_ids[missing], more.rows(missing))
    return [
        MarkerSighting(
            id=int(ids[index]),
            pixel=_px(squares.centres_px[index]),
            std_px=float(np.hypot(squares.centre_std_px[index], MIN_STD_PX)),
            corners=_corners(squares.corners_px[index]),
            corner_std_px=float(np.hypot(squares.corner_std_px[index], MIN_STD_PX)),
        )
        for index in np.argsort(ids, kind="stable")
    ]


def _px(pixel: FloatArray) -> Px:
    return float(pixel[0]), float(pixel[1])


def _corners(pixels: FloatArray) -> tuple[Px, Px, Px, Px]:
    first, second, third, fourth = pixels
    return _px(first), _px(second), _px(third), _px(fourth)


def _look(grey: ImageArray, name: str, camera: Camera | None, index: int) -> tuple[IntArray, Squares]:
    """Ids ``(m,)`` and places of what one look finds and is like the marker that it is taken for."""
    ids, rough_px = _detected(grey, name, index)
    if not len(ids):
        return ids, Squares(np.zeros((0, 4, 2)), np.zeros(0), np.zeros((0, 2)), np.zeros(0))
    squares = refine_edges(grey, rough_px, modules(name), camera)
    is_marker = likeness(grey, squares.corners_px, ids, name) > _MIN_CORRELATION
    return ids[is_marker], squares.rows(is_marker)


def _detected(grey: ImageArray, name: str, index: int) -> tuple[IntArray, FloatArray]:
    """Ids ``(m,)`` and rough corners ``(m, 4, 2)``."""
    scale, picture = _LOOKS[index].scale, grey
    if scale > 1 and grey.size * scale**2 > _LARGEST_PX:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2))
    if scale != 1:
        how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        picture = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=how), dtype=np.uint8)
    corners, ids, _ = _detector(name, index, max(picture.shape)).detectMarkers(picture)
    if not len(corners):
        return np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2))
    pixels = (np.reshape(corners, (-1, 4, 2)).astype(np.float64) + 0.5) / scale - 0.5
    return np.asarray(ids, dtype=np.int64).ravel(), pixels


@lru_cache(maxsize=32)
def _detector(name: str, index: int, longest_px: int) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    # OpenCV counts in shares of the image, by which a large one would have no small markers.
    parameters.minMarkerPerimeterRate = min(4 * MIN_SIDE_PX / longest_px, 1.0)
    if (change := _LOOKS[index].change) is not None:
        change(parameters)
    return cv2.aruco.ArucoDetector(dictionary(name), parameters)


def _with_new(ids: IntArray, squares: Squares, more_ids: IntArray, more: Squares) -> tuple[IntArray, Squares]:
    """Markers of an earlier look, with those that a later one found elsewhere."""
    sides_px = np.linalg.norm(more.corners_px[:, 0] - more.corners_px[:, 1], axis=-1)
    away_px = np.linalg.norm(more.centres_px[:, None] - squares.centres_px, axis=-1)
    new = np.all(away_px > _SAME * sides_px[:, None], axis=1)
    return np.concatenate([ids, more_ids[new]]), Squares.concatenate([squares, more.rows(new)])


def other_dictionary(image: ImageArray, name: str) -> str:
    """The dictionary of which an image shows more markers than of ``name``; empty where there is none.

    Of dictionaries that contain each other, the smallest.
    """
    grey = grey_of(image)
    counts = {other: len(_look(grey, other, None, 0)[0]) for other in dictionary_names()}
    best = min(counts, key=lambda other: (-counts[other], len(dictionary(other).bytesList)))
    return best if counts[best] > counts[name] else ""


def modules(name: str) -> int:
    """Along a side of a dictionary's markers, with the black border."""
    return int(dictionary(name).markerSize) + 2


def likeness(grey: ImageArray, corners_px: FloatArray, ids: IntArray, name: str) -> FloatArray:
    """Correlation ``(m,)`` of what is there with what markers look like: 1 for the same, about 0 for anything else.

    Args:
        grey: ``(h, w)``.
        corners_px: ``(m, 4, 2)``, at least one.
        ids: ``(m,)``.
        name: Of the dictionary.
    """
    along = (np.arange(modules(name))[:, None] + _WITHIN).ravel()
    at = np.stack(np.meshgrid(along, along), axis=-1).reshape(1, -1, 2).astype(np.float32)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32) * modules(name)
    quads = corners_px.astype(np.float32)
    seen_at = np.concatenate(
        [cv2.perspectiveTransform(at, cv2.getPerspectiveTransform(square, quad)) for quad in quads]
    )
    seen = cv2.remap(grey, seen_at[..., 0], seen_at[..., 1], cv2.INTER_LINEAR).astype(np.float64)
    wanted = np.stack([_pattern(name, int(each)) for each in ids])
    seen -= seen.mean(axis=1, keepdims=True)
    size = np.linalg.norm(seen, axis=1) * np.linalg.norm(wanted, axis=1)
    return np.asarray(np.sum(seen * wanted, axis=1) / np.maximum(size, 1e-9))


@lru_cache(maxsize=256)
def _pattern(name: str, marker: int) -> FloatArray:
    """A marker's samples less their mean; below 0 for black."""
    known = dictionary(name)
    bits = cv2.aruco.Dictionary.getBitsFromByteList(known.bytesList[marker : marker + 1], known.markerSize)
    samples = np.kron(np.pad(bits, 1), np.ones((len(_WITHIN), len(_WITHIN)))).ravel()
    return np.asarray(samples - samples.mean())


@dataclass(frozen=True, slots=True, eq=False)
class CameraPlace:
    """Place of a camera.

    Attributes:
        position_enu_m: ``(3,)`` from the station's origin.
        std_m: Of that, in any direction.
    """

    position_enu_m: FloatArray
    std_m: float


class MarkerObserver:
    """Implements ``service.ports.ImageObserver``.

    Args:
        survey: What to look for, in metres of the station's origin.
        camera: Whose images they are.
        ignore: Ids that are there too, and that nobody has surveyed.
        place_near: Where the camera is when an image is taken, None where nobody knows. With it, what looks much larger
            or smaller than its marker would is told to be something else.
    """

    def __init__(
        self,
        survey: MarkerSurvey,
        camera: Camera,
        ignore: frozenset[int] = frozenset(),
        place_near: Callable[[Image], CameraPlace | None] = lambda _: None,
    ) -> None:
        self._survey = survey
        self._surveyed = survey.by_id
        self._camera = camera
        self._ignore = ignore
        self._place_near = place_near
        self._strangers: Counter[int] = Counter()
        self._false: Counter[int] = Counter()

    @property
    def strangers(self) -> dict[int, int]:
        """In how many images ids were seen that nobody has surveyed, by id."""
        return dict(sorted(self._strangers.items()))

    @property
    def false(self) -> dict[int, int]:
        """In how many images a surveyed id looked much larger or smaller than its marker is, by id."""
        return dict(sorted(self._false.items()))

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """The centre, or the four corners, of each surveyed marker; nothing in an image without pixels.

        An id that is there twice is seen twice: which one is true is for the filter to say.
        """
        if image.pixels is None:
            return ()
        place, seen = self._place_near(image), list[Observation]()
        for each in find_markers(image.pixels(), self._survey, self._camera):
            marker = self._surveyed.get(each.id)
            if marker is None:
                self._count_stranger(each.id, image)
            elif place is not None and _looks_false(marker, each, place, self._camera):
                self._false[each.id] += 1
            else:
                seen += _observations(marker, each, image)
        return tuple(seen)

    def _count_stranger(self, marker: int, image: Image) -> None:
        if marker in self._ignore:
            return
        if marker not in self._strangers:
            text = "image %d shows %s, which is not surveyed; it is not used, and not mentioned again"
            _log.warning(text, image.index, marker_name(marker))
        self._strangers[marker] += 1


def _looks_false(marker: SurveyedMarker, seen: MarkerSighting, place: CameraPlace, camera: Camera) -> bool:
    """Whether a marker looks larger or smaller than anything of its size could, where it should be."""
    side_m = _side_m(marker)
    if side_m is None:
        return False
    away_m = float(np.linalg.norm(np.mean(marker.points_m, axis=0) - place.position_enu_m))
    angle, angle_std = apparent_side(camera, seen)
    doubt = STDS * math.hypot(angle_std / angle, place.std_m / away_m)
    return abs(math.log(angle * away_m / side_m)) > math.log1p(SIZE) + doubt


def _side_m(marker: SurveyedMarker) -> float | None:
    """Side of a marker's black square; None where nobody has measured it."""
    if marker.side_m is not None or len(marker.points_m) == 1:
        return marker.side_m
    corners_m: FloatArray = np.array(marker.points_m)
    return float(np.mean(np.linalg.norm(np.roll(corners_m, -1, axis=0) - corners_m, axis=1)))


def _observations(marker: SurveyedMarker, seen: MarkerSighting, image: Image) -> list[Observation]:
    is_centre = len(marker.points_m) == 1
    pixels = (seen.pixel,) if is_centre else seen.corners
    return [
        Observation.in_image(image, name, (pixel,), std_px=seen.std_px if is_centre else seen.corner_std_px)
        for name, pixel in zip(marker.point_names, pixels, strict=True)
    ]
