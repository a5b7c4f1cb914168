"""An iterated Kalman filter over the biases of a vehicle's telemetry, fed with one landmark's pixel at a time.

Beside the biases its state holds what would make it too sure of itself: the errors that are new in the current image
and shared by all landmarks in it, the surveyor's error of each landmark, and the lens's. The lens is considered, never
estimated (Schmidt): its errors are the camera file's, and the pose's correlation with them is kept.
"""

import math
from dataclasses import dataclass

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.intrinsics import intrinsics_covariance, reproject
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.camera import Camera
from aerodft.model.marker import SurveyedLandmark
from aerodft.model.pose_batch import PoseBatch
from calibration.live_model import BiasedPoses, BiasModel, propagated

_ITERATIONS = 6
_CURVED = 0.01
"""Of a sight's std: an error of linearisation that is not worth another iteration."""

_POSE = 6
_STRAY_PX = 50.0
"""How far off, about, an observation of something else is: what a tracker takes for the landmark is near it."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """One pixel that is said to be a landmark's.

    Attributes:
        image: The image's pose ``()``, by telemetry alone.
        landmark: The landmark.
        pixel: ``(2,)``.
        std_px: Of each coordinate.
    """

    image: BiasedPoses
    landmark: SurveyedLandmark
    pixel: FloatArray
    std_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Expectation:
    """A sight against the state.

    Attributes:
        px: ``(2,)`` observed minus expected; NaN where there is no view.
        cov_px2: ``(2, 2)`` of that.
        by_state: ``(2, n)`` of the expected pixel by the state.
    """

    px: FloatArray
    cov_px2: FloatArray
    by_state: FloatArray

    @property
    def chi2(self) -> float:
        """Squared distance in standard deviations; NaN where there is no view."""
        return float(self.px @ np.linalg.solve(self.cov_px2, self.px)) if np.all(np.isfinite(self.px)) else math.nan


class BiasFilter:
    """The state; a function of the sights that it was given, in their order.

    Args:
        model: The biases before anything was seen.
        camera: The camera.
        landmarks: All of them.
        outlier_share: Share of sights that are something else.
    """

    def __init__(
        self, model: BiasModel, camera: Camera, landmarks: tuple[SurveyedLandmark, ...], outlier_share: float
    ) -> None:
        self._model = model
        self._camera = camera
        self._landmarks = landmarks
        self._outlier_share = outlier_share
        lens = intrinsics_covariance(camera)
        uncertain = [each for each in landmarks if any(each.std_m)]
        biases = len(model.mean)
        self._biases = slice(0, biases)
        self._image = slice(biases, biases + _POSE)
        self._lens = slice(self._image.stop, self._image.stop + (len(lens) if np.any(lens) else 0))
        self._places = {each.name: slice(s, s + 3) for s, each in zip(_from(self._lens.stop), uncertain, strict=False)}
        self.restart()

    def restart(self) -> None:
        """Forget everything that was learned."""
        size = self._lens.stop + 3 * len(self._places)
        self._mean, self._cov = np.zeros(size), np.zeros((size, size))
        self._mean[self._biases], self._cov[self._biases, self._biases] = self._model.mean, self._model.cov
        if self._lens.stop > self._lens.start:
            self._cov[self._lens, self._lens] = intrinsics_covariance(self._camera)
        for each in self._landmarks:
            if each.name in self._places:
                place = self._places[each.name]
                self._cov[place, place] = np.diag(np.square(each.std_m))
        self._stamp_ns: int | None = None
        self._image_ns: int | None = None

    def biases(self, stamp_ns: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The biases at stamps ``(n,)``: mean ``(n, k)``, covariance ``(n, k, k)``, that with the lens ``(n, k, m)``.

        At a stamp before the last image's those of that image; ``m`` is 0 where the lens is exact.
        """
        left, returned = self._drifted(stamp_ns)
        mean = self._model.mean + left * (self._mean[self._biases] - self._model.mean)
        cov = left[:, :, None] * self._cov[self._biases, self._biases] * left[:, None]
        every = np.arange(cov.shape[-1])
        cov[:, every, every] += returned
        return mean, cov, left[:, :, None] * self._cov[self._biases, self._lens]

    def look(self, image: PoseBatch) -> BiasedPoses:
        """Go to an image: all that comes next is seen in it. An earlier one than the last is looked at from here.

        Args:
            image: Its pose by telemetry alone, in a batch of one.

        Returns:
            That pose ``()``.
        """
        stamp_ns, pose = int(image.stamp_ns[0]), self._model.biased(image).row(0)
        if self._stamp_ns is None or stamp_ns > self._stamp_ns:
            self._go_on(stamp_ns)
            self._stamp_ns = stamp_ns
        if stamp_ns == self._image_ns:
            return pose
        self._image_ns = stamp_ns
        biases = self._mean[self._biases]
        wxyz = pose.corrected(biases).wxyz
        noise = pose.noise_covariance(wxyz, self._model.noise_of(image.std[0], pose.height_column))
        if stamp_ns < self._stamp_ns:  # the biases of then are not quite those of now
            _, returned = self._model.drifted(np.array((self._stamp_ns - stamp_ns) / SECOND_NS))
            noise = noise + propagated(pose.by_biases(biases, wxyz), np.diag(returned))
        self._mean[self._image] = 0.0
        self._cov[self._image, :] = self._cov[:, self._image] = 0.0
        self._cov[self._image, self._image] = noise
        return pose

    def expect(self, sight: Sight) -> Expectation:
        """What a sight would be expected to be, against what it is."""
        seen, by = self._linearised(sight, self._mean)
        cov = by @ self._cov @ by.T + sight.std_px**2 * np.eye(2)
        return Expectation(sight.pixel - seen, cov, by)

    def learn(self, sight: Sight, expected: Expectation) -> None:
        """Follow a sight that was found credible, by how credible it is.

        A sight is mixed of what it teaches if it is the landmark and of nothing if it is not, by their probabilities.
        So as long as little is known, and something tens of pixels off would be believed, one sight does not make sure.

        Args:
            sight: The sight.
            expected: What was expected of it, just before.
        """
        trust, noise = self._trust(expected), sight.std_px**2 * np.eye(2)
        off, by, step = expected.px, expected.by_state, np.zeros_like(self._mean)
        for _ in range(_ITERATIONS):
            gain = self._cov @ by.T @ np.linalg.inv(by @ self._cov @ by.T + noise)
            gain[self._lens] = 0.0
            last, step = step, gain @ (off + by @ step)
            moved_px = float(np.max(np.abs(by @ (step - last))))
            if moved_px**2 / self._camera.fx_px < _CURVED * sight.std_px:
                break
            seen, by = self._linearised(sight, self._mean + step)
            off = sight.pixel - seen
            if not np.all(np.isfinite(off)):
                return  # the way there leads out of view: nothing to follow
        rest = np.eye(len(step)) - gain @ by
        taught = rest @ self._cov @ rest.T + gain @ noise @ gain.T
        mixed = trust * taught + (1 - trust) * self._cov + trust * (1 - trust) * np.outer(step, step)
        self._mean, self._cov = self._mean + trust * step, (mixed + mixed.T) / 2

    def _trust(self, expected: Expectation) -> float:
        """The probability that a sight is of its landmark."""
        stray = expected.cov_px2 + _STRAY_PX**2 * np.eye(2)
        good = (1 - self._outlier_share) * _density(expected.px, expected.cov_px2)
        bad = self._outlier_share * _density(expected.px, stray)
        return good / (good + bad)

    def _linearised(self, sight: Sight, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The landmark's pixel ``(2,)`` in a state ``(n,)``, and its derivative ``(2, n)`` by that."""
        biases = state[self._biases]
        pose = sight.image.corrected(biases, state[self._image])
        place, point = self._places.get(sight.landmark.name), np.array(sight.landmark.position_enu_m)
        if place is not None:
            point = point + state[place]
        seen = reproject(self._camera, pose.position_enu_m, matrix(pose.wxyz), point)
        by_pose = np.hstack([-seen.by_point, seen.by_rotation])
        by = np.zeros((2, len(state)))
        by[:, self._biases] = by_pose @ sight.image.by_biases(biases, pose.wxyz)
        by[:, self._image] = by_pose
        if self._lens.stop > self._lens.start:
            by[:, self._lens] = seen.by_intrinsics
        if place is not None:
            by[:, place] = seen.by_point
        return seen.pixels_px, by

    def _go_on(self, stamp_ns: int) -> None:
        """Bring the state to a later stamp."""
        (left,), (returned,) = self._drifted(np.array([stamp_ns]))
        self._mean[self._biases] = self._model.mean + left * (self._mean[self._biases] - self._model.mean)
        self._cov[self._biases, :] *= left[:, None]
        self._cov[:, self._biases] *= left
        self._cov[self._biases, self._biases] += np.diag(returned)

    def _drifted(self, stamp_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """As ``BiasModel.drifted`` at stamps ``(n,)``: nothing has drifted at one of the past."""
        since_ns = np.zeros_like(stamp_ns) if self._stamp_ns is None else np.maximum(stamp_ns - self._stamp_ns, 0)
        return self._model.drifted(since_ns / SECOND_NS)


def _from(start: int) -> range:
    """Starts of blocks of three."""
    return range(start, np.iinfo(np.int32).max, 3)


def _density(px: FloatArray, cov_px2: FloatArray) -> float:
    """Of a two-dimensional normal distribution."""
    return math.exp(-0.5 * float(px @ np.linalg.solve(cov_px2, px))) / math.sqrt(float(np.linalg.det(cov_px2)))
