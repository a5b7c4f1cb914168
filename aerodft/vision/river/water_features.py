"""What one image shows of the water: a small copy whose pixels tell water from land, and the level plane that it is.

Ground is of many colours: blades, soil and stones lie side by side. Water has one colour at a place; waves, shade and
foam change its lightness. So the texture is first of all how much the ratio of red to green varies nearby. The plane
leads from pixels to places on the water and back.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.dft import Setup
from aerodft.dft.maps import GroundMap
from aerodft.geometry import matrix, pixels_from_rays
from aerodft.model import BoolArray, Camera, FloatArray, ImageArray, IntArray, Pose

Float32Image = npt.NDArray[np.float32]

WIDTH_PX: Final = 480  # of the small copy's longer side: a bank is found to a few pixels of the image, then refined
_SMOOTH_PX: Final = 1.0
_DETAIL_PX: Final = 2.0  # of the image, and of the copy of twice the size: what is smaller is texture
_NEIGHBOURHOOD_PX: Final = 2.0
_RATIO_PX: Final = 0.7  # likewise: video has colour at half the size
_LIGHT_SHARE: Final = 0.1  # of a contrast in lightness: waves have it too
_EDGE_PX: Final = 5  # so far an edge spreads its variety over what lies beside it
_QUIETEST_PERCENT: Final = 10.0  # of an image varies for its noise alone, which is more in the dark
_QUIET: Final = 0.011  # of the ratio's logarithm
_BLACK: Final = 8  # grey levels, of the brightest channel: what a codec leaves of none
_DARK: Final = 8.0  # grey levels: what is darker has no colour
RED_TO_GREEN, BLUE_TO_GREEN, LIGHT, TEXTURE = 0, 1, 2, 3
"""Which of the planes is what."""
LOGARITHM: Final = 40.0
"""What the logarithms of colour ratios and lightness are multiplied by: a unit can just be seen."""
_SCALE: Final = np.array([LOGARITHM, LOGARITHM, LOGARITHM, 12.0], dtype=np.float32)
_STRIP_PX: Final = 6  # on either side of an outline
_NOISE: Final = np.array([1.5, 1.5, 4.0, 1.0])  # least variances of the planes: flat colours differ by no more
_CLUSTERS: Final = 12
_WEIGHTS: Final = np.array([1.0, 1.0, 0.5, 0.7], dtype=np.float32)  # of the planes, as for the clusters of the mask
_EVERY: Final = 5
_LIKENESS_SMOOTH_PX: Final = 1.5
_SEED: Final = 1
FARTHEST_HEIGHTS: Final = 6.0
"""Water farther than so many camera heights is not looked at, unless told otherwise.

It lies 9.6 degrees below the horizon, where 0.3 degrees of tilt are 3 % of a width.
"""


@dataclass(frozen=True, slots=True, eq=False)
class WaterFeatures:
    """A small copy of an image.

    Attributes:
        scale: Its pixels per pixel of the image, below or at 1.
        planes: ``(height, width, 4)``: logarithms of red to green, blue to green, lightness and the texture; shade
            changes none but the lightness.
        pixels: ``(height, width, 3)`` BGR.
        detail: ``(height, width)``: what the image has that is finer than the copy, relative to the lightness.
        blank: ``(height, width)``: black borders, which show nothing: of a letterbox, or of an image made undistorted.
    """

    scale: float
    planes: Float32Image
    pixels: ImageArray
    detail: Float32Image
    blank: BoolArray

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.planes.shape[0], self.planes.shape[1]

    def variety(self, where: BoolArray) -> float:
        """How much the ratio of red to green varies nearby, at the median pixel of ``where``: 0.03 is 3 %."""
        return float(np.exp(np.median(self.planes[where][:, 3]) / _SCALE[3]))

    def without_planes(self) -> "WaterFeatures":
        """What is left to go from the image to the small copy and back."""
        nothing = np.empty((0, 0), dtype=np.float32)
        return WaterFeatures(self.scale, self.planes[..., :0].copy(), self.pixels[..., :0].copy(), nothing, self.blank)

    def halved(self) -> "WaterFeatures":
        """The features at half the size, each pixel the mean of four."""
        size = max(1, self.shape[1] // 2), max(1, self.shape[0] // 2)
        blank = cv2.resize(self.blank.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        if not self.planes.size:
            height, width = blank.shape
            planes, pixels = np.empty((height, width, 0), np.float32), np.empty((height, width, 0), np.uint8)
            detail = self.detail
        else:
            detail = np.asarray(cv2.resize(self.detail, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
            planes = np.asarray(cv2.resize(self.planes, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
            pixels = np.asarray(cv2.resize(self.pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        return WaterFeatures(0.5 * self.scale, planes, pixels, detail, np.asarray(blank))

    def to_image(self, small_px: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of the small copy as pixels of the image."""
        return np.asarray((np.asarray(small_px, dtype=np.float64) + 0.5) / self.scale - 0.5)

    def to_small(self, pixels_px: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of the image as pixels of the small copy."""
        return np.asarray((np.asarray(pixels_px, dtype=np.float64) + 0.5) * self.scale - 0.5)


def water_features(image: ImageArray) -> WaterFeatures:
    """The features of an image ``(height, width, 3)`` BGR."""
    scale = min(1.0, WIDTH_PX / max(image.shape[:2]))
    size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    double = (min(2 * size[0], image.shape[1]), min(2 * size[1], image.shape[0]))
    middle = np.asarray(cv2.resize(image, double, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    small = cv2.resize(middle, size, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(small, (0, 0), _SMOOTH_PX).astype(np.float32)
    blue, green, red = cv2.split(np.log(smooth + _DARK))
    lightness = (blue + green + red) / 3.0
    grey = np.asarray(cv2.cvtColor(middle, cv2.COLOR_BGR2GRAY), dtype=np.float32)
    light = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA) + _DARK, dtype=np.float32)
    texture = 0.5 * np.log(_variety(middle, light) + _LIGHT_SHARE**2 * _contrast(grey, light) + _QUIET**2)
    planes = _SCALE * np.dstack([red - green, blue - green, lightness, texture])
    pixels = np.asarray(small, dtype=np.uint8)
    detail = _fine_detail(image, size)
    return WaterFeatures(scale, np.asarray(planes, dtype=np.float32), pixels, detail, _blank(pixels))


def _fine_detail(image: ImageArray, size: tuple[int, int]) -> Float32Image:
    """How much the full image varies at its finest, for each pixel of a smaller copy, relative to the lightness."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    finest = cv2.absdiff(grey, cv2.GaussianBlur(grey, (0, 0), _DETAIL_PX)).astype(np.float32)
    fine, light = (cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (finest, grey))
    return np.asarray(fine / (light + _DARK), dtype=np.float32)


def _blank(pixels: ImageArray) -> BoolArray:
    """Black pixels ``(height, width)`` that hang together with the border, and what they are mixed with."""
    black = (np.max(pixels, axis=-1) <= _BLACK).astype(np.uint8)
    if not black.any():
        return np.zeros(black.shape, dtype=bool)
    framed = cv2.copyMakeBorder(black, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1)
    _, labels = cv2.connectedComponents(framed, connectivity=4)
    outer = (labels == labels[0, 0])[1:-1, 1:-1].astype(np.uint8)
    broad = cv2.morphologyEx(outer, cv2.MORPH_OPEN, np.ones((3, 3), dtype=np.uint8))
    return np.asarray(cv2.dilate(broad, np.ones((5, 5), dtype=np.uint8)) > 0)


def _variety(image: ImageArray, light: Float32Image) -> Float32Image:
    """Variance of the logarithm of red to green near each pixel of a smaller copy, of which ``light`` is the grey."""
    size = light.shape[1], light.shape[0]
    _, green, red = cv2.split(np.log(cv2.GaussianBlur(image, (0, 0), _RATIO_PX).astype(np.float32) + _DARK))
    ratio = red - green
    sigma = _NEIGHBOURHOOD_PX * image.shape[1] / size[0]
    mean = cv2.GaussianBlur(ratio, (0, 0), sigma)
    variance = np.maximum(cv2.GaussianBlur(ratio * ratio, (0, 0), sigma) - mean * mean, 0.0)
    nearby = cv2.resize(variance, size, interpolation=cv2.INTER_AREA)
    noise = float(np.percentile(nearby * np.square(light), _QUIETEST_PERCENT)) / np.square(light)
    nearby = np.maximum(nearby - noise, 0.0)
    return np.asarray(cv2.erode(nearby, np.ones((_EDGE_PX, _EDGE_PX), dtype=np.uint8)), dtype=np.float32)


def _contrast(grey: Float32Image, light: Float32Image) -> Float32Image:
    """Mean square of the lightness's fine detail near each pixel of the same copy, relative to the lightness."""
    detail = grey - cv2.GaussianBlur(grey, (0, 0), _DETAIL_PX)
    strength = cv2.resize(detail * detail, light.shape[::-1], interpolation=cv2.INTER_AREA) / np.square(light)
    return np.asarray(cv2.GaussianBlur(strength, (0, 0), _NEIGHBOURHOOD_PX), dtype=np.float32)


def outline_contrast(planes: Float32Image, region: BoolArray, ground: BoolArray) -> tuple[BoolArray, FloatArray]:
    """The outline of a region, and how different its two sides are along it.

    Args:
        planes: ``(height, width, k)`` features.
        region: ``(height, width)``.
        ground: ``(height, width)``: what was looked at; its border is no outline.

    Returns:
        The region's own pixels at its outline ``(height, width)``; for each of them the distance of the two sides'
        means in standard deviations ``(n,)``.
    """
    kernel, inside = np.ones((3, 3), dtype=np.uint8), region.astype(np.uint8)
    within = cv2.erode(inside, kernel)
    near = cv2.erode(inside, kernel, iterations=_STRIP_PX)
    beyond = cv2.dilate(inside, kernel, iterations=_STRIP_PX)
    border = cv2.erode(ground.astype(np.uint8), kernel, iterations=2, borderValue=0)
    outline = (inside > within) & (border > 0)
    if not outline.any():
        return outline, np.empty(0)
    mean_in, variance_in = _local(planes, (within > near).astype(np.float32), outline)
    mean_out, variance_out = _local(planes, ((beyond > inside) & ground).astype(np.float32), outline)
    spread = 0.5 * (variance_in + variance_out) + _NOISE
    return outline, np.asarray(np.sqrt(np.sum(np.square(mean_in - mean_out) / spread, axis=-1)), dtype=np.float64)


def _local(planes: Float32Image, weight: Float32Image, at: BoolArray) -> tuple[Float32Image, Float32Image]:
    """Mean and variance ``(n, k)`` of the planes around each pixel of ``at``, weighted."""
    size = (2 * _STRIP_PX + 1, 2 * _STRIP_PX + 1)
    total = cv2.boxFilter(weight, -1, size)[at][:, None] + 1e-6
    mean = cv2.boxFilter(planes * weight[..., None], -1, size)[at] / total
    square = cv2.boxFilter(np.square(planes) * weight[..., None], -1, size)[at] / total
    return mean, np.maximum(square - mean * mean, 0.0)


def clusters_of(
    weighted: Float32Image, smooth_px: float, ground: BoolArray, count: int, *, tries: int
) -> IntArray | None:
    """The cluster of every pixel of ``weighted (height, width, k)``; None for too few pixels of ``ground`` for them.

    Features are smoothed before; of some tries the best counts.
    """
    values = np.asarray(cv2.GaussianBlur(weighted, (0, 0), smooth_px), dtype=np.float32)
    sample = np.ascontiguousarray(values[ground][::_EVERY])
    if len(sample) <= count:
        return None
    cv2.setRNGSeed(_SEED)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 15, 0.2)
    _, _, centres = cv2.kmeans(sample, count, np.empty(0, dtype=np.int32), criteria, tries, cv2.KMEANS_PP_CENTERS)
    away = [np.sum(np.square(values - centre), axis=-1) for centre in centres]
    return np.asarray(np.argmin(np.stack(away), axis=0), dtype=np.int64)


def water_likeness(planes: Float32Image, water: BoolArray, ground: BoolArray) -> Float32Image:
    """Share of water among the pixels of the same colour, texture and lightness, ``(height, width)``, 0 to 1.

    A half says that the pixel's looks do not tell it; 0 also where nothing was looked at.

    Args:
        planes: ``(height, width, 4)`` of ``WaterFeatures``.
        water: ``(height, width)``: what was found.
        ground: What was looked at.
    """
    labels = clusters_of(planes * _WEIGHTS, _LIKENESS_SMOOTH_PX, ground, _CLUSTERS, tries=1)
    if labels is None:
        return (water & ground).astype(np.float32)
    wet = np.bincount(labels[ground & water], minlength=_CLUSTERS)
    total = np.maximum(np.bincount(labels[ground], minlength=_CLUSTERS), 1)
    return np.where(ground, (wet / total)[labels], 0.0).astype(np.float32)


@dataclass(frozen=True, eq=False)
class WaterPlane:
    """A horizontal plane as one image shows it; pinhole model.

    Attributes:
        camera: The camera.
        pose: One pose.
        elevation_m: Of the plane, in the pose's ENU.
        max_range_m: Farther water (slant range) is out of view; None for ``FARTHEST_HEIGHTS``.
    """

    camera: Camera
    pose: Pose
    elevation_m: float = 0.0
    max_range_m: float | None = None

    @staticmethod
    def from_setup(setup: Setup, pose: Pose) -> "WaterPlane":
        """The level plane that a setup measures on."""
        return WaterPlane(setup.camera, pose, setup.elevation_m, setup.max_range_m)

    @property
    def height_m(self) -> float:
        """Of the camera above the plane; not above 0 where it is below."""
        return float(self.pose.position_enu_m[2]) - self.elevation_m

    @property
    def reach_m(self) -> float:
        """How far away, horizontally, the plane is looked at."""
        slant = FARTHEST_HEIGHTS * self.height_m if self.max_range_m is None else self.max_range_m
        return math.sqrt(max(slant * slant - self.height_m**2, 0.0))

    @cached_property
    def _map(self) -> GroundMap:
        return GroundMap.at(self.camera, self.pose, self.elevation_m)

    @cached_property
    def _cam_from_enu(self) -> FloatArray:
        return matrix(self.pose.wxyz)

    def places_en_m(self, pixels_px: FloatArray) -> FloatArray:
        """East and north ``(..., 2)`` of pixels ``(..., 2)``; NaN at and above the horizon and out of reach."""
        places = self._map.points_enu_m(pixels_px)[..., :2]
        with np.errstate(invalid="ignore"):
            near = np.linalg.norm(places - self.pose.position_enu_m[:2], axis=-1) <= self.reach_m
        return np.where(near[..., None], places, np.nan)

    def pixels_px(self, places_en_m: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of places ``(..., 2)``; NaN behind the camera; may lie beside the image."""
        away = np.empty((*places_en_m.shape[:-1], 3))
        away[..., :2] = places_en_m - self.pose.position_enu_m[:2]
        away[..., 2] = -self.height_m
        return pixels_from_rays(self.camera, away @ self._cam_from_enu)

    def in_view(self, places_en_m: FloatArray, pixels_px: FloatArray) -> BoolArray:
        """Which places ``(..., 2)`` with their pixels ``(..., 2)`` the image shows, near enough: ``(...)``."""
        size = np.array([self.camera.width_px, self.camera.height_px])
        low, high = -PIXEL_CENTRE_OFFSET_PX, size - PIXEL_CENTRE_OFFSET_PX
        with np.errstate(invalid="ignore"):
            inside = np.all((pixels_px >= low) & (pixels_px <= high), axis=-1)
            near = np.linalg.norm(places_en_m - self.pose.position_enu_m[:2], axis=-1) <= self.reach_m
        return np.asarray(inside & near)


def ground_of(plane: WaterPlane, features: WaterFeatures) -> BoolArray:
    """Which pixels of a small copy show the water's plane, near enough, ``(height, width)``."""
    rows, columns = features.shape
    small = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).astype(np.float64)
    return np.asarray(np.isfinite(plane.places_en_m(features.to_image(small))[..., 0]) & ~features.blank)
