"""The level water of one image: from its pixels to places on it and back."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.dft.ground_map import GroundMap
from aerodft.geometry.lens import pixels_from_rays
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.model.camera import Camera
from aerodft.model.pose import Pose
from aerodft.vision.water_features import WaterFeatures

FARTHEST_HEIGHTS: Final = 6.0
"""Water farther than so many camera heights is not looked at, unless told otherwise.

It lies 9.6 degrees below the horizon, where 0.3 degrees of tilt are 3 % of a width.
"""


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
        places = self._map.points_en_m(pixels_px)
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
