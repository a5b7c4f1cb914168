"""Small grey images, and where a lens without distortion would show their pixels: there planes move by homographies."""

from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from aerodft.geometry.lens import pixels_from_rays, rays_from_pixels
from aerodft.model.arrays import FloatArray, ImageArray
from aerodft.model.camera import Camera

SMALL_PX: Final = 640
"""Images are tracked at about this width."""

NODE_PX: Final = 16
"""Between these, a map from pixels to pixels is as good as straight."""

OUTSIDE_PX: Final = -1e4
"""Of what the lens does not show."""


class StraightView:
    """A camera's images made small, and their pixels with and without distortion.

    Args:
        camera: The camera.
        about_px: Width that images are made as small as, about.
    """

    def __init__(self, camera: Camera, about_px: int = SMALL_PX) -> None:
        self._whole, self._about_px = camera, about_px
        self.shrink = max(round(camera.width_px / about_px), 1)
        shift = (self.shrink - 1) / 2  # the centre of a small pixel is that of the pixels it was made of
        self.camera = replace(
            camera,
            width_px=camera.width_px // self.shrink,
            height_px=camera.height_px // self.shrink,
            fx_px=camera.fx_px / self.shrink,
            fy_px=camera.fy_px / self.shrink,
            cx_px=(camera.cx_px - shift) / self.shrink,
            cy_px=(camera.cy_px - shift) / self.shrink,
        )
        self._bends = any(camera.distortion)
        across, down = (-(-size // NODE_PX) for size in (self.camera.width_px, self.camera.height_px))
        centre_px = (NODE_PX - 1) / 2  # cv2.resize puts a node's value there
        u, v = np.meshgrid(np.arange(across) * NODE_PX + centre_px, np.arange(down) * NODE_PX + centre_px)
        self._nodes = self.straight(np.stack([u, v], axis=-1).astype(np.float64))

    @property
    def intrinsics(self) -> FloatArray:
        """``(3, 3)`` of its straight pixels."""
        lens = self.camera
        return np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1.0]])

    def zoomed(self, magnification: float) -> "StraightView":
        """That of the same camera at another focal length; it bends other pixels by other amounts."""
        return StraightView(self._whole.zoomed(magnification, 0.0), self._about_px) if self._bends else self

    def small(self, pixels: ImageArray) -> ImageArray:
        """An image ``(height, width, 3)`` BGR, grey and small."""
        grey = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        size = self.camera.width_px, self.camera.height_px
        whole = grey[: size[1] * self.shrink, : size[0] * self.shrink]
        return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA)) if self.shrink > 1 else grey

    def to_small(self, pixels_px: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of the camera's image in the small one."""
        return (pixels_px - (self.shrink - 1) / 2) / self.shrink

    def to_full(self, small_px: FloatArray) -> FloatArray:
        """The way back."""
        return small_px * self.shrink + (self.shrink - 1) / 2

    def straight(self, small_px: FloatArray) -> FloatArray:
        """Small pixels ``(..., 2)`` where they were without distortion; NaN beyond the lens model."""
        if not self._bends:
            return small_px
        rays, lens = rays_from_pixels(self.camera, small_px), self.camera
        return rays[..., :2] / rays[..., 2:] * [lens.fx_px, lens.fy_px] + [lens.cx_px, lens.cy_px]

    def bent(self, straight_px: FloatArray) -> FloatArray:
        """The way back; NaN where the lens shows nothing."""
        if not self._bends:
            return straight_px
        lens = self.camera
        flat = (straight_px - [lens.cx_px, lens.cy_px]) / [lens.fx_px, lens.fy_px]
        return pixels_from_rays(lens, np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1))

    def moved(self, homography: FloatArray, small_px: FloatArray, then: "StraightView") -> FloatArray:
        """Small pixels ``(..., 2)`` of another view, under a homography from its straight ones to those of this."""
        return self.bent(carried(homography, then.straight(small_px)))

    def warped(self, small: ImageArray, homography: FloatArray, then: "StraightView") -> ImageArray:
        """What a small image ``(height, width)`` of another view shows, as this one sees it; its border is repeated."""
        inverse: FloatArray = np.asarray(np.linalg.inv(homography), dtype=np.float64)
        nodes = then.bent(carried(inverse, self._nodes))
        nodes = np.nan_to_num(nodes, nan=OUTSIDE_PX).astype(np.float32)
        rows, columns = nodes.shape[:2]
        whole = cv2.resize(nodes, (columns * NODE_PX, rows * NODE_PX), interpolation=cv2.INTER_LINEAR)
        part = whole[: self.camera.height_px, : self.camera.width_px]
        columns_px, rows_px = cv2.split(part)
        seen = cv2.remap(small, columns_px, rows_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(seen, dtype=np.uint8)


def carried(homography: FloatArray, straight_px: FloatArray) -> FloatArray:
    """Points ``(..., 2)`` under a homography ``(3, 3)``; NaN behind the camera."""
    moved = straight_px @ homography[:, :2].T + homography[:, 2]
    depth = moved[..., 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(depth > 0, moved[..., :2] / depth, np.nan)
