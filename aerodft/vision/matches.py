"""Points that were followed from one image to another, as rays."""

from dataclasses import dataclass

import numpy as np

from aerodft.geometry.lens import rays_with_jacobian
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.model.camera import Camera

_WIDEST_TANGENT = 2.0  # farther from the axis a pixel says little about a plane ahead


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matches:
    """What two images have in common.

    Attributes:
        earlier: ``(n, 2)`` rays at unit depth in the earlier camera's axes.
        later: ``(n, 2)`` the same points' in the later one's.
        px: ``(n,)`` size of a tracked pixel in the later one, in the same unit.
    """

    earlier: FloatArray
    later: FloatArray
    px: FloatArray

    def __len__(self) -> int:
        return len(self.px)

    def where(self, keep: BoolArray) -> "Matches":
        """Some of them."""
        return Matches(earlier=self.earlier[keep], later=self.later[keep], px=self.px[keep])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImagePair:
    """Two images by their stamps, and the points that were followed from one to the other."""

    start_ns: int
    end_ns: int
    matches: Matches


def matches_of(camera: Camera, earlier_px: FloatArray, later_px: FloatArray, shrink: float = 1.0) -> Matches:
    """Pixels ``(n, 2)`` of both images as matches; those far from the axis are left out.

    Args:
        camera: The camera.
        earlier_px: In the earlier image.
        later_px: In the later one.
        shrink: How many pixels make one of the images in which they were tracked.
    """
    rays = rays_with_jacobian(camera, np.stack([earlier_px, later_px]))
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = rays.rays_cam[..., 2]
        flat = rays.rays_cam[..., :2] / depth[..., None]
        by_px = (rays.jac_px[..., :2, :] - flat[..., None] * rays.jac_px[..., 2:, :]) / depth[..., None, None]
        usable = np.all((depth > 0) & (np.linalg.norm(flat, axis=-1) < _WIDEST_TANGENT), axis=0)
    px = np.sqrt(np.abs(np.linalg.det(by_px[1][usable]))) * shrink
    return Matches(earlier=flat[0][usable], later=flat[1][usable], px=px)
