"""Observations by an ideal observer: true pixels of banks and landmarks, and the same with noise."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from aerodft.geometry import camera_angles, in_image, inverse, matrix, pixels_from_rays
from aerodft.model import BoolArray, Camera, FloatArray, IntArray, Pose, ProbeKind
from aerodft.sim.trajectory import Trajectory
from aerodft.sim.world import World

MARGIN_PX = 4.0
"""Points closer to the image's border are not observed."""
MAX_RANGE_M = 120.0
_MIN_HEIGHT_M = 1.0
_STATION_STEP_M = 1.0
_STATION_REACH_M = 400.0
_MIN_SPACING_M = 15.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ObserverModel:
    """Model of the observer: range, noise and river stations.

    Attributes:
        std_px: Standard deviation of every coordinate.
        max_range_m: Maximum range of observed points: farther ones cannot be picked to ``std_px``.
        stations_m: River stations of the probes ``width-a``, ``width-b``, ...; see :func:`most_visible_stations`.
        seed: Seed of the noise.
    """

    std_px: float = 0.5
    max_range_m: float = MAX_RANGE_M
    stations_m: tuple[float, ...] = ()
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sighting:
    """True and observed pixels of one probe in one image.

    Attributes:
        stamp_ns: The image's stamp.
        name: The probe's name.
        kind: The probe's kind.
        points_enu_m: ``(k, 3)`` true points.
        pixels: ``(k, 2)`` true pixels.
        observed: ``(k, 2)`` pixels with noise.
        std_px: Standard deviation of the noise.
        pose: The camera's true pose.
    """

    stamp_ns: int
    name: str
    kind: ProbeKind
    points_enu_m: FloatArray
    pixels: FloatArray
    observed: FloatArray
    std_px: float
    pose: Pose

    @property
    def value_m(self) -> float | None:
        """Distance between the two points; None for a single point."""
        if self.kind != ProbeKind.DISTANCE:
            return None
        return float(np.linalg.norm(self.points_enu_m[1] - self.points_enu_m[0]))

    def observation_line(self) -> bytes:
        """JSON line for an observation file or topic."""
        return orjson.dumps(
            {
                "stamp_ns": str(self.stamp_ns),
                "name": self.name,
                "pixels": self.observed.tolist(),
                "std_px": self.std_px,
            }
        )

    def truth_line(self) -> bytes:
        """JSON line for the truth file."""
        return orjson.dumps(
            {
                "stamp_ns": str(self.stamp_ns),
                "name": self.name,
                "kind": str(self.kind),
                "value": self.value_m,
                "unit": "m",
                "pixels": self.pixels.tolist(),
                "enu_m": self.points_enu_m.tolist(),
                "pose": pose_document(self.pose),
            }
        )


def pose_document(pose: Pose) -> dict[str, Any]:
    """A true pose as angles in degrees and as a quaternion."""
    tilt, roll, heading = (math.degrees(float(angle)) for angle in camera_angles(pose.wxyz))
    return {
        "position_enu_m": pose.position_enu_m.tolist(),
        "enu_wxyz_cam": pose.wxyz.tolist(),
        "height_agl_m": float(pose.position_enu_m[2]),
        "tilt_deg": tilt,
        "roll_deg": roll,
        "heading_deg": heading,
    }


def pixels_of(camera: Camera, pose: Pose, points_enu_m: FloatArray) -> FloatArray:
    """Pixels ``(..., 2)`` of points ``(..., 3)``; NaN behind the camera and beyond the lens model."""
    return pixels_from_rays(camera, (points_enu_m - pose.position_enu_m) @ matrix(inverse(pose.wxyz)).T)


def most_visible_stations(
    world: World, camera: Camera, trajectory: Trajectory, stamps_ns: IntArray, count: int
) -> tuple[float, ...]:
    """The ``count`` river stations (15 m or more apart) with both banks in the most images, ascending."""
    stations = np.arange(-_STATION_REACH_M, _STATION_REACH_M, 5 * _STATION_STEP_M)
    banks, visible_images = world.river.crossing(stations), np.zeros(len(stations))
    for stamp in stamps_ns.tolist():
        pose = trajectory.pose(stamp)
        if pose.position_enu_m[2] > _MIN_HEIGHT_M:
            visible_images += _observable(camera, pose, banks, ObserverModel()).all(axis=-1)
    chosen: list[float] = []
    for index in np.argsort(-visible_images, kind="stable"):
        station = float(stations[index])
        if len(chosen) < count and visible_images[index] and all(abs(station - s) >= _MIN_SPACING_M for s in chosen):
            chosen.append(station)
    return tuple(sorted(chosen))


def sightings(
    world: World, camera: Camera, trajectory: Trajectory, stamps_ns: Iterable[int], observing: ObserverModel
) -> Iterator[Sighting]:
    """Sightings at the images' stamps, in order; none from below 1 m.

    ``width-a``, ... are the river's width at fixed stations; ``river`` is its width at the image's middle, at another
    station in every image; ``marker-N`` the centre of a marker, ``post-N`` the foot of a post, ``walker-N`` feet.
    """
    generator = np.random.default_rng([observing.seed, 3])
    fixed = _fixed_targets(world, observing)
    stations = np.arange(-_STATION_REACH_M, _STATION_REACH_M, _STATION_STEP_M)
    banks = world.river.crossing(stations)
    for stamp in stamps_ns:
        pose = trajectory.pose(stamp)
        if pose.position_enu_m[2] <= _MIN_HEIGHT_M:
            continue
        time_s = (stamp - trajectory.start_ns) / 1e9
        targets = dict(fixed)
        central = _central_crossing(camera, pose, banks, observing)
        if central is not None:
            targets["river"] = banks[central]
        targets |= {f"walker-{i}": walker.foot_enu_m(time_s)[None] for i, walker in enumerate(world.walkers)}
        for name, points in targets.items():
            if not _observable(camera, pose, points, observing).all():
                continue
            pixels = pixels_of(camera, pose, points)
            yield Sighting(
                stamp_ns=stamp,
                name=name,
                kind=ProbeKind.DISTANCE if len(points) > 1 else ProbeKind.POSITION,
                points_enu_m=points,
                pixels=pixels,
                observed=pixels + observing.std_px * generator.standard_normal(pixels.shape),
                std_px=observing.std_px,
                pose=pose,
            )


def write_lines(path: Path, lines: Iterable[bytes]) -> None:
    """Write JSON lines."""
    with path.open("wb") as file:
        file.writelines(line + b"\n" for line in lines)


def _fixed_targets(world: World, observing: ObserverModel) -> dict[str, FloatArray]:
    targets = {
        f"width-{chr(ord('a') + index)}": world.river.crossing(station)
        for index, station in enumerate(observing.stations_m)
    }
    return targets | {name: point[None] for name, point in world.landmarks_enu_m().items()}


def _observable(camera: Camera, pose: Pose, points_enu_m: FloatArray, observing: ObserverModel) -> BoolArray:
    """Whether points ``(..., 3)`` are in the image, off its border, and in range, ``(...)``."""
    is_near = np.linalg.norm(points_enu_m - pose.position_enu_m, axis=-1) <= observing.max_range_m
    return np.asarray(is_near & in_image(camera, pixels_of(camera, pose, points_enu_m), MARGIN_PX))


def _central_crossing(camera: Camera, pose: Pose, banks_enu_m: FloatArray, observing: ObserverModel) -> int | None:
    """Index of the observable crossing ``(n, 2, 3)`` closest to the image's middle; None if none is observable."""
    is_visible = _observable(camera, pose, banks_enu_m, observing).all(axis=-1)
    if not is_visible.any():
        return None
    middle = np.array([camera.width_px - 1, camera.height_px - 1]) / 2
    distance_px = np.linalg.norm(pixels_of(camera, pose, banks_enu_m).mean(axis=-2) - middle, axis=-1)
    return int(np.argmin(np.where(is_visible, distance_px, np.inf)))
