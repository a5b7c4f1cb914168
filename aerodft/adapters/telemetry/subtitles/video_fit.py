"""Whether subtitles and a video belong together: cue times against the video's images, FrameCnt and the drone's clock.

A cue's time is that of its image, and FrameCnt is not: it may start at 218 and skip. Both are evidence of whether the
video is the one that the drone wrote the cues for.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.images import VideoInfo
from aerodft.adapters.telemetry.subtitles.cues import Cue
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model import FloatArray, IntArray

_SLACK_S: Final = 1.0  # cues of the slowest dialects are 1 s apart; half of it refuses whole flights of a Mavic Pro
_CUES: Final = 1.5  # cue intervals by which cues may begin later or end earlier than the video
_CUES_ON_TIME: Final = 0.75
_SAME_RATE: Final = 0.02  # relative; the closest rates of cameras, 24 and 25 per second, differ by 0.04
_CLOCK_S: Final = 0.05  # of clocks in milliseconds; samples jitter by 0.01 s
_COARSE_CLOCK_S: Final = 1.0  # of clocks in whole seconds
_LAGS: Final = 5  # per video, of which one may hold a step
_STEP_S: Final = 2.0  # of the clock, or of FrameCnt, against cue times; samples stay below 0.6 s
_SAME_FOCAL: Final = 0.01  # relative; what rounds to other digits is no other camera
_MIN_CUES: Final = 3  # of a dialect: damaged cues look like others
_CUT_HINT: Final = (
    "take the video as the drone wrote it, or cut the subtitles as the video was cut (their times must count from its "
    "first image)"
)


def check_fits(media_ns: Sequence[int], cues: Sequence[Cue], info: VideoInfo, where: Path) -> list[str]:
    """Say what a video and its subtitles do not share.

    Args:
        media_ns: Time of each cue since the video's first image, ascending.
        cues: The cues.
        info: The video.
        where: The file of the subtitles.

    Returns:
        A sentence for each part of the video without cues.

    Raises:
        InputError: The cues go on beyond the video's end, or the video was slowed down or sped up.
    """
    if info.duration_ns is None:
        return []
    media_s, duration_s = np.array(media_ns) / SECOND_NS, info.duration_ns / SECOND_NS
    slack_s = max(_SLACK_S, _CUES * interval_s(media_ns))
    got = f"cues up to {media_s[-1]:.1f} s, and a video of {duration_s:.1f} s"
    if media_s[-1] > duration_s + slack_s:
        raise InputError("subtitles of another video, or of more than this one", where=where, got=got, hint=_CUT_HINT)
    short_s, late_s = duration_s - media_s[-1] - slack_s, media_s[0] - slack_s
    counted_s = _counted_s(media_s, cues)
    image_s = duration_s / info.images if info.images else counted_s
    if short_s > 0 and image_s and counted_s and abs(image_s / counted_s - 1) > _SAME_RATE:
        got += f"; by FrameCnt {1 / counted_s:.2f} images per second, in the video {1 / image_s:.2f}"
        raise InputError("the video does not run as its subtitles do", where=where, got=got, hint=_CUT_HINT)
    sentences = []
    if short_s > 0:
        sentences.append(f"the cues end {duration_s - media_s[-1]:.1f} s before the video: images there have no pose")
    if late_s > 0:
        sentences.append(f"the cues begin {media_s[0]:.1f} s after the video: images there have no pose")
    return sentences


def interval_s(media_ns: Sequence[int]) -> float:
    """Time between two cues (s) that three quarters of them keep, as two dialects may be in a file; 0 for one cue."""
    return float(np.quantile(np.diff(media_ns), _CUES_ON_TIME)) / SECOND_NS if len(media_ns) > 1 else 0.0


def check_one_camera(media_ns: Sequence[int], cues: Sequence[Cue], where: Path) -> None:
    """Refuse a video whose subtitles are of several cameras, one behind the other: a camera file is of one.

    Clips meet where FrameCnt starts again, or where one dialect ends and another begins. They are of one camera where
    cues on both sides state the same things, and the same focal length within 1 %.

    Raises:
        InputError: They are of several.
    """
    for k in sorted({*_restarts(cues).tolist(), *_dialect_changes(cues)}):
        before, behind = cues[:k], cues[k:]
        dialects = [Counter(map(_dialect, part)).most_common(1)[0][0] for part in (before, behind)]
        focal_mm = [np.median(known) if (known := _focal_mm(part)) else math.nan for part in (before, behind)]
        if dialects[0] != dialects[1] or abs(focal_mm[1] / focal_mm[0] - 1) > _SAME_FOCAL:
            said = [_words(dialect, each) for dialect, each in zip(dialects, focal_mm, strict=True)]
            raise InputError(
                "clips of several cameras were joined",
                where=where,
                got=f"{said[0]} up to {media_ns[k] / SECOND_NS:.1f} s, then {said[1]}",
                hint="import each clip as its own flight",
            )


def _dialect(cue: Cue) -> tuple[str, bool, bool]:
    """What a cue states: the word of its height, and whether it has angles of the camera and a focal length."""
    key = cue.height_key or ("altitude" if cue.altitude_m is not None else "")
    return key, cue.gimbal_deg is not None, cue.focal_mm is not None


def _words(dialect: tuple[str, bool, bool], focal_mm: float) -> str:
    key, has_angles, has_focal = dialect
    parts = (f"{key or 'no height'}", "camera angles" if has_angles else "", f"{focal_mm:g} mm" if has_focal else "")
    return " with ".join(filter(None, (parts[0], ", ".join(filter(None, parts[1:])))))


def _focal_mm(cues: Sequence[Cue]) -> list[float]:
    return [each.focal_mm for each in cues if each.focal_mm is not None]


def _dialect_changes(cues: Sequence[Cue]) -> list[int]:
    """Cues with which a word for heights begins after the one before it has ended; cues without one change nothing."""
    spans: dict[str, list[int]] = {}
    for k, cue in enumerate(cues):
        spans.setdefault(cue.height_key, []).append(k)
    spans.pop("", None)
    common = sorted((rows for rows in spans.values() if len(rows) >= _MIN_CUES), key=lambda rows: rows[0])
    return [rows[0] for before, rows in pairwise(common) if before[-1] < rows[0]]


def _restarts(cues: Sequence[Cue]) -> IntArray:
    """Cues ``(k,)`` whose FrameCnt is below that of the one before."""
    counts = _known([cue.count for cue in cues])
    has_count = np.flatnonzero(np.isfinite(counts))
    return has_count[1:][np.diff(counts[has_count]) < 0]


def joints(media_ns: Sequence[int], cues: Sequence[Cue]) -> Iterator[str]:
    """A sentence where the drone's clock does not run as the video, or clips were joined."""
    media_s, restarts = np.array(media_ns) / SECOND_NS, _restarts(cues)
    if len(restarts):
        yield f"FrameCnt starts again at {media_s[restarts[0]]:.1f} s: clips were joined, maybe of several cameras"
    clock_ns = [cue.clock_ns for cue in cues]
    has_clock = np.array([each is not None for each in clock_ns])
    if has_clock.sum() < 3 or len(restarts):  # noqa: PLR2004 - two have no median of differences
        return
    first_ns = next(each for each in clock_ns if each is not None)
    clock_s = _known([None if each is None else (each - first_ns) / SECOND_NS for each in clock_ns])[has_clock]
    media_s = media_s[has_clock]
    is_coarse = all(each % SECOND_NS == 0 for each in clock_ns if each is not None)
    lag = max(len(media_s) // _LAGS, 1)  # a step of the clock is in few of the differences, the median is in others
    apart_s = media_s[lag:] - media_s[:-lag]
    rate = float(np.median((clock_s[lag:] - clock_s[:-lag]) / apart_s))
    resolution_s = _COARSE_CLOCK_S if is_coarse else _CLOCK_S
    if abs(rate - 1) > _SAME_RATE + resolution_s / float(np.median(apart_s)):
        yield (
            f"the drone's clock runs {rate:.2f} times as fast as the video: slow motion, or a time-lapse; UTC is right "
            "in its middle alone, and speeds are those in the video"
        )
        return
    steps_s = np.diff(clock_s - media_s)
    for step in np.flatnonzero(np.abs(steps_s) > _STEP_S)[:1]:
        yield (
            f"the drone's clock steps by {steps_s[step]:+.1f} s at {media_s[step + 1]:.1f} s: clips were joined, and "
            "UTC is right for one of them alone"
        )


def _counted_s(media_s: FloatArray, cues: Sequence[Cue]) -> float | None:
    """Median time of an image by FrameCnt; None where cues do not count."""
    counts = _known([cue.count for cue in cues])
    has_count = np.isfinite(counts)
    step, apart_s = np.diff(counts[has_count]), np.diff(media_s[has_count])
    apart_s, step = apart_s[step > 0], step[step > 0]
    return float(np.sum(apart_s) / np.sum(step)) if len(step) else None


def _known(values: Sequence[float | None]) -> FloatArray:
    return np.array([np.nan if each is None else each for each in values])
