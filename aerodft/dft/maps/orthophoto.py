"""Orthophoto: an image resampled to a grid of equal steps east and north."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.dft.maps.depth import DepthMap, depth_map
from aerodft.geometry import Ground, matrix, pixels_from_rays
from aerodft.model import BoolArray, Camera, FloatArray, ImageArray, Pose

MAX_GSD_RATIO: Final = 4.0
"""Largest ratio of sampling distance to the map's step, or to the image's median; coarser ground is left out."""

MAX_PIXELS: Final = 32_000_000
"""Default limit of a view's pixels; larger views get larger steps."""

_MAX_SIDE = 32_000  # pixels; OpenCV's remap takes no longer sides
_BLOCK_SIZE = 1 << 18  # pixels per resampled block: some 100 MB where they meet terrain


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TopView:
    """Orthophoto, north up.

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
    """Step, extent and size limits of an orthophoto.

    Attributes:
        step_m: Side of a pixel; None for the median of the image's own sampling distances. Larger where the view
            would have more than ``max_pixels``.
        max_range_m: Farther ground is left out; None for none but what is sampled ``MAX_GSD_RATIO`` times too coarsely.
        max_pixels: Of the view.
    """

    step_m: float | None = None
    max_range_m: float | None = None
    max_pixels: int = MAX_PIXELS

    def __post_init__(self) -> None:
        if self.step_m is not None and not 0 < self.step_m < math.inf:
            raise ValueError(f"got a step of {self.step_m} m, expected one above 0")


_DEFAULT_SAMPLING = Sampling()


def top_view(
    image: ImageArray,
    camera: Camera,
    pose: Pose,
    sampling: Sampling = _DEFAULT_SAMPLING,
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
    median_gsd_m = float(np.nanmedian(seen.gsd_m))
    step = median_gsd_m if sampling.step_m is None else sampling.step_m
    scene = _Scene(image, camera, pose, ground, elevation_m, seen, MAX_GSD_RATIO * max(median_gsd_m, step))
    (west, south, east, north), max_range_m = scene.bounds()
    step = max(step, math.sqrt((east - west) * (north - south) / sampling.max_pixels))
    step = max(step, (east - west) / _MAX_SIDE, (north - south) / _MAX_SIDE)
    west, north = math.floor(west / step) * step, math.ceil(north / step) * step
    width, height = max(1, math.ceil((east - west) / step)), max(1, math.ceil((north - south) / step))
    pixels = np.zeros((height, width, 4), dtype=np.uint8)
    rows = max(1, _BLOCK_SIZE // width)
    for top in range(0, height, rows):
        part = pixels[top : top + rows]
        centres = _pixel_centres((west, north - top * step), step, part.shape[:2])
        scene.resample(centres, max_range_m, step, part)
    return TopView(pixels=pixels, west_m=west, north_m=north, step_m=step)


def _pixel_centres(corner_en_m: tuple[float, float], step_m: float, shape: tuple[int, ...]) -> FloatArray:
    """East and north ``(rows, columns, 2)`` of the centres of a block's pixels."""
    rows, columns = shape
    centres = np.empty((rows, columns, 2))
    centres[..., 0] = corner_en_m[0] + (np.arange(columns) + 0.5) * step_m
    centres[..., 1] = (corner_en_m[1] - (np.arange(rows) + 0.5) * step_m)[:, None]
    return centres


@dataclass(frozen=True, slots=True)
class _Scene:
    image: ImageArray
    camera: Camera
    pose: Pose
    ground: Ground | None
    elevation_m: float
    seen: DepthMap
    max_gsd_m: float

    def bounds(self) -> tuple[tuple[float, float, float, float], float]:
        """West, south, east and north of the ground sampled finely enough, and its longest range."""
        good = self.seen.gsd_m <= self.max_gsd_m
        east, north = (plane[good] for plane in self.seen.east_north_m())
        box = float(east.min()), float(north.min()), float(east.max()), float(north.max())
        return box, float(self.seen.range_m[good].max())

    def resample(self, places_en_m: FloatArray, max_range_m: float, step_m: float, out: ImageArray) -> None:
        """Write the image at places ``(rows, columns, 2)`` to ``out (rows, columns, 4)``, which holds zeros."""
        sightlines = self._sightlines(places_en_m)
        at = pixels_from_rays(self.camera, sightlines @ matrix(self.pose.wxyz))
        size = np.array([self.camera.width_px, self.camera.height_px])
        with np.errstate(invalid="ignore"):
            seen = np.all((at >= -PIXEL_CENTRE_OFFSET_PX) & (at <= size - PIXEL_CENTRE_OFFSET_PX), axis=-1)
            seen &= np.linalg.norm(sightlines, axis=-1) <= max_range_m
        if self.ground is not None:
            seen[seen] = self._is_visible(self.ground, sightlines[seen], at[seen], step_m)
        at = np.where(seen[..., None], at, 0.0).astype(np.float32)
        colours = cv2.remap(self.image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        out[..., :3] = np.where(seen[..., None], colours, 0)
        out[..., 3] = np.where(seen, 255, 0)

    def _sightlines(self, places_en_m: FloatArray) -> FloatArray:
        """ENU vectors ``(..., 3)`` from the camera to the ground at ``(..., 2)``; NaN without a height."""
        sightlines = np.empty((*places_en_m.shape[:-1], 3))
        sightlines[..., :2] = places_en_m - self.pose.position_enu_m[:2]
        height = 0.0 if self.ground is None else self.ground.height_at(places_en_m)
        sightlines[..., 2] = height + self.elevation_m - self.pose.position_enu_m[2]
        if self.seen.curvature_per_m:
            sightlines[..., 2] -= self.seen.curvature_per_m * np.sum(np.square(sightlines[..., :2]), axis=-1)
        return sightlines

    def _is_visible(self, ground: Ground, sightlines_enu_m: FloatArray, at_px: FloatArray, step_m: float) -> BoolArray:
        """Whether lines of sight ``(n, 3)`` are free to a map step of their ends and sampled finely enough.

        On level ground the longest range says where it is sampled too coarsely; here it may be anywhere.
        """
        hits = ground.meet(self.pose.position_enu_m, sightlines_enu_m, self.elevation_m)
        nearest = np.clip(np.rint(at_px).astype(np.intp), 0, [self.camera.width_px - 1, self.camera.height_px - 1])
        with np.errstate(invalid="ignore"):
            reached = hits.range_m >= np.linalg.norm(sightlines_enu_m, axis=-1) - step_m
            return np.asarray(reached & (self.seen.gsd_m[nearest[:, 1], nearest[:, 0]] <= self.max_gsd_m))
