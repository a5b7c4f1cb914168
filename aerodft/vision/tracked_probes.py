"""Clicked points of the ground that are found again in every image: probes that stay where they are while we move.

The plane around them is held (``plane_lock``), telemetry tells land from water that flows and finds the plane again
after it was lost. A point that is not found, or that has left the image, is lost: it has no pixels, never wrong ones.
"""

import math
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX, SECOND_NS
from aerodft.geometry.ground import Ground
from aerodft.model.arrays import ImageArray
from aerodft.model.camera import Camera
from aerodft.model.image import Image
from aerodft.model.observation import Observation
from aerodft.model.probe import Probe
from aerodft.vision.keyframes import PlaneImage, PoseOf, Standpoint, Standpoints
from aerodft.vision.plane_lock import Lock, PlaneLock
from aerodft.vision.tracking import StraightView, carried

_REACH: Final = 0.35  # of the image's width: what is farther from the probes may be another plane
_START_NS: Final = SECOND_NS // 5  # pixels are those of an image that is no later than this after their time
_MOST_STD_PX: Final = 8.0  # full pixels: what is known no better is lost
_STD_PX: Final = 0.2  # full pixels: a tracker is never better
_DECIMALS: Final = 3


class TrackedProbes:
    """Implements ``service.ports.ImageObserver``: an observation of every tracked probe, without pixels where lost.

    Args:
        camera: The camera.
        probes: Whose pixels are those of one image: of the first, or of that of their time.
        pose_of: The pose at an image's stamp, about; None where it is not known. The first image's is asked for again.
        ground: What the probes' elevations are counted from; None for the level plane at 0.
    """

    def __init__(self, camera: Camera, probes: tuple[Probe, ...], pose_of: PoseOf, ground: Ground | None) -> None:
        times = dict.fromkeys(probe.at_ns for probe in probes)
        view = StraightView(camera)
        self._view = view
        self._groups = [
            _Together(
                camera,
                Standpoints(camera, view, pose_of, elevation_m=None),
                view,
                tuple(probe for probe in probes if probe.at_ns == at_ns),
                ground,
            )
            for at_ns in times
        ]

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """Where the probes are.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        small = self._view.small(image.pixels())
        return tuple(found for group in self._groups for found in group.look(image, small))


class _Together:
    """Probes whose pixels are those of one image."""

    def __init__(
        self,
        camera: Camera,
        standpoints: Standpoints,
        view: StraightView,
        probes: tuple[Probe, ...],
        ground: Ground | None,
    ) -> None:
        self._camera, self._standpoints, self._probes, self._ground = camera, standpoints, probes, ground
        self._at_ns = probes[0].at_ns
        self._first: tuple[Image, ImageArray] | None = None
        self._lock: PlaneLock | None = None
        self._first_view = view
        self._is_missed = False
        pixels = np.array([pixel for probe in probes for pixel in probe.pixels])
        self._small_px = view.to_small(pixels)

    def look(self, image: Image, small: ImageArray) -> list[Observation]:
        """Each probe with what became of it; nothing before their time."""
        stamp_ns = image.stamp_ns
        if self._at_ns is not None and stamp_ns < self._at_ns:
            return []
        if self._first is None:
            self._is_missed |= self._at_ns is not None and stamp_ns > self._at_ns + _START_NS
            if not self._is_missed:
                self._first = replace(image, pixels=None), small
                return [Observation.in_image(image, probe.name, probe.pixels) for probe in self._probes]
        if self._first is None:
            why = "there was no image at the time that its pixels are of, or none within 0.2 s after it"
            return [Observation.in_image(image, probe.name, unseen=why) for probe in self._probes]
        at_first = self._standpoints.seen(self._first[0])
        if self._lock is None:  # not before, because the first image's pose may come after it
            self._first_view = self._standpoints.view_of(at_first)
            taken = self._taken(*self._first, self._first_view, None)
            self._lock = PlaneLock(taken, self._small_px, _REACH * small.shape[1])
        if self._standpoints.elevation_m is None and at_first is not None:
            pixel, elevation_m = np.array(self._probes[0].pixels[0]), self._probes[0].elevation_m
            self._standpoints.find_plane(at_first, pixel, self._ground, elevation_m)
            self._lock.know_first(self._standpoints.of(at_first))
        now = self._standpoints.seen(image)
        view = self._standpoints.view_of(now)
        found = self._lock.follow(self._taken(image, small, view, self._standpoints.of(now)))
        return [self._answer(image, probe, found, view) for probe in self._probes]

    def _taken(self, image: Image, small: ImageArray, view: StraightView, standpoint: Standpoint | None) -> PlaneImage:
        return PlaneImage(small, view, (image.stamp_ns - self._epoch_ns(image)) / SECOND_NS, standpoint)

    def _epoch_ns(self, image: Image) -> int:
        return image.stamp_ns if self._first is None else self._first[0].stamp_ns

    def _answer(self, image: Image, probe: Probe, found: Lock | None, view: StraightView) -> Observation:
        lost = partial(Observation.in_image, image, probe.name)
        if found is None:
            return lost(unseen="the ground around it was not recognised, or what was may be water that flows")
        first_px = self._first_view.straight(view.to_small(np.array(probe.pixels)))
        moved = view.to_full(view.bent(carried(found.homography, first_px)))
        farthest = np.array([self._camera.width_px, self._camera.height_px]) - PIXEL_CENTRE_OFFSET_PX
        if not np.all((moved >= -PIXEL_CENTRE_OFFSET_PX) & (moved <= farthest)):
            return lost(unseen="it is out of the image")
        cov_px2 = found.cov_px2(first_px)
        carried_px = view.shrink * math.sqrt(float(np.max(np.linalg.eigvalsh(cov_px2))))
        if not carried_px <= _MOST_STD_PX:
            return lost(unseen=f"where it is in the image is known to no better than {_MOST_STD_PX:.0f} px")
        pixels = tuple((u, v) for u, v in np.round(moved, _DECIMALS).tolist())
        std_px = math.hypot(probe.std_px, carried_px, _STD_PX)
        return Observation.in_image(image, probe.name, pixels, std_px=std_px)
