"""What a camera would see after a turn, made of an image that it took before: templates as they must look by now."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.geometry.lens import pixels_from_rays, rays_from_pixels
from aerodft.geometry.rotation import inverse, matrix, to_rotation_vector
from aerodft.geometry.turning import turned
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.vision.evened import evened

_NODE_PX: Final = 8  # between these, a map from pixels to pixels is as good as straight
_SAME_RAD: Final = 1e-6
_MARGIN_PX: Final = 24.0
_OUTSIDE_PX: Final = -1e4


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A reference as it is seen after a turn.

    Attributes:
        wxyz: ``(4,)`` ``now_SO3_reference``.
        evened: ``(height, width)``.
        points_px: ``(n, 2)``: where the reference's points are in it.
        inside: ``(n,)``: which of them are far enough from its edges.
    """

    wxyz: FloatArray
    evened: ImageArray
    points_px: FloatArray
    inside: BoolArray


def view_after(camera: Camera, reference: ImageArray, points_px: FloatArray, wxyz: FloatArray) -> View:
    """The view of a camera that has turned since it took the reference.

    Args:
        camera: The camera.
        reference: ``(height, width)`` grey.
        points_px: ``(n, 2)`` points of the reference.
        wxyz: ``(4,)`` ``now_SO3_reference``.
    """
    if np.linalg.norm(to_rotation_vector(wxyz)) < _SAME_RAD:
        return View(wxyz, evened(reference), points_px, _inside(camera, points_px))
    map_px = _map(camera, wxyz)
    seen = cv2.remap(reference, map_px[0], map_px[1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
    points_now_px = turned(camera, wxyz, points_px)
    return View(wxyz, evened(np.asarray(seen, dtype=np.uint8)), points_now_px, _inside(camera, points_now_px))


def _map(camera: Camera, wxyz: FloatArray) -> tuple[np.ndarray, np.ndarray]:
    """For each pixel now, the column and the row of the reference ``(height, width)`` that it shows."""
    across, down = (-(-size // _NODE_PX) for size in (camera.width_px, camera.height_px))
    centre_px = (_NODE_PX - 1) / 2  # cv2.resize puts a node's value there
    u, v = np.meshgrid(np.arange(across) * _NODE_PX + centre_px, np.arange(down) * _NODE_PX + centre_px)
    rays = rays_from_pixels(camera, np.stack([u, v], axis=-1)) @ matrix(inverse(wxyz)).T
    nodes_px = np.nan_to_num(pixels_from_rays(camera, rays), nan=_OUTSIDE_PX).astype(np.float32)
    whole = cv2.resize(nodes_px, (across * _NODE_PX, down * _NODE_PX), interpolation=cv2.INTER_LINEAR)
    part = whole[: camera.height_px, : camera.width_px]
    return np.ascontiguousarray(part[..., 0]), np.ascontiguousarray(part[..., 1])


def _inside(camera: Camera, points_px: FloatArray) -> BoolArray:
    """Far enough from the edges for a template; NaN is outside."""
    farthest = np.array([camera.width_px, camera.height_px]) - 1 - _MARGIN_PX
    return np.asarray(np.all((points_px >= _MARGIN_PX) & (points_px <= farthest), axis=-1))
