"""State of a calibration of many images: shared unknowns and the errors of single images.

Telemetry gives the camera's track around each image's stamp; its stated standard deviations split into a shared error
and a new one in each image.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.dft import INTRINSICS, ROTATION
from aerodft.geometry import (
    from_rotation_vector,
    inverse,
    matrix,
    multiply,
    right_jacobian,
    skew,
    slerp,
    to_rotation_vector,
)
from aerodft.model import BIASES, Evidence, FloatArray, Pose, PoseStd, Prior
from aerodft.service import ErrorStd
from calibration.flight.biases import ORDER, TIME_OFFSET, BiasedPoses, excess_std
from calibration.pose import State, Unknowns

_MOTION_STEP_S = 0.02  # half step of the difference quotient of the motion: about an interval between two attitudes
_STDS = ("horizontal_m", "horizontal_m", "height_agl_m", "tilt_rad", "pan_rad", "roll_rad", "heading_rad")
_SHARED_STDS = {
    "height": "height_agl_m",
    "tilt": "tilt_rad",
    "roll": "roll_rad",
    "heading": "heading_rad",
    "pan": "pan_rad",
    "east": "horizontal_m",
    "north": "horizontal_m",
}
OWN: Final = 7
"""Errors that are new in each image: east, north, up, tilt, pan, roll, heading."""

_TIME = BIASES.index("time")


@dataclass(frozen=True, slots=True, eq=False)
class PoseTrack:
    """Poses before and after an image's stamp, interpolated in between.

    Attributes:
        offset_s: ``(k,)`` ascending, from the stamp; 0 is among them or between them.
        position_m: ``(k, 3)`` east, north, up.
        wxyz: ``(k, 4)`` from camera axes to east, north, up.
    """

    offset_s: FloatArray
    position_m: FloatArray
    wxyz: FloatArray

    @classmethod
    def at_constant_rates(cls, pose: Pose, reach_s: float) -> "PoseTrack":
        """Motion at constant rates through a pose, ``reach_s`` before and after; the pose alone for a reach of 0."""
        offset_s = np.array([-reach_s, 0.0, reach_s] if reach_s > 0 else [0.0])
        turns = from_rotation_vector(offset_s[:, None] * pose.rate_cam_radps)
        position_m = pose.position_enu_m + offset_s[:, None] * pose.velocity_enu_mps
        return cls(offset_s, position_m, multiply(pose.wxyz, turns))

    def at(self, offset_s: float) -> Pose:
        """Interpolate the pose at an offset from the stamp, with its motion.

        Raises:
            ValueError: Nothing is known of that time.
        """
        pose = self.pose(offset_s)
        first, last = float(self.offset_s[0]), float(self.offset_s[-1])
        before, after = max(offset_s - _MOTION_STEP_S, first), min(offset_s + _MOTION_STEP_S, last)
        if before == after:
            return pose
        start, end = self.pose(before), self.pose(after)
        turn = to_rotation_vector(multiply(inverse(start.wxyz), end.wxyz))
        velocity_enu_mps = (end.position_enu_m - start.position_enu_m) / (after - before)
        return replace(pose, velocity_enu_mps=velocity_enu_mps, rate_cam_radps=turn / (after - before))

    def pose(self, offset_s: float) -> Pose:
        """Interpolate the pose at an offset from the stamp, without its motion.

        Raises:
            ValueError: Nothing is known of that time.
        """
        first, last = float(self.offset_s[0]), float(self.offset_s[-1])
        if not first <= offset_s <= last:
            raise ValueError(f"got {offset_s:g} s, expected {first:g} to {last:g}")
        if len(self.offset_s) == 1:
            return Pose(position_enu_m=self.position_m[0], wxyz=self.wxyz[0])
        after = int(np.clip(np.searchsorted(self.offset_s, offset_s), 1, len(self.offset_s) - 1))
        low, high = self.offset_s[after - 1 : after + 1].tolist()
        weight = (offset_s - low) / (high - low)
        position = (1 - weight) * self.position_m[after - 1] + weight * self.position_m[after]
        return Pose(position_enu_m=position, wxyz=slerp(self.wxyz[after - 1], self.wxyz[after], weight))


def split_stds(
    stds: Sequence[PoseStd], share: float, noise: ErrorStd
) -> tuple[dict[str, Prior], tuple[FloatArray, ...]]:
    """Split stated stds into priors of the biases by name and the noise ``(7,)`` of each image.

    As in a live calibration, most of a stated error is one for the whole flight. The excess of an image's std over the
    best image's is noise of that image.

    Args:
        stds: Stated standard deviations of each image.
        share: Share of each std that is noise of every image.
        noise: Noise of single errors that replaces their share, in their own units.
    """
    best = {name: min(getattr(std, name) for std in stds) for name in set(_STDS)}
    shared = math.sqrt(1 - share**2)
    priors = {bias: Prior(value=0.0, std=shared * best[name]) for bias, name in _SHARED_STDS.items()}
    stated = {name: getattr(noise, name) for name in best}
    floor = {name: share * best[name] if std is None else std for name, std in stated.items()}
    return priors, tuple(
        np.array([math.hypot(floor[name], excess_std(getattr(std, name), best[name])) for name in _STDS])
        for std in stds
    )


def typical_noise(noises: Sequence[FloatArray]) -> PoseStd:
    """Median noise of the images, for an image of which no std is stated."""
    east, _, height, tilt, pan, roll, heading = np.median(noises, axis=0).tolist()
    return PoseStd(
        height_agl_m=height, horizontal_m=east, tilt_rad=tilt, pan_rad=pan, roll_rad=roll, heading_rad=heading
    )


@dataclass(frozen=True, slots=True, eq=False)
class ImageView:
    """Evidence, telemetry track and noise of one image.

    Attributes:
        name: Of the image.
        evidence: Observations in it.
        track: Telemetry poses around its stamp.
        noise: ``(7,)`` standard deviations of this image's own errors, m and rad; see ``OWN``.
    """

    name: str
    evidence: tuple[Evidence, ...]
    track: PoseTrack
    noise: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ImagesState:
    """Estimate of lens, ground, biases and the images' own errors.

    Attributes:
        base: Lens and ground, which all images share; its pose means nothing.
        biases: ``(8,)`` as ``BIASES``: metres, radians, seconds.
        own: ``(n, 7)`` own errors of each image, in its standard deviations; see ``OWN``.
    """

    base: State
    biases: FloatArray
    own: FloatArray

    def value(self, name: str) -> float:
        """Value of an unknown: metres, radians, seconds, pixels; distortion coefficients as they are."""
        return float(self.biases[BIASES.index(name)]) if name in BIASES else self.base.value(name)


@dataclass(frozen=True, slots=True)
class SharedUnknowns:
    """Unknowns that all images share.

    Attributes:
        names: Some of ``BIASES``, and of the lens and the ground, in the order of the solution.
    """

    names: tuple[str, ...]

    @property
    def lens(self) -> Unknowns:
        """Unknowns of the lens and the ground."""
        return Unknowns(tuple(name for name in self.names if name not in BIASES))

    def moved(self, state: ImagesState, step: FloatArray) -> ImagesState:
        """Apply a step of the shared unknowns ``(n,)``, followed by those of each image's own errors.

        Raises:
            ValueError: The step leads to an impossible camera.
        """
        count = len(self.names)
        shared = dict(zip(self.names, step[:count].tolist(), strict=True))
        lens = self.lens
        return replace(
            state,
            base=lens.moved(state.base, np.array([shared[name] for name in lens.names])) if lens.names else state.base,
            biases=state.biases + [shared.get(name, 0.0) for name in BIASES],
            own=state.own + step[count:].reshape(state.own.shape),
        )

    def to_shared(self, state: ImagesState) -> FloatArray:
        """Jacobian ``(8 + m, n)`` of biases and intrinsics by the shared unknowns."""
        count = len(BIASES)
        by = np.zeros((count + 4 + len(state.base.camera.distortion), len(self.names)))
        for column, name in enumerate(self.names):
            if name in BIASES:
                by[BIASES.index(name), column] = 1.0
        by[count:, self._columns(self.lens.names)] = self.lens.jac_unknowns(state.base)[INTRINSICS]
        return by

    def camera(self, state: ImagesState, index: int, view: ImageView) -> State:
        """Camera of one image.

        Args:
            state: The guess.
            index: Of the image.
            view: The image.

        Raises:
            ValueError: Telemetry says nothing of the time that its stamp was moved to.
        """
        return _image_camera(state, index, view, view.track.pose(float(state.biases[_TIME]))).camera

    def placed(self, state: ImagesState, index: int, view: ImageView) -> tuple[State, FloatArray]:
        """Camera of one image, and the Jacobian of the errors of ``dft.projection`` by the unknowns.

        Returns:
            The camera; ``(s, n + 7)`` by the ``n`` shared unknowns and by the image's own errors.

        Raises:
            ValueError: Telemetry says nothing of the time that its stamp was moved to.
        """
        found, count = _image_camera(state, index, view, view.track.at(float(state.biases[_TIME]))), len(self.names)
        by_bias = found.biased.by_biases_of_corrected_stamps(_biases_at_corrected_stamp(state), found.wxyz)
        by_bias[ROTATION] = found.by_bias_rotation @ by_bias[ROTATION]
        by = np.zeros((INTRINSICS.start + 4 + len(state.base.camera.distortion), count + OWN))
        biases = [name for name in self.names if name in BIASES]
        by[:6, self._columns(biases)] = by_bias[:, [ORDER.index(BIASES.index(name)) for name in biases]]
        if self.lens.names:
            by[:, self._columns(self.lens.names)] = self.lens.jac_unknowns(found.camera)
        by[:3, count : count + 3] = np.diag(view.noise[:3])
        by[ROTATION, count + 3 : -1] = found.by_own * view.noise[3:6]
        by[ROTATION, -1] = found.by_own @ found.down_cam * view.noise[6]
        return found.camera, by

    def _columns(self, names: Sequence[str]) -> list[int]:
        return [self.names.index(name) for name in names]


@dataclass(frozen=True, slots=True, eq=False)
class _ImageCamera:
    """Camera of one image with the intermediate values of its Jacobian.

    Attributes:
        camera: The camera.
        biased: Its pose by telemetry.
        wxyz: ``(4,)`` attitude without biases, before this image's own errors.
        down_cam: ``(3,)`` straight down, before this image's own errors.
        by_bias_rotation: ``(3, 3)`` Jacobian by a rotation before this image's own errors.
        by_own: ``(3, 3)`` Jacobian by the rotation vector of its own errors.
    """

    camera: State
    biased: BiasedPoses
    wxyz: FloatArray
    down_cam: FloatArray
    by_bias_rotation: FloatArray
    by_own: FloatArray


def _image_camera(state: ImagesState, index: int, view: ImageView, pose: Pose) -> _ImageCamera:
    """Correct a telemetry pose of an image to its camera."""
    own, biased = state.own[index] * view.noise, BiasedPoses.from_poses(pose, np.array(0))
    corrected = biased.corrected(_biases_at_corrected_stamp(state))
    down_cam = -matrix(corrected.wxyz)[2]
    own_rotation = own[3:6] + own[6] * down_cam
    rotation, by_own = from_rotation_vector(own_rotation), right_jacobian(own_rotation)
    camera = replace(state.base, position_m=corrected.position_enu_m + own[:3], wxyz=multiply(corrected.wxyz, rotation))
    by_bias_rotation = matrix(rotation).T + own[6] * by_own @ skew(down_cam)
    return _ImageCamera(camera, biased, corrected.wxyz, down_cam, by_bias_rotation, by_own)


def _biases_at_corrected_stamp(state: ImagesState) -> FloatArray:
    """Biases ``(8,)`` of a pose interpolated at its corrected stamp, in the order of ``biases``."""
    biases = state.biases[ORDER]
    biases[TIME_OFFSET] = 0.0
    return biases
