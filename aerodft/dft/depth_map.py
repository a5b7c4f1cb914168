"""Range, ground coordinates and ground sampling distance of every pixel of an image (the paper's Section 6.2).

Single precision: rays are off by at most 4e-7 rad, which is less than a thousandth of a pixel. A range is off by as
much of itself, divided by the tangent of the ray's depression below the horizon.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from aerodft.geometry.dense import GSD, PITCH, RANGE, RAY_Z, Float32Array, X, Y, meet_dense
from aerodft.geometry.lens import rays_with_jacobian
from aerodft.geometry.rotation import camera_angles, matrix
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.pose import Pose

_PLANES = 4
_AT_ONCE = 1 << 18  # pixels whose rays are found together: some 100 MB of double precision


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthMap:
    """What every pixel of an image sees of level ground; NaN where it sees none.

    Attributes:
        planes: ``(4, height, width)`` float32: ``range_m``, ``x_m``, ``y_m`` and ``gsd_m``.
        foot_en_m: East and north ``(2,)`` of the ground frame's origin, below the camera.
        heading_rad: Of the ground frame's Y axis.
    """

    planes: Float32Array
    foot_en_m: FloatArray
    heading_rad: float

    @property
    def range_m(self) -> Float32Array:
        """``(height, width)`` slant range from the camera."""
        return self._plane(RANGE)

    @property
    def x_m(self) -> Float32Array:
        """``(height, width)`` to the right, ground frame."""
        return self._plane(X)

    @property
    def y_m(self) -> Float32Array:
        """``(height, width)`` ahead, ground frame."""
        return self._plane(Y)

    @property
    def gsd_m(self) -> Float32Array:
        """``(height, width)`` ground sampling distance: the square root of the ground's area in a pixel.

        This is the geometric mean of the singular values of d(ground)/d(pixel). Where a pixel sees equal angles in
        all directions, these are ``gsd * sqrt(sin(depression))`` across the line of sight and
        ``gsd / sqrt(sin(depression))`` along it.
        """
        return self._plane(GSD)

    def _plane(self, index: int) -> Float32Array:
        plane: Float32Array = self.planes[index]
        return plane

    def east_north_m(self) -> tuple[Float32Array, Float32Array]:
        """East and north, ``(height, width)`` each; made anew at every call."""
        sine, cosine = math.sin(self.heading_rad), math.cos(self.heading_rad)
        east, north = self.foot_en_m.tolist()
        x_m, y_m = self.x_m, self.y_m
        return np.asarray(east + cosine * x_m + sine * y_m), np.asarray(north - sine * x_m + cosine * y_m)


def depth_map(
    camera: Camera,
    pose: Pose,
    elevation_m: float = 0.0,
    max_range_m: float | None = None,
    out: Float32Array | None = None,
) -> DepthMap:
    """Meet the ray of every pixel with the horizontal plane at ``elevation_m``; pinhole model.

    The camera's rays are found once and kept; for a lens with distortion that takes seconds, what follows milliseconds.

    Args:
        camera: The camera.
        pose: One pose; its position's third component is the height above the elevation 0.
        elevation_m: Height of the plane. From below it nothing is seen of it.
        max_range_m: Farther points are misses; None for no limit.
        out: ``(4, height, width)`` float32, C order, to write to instead of new memory.

    Returns:
        The map; NaN at and above the horizon, beyond the valid part of the lens, and beyond ``max_range_m``.

    Raises:
        ValueError: ``out`` does not fit.
    """
    shape = (_PLANES, camera.height_px, camera.width_px)
    planes = np.empty(shape, dtype=np.float32) if out is None else out
    if planes.shape != shape or planes.dtype != np.float32 or not planes.flags.c_contiguous:
        raise ValueError(f"got out {planes.shape} of {planes.dtype}, expected C-ordered float32 {shape}")
    heading = float(camera_angles(pose.wxyz)[2])
    height = float(pose.position_enu_m[2]) - elevation_m
    if height > 0:
        sine, cosine = math.sin(heading), math.cos(heading)
        ground_from_enu = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        turn = (ground_from_enu @ matrix(pose.wxyz)).astype(np.float32)
        limit = np.float32(math.inf if max_range_m is None else max_range_m)
        meet_dense(_ray_table(camera), turn, np.float32(height), limit, planes.reshape(_PLANES, -1))
    else:
        planes[...] = np.nan
    return DepthMap(planes=planes, foot_en_m=pose.position_enu_m[:2], heading_rad=heading)


@lru_cache(maxsize=2)
def _ray_table(camera: Camera) -> Float32Array:
    """``(4, n)`` unit rays in camera axes and square roots of the pixels' solid angles, row by row."""
    width, count = camera.width_px, camera.width_px * camera.height_px
    table = np.empty((_PLANES, count), dtype=np.float32)
    for first in range(0, count, _AT_ONCE):
        index = np.arange(first, min(first + _AT_ONCE, count))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # beyond the lens there is no ray
            rays = rays_with_jacobian(camera, np.stack([index % width, index // width], axis=-1).astype(np.float64))
            length = np.linalg.norm(rays.rays_cam, axis=-1)
            volume = np.sum(rays.rays_cam * np.cross(rays.jac_px[..., 0], rays.jac_px[..., 1]), axis=-1)
            table[PITCH, index] = np.sqrt(np.abs(volume) / length**3)
            table[: RAY_Z + 1, index] = (rays.rays_cam / length[:, None]).T
    table.setflags(write=False)
    return table
