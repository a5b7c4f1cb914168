"""Aligning a video with a log by how the camera turned: offset and drift of their clocks, and the gimbal's lag."""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import tomli_w

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.config.station import StationConfig, Topics, VideoFile, load_station, stated_start_ns
from aerodft.adapters.images import VideoFileSource
from aerodft.adapters.telemetry import decoder_of
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.app import Progress, no_progress
from aerodft.app.assembly import check_size, open_telemetry_log
from aerodft.conventions import SECOND_NS
from aerodft.errors import ConfigError, NoAnswerError, UsageError
from aerodft.model import Camera
from aerodft.service import TelemetrySettings
from aerodft.service.attitude import AttitudeHistory, attitude_histories
from aerodft.version import SOFTWARE
from aerodft.vision.camera_motion import ImagePair, PlaneTracker
from calibration.sync import Alignment, check_overlap
from calibration.sync import align as align_rotations

MAX_OFFSET_LIMIT_S: Final = 600.0
DEFAULT_MAX_OFFSET_S: Final = 20.0  # chosen: a camera's clock that was set by hand; twice takes twice as long to search
_SIGMAS_95: Final = 1.96

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoAlignment:
    """A video's clock against a log's UTC, with the settings that follow from it, rounded as they are written.

    Attributes:
        video: The video.
        log: The log.
        start_ns: UTC stamp of the video's first image by its own clock, before the offset is added.
        seconds: Length of the video, by its own clock.
        pairs: How many pairs of images were compared.
        solution: Offset, drift and lag with their covariance, unrounded.
    """

    video: Path
    log: Path
    start_ns: int
    seconds: float
    pairs: int
    solution: Alignment

    @property
    def time_offset_s(self) -> float:
        """Seconds to add to a stamp at ``time_reference_ns``."""
        return round(self.solution.offset_s, 6)

    @property
    def time_drift(self) -> float:
        """Seconds to add per second since ``time_reference_ns``."""
        return round(self.solution.drift, 8)

    @property
    def time_reference_ns(self) -> int:
        """Stamp of the video's clock at which the offset holds."""
        return self.solution.reference_ns

    @property
    def time_std_s(self) -> float:
        """Standard deviation of the aligned stamps, the largest over the video.

        It replaces the std that a station states: the alignment measured the clock that the station guessed. Attitudes
        depend on offset less lag, positions on the offset; both are covered.
        """
        ends_s = (-self.seconds / 2, self.seconds / 2)
        solution = self.solution
        largest_s = max(max(solution.attitude_std_s(end_s), solution.position_std_s(end_s)) for end_s in ends_s)
        return math.ceil(largest_s * 1e4) / 1e4

    @property
    def delay_s(self) -> float:
        """The gimbal's lag."""
        return round(max(self.solution.lag_s, 0.0), 4)

    @property
    def lag_s(self) -> float | None:
        """Lag of the gimbal; None where the data do not tell."""
        return round(self.solution.lateness_s, 4) if self.solution.is_lag_determined else None

    @property
    def reasons(self) -> list[str]:
        """Sentences on how far the numbers can be relied on."""
        if not self.solution.is_lag_determined:
            sentence = (
                "the data do not tell the gimbal's lag from the clocks' offset: a typical lag is taken, and its"
                " uncertainty is part of the offset's; the camera's attitude is found all the same"
            )
            return [sentence]
        if self.solution.time_constant_s > self.solution.lag_s / 2:
            sentence = (
                "the camera sets off at once and catches up slowly (time constant"
                f" {self.solution.time_constant_s:.2f} s): the delay is the mean, and telemetry.attitude.lag_s allows"
                " for the rest"
            )
            return [sentence]
        return []

    def to_toml(self) -> str:
        """Lines of a station's file; with them its measurements are those of ``import --sync auto``."""
        images = {
            "video": str(self.video.absolute()),
            "start": unix_ns_to_iso(self.start_ns),
            "time_offset_s": self.time_offset_s,
            "time_drift": self.time_drift,
            "time_reference": unix_ns_to_iso(self.time_reference_ns),
            "time_std_s": self.time_std_s,
        }
        attitude = {"delay_s": self.delay_s} | ({} if self.lag_s is None else {"lag_s": self.lag_s})
        return tomli_w.dumps({"images": images, "telemetry": {"attitude": attitude}})

    def applied(self, station: StationConfig, telemetry: TelemetrySettings) -> StationConfig:
        """The station as if its file had the lines of ``to_toml``."""
        attitude = replace(telemetry.attitude, delay_ns=round(self.delay_s * SECOND_NS))
        if self.lag_s is not None:
            attitude = replace(attitude, lag_ns=round(self.lag_s * SECOND_NS))
        images = replace(
            station.images,
            source=VideoFile(path=self.video.absolute(), start_ns=self.start_ns),
            time_offset_s=self.time_offset_s,
            time_drift=self.time_drift,
            time_reference_ns=self.time_reference_ns,
            is_auto=False,
        )
        telemetry = replace(telemetry, attitude=attitude)
        pipeline = replace(station.pipeline, telemetry=telemetry, time_std_s=self.time_std_s)
        return replace(station, images=images, pipeline=pipeline)

    def to_dict(self) -> dict[str, Any]:
        """The JSON document of ``aerodft sync --json`` (``aerodft.sync/1``), without files written."""
        found = self.solution
        offset_std_s, drift_std, lag_std_s = found.stds.tolist()
        numbers: dict[str, float | list[float]] = {}
        for name, unit, value, std in (
            ("offset", "_s", found.offset_s, offset_std_s),
            ("drift", "", found.drift, drift_std),
            ("lag", "_s", found.lag_s, lag_std_s),
            ("attitude_offset", "_s", found.offset_s - found.lag_s, found.attitude_std_s()),
        ):
            numbers |= {f"{name}{unit}": value, f"{name}_std{unit}": std, f"{name}_ci95{unit}": interval95(value, std)}
        return {
            "schema": "aerodft.sync/1",
            "status": "ok",
            "video": str(self.video),
            "log": str(self.log),
            "video_start": unix_ns_to_iso(self.start_ns),
            "video_start_ns": str(self.start_ns),
            "source": str(found.source),
            "reference": unix_ns_to_iso(found.reference_ns),
            "reference_ns": str(found.reference_ns),
            **numbers,
            "lag_told": found.is_lag_determined,
            "time_constant_s": found.time_constant_s,
            "covariance": found.cov.tolist(),
            "peak_ratio": found.peak_ratio,
            "seconds": self.seconds,
            "pairs": self.pairs,
            "reasons": self.reasons,
            "config": self.to_toml(),
            "files": [],
            "software": SOFTWARE,
        }


def interval95(value: float, std: float) -> list[float]:
    """Lower and upper bound of the 95 % interval of a normal distribution."""
    return [value - _SIGMAS_95 * std, value + _SIGMAS_95 * std]


def align(  # noqa: PLR0913 - what a user may choose, by name
    video: str | Path,
    log: str | Path,
    *,
    station: str | Path | StationConfig | None = None,
    camera: str | Path | Camera | None = None,
    video_start_ns: int | None = None,
    max_offset_s: float = DEFAULT_MAX_OFFSET_S,
    topics: Topics | None = None,
    progress: Progress = no_progress,
) -> VideoAlignment:
    """Align a video with a log by how the camera turned.

    The ground is followed from image to image; how the camera turned is compared with what gimbal and vehicle report.

    Args:
        video: Video file.
        log: A log of any registered format, or an MCAP file with MAVLink, of the same flight.
        station: Station file, or a station: camera, and how attitudes are read; None where ``camera`` is given.
        camera: Camera file, or a camera, in place of the station's.
        video_start_ns: UTC of the video's first image; None for the station's, or the file's.
        max_offset_s: By how much that may be wrong, either way; above 0, at most 600 s.
        topics: Which topic of another tool's recording is what; None for the station's.
        progress: Called with nanoseconds of the video that were followed.

    Raises:
        ValueError: Neither a station nor a camera is given, or ``max_offset_s`` is out of range.
        ConfigError: The station has no telemetry, or a file is wrong.
        InputError: A file cannot be read, or images are of another size than the camera's.
        NoAnswerError: The camera hardly turns, or several offsets fit.

    Examples:
        >>> from aerodft import InputError, align
        >>> try:
        ...     align("missing.mp4", "samples/copter.tlog", camera="configs/cameras/demo-1080p.toml")
        ... except InputError as error:
        ...     print(error.where)
        missing.mp4
    """
    if station is None and camera is None:
        raise ValueError("align needs a station or a camera")
    if not 0 < max_offset_s <= MAX_OFFSET_LIMIT_S:
        raise ValueError(f"max_offset_s is {max_offset_s:g}, above 0 and at most {MAX_OFFSET_LIMIT_S:g} are possible")
    video, telemetry = Path(video), TelemetrySettings()
    if station is not None:
        where = "" if isinstance(station, StationConfig) else station
        station = station if isinstance(station, StationConfig) else load_station(Path(station))
        if station.pipeline.telemetry is None:
            raise ConfigError("the configuration has [pose]", where=where, expected="[telemetry]")
        telemetry = station.pipeline.telemetry
        camera, topics = camera or station.pipeline.camera, topics or station.topics
        if video_start_ns is None:
            video_start_ns = stated_start_ns(station.images.source, video)
    if not isinstance(camera, Camera):
        camera = load_camera(Path(str(camera)))
    source = VideoFileSource(video, start_ns=video_start_ns)
    return _aligned(source, Path(log), camera, telemetry, max_offset_s, topics, progress)


def aligned_station(
    station: StationConfig, log: Path | None, where: str, max_offset_s: float, progress: Progress = no_progress
) -> StationConfig:
    """The station with its video aligned with its log: offset, drift, delay, and how well they are known.

    Args:
        station: The station.
        log: Its log.
        where: Its file, for messages; empty where it was not read from one.
        max_offset_s: As in ``align``.
        progress: As in ``align``.

    Raises:
        UsageError: There is no log.
        ConfigError: There is no video, or a calibration states a time offset too.
        InputError: A file cannot be read.
        NoAnswerError: The camera hardly turns, or several offsets fit.
    """
    source, telemetry = station.images.source, station.pipeline.telemetry
    if log is None or telemetry is None:
        raise UsageError("nothing to align the video with", expected="a LOG, and [telemetry] in the configuration")
    if not isinstance(source, VideoFile):
        raise ConfigError("nothing to align", where=where, got="no video", expected="`video`, or images.video")
    if station.calibration is not None and station.calibration.bias.time_s:
        raise ConfigError(
            "two time offsets",
            where=where,
            got="one to be found, and one in the calibration",
            expected="one of them",
            hint="leave out the calibration, or the search for the offset (`sync`)",
        )
    found = align(
        source.path,
        log,
        station=station,
        video_start_ns=source.start_ns,
        max_offset_s=max_offset_s,
        progress=progress,
    )
    offset_s, drift, lag_s = found.solution.stds.tolist()
    _log.info(
        "%s: %+.3f s (std %.3f s) and %+.3f %% (std %.3f %%) off the log, the gimbal %.3f s late (std %.3f s)",
        *(found.video, found.solution.offset_s, offset_s, 100 * found.solution.drift, 100 * drift),
        *(found.solution.lag_s, lag_s),
    )
    for sentence in found.reasons:
        _log.info("%s", sentence)
    return found.applied(station, telemetry)


def _aligned(
    video: VideoFileSource,
    log: Path,
    camera: Camera,
    telemetry: TelemetrySettings,
    max_offset_s: float,
    topics: Topics | None,
    progress: Progress,
) -> VideoAlignment:
    """The alignment of an open video; see ``align``."""
    source, _ = open_telemetry_log(log, topics, telemetry)
    histories = attitude_histories(source, decoder_of(telemetry), telemetry.attitude)
    start_ns, end_ns = video.span_ns or (video.start_ns, video.start_ns)
    histories.sort(key=partial(_shared_ns, video_ns=(start_ns, end_ns), reach_ns=round(max_offset_s * SECOND_NS)))
    try:
        if end_ns > start_ns:
            check_overlap(histories[-1], (start_ns, end_ns), max_offset_s + (end_ns - start_ns) / SECOND_NS)
        focal_std = camera.std.focal_px / camera.fx_px
        pairs = _image_pairs(video, camera, lambda stamp_ns: progress(stamp_ns - start_ns, end_ns - start_ns))
        solution = _aligned_with_any(pairs, histories[::-1], telemetry, max_offset_s, focal_std)
    except NoAnswerError as error:
        where = f"{video.path} and {log}"
        raise NoAnswerError(error.what, where=where, got=error.got, expected=error.expected, hint=error.hint) from None
    seconds = (pairs[-1].end_ns - pairs[0].start_ns) / SECOND_NS
    return VideoAlignment(
        video=video.path,
        log=log,
        start_ns=video.start_ns,
        seconds=seconds,
        pairs=len(pairs),
        solution=solution,
    )


def _shared_ns(history: AttitudeHistory, *, video_ns: tuple[int, int], reach_ns: int) -> int:
    """How long attitudes and a video whose start may be wrong run together; negative where they are apart."""
    first_ns, last_ns = history.span_ns or (0, 0)
    return min(last_ns, video_ns[1] + reach_ns) - max(first_ns, video_ns[0] - reach_ns)


def _aligned_with_any(
    pairs: list[ImagePair],
    histories: list[AttitudeHistory],
    telemetry: TelemetrySettings,
    max_offset_s: float,
    focal_std: float,
) -> Alignment:
    """The alignment with the first stretch between reboots that has one.

    Raises:
        NoAnswerError: None has; why the first one has not.
    """
    refusal: NoAnswerError | None = None
    for history in histories:
        try:
            return align_rotations(pairs, history, telemetry.attitude, max_offset_s, focal_std)
        except NoAnswerError as error:
            refusal = refusal or error
    assert refusal is not None  # noqa: S101 - there is at least one history, for the type checker
    raise refusal


def _image_pairs(video: VideoFileSource, camera: Camera, reached: Callable[[int], None]) -> list[ImagePair]:
    """Pairs of images with the motion of the ground between them."""
    tracker = PlaneTracker(camera)
    for image in video.events():
        check_size(image, camera, video.path)
        if image.pixels is not None:
            tracker.add(image.stamp_ns, image.pixels)
        reached(image.stamp_ns)
    return tracker.pairs
