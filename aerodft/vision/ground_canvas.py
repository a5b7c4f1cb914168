"""A stabilised view of the ground: images of a camera that moves, laid onto what one of them saw of the plane."""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.vision.straight import NODE_PX, OUTSIDE_PX, StraightView, carried

_MARGIN: Final = 0.3  # of the image's size, to each side
_SCALES: Final = (0.75, 1.35)  # seen larger or smaller than that it is time for another canvas

Window = tuple[slice, slice]


class GroundCanvas:
    """The straight pixels of one image, with margins.

    Args:
        view: Of that image.
        since_first: ``(3, 3)`` homography since the first image, of straight pixels of such views.
    """

    def __init__(self, view: StraightView, since_first: FloatArray) -> None:
        width, height = view.camera.width_px, view.camera.height_px
        self._margin_px = np.array([round(_MARGIN * width), round(_MARGIN * height)], dtype=np.float64)
        self.shape = height + 2 * int(self._margin_px[1]), width + 2 * int(self._margin_px[0])
        self.since_first = since_first
        self._size_px = np.array([width, height], dtype=np.float64)

    def onto(self, since_first: FloatArray) -> FloatArray:
        """``(3, 3)`` from canvas pixels to straight pixels of an image with that homography since the first."""
        back = np.eye(3)
        back[:2, 2] = -self._margin_px
        return np.asarray(since_first @ np.linalg.inv(self.since_first) @ back)

    def window(self, onto: FloatArray) -> Window:
        """The part of the canvas that an image can show."""
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (self._size_px - 1)
        at = carried(np.asarray(np.linalg.inv(onto), dtype=np.float64), corners)
        if not np.all(np.isfinite(at)):
            return slice(0, self.shape[0]), slice(0, self.shape[1])
        low = np.clip(np.floor(np.min(at, axis=0)), 0, None).astype(int)
        high = np.clip(np.ceil(np.max(at, axis=0)) + 1, 0, [self.shape[1], self.shape[0]]).astype(int)
        return slice(int(low[1]), max(int(high[1]), int(low[1]))), slice(int(low[0]), max(int(high[0]), int(low[0])))

    def holds(self, onto: FloatArray) -> bool:
        """Whether an image lies within the canvas, in about its size."""
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]]) * (self._size_px - 1)
        back: FloatArray = np.asarray(np.linalg.inv(onto), dtype=np.float64)
        at = carried(back, corners)
        if not np.all(np.isfinite(at)):
            return False
        inside = np.all((at > -0.1 * self._size_px) & (at < [self.shape[1], self.shape[0]] + 0.1 * self._size_px))
        ends = carried(back, corners[4] + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        scale = np.sqrt(abs(float(np.linalg.det(ends[1:] - ends[0]))))
        return bool(inside and _SCALES[0] <= scale <= _SCALES[1])

    def laid(
        self, pixels: ImageArray, view: StraightView, onto: FloatArray, window: Window
    ) -> tuple[ImageArray, BoolArray]:
        """An image of a view as the canvas shows it, and where it does; of the window only."""
        rows, columns = window
        height, width = rows.stop - rows.start, columns.stop - columns.start
        across, down = -(-width // NODE_PX), -(-height // NODE_PX)
        centre_px = (NODE_PX - 1) / 2  # cv2.resize puts a node's value there
        u, v = np.meshgrid(np.arange(across) * NODE_PX + centre_px, np.arange(down) * NODE_PX + centre_px)
        nodes = view.bent(carried(onto, np.stack([u + columns.start, v + rows.start], axis=-1)))
        nodes = np.nan_to_num(nodes, nan=OUTSIDE_PX).astype(np.float32)
        size = across * NODE_PX, down * NODE_PX
        columns_px, rows_px = (
            cv2.resize(np.ascontiguousarray(nodes[..., k]), size, interpolation=cv2.INTER_LINEAR)[:height, :width]
            for k in (0, 1)
        )
        seen = cv2.remap(pixels, columns_px, rows_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        farthest = self._size_px - 2
        is_seen = (columns_px >= 1) & (columns_px <= farthest[0]) & (rows_px >= 1) & (rows_px <= farthest[1])
        return np.asarray(seen, dtype=np.uint8), np.asarray(is_seen)

    def moved_here(self, planes: np.ndarray, other: "GroundCanvas") -> np.ndarray:
        """What lies on another canvas ``(h, w, ...)`` as it lies on this one; 0 where there is nothing."""
        back = np.eye(3)
        back[:2, 2] = -self._margin_px
        onto = np.linalg.inv(other.onto(np.eye(3))) @ np.linalg.inv(self.since_first) @ back
        return np.asarray(cv2.warpPerspective(planes, np.linalg.inv(onto), self.shape[::-1], flags=cv2.INTER_LINEAR))
