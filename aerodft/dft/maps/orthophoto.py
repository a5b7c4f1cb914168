"""The ground seen from straight above: an image resampled to a grid of equal steps east and north."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.dft.maps.depth import DepthMap, depth_map
from aerodft.geometry import Ground, matrix, pixels_from_rays
from aerodft.model import BoolArray, Camera, FloatArray, ImageArray, Pose

COARSEST: Final = 4.0
"""Ground that the image samples so many times more coarsely than the view, or its own median, is left out."""

MOST_PIXELS: Final = 32_000_000
"""A view of more pixels gets larger steps, unless told otherwise."""

_LONGEST_SIDE = 32_000  # OpenCV remaps no longer ones
_AT_ONCE = 1 << 18  # pixels that are resampled together: some 100 MB where they meet terrain


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TopView:
    """A map image, north up.

    Attributes:
        pixels: ``(height, width, 4)`` uint8 BGRA; transparent where the image shows no such ground.
        west_m: East coordinate of the left border of the leftmost pixels (ENU).
        north_m: North coordinate of the upper border of the topmost pixels (ENU).
        step_m: Side of a pixel.
    """

    pixels: ImageArray
    west_m: float
    north_m: float
    step_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampling:
    """How finely and how far a view shows the ground.

    Attributes:
        step_m: Side of a pixel; None for the median of the image's own sampling distances. Larger where the view
            would have more than ``most_pixels``.
        max_range_m: Farther ground is left out; None for none but what is sampled ``COARSEST`` times too coarsely.
        most_pixels: Of the view.
    """

    step_m: float | None = None
    max_range_m: float | None = None
    most_pixels: int = MOST_PIXELS

    def __post_init__(self) -> None:
        if self.step_m is not None and not 0 < self.step_m < math.inf:
            raise ValueError(f"got a step of {self.step_m} m, expected one above 0")


_OWN = Sampling()


def top_view(
    image: ImageArray,
    camera: Camera,
    pose: Pose,
    sampling: Sampling = _OWN,
    *,
    elevation_m: float = 0.0,
    ground: Ground | None = None,
    seen: DepthMap | None = None,
) -> TopView | None:
    """Resample an image to the ground, bilinearly; pinhole model.

    What stands up from the ground falls over, away from the camera. On terrain what is hidden from the camera is
    transparent, and so is what has no height.

    Args:
        image: ``(height, width, 3)`` uint8 BGR, of the camera's size.
        camera: The camera.
        pose: One pose.
        sampling: Of the view.
        elevation_m: Height of level ground, or of the measured surface above ``ground``.
        ground: Ground that is not level; None for the horizontal plane at ``elevation_m``.
        seen: The depth map of all this, up to ``sampling.max_range_m``, where it is there already.

    Returns:
        The view; None where the image shows no ground.

    Raises:
        ValueError: The image's size or type is not the camera's.
    """
    if image.shape != (camera.height_px, camera.width_px, 3) or image.dtype != np.uint8:
        raise ValueError(f"got {image.shape} {image.dtype}, expected uint8 {camera.height_px, camera.width_px, 3}")
    seen = seen or depth_map(camera, pose, elevation_m, sampling.max_range_m, ground)
    if np.all(np.isnan(seen.gsd_m)):
        return None
    own_m = float(np.nanmedian(seen.gsd_m))
    step = own_m if sampling.step_m is None else sampling.step_m
    scene = _Scene(image, camera, pose, ground, elevation_m, seen, COARSEST * max(own_m, step))
    (west, south, east, north), reach_m = scene.bounds()
    step = max(step, math.sqrt((east - west) * (north - south) / sampling.most_pixels))
    step = max(step, (east - west) / _LONGEST_SIDE, (north - south) / _LONGEST_SIDE)
    west, north = math.floor(west / step) * step, math.ceil(north / step) * step
    width, height = max(1, math.ceil((east - west) / step)), max(1, math.ceil((north - south) / step))
    pixels = np.zeros((height, width, 4), dtype=np.uint8)
    rows = max(1, _AT_ONCE // width)
    for top in range(0, height, rows):
        part = pixels[top : top + rows]
        middles = _middles((west, north - top * step), step, part.shape[:2])
        scene.resample(middles, reach_m, step, part)
    return TopView(pixels=pixels, west_m=west, north_m=north, step_m=step)


def _middles(corner_en_m: tuple[float, float], step_m: float, shape: tuple[int, ...]) -> FloatArray:
    """East and north of the middles of a block's pixels, ``(rows, columns, 2)``."""
    rows, columns = shape
    middles = np.empty((rows, columns, 2))
    middles[..., 0] = corner_en_m[0] + (np.arange(columns) + 0.5) * step_m
    middles[..., 1] = (corner_en_m[1] - (np.arange(rows) + 0.5) * step_m)[:, None]
    return middles


@dataclass(frozen=True, slots=True)
class _Scene:
    image: ImageArray
    camera: Camera
    pose: Pose
    ground: Ground | None
    elevation_m: float
    seen: DepthMap
    coarsest_m: float

    def bounds(self) -> tuple[tuple[float, float, float, float], float]:
        """West, south, east and north of the ground that is sampled well enough, and its longest range."""
        good = self.seen.gsd_m <= self.coarsest_m
        east, north = (plane[good] for plane in self.seen.east_north_m())
        box = float(east.min()), float(north.min()), float(east.max()), float(north.max())
        return box, float(self.seen.range_m[good].max())

    def resample(self, places_en_m: FloatArray, reach_m: float, step_m: float, out: ImageArray) -> None:
        """The image at places ``(rows, columns, 2)``, into ``out (rows, columns, 4)``, all zeros."""
        away = self._sight(places_en_m)
        at = pixels_from_rays(self.camera, away @ matrix(self.pose.wxyz))
        size = np.array([self.camera.width_px, self.camera.height_px])
        with np.errstate(invalid="ignore"):
            seen = np.all((at >= -PIXEL_CENTRE_OFFSET_PX) & (at <= size - PIXEL_CENTRE_OFFSET_PX), axis=-1)
            seen &= np.linalg.norm(away, axis=-1) <= reach_m
        if self.ground is not None:
            seen[seen] = self._in_the_open(self.ground, away[seen], at[seen], step_m)
        at = np.where(seen[..., None], at, 0.0).astype(np.float32)
        colours = cv2.remap(self.image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        out[..., :3] = np.where(seen[..., None], colours, 0)
        out[..., 3] = np.where(seen, 255, 0)

    def _sight(self, places_en_m: FloatArray) -> FloatArray:
        """From the camera to the ground at places ``(..., 2)``, in its own axes ``(..., 3)``; NaN without a height."""
        away = np.empty((*places_en_m.shape[:-1], 3))
        away[..., :2] = places_en_m - self.pose.position_enu_m[:2]
        height = 0.0 if self.ground is None else self.ground.height_at(places_en_m)
        away[..., 2] = height + self.elevation_m - self.pose.position_enu_m[2]
        if self.seen.curvature_per_m:
            away[..., 2] -= self.seen.curvature_per_m * np.sum(np.square(away[..., :2]), axis=-1)
        return away

    def _in_the_open(self, ground: Ground, away_enu_m: FloatArray, at_px: FloatArray, step_m: float) -> BoolArray:
        """Whether sights ``(n, 3)`` reach their ends within a step of the map, and meet the ground steeply enough.

        On level ground the longest range says where it is sampled too coarsely; here it may be anywhere.
        """
        hits = ground.meet(self.pose.position_enu_m, away_enu_m, self.elevation_m)
        nearest = np.clip(np.rint(at_px).astype(np.intp), 0, [self.camera.width_px - 1, self.camera.height_px - 1])
        with np.errstate(invalid="ignore"):
            reached = hits.range_m >= np.linalg.norm(away_enu_m, axis=-1) - step_m
            return np.asarray(reached & (self.seen.gsd_m[nearest[:, 1], nearest[:, 0]] <= self.coarsest_m))
