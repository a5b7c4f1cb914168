"""Whether subtitles and a video belong together: cue times against the video's images, FrameCnt and the drone's clock.

A cue's time is that of its image, and FrameCnt is not: it may start at 218 and skip. Both are evidence of whether the
video is the one that the drone wrote the cues for.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.images import VideoInfo
from aerodft.adapters.telemetry.subtitles.cues import Cue
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model import FloatArray

_SLACK_S: Final = 1.0  # cues of the slowest dialects are 1 s apart; half of it refuses whole flights of a Mavic Pro
_CUES: Final = 1.5  # cue intervals by which cues may begin later or end earlier than the video
_CUES_ON_TIME: Final = 0.75
_SAME_RATE: Final = 0.02  # relative; the closest rates of cameras, 24 and 25 per second, differ by 0.04
_CLOCK_S: Final = 0.05  # of clocks in milliseconds; samples jitter by 0.01 s
_COARSE_CLOCK_S: Final = 1.0  # of clocks in whole seconds
_LAGS: Final = 5  # per video, of which one may hold a step
_STEP_S: Final = 2.0  # of the clock, or of FrameCnt, against cue times; samples stay below 0.6 s
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


def joints(media_ns: Sequence[int], cues: Sequence[Cue]) -> Iterator[str]:
    """A sentence where the drone's clock does not run as the video, or clips were joined."""
    media_s = np.array(media_ns) / SECOND_NS
    counts = _known([cue.count for cue in cues])
    has_count = np.flatnonzero(np.isfinite(counts))
    restarts = has_count[1:][np.diff(counts[has_count]) < 0]
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
