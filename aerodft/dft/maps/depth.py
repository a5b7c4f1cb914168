"""Range, ground coordinates and ground sampling distance of every pixel of an image (the paper's Section 6.2).

Single precision: rays are off by at most 4e-7 rad, which is less than a thousandth of a pixel. A range is off by as
much of itself, divided by the tangent of the angle between the ray and the ground.

``GroundMap`` and ``ground_covariances`` are for pixels of any number and place at one pose, on level ground.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from aerodft.dft.covariance import point_covariances, shared_covariance
from aerodft.dft.projection import ELEVATION, INTRINSICS, POSITION, ROTATION, project
from aerodft.geometry import (
    GSD,
    LENS_MODELS,
    PITCH,
    RANGE,
    RAY_Z,
    Float32Array,
    Ground,
    GroundHits,
    Plane,
    X,
    Y,
    all_coefficients,
    camera_angles,
    matrix,
    meet_dense,
    meet_pinhole,
    rays_by_intrinsics,
    rays_from_pixels,
    rays_with_jacobian,
)
from aerodft.model import Camera, FloatArray, Pose, ProjectionModel, read_only

Z = 4  # plane of a depth map, behind those of ``dense``

_LEVEL_PLANES, _PLANES = 4, 5  # of a map; a table of rays has four as well
_BLOCK_SIZE = 1 << 18  # pixels per block of rays and of intersections with terrain: some 100 MB of double precision
_STD_BLOCK_SIZE = 1 << 17  # pixels per block of range derivatives: some 100 MB
_UP = read_only([0.0, 0.0, 1.0])
_MIN_COSINE = 1e-6  # of the incidence, so that sampling distances stay finite; rays are no better known

_COVARIANCE_BLOCK_SIZE = 1 << 12  # pixels per block, so that their derivatives stay in the cache


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthMap:
    """Range, ground coordinates and ground sampling distance of every pixel; NaN where it sees no ground.

    Attributes:
        planes: ``(4, height, width)`` float32: ``range_m``, ``x_m``, ``y_m`` and ``gsd_m``; where the ground is not
            level ``(5, height, width)``, with ``z_m``.
        foot_en_m: East and north ``(2,)`` of the ground frame's origin, below the camera.
        heading_rad: Of the ground frame's Y axis.
        elevation_m: Of the measured surface: level ground's own height, else above the ground.
        curvature_per_m: As ``GroundHits.curvature_per_m``: what is ``r`` away lies lower by ``curvature_per_m r^2``
            than ``z_m`` says, seen from the camera. 0 on level and tilted ground.
    """

    planes: Float32Array
    foot_en_m: FloatArray
    heading_rad: float
    elevation_m: float
    curvature_per_m: float = 0.0

    @property
    def range_m(self) -> Float32Array:
        """Slant ranges ``(height, width)`` from the camera."""
        return self._plane(RANGE)

    @property
    def x_m(self) -> Float32Array:
        """Ground frame X, to the right, ``(height, width)``."""
        return self._plane(X)

    @property
    def y_m(self) -> Float32Array:
        """Ground frame Y, ahead, ``(height, width)``."""
        return self._plane(Y)

    @property
    def z_m(self) -> Float32Array:
        """Heights ``(height, width)`` above the elevation 0, as the camera's; a new array on level ground."""
        if len(self.planes) > Z:
            return self._plane(Z)
        return np.where(np.isnan(self.range_m), np.float32(math.nan), np.float32(self.elevation_m))

    @property
    def gsd_m(self) -> Float32Array:
        """Ground sampling distances ``(height, width)``: square root of the ground's area in a pixel.

        The area is that of the surface itself, not of the map: ``solid angle * range^2 / cos(incidence)``, with the
        incidence between the line of sight and the ground's normal. On level ground this is the geometric mean of the
        singular values of d(ground)/d(pixel). Where a pixel sees equal angles in all directions, these are
        ``gsd * sqrt(cos(incidence))`` across the line of sight and ``gsd / sqrt(cos(incidence))`` along it.
        """
        return self._plane(GSD)

    def _plane(self, index: int) -> Float32Array:
        plane: Float32Array = self.planes[index]
        return plane

    def east_north_m(self) -> tuple[Float32Array, Float32Array]:
        """East and north ``(height, width)``, computed at every call."""
        sine, cosine = math.sin(self.heading_rad), math.cos(self.heading_rad)
        east, north = self.foot_en_m.tolist()
        x_m, y_m = self.x_m, self.y_m
        return np.asarray(east + cosine * x_m + sine * y_m), np.asarray(north - sine * x_m + cosine * y_m)


def depth_map(
    camera: Camera,
    pose: Pose,
    elevation_m: float = 0.0,
    max_range_m: float | None = None,
    ground: Ground | None = None,
    out: Float32Array | None = None,
) -> DepthMap:
    """Intersect the rays of all pixels with the ground; pinhole model.

    The camera's rays are found once and kept; for a lens with distortion that takes seconds, what follows milliseconds
    on level and tilted ground. Terrain is met at up to a million pixels a second.

    Args:
        camera: The camera.
        pose: One pose; its position's third component is the height above the elevation 0.
        elevation_m: Height of the measured surface: of level ground, or above ``ground``. From below it nothing is
            seen of it.
        max_range_m: Farther points are misses; None for no limit.
        ground: Ground that is not level; None for the horizontal plane at ``elevation_m``. Terrain hides what is
            behind it.
        out: ``(4, height, width)`` float32, with ``ground`` ``(5, height, width)``, C order, to write to instead of
            new memory.

    Returns:
        The map; NaN at and above the horizon, where terrain ends or has no heights, beyond the valid part of the
        lens, and beyond ``max_range_m``.

    Raises:
        ValueError: ``out`` does not fit.
    """
    shape = (_LEVEL_PLANES if ground is None else _PLANES, camera.height_px, camera.width_px)
    planes = np.empty(shape, dtype=np.float32) if out is None else out
    if planes.shape != shape or planes.dtype != np.float32 or not planes.flags.c_contiguous:
        raise ValueError(f"got out {planes.shape} of {planes.dtype}, expected C-ordered float32 {shape}")
    limit_m = math.inf if max_range_m is None else max_range_m
    heading = float(camera_angles(pose.wxyz)[2])
    flat, curvature_per_m = planes.reshape(len(planes), -1), 0.0
    if ground is None or isinstance(ground, Plane):
        plane = plane_at_elevation(ground, elevation_m)
        _intersect_plane(camera, pose, heading, plane, limit_m, flat)
        if ground is not None:
            _fill_plane_heights(pose, heading, plane, flat)
    else:
        curvature_per_m = _intersect_ground(camera, pose, heading, ground, elevation_m, limit_m, flat)
    return DepthMap(
        planes=planes,
        foot_en_m=pose.position_enu_m[:2],
        heading_rad=heading,
        elevation_m=elevation_m,
        curvature_per_m=curvature_per_m,
    )


def plane_at_elevation(ground: Plane | None, elevation_m: float) -> Plane:
    """Raise ``ground`` by ``elevation_m`` along the vertical; None stands for level ground at 0 m."""
    return Plane(_UP, elevation_m) if ground is None else ground.raised(elevation_m)


def _ground_from_enu(heading_rad: float) -> FloatArray:
    """Rotation ``(2, 2)`` from east and north to the ground frame's X and Y."""
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    return np.array([[cosine, -sine], [sine, cosine]])


def _intersect_plane(
    camera: Camera, pose: Pose, heading_rad: float, plane: Plane, limit_m: float, out: Float32Array
) -> None:
    """Write range, X, Y and sampling distance on a plane to the first planes of ``out (planes, n)``.

    With the plane's normal for the vertical the kernel of level ground meets any plane: only distances from the plane
    and angles with it count.
    """
    above_m = float(plane.normal_enu @ pose.position_enu_m) - plane.offset_m
    if above_m > 0:
        axes = np.zeros((3, 3))
        axes[:2, :2], axes[2] = _ground_from_enu(heading_rad), plane.normal_enu
        ground_from_cam = (axes @ matrix(pose.wxyz)).astype(np.float32)
        meet_dense(ray_table(camera), ground_from_cam, np.float32(above_m), np.float32(limit_m), out[:_LEVEL_PLANES])
    else:
        out[...] = np.nan


def _fill_plane_heights(pose: Pose, heading_rad: float, plane: Plane, out: Float32Array) -> None:
    """Write the plane's heights at X and Y to ``out (planes, n)``."""
    by_x, by_y = (_ground_from_enu(heading_rad) @ (-plane.normal_enu[:2] / plane.normal_enu[2])).tolist()
    np.multiply(out[X], np.float32(by_x), out=out[Z])
    out[Z] += np.float32(by_y) * out[Y]
    out[Z] += np.float32(plane.height_at(pose.position_enu_m[:2]))


def _intersect_ground(
    camera: Camera,
    pose: Pose,
    heading_rad: float,
    ground: Ground,
    elevation_m: float,
    limit_m: float,
    out: Float32Array,
) -> float:
    """Write all planes of ``out (planes, n)``, by blocks of pixels; returns the ground's curvature (per m)."""
    table, rotation, ground_from_enu = ray_table(camera), matrix(pose.wxyz), _ground_from_enu(heading_rad)
    curvature_per_m = 0.0
    for first in range(0, table.shape[1], _BLOCK_SIZE):
        block = slice(first, first + _BLOCK_SIZE)
        rays_enu = table[: RAY_Z + 1, block].T @ rotation.T
        hits = ground.meet(pose.position_enu_m, rays_enu, elevation_m)
        away = hits.points_enu_m - pose.position_enu_m
        part = out[:, block]
        part[RANGE] = hits.range_m
        part[X], part[Y] = ground_from_enu @ away[:, :2].T
        part[Z] = hits.points_enu_m[:, 2]
        part[GSD] = (
            table[PITCH, block] * hits.range_m / np.sqrt(np.maximum(_cos_incidence(rays_enu, away, hits), _MIN_COSINE))
        )
        with np.errstate(invalid="ignore"):
            part[:, ~(hits.range_m <= limit_m)] = np.nan
        curvature_per_m = hits.curvature_per_m
    return curvature_per_m


def _cos_incidence(rays_enu: FloatArray, away_enu_m: FloatArray, hits: GroundHits) -> FloatArray:
    """Cosine between unit rays ``(n, 3)`` and the ground's normals in the camera's axes, on a curved earth."""
    normal = hits.normal_enu / hits.normal_enu[:, 2:]
    normal[:, :2] += 2 * hits.curvature_per_m * away_enu_m[:, :2]
    return np.asarray(-np.sum(normal * rays_enu, axis=-1) / np.linalg.norm(normal, axis=-1))


@lru_cache(maxsize=2)
def ray_table(camera: Camera) -> Float32Array:
    """Unit rays in camera axes and square roots of the pixels' solid angles ``(4, n)``, row by row."""
    width, count = camera.width_px, camera.width_px * camera.height_px
    table = np.empty((_LEVEL_PLANES, count), dtype=np.float32)
    for first in range(0, count, _BLOCK_SIZE):
        index = np.arange(first, min(first + _BLOCK_SIZE, count))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # beyond the lens there is no ray
            rays = rays_with_jacobian(camera, np.stack([index % width, index // width], axis=-1).astype(np.float64))
            length = np.linalg.norm(rays.rays_cam, axis=-1)
            volume = np.sum(rays.rays_cam * np.cross(rays.jac_px[..., 0], rays.jac_px[..., 1]), axis=-1)
            table[PITCH, index] = np.sqrt(np.abs(volume) / length**3)
            table[: RAY_Z + 1, index] = (rays.rays_cam / length[:, None]).T
    table.setflags(write=False)
    return table


def range_std(camera: Camera, pose: Pose, plane: Plane, elevation_std_m: float = 0.0) -> Float32Array:
    """Propagate pose, intrinsics and ground height to the standard deviation of every pixel's slant range.

    First order, as the engine's for single pixels: above 5 % of the range it is too small on the far side. The pixel's
    middle itself is exact: who points to something in the image adds the error of pointing.

    A ray ``d`` of length 1 meets a plane with the normal ``n``, ``h`` from the camera, at the range ``r = h / a`` with
    ``a = -n . d``. To first order it becomes longer by ``n / a`` with the camera's position, by ``(r / a) (d x n)``
    with a small rotation in camera axes, and by ``(r / a) (n + a d) / |q|`` with the ray ``q`` of which ``d`` is made.

    Args:
        camera: The camera, with how well its intrinsics are known.
        pose: One pose, with its covariance.
        plane: The ground, see ``depth_map.plane_at_elevation``.
        elevation_std_m: Of the ground's height, all of it together.

    Returns:
        ``(height, width)`` m, float32; NaN where the ray meets no ground.
    """
    height_m = float(plane.normal_enu @ pose.position_enu_m) - plane.offset_m
    std_m = np.full(camera.height_px * camera.width_px, np.nan, dtype=np.float32)
    shared_cov = shared_covariance(camera, pose, elevation_std_m)
    if height_m > 0:
        table = ray_table(camera)
        for first in range(0, len(std_m), _STD_BLOCK_SIZE):
            block = np.arange(first, min(first + _STD_BLOCK_SIZE, len(std_m)))
            rays_cam = table[: RAY_Z + 1, block].T.astype(np.float64)
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # no ray, level rays
                jac = _range_jacobian_pose(pose, plane, height_m, rays_cam, shared_cov.shape[-1])
                if np.any(shared_cov[INTRINSICS, INTRINSICS]):
                    pixels = np.stack([block % camera.width_px, block // camera.width_px], axis=-1).astype(np.float64)
                    jac[:, INTRINSICS] = _range_jacobian_intrinsics(camera, pose, plane, height_m, pixels)
                variance = np.sum((jac @ shared_cov) * jac, axis=-1)
                meets = rays_cam @ (plane.normal_enu @ matrix(pose.wxyz)) < 0
                std_m[block] = np.where(meets, np.sqrt(np.maximum(variance, 0.0)), np.nan)
    return std_m.reshape(camera.height_px, camera.width_px)


def _range_jacobian_pose(pose: Pose, plane: Plane, height_m: float, rays_cam: FloatArray, count: int) -> FloatArray:
    """Jacobian ``(n, count)`` by the shared errors, see ``projection``; zeros for the intrinsics."""
    normal_cam = plane.normal_enu @ matrix(pose.wxyz)
    cos_incidence = -(rays_cam @ normal_cam)[:, None]
    jac = np.zeros((len(rays_cam), count))
    jac[:, POSITION] = plane.normal_enu / cos_incidence
    jac[:, ROTATION] = (height_m / cos_incidence**2) * np.cross(rays_cam, normal_cam)
    jac[:, ELEVATION] = -plane.normal_enu[2] / cos_incidence[:, 0]
    return jac


def _range_jacobian_intrinsics(
    camera: Camera, pose: Pose, plane: Plane, height_m: float, pixels_px: FloatArray
) -> FloatArray:
    """Jacobian ``(n, m)`` of the ranges of pixels ``(n, 2)`` by the intrinsics."""
    normal_cam = plane.normal_enu @ matrix(pose.wxyz)
    rays = rays_from_pixels(camera, pixels_px)
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    rays_cam = rays / length
    cos_incidence = -(rays_cam @ normal_cam)[:, None]
    by_ray = height_m / cos_incidence**2 * (normal_cam + cos_incidence * rays_cam) / length
    return np.asarray(np.einsum("ni,nij->nj", by_ray, rays_by_intrinsics(camera, pixels_px)))


@dataclass(frozen=True, slots=True, eq=False)
class GroundMap:
    """Map from pixels to level ground at one pose: ``project`` without Jacobians and statuses.

    Attributes:
        camera: The camera.
        ground_from_ray: ``(3, 3)`` from rays in camera axes to ENU, horizontal axes scaled by the camera's height.
        foot_enu_m: ``(3,)`` ground point below the camera.
        ground_from_pixel: ``(3, 3)`` from homogeneous pixels to ENU, scaled so; None for a lens with distortion.
    """

    camera: Camera
    ground_from_ray: FloatArray
    foot_enu_m: FloatArray
    ground_from_pixel: FloatArray | None

    @classmethod
    def at(cls, camera: Camera, pose: Pose, elevation_m: float = 0.0) -> "GroundMap":
        """Build the map of one pose to the horizontal plane at ``elevation_m``; pinhole model.

        From below the plane nothing is seen of it.
        """
        height = float(pose.position_enu_m[2]) - elevation_m
        scale = np.array([height, height, 1.0]) if height > 0 else np.full(3, np.nan)
        ground_from_ray = scale[:, None] * matrix(pose.wxyz)
        foot = np.array([*pose.position_enu_m[:2], elevation_m])
        if _is_undistorted(camera):
            return cls(camera, ground_from_ray, foot, ground_from_ray @ _ray_from_pixel(camera))
        return cls(camera, ground_from_ray, foot, None)

    def points_enu_m(self, pixels_px: FloatArray) -> FloatArray:
        """Ground points ``(..., 3)`` of pixels ``(..., 2)``, in the image or beside it.

        NaN at and above the horizon, and beyond the valid part of the lens.
        """
        pixels = np.ascontiguousarray(pixels_px, dtype=np.float64)
        points = np.empty((*pixels.shape[:-1], 3))
        flat, out = pixels.reshape(-1, 2), points.reshape(-1, 3)
        if self.ground_from_pixel is not None:
            meet_pinhole(flat, self.ground_from_pixel, self.foot_enu_m, out)
        else:
            lens, ground = LENS_MODELS[self.camera.lens], (self.ground_from_ray, self.foot_enu_m)
            lens.meet_level(all_coefficients(self.camera), _intrinsics(self.camera), flat, ground, out)
        return points


def ground_covariances(
    camera: Camera, pose: Pose, pixels_px: FloatArray, elevation_m: float, elevation_std_m: float, std_px: float
) -> FloatArray:
    """Propagate to first order the covariances ``(..., 3, 3)`` of pixels ``(..., 2)`` on level ground.

    Each sums the errors of pose, intrinsics and elevation, which all points share, and of the pixel. Values where
    the ray does not go down mean nothing: the points there are NaN.
    """
    flat = pixels_px.reshape(-1, 2)
    shared_cov = shared_covariance(camera, pose, np.array(elevation_std_m))[None]
    cov = np.empty((len(flat), 3, 3))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for first in range(0, len(flat), _COVARIANCE_BLOCK_SIZE):
            block = slice(first, first + _COVARIANCE_BLOCK_SIZE)
            points = project(camera, pose, flat[block], elevation_m, ProjectionModel.PINHOLE)
            count = len(points.status)
            variances = np.zeros(count), np.full(count, std_px**2)
            cov[block] = point_covariances(points.jac_shared[None], points.jac_px[None], shared_cov, *variances)[0]
    return cov.reshape(*pixels_px.shape[:-1], 3, 3)


def _is_undistorted(camera: Camera) -> bool:
    """Whether the lens has no distortion."""
    return LENS_MODELS[camera.lens].is_pinhole(all_coefficients(camera))


def _ray_from_pixel(camera: Camera) -> FloatArray:
    """Inverse camera matrix ``(3, 3)`` of a lens without distortion."""
    return np.array(
        [
            [1 / camera.fx_px, 0.0, -camera.cx_px / camera.fx_px],
            [0.0, 1 / camera.fy_px, -camera.cy_px / camera.fy_px],
            [0.0, 0.0, 1.0],
        ]
    )


def _intrinsics(camera: Camera) -> tuple[float, float, float, float]:
    """fx, fy, cx and cy of a camera for the compiled kernels."""
    return float(camera.fx_px), float(camera.fy_px), float(camera.cx_px), float(camera.cy_px)
