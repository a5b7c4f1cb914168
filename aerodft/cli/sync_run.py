"""From a video and a log to their alignment: what ``aerodft sync``, and ``import`` with ``auto``, do."""

from dataclasses import dataclass
from pathlib import Path

from aerodft.adapters.config.station import Topics
from aerodft.adapters.images import VideoFileSource
from aerodft.adapters.telemetry import decoder_of
from aerodft.app.assembly import check_size, open_telemetry_log
from aerodft.cli.output import progress_bar
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError
from aerodft.model import Camera
from aerodft.service import TelemetrySettings
from aerodft.service.attitude import attitude_history
from aerodft.vision.camera_motion import ImagePair, PlaneTracker
from calibration.sync import Alignment, align, check_overlap

DEFAULT_MAX_OFFSET_S = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SyncRun:
    """One alignment.

    Attributes:
        video: The video.
        log: The log.
        start_ns: The stamp of the video's first image, by its own clock.
        seconds: How long the video is, by its own clock.
        pairs: How many pairs of images were compared.
        alignment: What was found.
    """

    video: Path
    log: Path
    start_ns: int
    seconds: float
    pairs: int
    alignment: Alignment


def run_sync(
    video: VideoFileSource,
    log: Path,
    camera: Camera,
    telemetry: TelemetrySettings,
    max_offset_s: float,
    topics: Topics | None = None,
) -> SyncRun:
    """Align a video with a log.

    Args:
        video: The video, stamped by its own clock.
        log: The log.
        camera: The video's camera.
        telemetry: Which vehicle, and which of its attitudes, are believed.
        max_offset_s: How far off the video's stamps may be.
        topics: Where the log is another tool's recording: which of its topics is what.

    Raises:
        InputError: A file cannot be read, or images are of another size than the camera's.
        NoAnswerError: The data do not tell, see ``calibration.sync.align``.
    """
    source, _ = open_telemetry_log(log, topics)
    history = attitude_history(source, decoder_of(telemetry), telemetry.attitude)
    start_ns, end_ns = video.span_ns or (video.start_ns, video.start_ns)
    try:
        if end_ns > start_ns:
            check_overlap(history, (start_ns + end_ns) // 2, max_offset_s + (end_ns - start_ns) / SECOND_NS)
        pairs = _followed(video, camera)
        alignment = align(pairs, history, telemetry.attitude, max_offset_s)
    except NoAnswerError as error:
        where = f"{video.path} and {log}"
        raise NoAnswerError(error.what, where=where, got=error.got, expected=error.expected, hint=error.hint) from None
    seconds = (pairs[-1].end_ns - pairs[0].start_ns) / SECOND_NS
    return SyncRun(
        video=video.path,
        log=log,
        start_ns=video.start_ns,
        seconds=seconds,
        pairs=len(pairs),
        alignment=alignment,
    )


def _followed(video: VideoFileSource, camera: Camera) -> list[ImagePair]:
    tracker = PlaneTracker(camera)
    start_ns, end_ns = video.span_ns or (video.start_ns, video.start_ns)
    with progress_bar("following the ground", start_ns, end_ns) as progress:
        for image in video.events():
            check_size(image, camera, video.path)
            if image.pixels is not None:
                tracker.add(image.stamp_ns, image.pixels)
            progress(image.stamp_ns)
    return tracker.pairs
