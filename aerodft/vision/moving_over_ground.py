"""What moves over the ground before a camera that moves itself: the ground is held still, what differs from it is new.

The plane is held as for tracked probes (``plane_lock``); images are laid onto a canvas of it, on which a background is
learned. What stands up from the ground is shifted when the camera moves on: ``ground_tracks`` tells it from what walks.
"""

from typing import Final

import cv2
import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.ground import Ground
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.model.image import Image
from aerodft.model.observation import Observation
from aerodft.service.objects import ObjectSettings
from aerodft.vision.blobs import is_ghost, objects_in, without_shadows
from aerodft.vision.ground_background import GroundBackground, GroundCanvas, Window
from aerodft.vision.keyframes import PlaneImage
from aerodft.vision.moving import observations_of
from aerodft.vision.plane_lock import PlaneLock
from aerodft.vision.reference import allowed_outside
from aerodft.vision.standpoints import PoseOf, Standpoints
from aerodft.vision.straight import StraightView, carried

_ABOUT_PX: Final = 1280  # images are compared at about this width
_ANOTHER_VIEW: Final = 0.4  # of what is seen: where more than this is new, the ground was not held
_LOST_S: Final = 1.0  # held no more for so long: begun anew
_FIRST_LOOKS: Final = 10  # whose median is the first background
_EDGE_PX: Final = 3.0  # what touches the image's border is cut off: it has no foot


class MovingOverGround:
    """Implements ``service.ports.ImageObserver``, as ``moving.MovingObjects`` does for a camera that stands still.

    Args:
        camera: The camera.
        settings: What is looked for.
        pose_of: The pose at an image's stamp, about; None where it is not known.
        ground: None for the level plane at 0; else the level of what is seen in the middle counts.

    Attributes:
        restless: Images so far in which too much seemed to move.
    """

    def __init__(self, camera: Camera, settings: ObjectSettings, pose_of: PoseOf, ground: Ground | None = None) -> None:
        self.restless = 0
        self._settings, self._ground = settings, ground
        self._allowed = allowed_outside(settings.ignore, camera.width_px, camera.height_px)
        self._all_allowed = bool(np.all(self._allowed))
        self._small, self._view = StraightView(camera), StraightView(camera, _ABOUT_PX)
        self._standpoints = Standpoints(camera, self._small, pose_of)
        self._to_view = self._view.intrinsics @ np.linalg.inv(self._small.intrinsics)
        self._lock: PlaneLock | None = None
        self._canvas: GroundCanvas | None = None
        self._background = GroundBackground.of((0, 0))
        self._first: list[tuple[ImageArray, BoolArray]] | None = []
        self._last_s = self._held_s = 0.0
        self._epoch_ns: int | None = None

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """Outlines of what moves.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        self._epoch_ns = image.stamp_ns if self._epoch_ns is None else self._epoch_ns
        time_s = (image.stamp_ns - self._epoch_ns) / SECOND_NS
        outlines = self._outlines(image, image.pixels(), time_s)
        seen = observations_of(outlines, image, self._settings.std_px)
        self.restless += bool(seen[0].unseen)
        return seen

    def _outlines(self, image: Image, pixels: ImageArray, time_s: float) -> list[FloatArray]:
        since_first, view = self._held(image, pixels, time_s)
        if since_first is None:
            return []
        if self._canvas is None:
            self._canvas = GroundCanvas(self._view, since_first)
            self._background, self._first = GroundBackground.of(self._canvas.shape), []
        elif not self._canvas.holds(self._canvas.onto(since_first)):
            canvas = GroundCanvas(self._view, since_first)
            self._background, self._canvas = self._background.on(canvas, self._canvas), canvas
        elapsed_s, self._last_s = time_s - self._last_s, time_s
        return self._new_on(self._canvas, self._view.shrunken(pixels), view, since_first, elapsed_s)

    def _held(self, image: Image, pixels: ImageArray, time_s: float) -> tuple[FloatArray | None, StraightView]:
        """Homography since the first image, and the view as it is zoomed; None where the ground is not held."""
        seen = self._standpoints.seen(image)
        if self._lock is None and self._ground is not None and seen is not None:
            middle = np.array([pixels.shape[1] - 1, pixels.shape[0] - 1]) / 2
            self._standpoints.find_plane(seen, middle, self._ground, 0.0)
        standpoint, view = self._standpoints.of(seen), self._standpoints.view_of(seen)
        now = PlaneImage(self._small.small(pixels), view, time_s, standpoint)
        zoomed = self._view if seen is None else self._standpoints.zoomed(self._view, seen)
        if self._lock is None or time_s - self._held_s > _LOST_S:
            if standpoint is None:
                return None, zoomed
            size = self._small.camera
            middle_px = np.array([[size.width_px / 2, size.height_px / 2]])
            self._lock, self._canvas, self._held_s = PlaneLock(now, middle_px, 2.0 * size.width_px), None, time_s
            return np.eye(3), zoomed
        lock = self._lock.follow(now)
        if lock is None:
            return None, zoomed
        self._held_s = time_s
        return self._to_view @ lock.homography @ np.linalg.inv(self._to_view), zoomed

    def _new_on(
        self, canvas: GroundCanvas, pixels: ImageArray, view: StraightView, since_first: FloatArray, elapsed_s: float
    ) -> list[FloatArray]:
        """Outlines in the image, of what is new on the canvas."""
        onto = canvas.onto(since_first)
        if self._first is not None:
            whole = slice(0, canvas.shape[0]), slice(0, canvas.shape[1])
            self._first.append(canvas.laid(pixels, view, onto, whole))
            if len(self._first) == _FIRST_LOOKS:
                self._background.begin(self._first)
                self._first = None
            return []
        window = canvas.window(onto)
        seen, is_seen = canvas.laid(pixels, view, onto, window)
        if not seen.size:
            return []
        is_new, shade = self._background.new_in(seen, is_seen, window, elapsed_s)
        if int(np.count_nonzero(is_new)) > _ANOTHER_VIEW * int(np.count_nonzero(is_seen)):
            self._lock, self._canvas = None, None
            return []
        least_px = max(round(self._settings.least_px / self._view.shrink**2), 8)
        mask = is_new
        if self._settings.shadows:
            background = np.clip(self._background.mean[window], 0, 255).astype(np.uint8)
            mask = without_shadows(seen, background, is_new, shade, least_px)
        outlines = self._without_ghosts(seen, is_new, objects_in(mask, least_px), window)
        self._background.learn(seen, is_seen, is_new, window, elapsed_s)
        corner = np.array([window[1].start, window[0].start], dtype=np.float64)
        found = [view.to_full(view.bent(carried(onto, outline + corner))) for outline in outlines]
        return [outline for outline in found if self._is_whole(outline)]

    def _without_ghosts(
        self, seen: ImageArray, is_new: BoolArray, outlines: list[FloatArray], window: Window
    ) -> list[FloatArray]:
        there = []
        for outline in outlines:
            if is_ghost(seen, self._background.mean[window], is_new, outline):
                inside = np.zeros(seen.shape[:2], dtype=np.uint8)
                cv2.fillPoly(inside, [np.round(outline).astype(np.int32)], 1)
                self._background.forget(seen, np.asarray(inside > 0), window)
            else:
                there.append(outline)
        return there

    def _is_whole(self, outline: FloatArray) -> bool:
        """Whether it lies in the image, and not in what is to be ignored."""
        height, width = self._allowed.shape
        if not np.all(np.isfinite(outline)):
            return False
        if np.any(outline < _EDGE_PX) or np.any(outline > np.array([width, height]) - 1 - _EDGE_PX):
            return False
        middle = np.round(np.mean(outline, axis=0)).astype(int)
        return self._all_allowed or bool(self._allowed[middle[1], middle[0]])
