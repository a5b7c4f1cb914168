"""Where in a log a video belongs: every offset and drift of a range, weighed by all image pairs at once.

For each image pair and each instant of the log, how well does the pair's homography agree with the camera's turn and
tilt then, whatever the camera's translation was? An offset with a drift is a straight line through that table; its
score is the sum along it. A pair's entry is its likelihood over its mean over the log, so that a pair that would fit
anywhere (a hover), or that lies outside the log, counts for nothing.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d

from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import FloatArray
from aerodft.vision.rotation import FREE, PlaneMotion
from calibration.sync_motion import CameraMotion, predicted

MAX_DRIFT = 0.03
"""Of clocks that are worth aligning, twice."""

_STEP_S = 0.05
_DRIFT_STEP = 0.0025
_MOST_PAIRS = 400
_RATE_STD_RADPS = 0.015  # of telemetry against the camera, in part because its lag is not quite known yet
_LAGS_S = (0.05, 0.175, 0.3)  # that are tried
_LEAST = np.exp(-8.0)  # likelihood of what cannot be: a pair may be wrong
_APART_S = 1.0  # peaks closer than this are one
_PEAKS = 2
_REACH = 2 * round(_APART_S / _STEP_S) + 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """A candidate: offset (s, at the reference), drift, lag (s), and its score (natural logarithm of the evidence)."""

    offset_s: float
    drift: float
    lag_s: float
    score: float


def search(motion: PlaneMotion, camera: CameraMotion, zero_ns: int, max_offset_s: float) -> tuple[Peak, ...]:
    """The best offset, and the best of those that are not near it, in descending order of score.

    Args:
        motion: ``n`` image pairs, stamped by the video's clock.
        camera: The log.
        zero_ns: The reference: offset is added there, drift counts from there; that of ``camera``.
        max_offset_s: Offsets of up to this, on both sides.
    """
    every = max(len(motion) // _MOST_PAIRS, 1)
    start_s, end_s = ((stamps[::every] - zero_ns) / SECOND_NS for stamps in (motion.start_ns, motion.end_ns))
    reach_s = max_offset_s + MAX_DRIFT * float(np.max(np.abs(start_s)))
    log_s = np.arange(start_s[0] - reach_s, start_s[-1] + reach_s + _STEP_S, _STEP_S)
    offsets = np.arange(-max_offset_s, max_offset_s + _STEP_S / 2, _STEP_S)
    drifts = np.arange(-MAX_DRIFT, MAX_DRIFT + _DRIFT_STEP / 2, _DRIFT_STEP)
    lags = _LAGS_S if camera.has_lag else (0.0,)
    scores = np.empty((len(lags), len(drifts), len(offsets)))
    pairs = np.arange(len(start_s))
    for layer, lag_s in enumerate(lags):
        table = _table(motion, every, camera, (log_s, end_s - start_s), lag_s)
        for row, drift in enumerate(drifts):
            at = np.rint((offsets[:, None] + (1 + drift) * start_s - log_s[0]) / _STEP_S).astype(np.int64)
            scores[layer, row] = table[pairs, np.clip(at, 0, len(log_s) - 1)].sum(axis=1)
    return _peaks(scores, offsets, drifts, lags)


def _table(
    motion: PlaneMotion, every: int, camera: CameraMotion, times: tuple[FloatArray, FloatArray], lag_s: float
) -> FloatArray:
    """``(pairs, instants)`` logarithms of likelihood over its mean; 0 where the log has nothing to say."""
    log_s, between_s = times
    typical_s = float(np.median(between_s))
    told = predicted(camera, log_s, log_s + typical_s, lag_s)
    rate, known = told.rotvec_rad / typical_s, told.known
    table = np.zeros((len(between_s), len(log_s)))
    if not np.any(known):
        return table
    for row, (homography, cov, step_s) in enumerate(
        zip(motion.homography[::every], motion.cov[::every], between_s, strict=True)
    ):
        misfit = _misfit(homography, cov, rate[known] * step_s, told.normal_cam[known], _RATE_STD_RADPS * step_s)
        likelihood = np.exp(-misfit / 2) + _LEAST
        table[row, known] = np.log(likelihood / likelihood.mean())
    return table


def _misfit(
    homography: FloatArray, cov: FloatArray, turn_rad: FloatArray, normal_cam: FloatArray, std_rad: float
) -> FloatArray:
    """Squared distance ``(m,)`` of one homography from those of turns and normals ``(m, 3)``, over all translations.

    First order in the turn and the translation.
    """
    by_turn = np.zeros((3, 3, 3))
    by_turn[1, 2, 0] = by_turn[2, 0, 1] = by_turn[0, 1, 2] = 1.0
    by_turn[2, 1, 0] = by_turn[0, 2, 1] = by_turn[1, 0, 2] = -1.0
    turning = by_turn.reshape(9, 3)[:FREE]
    information = np.linalg.inv(cov + std_rad**2 * turning @ turning.T)
    last = homography.ravel()[:FREE]
    off = last - np.eye(3).ravel()[:FREE] - turn_rad @ turning.T
    moving = np.zeros((len(normal_cam), 3, 3, 3))
    for axis in range(3):
        moving[:, axis, :, axis] = normal_cam
    moved = moving.reshape(-1, 9, 3)
    shifting = moved[:, :FREE] - last[:, None] * moved[:, FREE:]  # the last element stays 1
    weighted = np.swapaxes(shifting, -1, -2) @ information
    shift = np.linalg.solve(weighted @ shifting, weighted @ off[..., None])
    left = off - (shifting @ shift)[..., 0]
    return np.asarray(np.einsum("mi,ij,mj->m", left, information, left))


def _peaks(scores: FloatArray, offsets: FloatArray, drifts: FloatArray, lags: tuple[float, ...]) -> tuple[Peak, ...]:
    best = scores.max(axis=(0, 1))
    peaks: list[Peak] = []
    free = best >= maximum_filter1d(best, _REACH)  # a shoulder is no peak
    while np.any(free) and len(peaks) < _PEAKS:
        at = int(np.argmax(np.where(free, best, -np.inf)))
        lag, drift = np.unravel_index(int(np.argmax(scores[..., at])), scores.shape[:2])
        peaks.append(
            Peak(offset_s=float(offsets[at]), drift=float(drifts[drift]), lag_s=lags[int(lag)], score=float(best[at]))
        )
        free &= np.abs(offsets - offsets[at]) > _APART_S
    return tuple(peaks)
