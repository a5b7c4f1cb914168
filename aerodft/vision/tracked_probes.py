"""Clicked points of the ground that are found again in every image: probes that stay where they are while we move.

The plane around them is held (``plane_lock``), telemetry tells land from water that flows and finds the plane again
after it was lost. A point that is not found, or that has left the image, is lost: it has no pixels, never wrong ones.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX, SECOND_NS
from aerodft.geometry.ground import Ground
from aerodft.geometry.lens import rays_from_pixels
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.model.image import Image
from aerodft.model.observation import VISION, Observation
from aerodft.model.pose import Pose, PoseSample
from aerodft.model.probe import Probe
from aerodft.model.status import Status
from aerodft.vision.plane_lock import Lock, PlaneLock
from aerodft.vision.straight import StraightView, carried

_REACH: Final = 0.35  # of the image's width: what is farther from the probes may be another plane
_START_NS: Final = SECOND_NS // 5  # pixels are those of an image that is no later than this after their time
_MOST_STD_PX: Final = 15.0  # full pixels: what is known no better is lost
_STD_PX: Final = 0.2  # full pixels: a tracker is never better
_DECIMALS: Final = 3
_LEAST_DOWN: Final = 1e-3

Pixels = tuple[tuple[float, float], ...]
PoseOf = Callable[[Image], PoseSample | None]


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
        self._groups = [
            _Together(camera, view, tuple(probe for probe in probes if probe.at_ns == at_ns), ground) for at_ns in times
        ]
        self._view, self._pose_of = view, pose_of

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """Where the probes are.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        small = self._view.small(image.pixels())
        return tuple(
            Observation(
                name=probe.name,
                stamp_ns=image.stamp_ns,
                arrival_ns=image.arrival_ns,
                pixels=pixels,
                std_px=std_px,
                clock=image.clock,
                image=image.index,
                source=VISION,
            )
            for group in self._groups
            for probe, pixels, std_px in group.look(image, small, self._pose_of)
        )


class _Together:
    """Probes whose pixels are those of one image."""

    def __init__(self, camera: Camera, view: StraightView, probes: tuple[Probe, ...], ground: Ground | None) -> None:
        self._camera, self._view, self._probes, self._ground = camera, view, probes, ground
        self._at_ns = probes[0].at_ns
        self._lock: PlaneLock | None = None
        self._first: Image | None = None
        self._is_missed = False
        self._known: tuple[FloatArray, float] | None = None  # the plane at a pose, and its height
        pixels = np.array([pixel for probe in probes for pixel in probe.pixels])
        self._small_px = view.to_small(pixels)

    def look(self, image: Image, small: ImageArray, pose_of: PoseOf) -> list[tuple[Probe, Pixels, float | None]]:
        """Each probe with its pixels and their std; none before their time."""
        stamp_ns = image.stamp_ns
        if self._at_ns is not None and stamp_ns < self._at_ns:
            return []
        if self._lock is None and not self._is_missed:
            if self._at_ns is not None and stamp_ns > self._at_ns + _START_NS:
                self._is_missed = True
            else:
                self._first = replace(image, pixels=None)
                self._lock = PlaneLock(self._view, small, self._small_px, _REACH * small.shape[1])
                return [(probe, probe.pixels, None) for probe in self._probes]
        if self._lock is None or self._first is None:
            return [(probe, (), None) for probe in self._probes]
        if self._known is None and (at_first := self._seen_with(pose_of(self._first))) is not None:
            self._know(*at_first)
        now = self._seen_with(pose_of(image))
        found = self._lock.follow(small, None if now is None else self._plane(*now))
        return [self._answer(probe, found) for probe in self._probes]

    def _seen_with(self, sample: PoseSample | None) -> tuple[Camera, Pose] | None:
        """Camera, as far as it is zoomed, and pose; None where there is none."""
        if sample is None or sample.pose is None or sample.status is not Status.OK:
            return None
        if sample.zoom is None:
            return self._camera, sample.pose
        return self._camera.zoomed(sample.zoom.magnification, 0.0), sample.pose

    def _answer(self, probe: Probe, found: Lock | None) -> tuple[Probe, Pixels, float | None]:
        if found is None:
            return probe, (), None
        first_px = self._view.straight(self._view.to_small(np.array(probe.pixels)))
        moved = self._view.to_full(self._view.bent(carried(found.homography, first_px)))
        farthest = np.array([self._camera.width_px, self._camera.height_px]) - PIXEL_CENTRE_OFFSET_PX
        if not np.all((moved >= -PIXEL_CENTRE_OFFSET_PX) & (moved <= farthest)):
            return probe, (), None
        carried_px = self._view.shrink * found.std_px(first_px)
        if not carried_px <= _MOST_STD_PX:
            return probe, (), None
        pixels = tuple((u, v) for u, v in np.round(moved, _DECIMALS).tolist())
        return probe, pixels, math.hypot(probe.std_px, carried_px, _STD_PX)

    def _know(self, camera: Camera, pose: Pose) -> None:
        """Remember where the plane was in the first image, and how high it is."""
        ray = rays_from_pixels(camera, self._view.to_full(self._small_px[0]))
        down = ray @ matrix(pose.wxyz).T
        elevation_m = self._probes[0].elevation_m
        if self._ground is not None:
            hit = self._ground.meet(pose.position_enu_m, down, elevation_m)
            if hit.status:
                return
            elevation_m = float(hit.points_enu_m[2])
        elif not down[2] < -_LEAST_DOWN:
            return
        if pose.position_enu_m[2] > elevation_m:
            self._known = np.asarray(np.linalg.inv(self._on_plane(camera, pose, elevation_m))), elevation_m

    def _plane(self, camera: Camera, pose: Pose) -> FloatArray | None:
        """The homography since the first image that telemetry foretells; None before the plane is known."""
        if self._known is None or not pose.position_enu_m[2] > self._known[1]:
            return None
        return self._on_plane(camera, pose, self._known[1]) @ self._known[0]

    def _on_plane(self, camera: Camera, pose: Pose, elevation_m: float) -> FloatArray:
        """From east and north on a level plane to straight small pixels, ``(3, 3)``."""
        lens, scale = self._view.camera, camera.fx_px / self._camera.fx_px
        intrinsics = np.array([[lens.fx_px * scale, 0, lens.cx_px], [0, lens.fy_px * scale, lens.cy_px], [0, 0, 1.0]])
        plane = np.eye(3)
        plane[:, 2] = np.array([0.0, 0.0, elevation_m]) - pose.position_enu_m
        return np.asarray(intrinsics @ matrix(pose.wxyz).T @ plane)
