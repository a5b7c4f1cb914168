"""Where images were taken from, by telemetry, over the plane that they show."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.geometry.ground import Ground
from aerodft.geometry.lens import rays_from_pixels
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.image import Image
from aerodft.model.pose import Pose, PoseSample
from aerodft.model.status import Status
from aerodft.vision.plane_errors import Standpoint
from aerodft.vision.straight import StraightView

_LEAST_DOWN: Final = 1e-3

PoseOf = Callable[[Image], PoseSample | None]


@dataclass(frozen=True, slots=True)
class Seen:
    """A pose, and by how much the camera is zoomed."""

    pose: Pose
    magnification: float


class Standpoints:
    """Makes standpoints of poses.

    Args:
        camera: The camera.
        view: Its small images.
        pose_of: The pose at an image's stamp, about; None where it is not known.
        elevation_m: Of the plane above ENU 0; None until it is known.
    """

    def __init__(self, camera: Camera, view: StraightView, pose_of: PoseOf, elevation_m: float | None = 0.0) -> None:
        self.elevation_m = elevation_m
        self._camera, self._view, self._pose_of = camera, view, pose_of
        self._zoomed: dict[int, tuple[float, StraightView]] = {}

    def seen(self, image: Image) -> Seen | None:
        """What an image was taken with; None where that is not known."""
        sample = self._pose_of(image)
        if sample is None or sample.pose is None or sample.status is not Status.OK:
            return None
        return Seen(sample.pose, 1.0 if sample.zoom is None else sample.zoom.magnification)

    def view_of(self, seen: Seen | None) -> StraightView:
        """Where zooming changes what the lens bends: by the last zoom that is known."""
        if seen is not None:
            return self.zoomed(self._view, seen)
        return self._zoomed[id(self._view)][1] if id(self._view) in self._zoomed else self._view

    def zoomed(self, view: StraightView, seen: Seen) -> StraightView:
        """A view as the camera is zoomed."""
        known = self._zoomed.get(id(view), (1.0, view))
        if known[0] != seen.magnification:
            known = seen.magnification, view.zoomed(seen.magnification)
        self._zoomed[id(view)] = known
        return known[1]

    def of(self, seen: Seen | None) -> Standpoint | None:
        """Where an image was taken from; None where that, or how high the plane is, is not known."""
        if seen is None or self.elevation_m is None or not seen.pose.position_enu_m[2] > self.elevation_m:
            return None
        lens = self._view.intrinsics.copy()
        lens[0, 0] *= seen.magnification
        lens[1, 1] *= seen.magnification
        place_m = seen.pose.position_enu_m - np.array([0.0, 0.0, self.elevation_m])
        return Standpoint(lens, matrix(seen.pose.wxyz), place_m)

    def find_plane(self, seen: Seen, pixel: FloatArray, ground: Ground | None, elevation_m: float) -> None:
        """How high the plane is at a pixel ``(2,)``, which is on the ground or so high above it.

        It stays unknown where the pixel shows no ground, or the camera is below it.
        """
        ray = rays_from_pixels(self._camera.zoomed(seen.magnification, 0.0), pixel)
        down = ray @ matrix(seen.pose.wxyz).T
        if ground is not None:
            hit = ground.meet(seen.pose.position_enu_m, down, elevation_m)
            if hit.status:
                return
            elevation_m = float(hit.points_enu_m[2])
        elif not down[2] < -_LEAST_DOWN:
            return
        if seen.pose.position_enu_m[2] > elevation_m:
            self.elevation_m = elevation_m
