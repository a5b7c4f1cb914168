"""Many images of one camera, as a calibration moves them: what they share, and what is new in each of them.

Telemetry says where the camera was around each image's stamp, and its stated standard deviations say what is shared
and what is new.
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
from calibration.flight.biases import ORDER, TIME_OFFSET, BiasedPoses, excess
from calibration.pose import State, Unknowns

_APART_S = 0.02  # over twice this, motion is seen as even: about an interval between two attitudes
_OWN = ("horizontal_m", "horizontal_m", "height_agl_m", "tilt_rad", "pan_rad", "roll_rad", "heading_rad")
_SHARED = {
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
    """Poses before and after an image's stamp; in between, they are interpolated.

    Attributes:
        offset_s: ``(k,)`` ascending, from the stamp; 0 is among them or between them.
        position_m: ``(k, 3)`` east, north, up.
        wxyz: ``(k, 4)`` from camera axes to east, north, up.
    """

    offset_s: FloatArray
    position_m: FloatArray
    wxyz: FloatArray

    @classmethod
    def steady(cls, pose: Pose, reach_s: float) -> "PoseTrack":
        """Even motion through a pose, for so long before and after it; with a reach of 0 the pose alone."""
        offset_s = np.array([-reach_s, 0.0, reach_s] if reach_s > 0 else [0.0])
        turns = from_rotation_vector(offset_s[:, None] * pose.rate_cam_radps)
        position_m = pose.position_enu_m + offset_s[:, None] * pose.velocity_enu_mps
        return cls(offset_s, position_m, multiply(pose.wxyz, turns))

    def at(self, offset_s: float) -> Pose:
        """The pose so long after the stamp, with its motion.

        Raises:
            ValueError: Nothing is known of that time.
        """
        pose = self.pose(offset_s)
        first, last = float(self.offset_s[0]), float(self.offset_s[-1])
        before, after = max(offset_s - _APART_S, first), min(offset_s + _APART_S, last)
        if before == after:
            return pose
        start, end = self.pose(before), self.pose(after)
        turn = to_rotation_vector(multiply(inverse(start.wxyz), end.wxyz))
        velocity_enu_mps = (end.position_enu_m - start.position_enu_m) / (after - before)
        return replace(pose, velocity_enu_mps=velocity_enu_mps, rate_cam_radps=turn / (after - before))

    def pose(self, offset_s: float) -> Pose:
        """The pose so long after the stamp, without its motion.

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


def shared_and_new(
    stds: Sequence[PoseStd], share: float, noise: ErrorStd
) -> tuple[dict[str, Prior], tuple[FloatArray, ...]]:
    """Priors of the biases by name, and for each image the standard deviations ``(7,)`` of what is new in it.

    As in a live calibration: most of what is stated is one error for the whole flight. What an image is stated to be
    worse than the best one is new in it.

    Args:
        stds: What is stated of each image.
        share: Of each, what is new in every image.
        noise: What is new in every image of single errors, in their own units.
    """
    best = {name: min(getattr(std, name) for std in stds) for name in set(_OWN)}
    shared = math.sqrt(1 - share**2)
    priors = {bias: Prior(value=0.0, std=shared * best[name]) for bias, name in _SHARED.items()}
    stated = {name: getattr(noise, name) for name in best}
    least = {name: share * best[name] if std is None else std for name, std in stated.items()}
    return priors, tuple(
        np.array([math.hypot(least[name], excess(getattr(std, name), best[name])) for name in _OWN]) for std in stds
    )


def typical_noise(noises: Sequence[FloatArray]) -> PoseStd:
    """What is new in an image of which nobody says more: the middle of what was stated."""
    east, _, height, tilt, pan, roll, heading = np.median(noises, axis=0).tolist()
    return PoseStd(
        height_agl_m=height, horizontal_m=east, tilt_rad=tilt, pan_rad=pan, roll_rad=roll, heading_rad=heading
    )


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One image.

    Attributes:
        name: Of the image.
        evidence: What is known in it.
        track: Where telemetry says that the camera was.
        noise: ``(7,)`` standard deviations of what is new in this image, m and rad; see ``OWN``.
    """

    name: str
    evidence: tuple[Evidence, ...]
    track: PoseTrack
    noise: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ImagesState:
    """One guess at everything.

    Attributes:
        base: Lens and ground, which all images share; its pose means nothing.
        biases: ``(8,)`` as ``BIASES``: metres, radians, seconds.
        own: ``(n, 7)`` what is new in each image, in its standard deviations; see ``OWN``.
    """

    base: State
    biases: FloatArray
    own: FloatArray

    def value(self, name: str) -> float:
        """An unknown's value: metres, radians, seconds, pixels; distortion coefficients as they are."""
        return float(self.biases[BIASES.index(name)]) if name in BIASES else self.base.value(name)


@dataclass(frozen=True, slots=True)
class SharedUnknowns:
    """What is solved for in all images at once.

    Attributes:
        names: Some of ``BIASES``, and of the lens and the ground, in the order of the solution.
    """

    names: tuple[str, ...]

    @property
    def lens(self) -> Unknowns:
        """Those of the lens and the ground."""
        return Unknowns(tuple(name for name in self.names if name not in BIASES))

    def moved(self, state: ImagesState, step: FloatArray) -> ImagesState:
        """The state after a step of the shared unknowns ``(n,)`` and then of what is new in each image.

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
        """``(8 + m, n)``: biases and intrinsics by the shared unknowns."""
        count = len(BIASES)
        by = np.zeros((count + 4 + len(state.base.camera.distortion), len(self.names)))
        for column, name in enumerate(self.names):
            if name in BIASES:
                by[BIASES.index(name), column] = 1.0
        by[count:, self._columns(self.lens.names)] = self.lens.by_unknowns(state.base)[INTRINSICS]
        return by

    def camera(self, state: ImagesState, index: int, view: View) -> State:
        """The camera of one image.

        Args:
            state: The guess.
            index: Of the image.
            view: The image.

        Raises:
            ValueError: Telemetry says nothing of the time that its stamp was moved to.
        """
        return _image_camera(state, index, view, view.track.pose(float(state.biases[_TIME]))).camera

    def placed(self, state: ImagesState, index: int, view: View) -> tuple[State, FloatArray]:
        """The camera of one image, and the errors of ``dft.projection`` by the unknowns.

        Returns:
            The camera; ``(s, n + 7)`` by the ``n`` shared unknowns and by what is new in the image.

        Raises:
            ValueError: Telemetry says nothing of the time that its stamp was moved to.
        """
        found, count = _image_camera(state, index, view, view.track.at(float(state.biases[_TIME]))), len(self.names)
        by_bias = found.biased.by_biases_of_corrected_stamps(_of_corrected_stamp(state), found.wxyz)
        by_bias[ROTATION] = found.back @ by_bias[ROTATION]
        by = np.zeros((INTRINSICS.start + 4 + len(state.base.camera.distortion), count + OWN))
        chosen = [name for name in self.names if name in BIASES]
        by[:6, self._columns(chosen)] = by_bias[:, [ORDER.index(BIASES.index(name)) for name in chosen]]
        if self.lens.names:
            by[:, self._columns(self.lens.names)] = self.lens.by_unknowns(found.camera)
        by[:3, count : count + 3] = np.diag(view.noise[:3])
        by[ROTATION, count + 3 : -1] = found.by_own * view.noise[3:6]
        by[ROTATION, -1] = found.by_own @ found.down_cam * view.noise[6]
        return found.camera, by

    def _columns(self, names: Sequence[str]) -> list[int]:
        return [self.names.index(name) for name in names]


@dataclass(frozen=True, slots=True, eq=False)
class _ImageCamera:
    """A camera, and what its derivatives need.

    Attributes:
        camera: The camera.
        biased: Its pose by telemetry.
        wxyz: ``(4,)`` that attitude without biases, before what is new in this image.
        down_cam: ``(3,)`` straight down, before what is new in this image.
        back: ``(3, 3)`` its turn by one before what is new.
        by_own: ``(3, 3)`` by the rotation vector of what is new.
    """

    camera: State
    biased: BiasedPoses
    wxyz: FloatArray
    down_cam: FloatArray
    back: FloatArray
    by_own: FloatArray


def _image_camera(state: ImagesState, index: int, view: View, pose: Pose) -> _ImageCamera:
    """The camera of an image where telemetry says ``pose``."""
    own, biased = state.own[index] * view.noise, BiasedPoses.from_poses(pose, np.array(0))
    corrected = biased.corrected(_of_corrected_stamp(state))
    down_cam = -matrix(corrected.wxyz)[2]
    new = own[3:6] + own[6] * down_cam
    last, by_own = from_rotation_vector(new), right_jacobian(new)
    camera = replace(state.base, position_m=corrected.position_enu_m + own[:3], wxyz=multiply(corrected.wxyz, last))
    back = matrix(last).T + own[6] * by_own @ skew(down_cam)
    return _ImageCamera(camera, biased, corrected.wxyz, down_cam, back, by_own)


def _of_corrected_stamp(state: ImagesState) -> FloatArray:
    """The biases ``(8,)`` of a pose that was looked up at its corrected stamp, in the order of ``biases``."""
    biases = state.biases[ORDER]
    biases[TIME_OFFSET] = 0.0
    return biases
