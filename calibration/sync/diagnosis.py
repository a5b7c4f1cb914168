"""Why a video and a log do not fit: a focal length, a mount, no turns to compare, or another flight."""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from aerodft.errors import NoAnswerError
from aerodft.model import FloatArray, GimbalSource
from aerodft.service import AttitudeSettings, FixedMount
from aerodft.service.attitude import AttitudeHistory
from aerodft.vision.camera_motion import PlaneMotion
from calibration.sync.fit import Peak, evidence_by_focal, search, with_focal
from calibration.sync.motion import CameraMotion

MIN_SCORE: Final = 30.0
"""Smallest evidence (natural logarithm) of an accepted offset."""

MAX_FOCAL_ERROR: Final = 0.05
"""Largest relative error of the focal length of an accepted alignment, or three times the stated std if that is more.

Views of wandering flights tell it to 2 %. Half would refuse cameras without distortion coefficients, twice would give
widths that are 10 % off."""

_FOCAL_STDS: Final = 3.0
_SCALES: Final = np.geomspace(0.5, 2.0, 41)  # 3.5 % apart
_COARSE_SCALES: Final = np.geomspace(0.5, 2.0, 15)  # 10 % apart: about half of the evidence is left 5 % off
_MOUNT_PITCHES_DEG: Final = (-90, -75, -60, -45, -30, -15, 0)
_MOUNT_YAWS_DEG: Final = (0, 90, 180, -90)
_MOST_PAIRS: Final = 60  # weighed for each of the guesses
_MIN_GAIN: Final = 2.0  # of the evidence by a guess over that of what is stated
_MIN_SCORE_PER_PAIR: Final = 1.0  # of a guess: right ones have 2.5, another flight's best 0.3
_MIN_TURN_RAD: Final = math.radians(3.0)  # root sum of squares over the pairs; a hover has 0.1, 45 s of wandering 19


def check_focal(motion: PlaneMotion, camera: CameraMotion, zero_ns: int, values: FloatArray, focal_std: float) -> None:
    """Refuse an alignment that fits another focal length much better.

    Args:
        motion: Image pairs, stamped by the video's clock.
        camera: The log.
        zero_ns: The reference.
        values: ``(3,)``: offset (s), drift, lag (s) of the alignment.
        focal_std: Stated standard deviation of the focal length over it.

    Raises:
        NoAnswerError: It does.
    """
    evidence = evidence_by_focal(motion, camera, zero_ns, values, _SCALES)
    best, stated = int(np.argmax(evidence)), len(_SCALES) // 2
    scale = float(_SCALES[best])
    if evidence[best] - evidence[stated] > MIN_SCORE and abs(scale - 1.0) > max(
        MAX_FOCAL_ERROR, _FOCAL_STDS * focal_std
    ):
        raise _focal_refusal(scale)


def _focal_refusal(scale: float) -> NoAnswerError:
    return NoAnswerError(
        "the camera file's focal length contradicts the log",
        got=f"turns in the images that fit a focal length {scale:.2f} times as long",
        expected=f"within {100 * MAX_FOCAL_ERROR:g} %, or three times its stated std",
        hint="check the camera, its mode and its zoom (`find_cameras`), or calibrate the lens (`calibrate_lens`)",
    )


def refusal(
    motion: PlaneMotion,
    camera: CameraMotion,
    history: AttitudeHistory,
    settings: AttitudeSettings,
    zero_ns: int,
    reach_s: tuple[float, float],
    best: Peak,
) -> NoAnswerError:
    """The reason why no offset has enough evidence.

    Args:
        motion: Image pairs, stamped by the video's clock.
        camera: The log.
        history: Its attitudes.
        settings: How they are read.
        zero_ns: The reference.
        reach_s: Largest offset, and how far from the reference attitudes are used.
        best: The best offset.
    """
    share = f"{max(best.score / MIN_SCORE, 0):.0%} of what tells an offset, at {best.offset_s:+.1f} s"
    if not _turned(motion):
        return NoAnswerError(
            "too little motion to tell",
            got=f"at best {share}",
            expected="100 % or more",
            hint="the gimbal or the vehicle must turn while the video runs",
        )
    max_offset_s, around_s = reach_s

    def score(guess: PlaneMotion, log: CameraMotion) -> float:
        return search(guess, log, zero_ns, max_offset_s, most_pairs=_MOST_PAIRS)[0].score

    stated = score(motion, camera)
    weighed = len(motion) / max(len(motion) // _MOST_PAIRS, 1)
    needed = max(_MIN_GAIN * stated, _MIN_SCORE_PER_PAIR * weighed)
    if not camera.has_lag and settings.fixed_mount is not None:
        mounts = [
            FixedMount(yaw_rad=math.radians(yaw), pitch_rad=math.radians(pitch), roll_rad=0.0)
            for pitch in _MOUNT_PITCHES_DEG
            for yaw in _MOUNT_YAWS_DEG
        ]
        logs = [CameraMotion(history, replace(settings, fixed_mount=each), zero_ns, around_s) for each in mounts]
        scores = [score(motion, log) for log in logs]
        if max(scores) > needed:
            return _mount_refusal(settings.fixed_mount, mounts[int(np.argmax(scores))])
    scores = [score(with_focal(motion, scale), camera) for scale in _COARSE_SCALES.tolist()]
    if max(scores) > needed:
        return _focal_refusal(float(_COARSE_SCALES[int(np.argmax(scores))]))
    has_mount = camera.source == GimbalSource.FIXED_MOUNT
    how = "telemetry.attitude.fixed_mount" if has_mount else "telemetry.attitude.frame"
    return NoAnswerError(
        "the turns in the video are not those of the log, or the video is not of this flight",
        got=f"at best {share}",
        expected="100 % or more",
        hint=f"see `max_offset_s`, `video_start_ns`; else check the camera file and {how}",
    )


def _mount_refusal(stated: FixedMount, fitting: FixedMount) -> NoAnswerError:
    def said(mount: FixedMount) -> str:
        return f"yaw {math.degrees(mount.yaw_rad):.0f}, pitch {math.degrees(mount.pitch_rad):.0f} deg"

    return NoAnswerError(
        "telemetry.attitude.fixed_mount contradicts the video",
        got=said(stated),
        expected=f"about {said(fitting)}, which the turns in the images fit",
        hint="state how the camera is mounted",
    )


def _turned(motion: PlaneMotion) -> bool:
    """Whether the images show that the camera turned, about its axis or to a side.

    The antisymmetric part of a homography is the turn, but for translations along the plane: those of one direction
    add up, turns of a gimbal do not, so the spread over the pairs counts.
    """
    skewed = (motion.homography - motion.homography.swapaxes(-1, -2)) / 2
    turns = np.stack([skewed[:, 2, 1], skewed[:, 0, 2], skewed[:, 1, 0]], axis=-1)
    spread = np.sqrt(np.sum(np.square(turns - np.median(turns, axis=0))))
    return bool(spread > _MIN_TURN_RAD)
