"""The water's plane as one image shows it, and the small copy of the image that water is looked for in."""

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
from aerodft.model import BoolArray, Camera, FloatArray, ImageArray, Pose

Float32Image = npt.NDArray[np.float32]

LONGER_SIDE_PX: Final = 768
"""Of the small copy: as large as the pictures that the network was trained on."""
_BLACK: Final = 8  # grey levels, of the brightest channel: what a codec leaves of none
FARTHEST_HEIGHTS: Final = 6.0
"""Water farther than so many camera heights is not looked at, unless told otherwise.

It lies 9.6 degrees below the horizon, where 0.3 degrees of tilt are 3 % of a width.
"""


@dataclass(frozen=True, slots=True, eq=False)
class SmallCopy:
    """A small copy of an image.

    Attributes:
        scale: Its pixels per pixel of the image, below or at 1.
        pixels: ``(height, width, 3)`` BGR.
        blank: ``(height, width)``: black borders, which show nothing: of a letterbox, or of an image made undistorted.
    """

    scale: float
    pixels: ImageArray
    blank: BoolArray

    @staticmethod
    def of_image(image: ImageArray) -> "SmallCopy":
        """The copy of an image ``(height, width, 3)`` BGR."""
        scale = min(1.0, LONGER_SIDE_PX / max(image.shape[:2]))
        size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
        pixels = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        return SmallCopy(scale, pixels, _blank(pixels))

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.blank.shape[0], self.blank.shape[1]

    def to_image(self, small_px: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of the small copy as pixels of the image."""
        return np.asarray((np.asarray(small_px, dtype=np.float64) + 0.5) / self.scale - 0.5)

    def to_small(self, pixels_px: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of the image as pixels of the small copy."""
        return np.asarray((np.asarray(pixels_px, dtype=np.float64) + 0.5) * self.scale - 0.5)


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


def ground_of(plane: WaterPlane, copy: SmallCopy) -> BoolArray:
    """Which pixels of a small copy show the water's plane, near enough, ``(height, width)``."""
    rows, columns = copy.shape
    small = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).astype(np.float64)
    return np.asarray(np.isfinite(plane.places_en_m(copy.to_image(small))[..., 0]) & ~copy.blank)
