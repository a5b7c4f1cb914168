"""The ground seen from straight above: an image resampled to a grid of equal steps east and north."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.dft.depth_map import DepthMap, depth_map
from aerodft.geometry.lens import pixels_from_rays
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.model.pose import Pose

COARSEST: Final = 4.0
"""Ground that the image samples so many times more coarsely than the view, or its own median, is left out."""

MOST_PIXELS: Final = 32_000_000
"""A view of more pixels gets larger steps, unless told otherwise."""

_LONGEST_SIDE = 32_000  # OpenCV remaps no longer ones
_AT_ONCE = 1 << 19  # pixels that are resampled together


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


def top_view(
    image: ImageArray,
    camera: Camera,
    pose: Pose,
    *,
    elevation_m: float = 0.0,
    step_m: float | None = None,
    max_range_m: float | None = None,
    most_pixels: int = MOST_PIXELS,
) -> TopView | None:
    """Resample an image to the ground, bilinearly; pinhole model, level ground.

    What stands up from the ground falls over, away from the camera.

    Args:
        image: ``(height, width, 3)`` uint8 BGR, of the camera's size.
        camera: The camera.
        pose: One pose.
        elevation_m: Height of the ground.
        step_m: Side of a pixel; None for the median of the image's own sampling distances. Larger where the view
            would have more than ``most_pixels``.
        max_range_m: Farther ground is left out; None for none but what is sampled ``COARSEST`` times too coarsely.
        most_pixels: Of the view.

    Returns:
        The view; None where the image shows no ground.

    Raises:
        ValueError: The image's size or type is not the camera's, or the step is not above 0.
    """
    if image.shape != (camera.height_px, camera.width_px, 3) or image.dtype != np.uint8:
        raise ValueError(f"got {image.shape} {image.dtype}, expected uint8 {camera.height_px, camera.width_px, 3}")
    if step_m is not None and not 0 < step_m < math.inf:
        raise ValueError(f"got a step of {step_m} m, expected one above 0")
    seen = depth_map(camera, pose, elevation_m, max_range_m)
    if np.all(np.isnan(seen.gsd_m)):
        return None
    own_m = float(np.nanmedian(seen.gsd_m))
    step = own_m if step_m is None else step_m
    (west, south, east, north), reach = _bounds(seen, COARSEST * max(own_m, step))
    step = max(step, math.sqrt((east - west) * (north - south) / most_pixels))
    step = max(step, (east - west) / _LONGEST_SIDE, (north - south) / _LONGEST_SIDE)
    west, north = math.floor(west / step) * step, math.ceil(north / step) * step
    width, height = max(1, math.ceil((east - west) / step)), max(1, math.ceil((north - south) / step))
    pixels = np.zeros((height, width, 4), dtype=np.uint8)
    rows = max(1, _AT_ONCE // width)
    for top in range(0, height, rows):
        part = pixels[top : top + rows]
        away = _away(pose, elevation_m, (west, north - top * step), step, part.shape[:2])
        _resample(image, camera, pose, away, reach, part)
    return TopView(pixels=pixels, west_m=west, north_m=north, step_m=step)


def _bounds(seen: DepthMap, coarsest_m: float) -> tuple[tuple[float, float, float, float], float]:
    """West, south, east and north of the ground that is sampled well enough, and its longest range."""
    good = seen.gsd_m <= coarsest_m
    east, north = (plane[good] for plane in seen.east_north_m())
    box = float(east.min()), float(north.min()), float(east.max()), float(north.max())
    return box, float(seen.range_m[good].max())


def _away(
    pose: Pose, elevation_m: float, corner_en_m: tuple[float, float], step_m: float, shape: tuple[int, ...]
) -> FloatArray:
    """From the camera to the middles of a block's pixels, ENU ``(rows, columns, 3)``."""
    rows, columns = shape
    east = corner_en_m[0] + (np.arange(columns) + 0.5) * step_m
    north = corner_en_m[1] - (np.arange(rows) + 0.5) * step_m
    points = np.empty((rows, columns, 3))
    points[..., 0], points[..., 1], points[..., 2] = east, north[:, None], elevation_m
    return points - pose.position_enu_m


def _resample(
    image: ImageArray, camera: Camera, pose: Pose, away_enu_m: FloatArray, reach_m: float, out: ImageArray
) -> None:
    at = pixels_from_rays(camera, away_enu_m @ matrix(pose.wxyz))
    size = np.array([camera.width_px, camera.height_px])
    with np.errstate(invalid="ignore"):
        seen = np.all((at >= -PIXEL_CENTRE_OFFSET_PX) & (at <= size - PIXEL_CENTRE_OFFSET_PX), axis=-1)
    seen &= np.linalg.norm(away_enu_m, axis=-1) <= reach_m
    at = np.where(seen[..., None], at, 0.0).astype(np.float32)
    out[..., :3] = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    out[..., 3] = np.where(seen, 255, 0)
    out[~seen] = 0
