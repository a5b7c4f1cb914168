"""The images of a recording or a video with their poses, as many as a river is looked for in."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.config.station import StationConfig
from aerodft.adapters.files import looks_like
from aerodft.adapters.images import VideoFileSource, video_info
from aerodft.app import Progress
from aerodft.app.assembly import build_pipeline, check_size, reoffset, stations_of
from aerodft.app.measure import MeasuredSurface
from aerodft.conventions import SECOND_NS
from aerodft.dft import Setup, zoomed
from aerodft.errors import InputError, NoAnswerError
from aerodft.model import Event, Image, ImageArray, IntArray, PoseSample, Status
from aerodft.reports.river import RiverImages
from aerodft.service import MergedFeed, Source
from aerodft.vision.river import LATEST_S, SOONEST_S, LaterLook, RiverView, WaterPlane, motion_copy
from replay.recordings import Recording, RecordingSource

_WANTED: Final = "an image, a fixed camera's video, or a recording"
_LOGS: Final = {"a MAVLink .tlog": ".tlog", "an ArduPilot .bin log": ".bin"}
_NO_IMAGES: Final = frozenset({"text", "a ZIP archive", "a gzip archive", "a PDF document"})


def is_recording(path: Path) -> bool:
    """Whether a path is a recording, of a flight, rather than one image or a video.

    Raises:
        InputError: It is none of them.
    """
    if not path.exists():
        raise InputError("no such file", where=path, expected=_WANTED)
    if path.is_dir() and not any(path.glob("*.mcap")):
        hint = "`import_flight` makes a recording of a flight's log and `images`"
        raise InputError(
            "a folder without a recording", where=path, expected="an image, a video, a recording", hint=hint
        )
    kind = looks_like(path)
    if kind in _LOGS or path.suffix.lower() in _LOGS.values():
        hint = "`import_flight` makes a recording of a log and its `images` or `video`"
        raise InputError("a flight's log has no images", where=path, got=kind, expected=_WANTED, hint=hint)
    if kind in _NO_IMAGES:
        raise InputError("no image", where=path, got=kind, expected=_WANTED)
    return path.is_dir() or path.suffix.lower() == ".mcap"


def recorded_images(
    folder: Path, config: Path | None, calibration: Path | None, surface: MeasuredSurface, most: int
) -> RiverImages:
    """Images of a recording, evenly spread, with the poses that its telemetry gives them.

    Raises:
        InputError: There is no recording, or it lacks its configuration.
        NoAnswerError: No image was recorded, or none has a pose.
    """
    recording = Recording(folder)
    was, station = stations_of(recording, config, calibration)
    source = _PixelSource(reoffset(RecordingSource(recording, pixels=True), was, station))
    samples = list(_samples(station, source))
    if not source.pixels:
        hint = "record.image_hz says how many are kept; `import_flight` takes them as `video` or `images`"
        raise NoAnswerError("no images in the recording", where=folder, hint=hint)
    kept = [(index, sample) for index, sample in samples if index in source.pixels]
    without_pose = dict(Counter(str(sample.status) for _, sample in kept if sample.status is not Status.OK))
    settings = station.pipeline
    setup = surface.on(Setup(camera=settings.camera, max_range_m=settings.max_range_m, config_id=settings.config_id))
    posed = [(index, sample) for index, sample in kept if sample.status is Status.OK]
    if not posed:
        got = ", ".join(f"{count} {status}" for status, count in without_pose.items())
        raise NoAnswerError("no image has a pose", where=folder, got=got, hint="see `diagnose`")
    stamps = np.array([sample.stamp_ns for _, sample in posed])
    views = []
    for row in _rows(len(posed), most):
        (index, sample), after = posed[row], _soon_after(stamps, row)
        view = RiverView(index, *zoomed(setup, sample), source.pixels[index])
        if after is not None:
            then, pixels = zoomed(setup, posed[after][1]), source.pixels[posed[after][0]]
            view = replace(view, later=_later(view, *then, partial(_copied, pixels)))
        views.append(view)
    return RiverImages(tuple(views), len(kept), without_pose, is_utc=True)


def filmed_images(video: Path, setup: Setup, sample: PoseSample, most: int, progress: Progress) -> RiverImages:
    """Images of a fixed camera's video, evenly spread.

    Args:
        video: The video.
        setup: The camera, and the measured surface.
        sample: The camera's pose.
        most: How many images at the most.
        progress: Called with the seconds of the video that were read, twice; not where it does not say its length.

    Raises:
        InputError: The video cannot be read, or is not of the camera.
        NoAnswerError: It holds no image.
    """
    duration_ns = video_info(video).duration_ns
    length_s = 0 if duration_ns is None else duration_ns // SECOND_NS + 1

    def advance(seconds: int) -> None:
        if length_s:
            progress(seconds, 2 * length_s)

    stamps = [image.stamp_ns for image in _images(video, setup, advance)]
    if not stamps:
        raise NoAnswerError("no image in the video", where=video)
    after = {row: _soon_after(np.array(stamps), row) for row in _rows(len(stamps), most)}
    wanted = set(after.values())
    held, copies = {}, {}
    for row, image in enumerate(_images(video, setup, lambda seconds: advance(stamps[-1] // SECOND_NS + seconds))):
        if row in after or row in wanted:
            pixels = _held(image)
            if row in wanted:
                copies[row] = motion_copy(pixels())
            if row in after:
                held[row] = image, pixels
    views = []
    for row, (image, pixels) in held.items():
        later = after[row]
        view = RiverView(image.index, setup, replace(sample, stamp_ns=image.stamp_ns), pixels)
        if later is not None:
            then = replace(sample, stamp_ns=stamps[later])
            view = replace(view, later=_later(view, setup, then, partial(copies.__getitem__, later)))
        views.append(view)
    return RiverImages(tuple(views), len(stamps), {}, is_utc=False)


def _copied(pixels: Callable[[], ImageArray]) -> ImageArray:
    return motion_copy(pixels())


def _later(view: RiverView, setup: Setup, sample: PoseSample, copy: Callable[[], ImageArray]) -> LaterLook:
    """What a view shows when its place is seen again; ``copy`` reads the later image's ``motion_copy``."""
    assert sample.pose is not None  # noqa: S101 - images without a pose are not looked at, for the type checker
    plane = WaterPlane.from_setup(setup, sample.pose)
    return LaterLook(plane, copy, (sample.stamp_ns - view.sample.stamp_ns) / SECOND_NS)


def _soon_after(stamps_ns: IntArray, row: int) -> int | None:
    """The first image, of all with these stamps, that shows how water moves since another."""
    away_s = (stamps_ns - stamps_ns[row]) / SECOND_NS
    found = np.flatnonzero((away_s >= SOONEST_S) & (away_s <= LATEST_S))
    return int(found[0]) if len(found) else None


def _images(video: Path, setup: Setup, advance: Callable[[int], None]) -> Iterator[Image]:
    for row, event in enumerate(VideoFileSource(video, start_ns=0).events()):
        assert isinstance(event, Image)  # noqa: S101 - a video has nothing else, for the type checker
        if row == 0:
            check_size(event, setup.camera, video)
        advance(event.stamp_ns // SECOND_NS)
        yield event


def _held(image: Image) -> Callable[[], ImageArray]:
    """The pixels, read now: a video's images can be had in order only."""
    assert image.pixels is not None  # noqa: S101 - a video's images have pixels, for the type checker
    pixels: ImageArray = np.array(image.pixels())
    return lambda: pixels


class _PixelSource:
    """A source, and the pixels of the images that came from it.

    Attributes:
        pixels: By image.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self.pixels: dict[int, Callable[[], ImageArray]] = {}

    def events(self) -> Iterator[Event]:
        for event in self._source.events():
            if isinstance(event, Image) and event.pixels is not None:
                self.pixels[event.index] = event.pixels
            yield event


def _samples(station: StationConfig, source: Source) -> Iterator[tuple[int, PoseSample]]:
    """Every image's index and pose."""
    pipeline = build_pipeline(replace(station, pipeline=replace(station.pipeline, probes=())))
    feed = MergedFeed([source], station.pipeline.tick_ns)
    for outputs in (*map(pipeline.advance, feed.batches()), pipeline.finish()):
        for block in outputs.images:
            yield from zip(block.images.tolist(), block.poses, strict=True)


def _rows(count: int, most: int) -> list[int]:
    return sorted({round(row) for row in np.linspace(0, count - 1, min(count, most)).tolist()})
