"""A fixed camera's steady points: where they were in its reference, and where they are now."""

from typing import Final

import numpy as np

from aerodft.geometry.rotation import inverse, multiply, to_rotation_vector
from aerodft.geometry.turning import LEAST_POINTS, Turn, find_turn, turned
from aerodft.model.arrays import FloatArray, ImageArray, IntArray
from aerodft.model.calibration import STEADY
from aerodft.model.camera import Camera
from aerodft.model.image import Image
from aerodft.model.observation import Observation
from aerodft.vision.reference import (
    FirstGoodImage,
    Polygon,
    Reference,
    View,
    allowed_outside,
    features_of,
    matched,
    reference_of,
    view_after,
)
from aerodft.vision.tracking import evened, followed

_NO_TURN: Final = np.array([1.0, 0.0, 0.0, 0.0])
_ANOTHER_VIEW_RAD: Final = 0.009  # half a degree: templates look different from there on
_RECOGNISED_PX: Final = 4.0  # descriptors are no more precise
_LEAST_RECOGNISED: Final = 12
_LOST: Final = 0.2  # of the points in view: where fewer than these agree, the camera may look elsewhere
_MOST_MATCHES: Final = 200
_RESTLESS_PX: Final = 1.0  # between two looks, beside what the camera's turn explains
_FADING: Final = 0.2
_UNREST: Final = 0.5
_DECIMALS: Final = 3  # of a pixel; trackers have not two

_Pairs = tuple[FloatArray, FloatArray]


class SteadyPoints:
    """Implements ``service.ports.ImageObserver``: one observation an image, of pairs of pixels.

    Points are always held against the reference, never against the image before, so nothing drifts. An observation
    without pairs says that nothing was found. Where the view is not the reference turned, it has what looks alike.

    Args:
        camera: The camera.
        ignore: Polygons of reference pixels with water, trees, roads, whatever moves by itself.
        reference: ``(height, width, 3)`` BGR; None to take the first good image.
    """

    def __init__(self, camera: Camera, ignore: tuple[Polygon, ...] = (), reference: ImageArray | None = None) -> None:
        self._camera = camera
        allowed = allowed_outside(ignore, camera.width_px, camera.height_px)
        self._first = FirstGoodImage(allowed)
        self._held: _Held | None = None
        if reference is not None:
            self._held = _Held(camera, reference_of(reference, allowed))

    @property
    def corners(self) -> int | None:
        """How many points the reference has; None before there is one."""
        return None if self._held is None else self._held.corners

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """Pairs of pixels: where a point is in the reference, and where it is in this image.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        pixels = image.pixels()
        if self._held is None and (reference := self._first.offer(pixels)) is not None:
            self._held = _Held(self._camera, reference)
        then_px, now_px = self._held.look(evened(pixels)) if self._held is not None else _no_pairs()
        flat = np.round(np.stack([then_px, now_px], axis=1).reshape(-1, 2), _DECIMALS).tolist()
        return (Observation.in_image(image, STEADY, tuple((u, v) for u, v in flat)),)


class _Held:
    """A reference, and how the camera has turned since."""

    def __init__(self, camera: Camera, reference: Reference) -> None:
        self._camera = camera
        self._reference = reference
        self._points_px = reference.points_px
        self._wxyz = _NO_TURN
        self._view = self._seen_after(_NO_TURN)
        self._last_off_px = np.full_like(self._points_px, np.nan)
        self._unrest = np.zeros(len(self._points_px))

    @property
    def corners(self) -> int:
        return len(self._points_px)

    def look(self, now: ImageArray) -> _Pairs:
        """What is found of the reference in an evened image ``(height, width)``: pixels ``(n, 2)`` then and now."""
        found, now_px, turn = self._follow(now)
        if turn is None or np.count_nonzero(turn.agreeing) < self._least_agreeing():
            then_px, new_px = matched(self._reference.features, features_of(now))
            known = find_turn(self._camera, then_px, new_px, tolerance_px=_RECOGNISED_PX)
            if known is None or np.count_nonzero(known.agreeing) < _LEAST_RECOGNISED:
                return then_px[:_MOST_MATCHES], new_px[:_MOST_MATCHES]
            self._wxyz, self._view = known.wxyz, self._seen_after(known.wxyz)
            found, now_px, turn = self._follow(now)
        elif self._is_another_view(turn):
            self._wxyz, self._view = turn.wxyz, self._seen_after(turn.wxyz)
            found, now_px, turn = self._follow(now)
        if turn is not None:
            self._learn(found, turn)
        calm = self._unrest[found] < _UNREST
        return self._points_px[found][calm], now_px[calm]

    def _least_agreeing(self) -> float:
        in_view = np.count_nonzero(self._view.inside & (self._unrest < _UNREST))
        return max(_LOST * in_view, LEAST_POINTS)

    def _follow(self, now: ImageArray) -> tuple[IntArray, FloatArray, Turn | None]:
        """Indices ``(k,)`` of the points that were found, where, and the turn that most of them agree on."""
        guess_px = turned(self._camera, self._wxyz, self._points_px)
        tried = np.flatnonzero(self._view.inside & np.isfinite(guess_px[:, 0]))
        there_px, ok = followed(self._view.evened, now, self._view.points_px[tried], guess_px[tried])
        found, now_px = tried[ok], there_px[ok]
        return found, now_px, find_turn(self._camera, self._points_px[found], now_px)

    def _learn(self, found: IntArray, turn: Turn) -> None:
        """Go on from where the camera looks now, and remember which points move by themselves."""
        self._wxyz = turn.wxyz
        moved = np.max(np.abs(turn.off_px - self._last_off_px[found]), axis=-1) > _RESTLESS_PX
        self._unrest[found] += _FADING * (moved - self._unrest[found])
        self._last_off_px[found] = turn.off_px

    def _is_another_view(self, turn: Turn) -> bool:
        step = to_rotation_vector(multiply(inverse(self._view.wxyz), turn.wxyz))
        return bool(np.linalg.norm(step) > _ANOTHER_VIEW_RAD)

    def _seen_after(self, wxyz: FloatArray) -> View:
        return view_after(self._camera, self._reference.grey, self._points_px, wxyz)


def _no_pairs() -> _Pairs:
    return np.zeros((0, 2)), np.zeros((0, 2))
