"""Tracks of moving objects as measurements: places and speeds with their uncertainty, distances between objects.

A filter averages what is random from image to image; the camera's pose is off in the same way in all of them, and so is
an outline's edge. Both are added to what the filter knows, by how the place, the speed and the distance depend on them.
"""

import math
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.dft import (
    MAX_RELATIVE_RANGE_STD,
    Z95,
    GroundPoints,
    MeasurementBatch,
    MeasurementColumn,
    Request,
    Setup,
    ellipses95,
    lat_lon_alt,
    shared_covariance,
    single_image_batch,
    to_ground_frame,
    zoomed,
)
from aerodft.geometry import matrix, pixels_from_rays
from aerodft.model import FloatArray, Observation, PixelSource, Pose, PoseSample, Probe, ProbeKind, Status
from aerodft.service import ObjectSettings
from aerodft.vision.objects.ground_tracks import GroundTrack, GroundTracks, below_top, footprints, ground_at

_AHEAD_S: Final = 0.5  # over which a velocity's dependence on the pose is taken
_STILL_MPS: Final = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class _PlacedTrack:
    """A track in one image.

    Attributes:
        track: The track.
        pixel_px: ``(2,)`` of its place.
        enu_m: ``(3,)``.
        jac_shared: ``(3, s)`` derivative of the place by what all points share.
        velocity_jac_shared: ``(2, s)`` of the velocity.
        own_cov_m2: ``(3, 3)``, of the filter and of the outline.
    """

    track: GroundTrack
    pixel_px: FloatArray
    enu_m: FloatArray
    jac_shared: FloatArray
    velocity_jac_shared: FloatArray
    own_cov_m2: FloatArray


class ObjectTracks:
    """Implements ``service.ports.ObjectTracker``.

    Args:
        settings: How objects are followed.
    """

    def __init__(self, settings: ObjectSettings) -> None:
        self._settings = settings
        self._tracks = GroundTracks(settings)

    def follow(
        self, setup: Setup, sample: PoseSample, observations: tuple[Observation, ...], image: int | None
    ) -> MeasurementBatch | None:
        """Follow what is seen in the next image.

        Args:
            setup: The station's circumstances.
            sample: The image's pose.
            observations: Of its objects, one each, or one without anything.
            image: Its index, where it has one.

        Returns:
            The measurements of all objects; None where there are none, or the image is older than the last one.
        """
        pose = sample.pose
        if pose is None or sample.status is not Status.OK:
            nothing = MeasurementColumn.single("m/s", sample.status, sample.reasons)
            missed = [(_request(track.name, ProbeKind.TRACK, ()), nothing) for track in self._tracks.confirmed]
            return self._answers(setup, sample, image, missed)
        setup, sample = zoomed(setup, sample)
        below = partial(below_top, setup, pose)
        if not self._tracks.advance(sample.stamp_ns, footprints(setup, pose, observations), below, pose.position_enu_m):
            return None
        placed = [_placed(setup, pose, track, self._settings.std_px) for track in self._tracks.confirmed]
        gone = [track for track, at in zip(self._tracks.confirmed, placed, strict=True) if at is None]
        self._tracks.drop(gone)
        inside = [at for at in placed if at is not None]
        shared = shared_covariance(setup.camera, pose, setup.surface_std_m)
        found = [(self._track_request(at), _track_answer(at, sample, pose, shared)) for at in inside]
        pairs = [
            (one, other)
            for one, other in combinations(inside, 2)
            if np.linalg.norm((other.enu_m - one.enu_m)[:2]) <= self._settings.distances_within_m
        ]
        found += [(self._pair_request(pair), _distance_answer(pair, sample, pose, shared)) for pair in pairs]
        return self._answers(setup, sample, image, found)

    def _track_request(self, at: _PlacedTrack) -> Request:
        return _request(at.track.name, ProbeKind.TRACK, (at.pixel_px,), self._settings.std_px)

    def _pair_request(self, pair: tuple[_PlacedTrack, _PlacedTrack]) -> Request:
        name = "-".join(at.track.name for at in pair)
        return _request(name, ProbeKind.DISTANCE, (pair[0].pixel_px, pair[1].pixel_px), self._settings.std_px)

    def _answers(
        self, setup: Setup, sample: PoseSample, image: int | None, found: list[tuple[Request, MeasurementColumn]]
    ) -> MeasurementBatch | None:
        if not found:
            return None
        requests = tuple(request for request, _ in found)
        return single_image_batch(setup, sample, image, requests, tuple(column for _, column in found))


def _request(name: str, kind: ProbeKind, pixels: tuple[FloatArray, ...], std_px: float = 1.0) -> Request:
    probe = Probe(name=name, kind=kind, source=PixelSource.OBSERVED)
    return Request(probe=probe, pixels=tuple((u, v) for u, v in (each.tolist() for each in pixels)), std_px=std_px)


def _placed(setup: Setup, pose: Pose, track: GroundTrack, edge_std_px: float) -> _PlacedTrack | None:
    """A track where it is now; None where that is out of the image, or anywhere."""
    state = track.state
    places = np.stack([state.place_en_m, state.place_en_m + _AHEAD_S * state.velocity_en_mps])
    pixels = _pixels_of(setup, pose, places)
    ground = ground_at(setup, pose, pixels)
    if ground.status[0] or (track.hidden and _is_astray(ground, pose, state.cov[:2, :2])):
        return None
    jac_px = ground.jac_px[0]
    level = jac_px @ np.linalg.inv(jac_px[:2])  # from a step on the map to one on the ground
    own = level @ state.cov[:2, :2] @ level.T + jac_px @ jac_px.T * edge_std_px**2
    turn = (ground.jac_shared[1, :2] - ground.jac_shared[0, :2]) / _AHEAD_S
    if not np.all(np.isfinite(turn)):
        turn = np.zeros_like(turn)
    enu = np.append(state.place_en_m, ground.points_enu_m[0, 2])
    return _PlacedTrack(track, pixels[0], enu, ground.jac_shared[0], turn, own)


def _is_astray(ground: GroundPoints, pose: Pose, cov_m2: FloatArray) -> bool:
    """Whether what is not seen may be anywhere by now."""
    range_m = float(np.linalg.norm(ground.points_enu_m[0] - pose.position_enu_m))
    return not math.sqrt(max(np.linalg.eigvalsh(cov_m2))) <= MAX_RELATIVE_RANGE_STD * range_m


def _pixels_of(setup: Setup, pose: Pose, places_en_m: FloatArray) -> FloatArray:
    """Pixels ``(k, 2)`` of places ``(k, 2)`` on the measured ground."""
    up = np.zeros(len(places_en_m)) if setup.ground is None else setup.ground.height_at(places_en_m)
    points = np.column_stack([places_en_m, up + setup.elevation_m])
    return pixels_from_rays(setup.camera, (points - pose.position_enu_m) @ matrix(pose.wxyz))


def _track_answer(at: _PlacedTrack, sample: PoseSample, pose: Pose, shared: FloatArray) -> MeasurementColumn:
    velocity = at.track.state.velocity_en_mps
    speed = float(np.linalg.norm(velocity))
    cov = at.track.state.cov[2:, 2:] + at.velocity_jac_shared @ shared @ at.velocity_jac_shared.T
    along = velocity / speed if speed > _STILL_MPS else np.array([1.0, 0.0])
    std = math.sqrt(max(float(along @ cov @ along), 0.0))
    cov_enu = at.own_cov_m2 + at.jac_shared @ shared @ at.jac_shared.T
    range_m = float(np.linalg.norm(at.enu_m - pose.position_enu_m))
    if not math.sqrt(max(np.linalg.eigvalsh(cov_enu))) <= MAX_RELATIVE_RANGE_STD * range_m:
        sentence = f"{at.track.name} is {range_m:.1f} m away: too near the horizon for a place"
        return MeasurementColumn.single("m/s", Status.ILL_CONDITIONED, (sentence,))
    numbers = {"ellipse95": ellipses95(cov_enu), **_places(sample, pose, at.enu_m[None], cov_enu)}
    return _column("m/s", sample, at.track, numbers, (speed, std))


def _distance_answer(
    pair: tuple[_PlacedTrack, _PlacedTrack], sample: PoseSample, pose: Pose, shared: FloatArray
) -> MeasurementColumn:
    """Distance of two points; shared errors enter by the difference of the points' dependence on them."""
    first, second = pair
    apart = (second.enu_m - first.enu_m)[:2]
    distance = float(np.linalg.norm(apart))
    along = apart / distance if distance > 0 else np.array([1.0, 0.0])
    by = along @ (second.jac_shared - first.jac_shared)[:2]
    own = first.own_cov_m2[:2, :2] + second.own_cov_m2[:2, :2]
    std = math.sqrt(max(float(by @ shared @ by + along @ own @ along), 0.0))
    hidden = next((at.track for at in pair if at.track.hidden), first.track)
    cov_enu = first.own_cov_m2 + first.jac_shared @ shared @ first.jac_shared.T
    numbers = _places(sample, pose, np.stack([first.enu_m, second.enu_m]), cov_enu)
    return _column("m", sample, hidden, numbers, (distance, std))


def _column(
    unit: str, sample: PoseSample, track: GroundTrack, numbers: dict[str, FloatArray], scalar: tuple[float, float]
) -> MeasurementColumn:
    """A value with its standard deviation and places; what is hidden has places alone."""
    if track.hidden:
        since_s = (sample.stamp_ns - track.seen_ns) / SECOND_NS
        reasons = (f"{track.name}: {track.hidden} for {since_s:.1f} s", *sample.reasons)
        return MeasurementColumn.single(unit, Status.OCCLUDED, reasons, numbers)
    value, std = scalar
    ends = np.array([max(value - Z95 * std, 0.0), value + Z95 * std])
    numbers |= {"value": np.array(value), "std": np.array(std), "ci95": ends}
    return MeasurementColumn.single(unit, Status.OK, sample.reasons, numbers)


def _places(sample: PoseSample, pose: Pose, enu_m: FloatArray, cov_enu_m2: FloatArray) -> dict[str, FloatArray]:
    """Numbers of places ``(k, 3)``; ups that count from the measured plane are reported from the station's 0."""
    station_m = enu_m + [0.0, 0.0, sample.plane_elevation_m]
    if sample.level is not None and sample.level.is_height_own:
        cov_enu_m2 = cov_enu_m2 + np.diag([0.0, 0.0, sample.level.std_m**2])
    numbers = {
        "ground_m": to_ground_frame(pose, enu_m),
        "enu_m": station_m,
        "cov_enu_m2": cov_enu_m2,
        "range_m": np.linalg.norm(enu_m - pose.position_enu_m, axis=-1),
    }
    return numbers if sample.origin is None else {**numbers, "geo": lat_lon_alt(sample.origin, station_m)}
