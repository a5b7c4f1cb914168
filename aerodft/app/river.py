"""A river's width along it, from one image with a known pose, a recording or a fixed camera's video."""

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from aerodft.adapters.config.station import NO_SETTINGS, Settings, StationConfig
from aerodft.adapters.files import looks_like
from aerodft.adapters.images import STILLS, VIDEO_SUFFIXES, VideoFileSource, read_camera_image, video_info
from aerodft.app import Progress, no_progress
from aerodft.app.assembly import build_pipeline, check_size, reoffset, stations_of
from aerodft.app.measure import CameraPose, MeasuredSurface, image_setup, in_range, read_photograph
from aerodft.conventions import LARGEST, SECOND_NS
from aerodft.dft import Setup, zoomed
from aerodft.errors import InputError, NoAnswerError, Reason, UsageError
from aerodft.model import Camera, Event, Image, ImageArray, IntArray, PoseSample, Status
from aerodft.reports.river import (
    COLUMNS,
    RiverImages,
    contradiction_refusal,
    reach_document,
    refusal_document,
    river_document,
    transect_map,
    transect_rows,
    write_reach,
    write_river,
)
from aerodft.service import MergedFeed, Source
from aerodft.vision.river import (
    LATEST_S,
    SOONEST_S,
    LaterLook,
    NoRiver,
    Reach,
    River,
    RiverHints,
    RiverQuestion,
    RiverView,
    WaterNetwork,
    WaterPlane,
    find_river,
    measure_reach,
    motion_copy,
)
from replay.recordings import Recording, RecordingSource

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

MOST_IMAGES: Final = 60
"""Images of a recording or a video that are looked at by default."""

_WANTED: Final = "an image, a fixed camera's video, or a recording"
_LOGS: Final = {"a MAVLink .tlog": ".tlog", "an ArduPilot .bin log": ".bin", "a PX4 .ulg log": ".ulg"}
_NO_IMAGES: Final = frozenset({"text", "a ZIP archive", "a gzip archive", "a PDF document"})


@dataclass(frozen=True, slots=True)
class Transects:
    """The lines across a river, with what each came to.

    Attributes:
        document: The survey's.
        sample: Whose place the ends are from.
    """

    document: dict[str, Any]
    sample: PoseSample

    def __len__(self) -> int:
        return len(self.document["transects"])

    def rows(self) -> list[dict[str, Any]]:
        """A row for each, as in ``transects.csv``: station, status, width, std, 95 % and ends; None for unknown."""
        return transect_rows(self.document)

    def to_geojson(self) -> dict[str, Any]:
        """The measured ones as GeoJSON lines from bank to bank, with their rows as properties.

        Where the camera's place is not known there is no GeoJSON: it is a document of schema
        ``aerodft.river_local/1``, with east and north of the camera's foot in metres.
        """
        return transect_map(self.document, self.sample)

    def to_geopandas(self) -> "GeoDataFrame":
        """The measured ones as a GeoDataFrame, in WGS84 where the camera's place is known.

        Raises:
            InputError: geopandas is not installed.
        """
        try:
            from geopandas import GeoDataFrame  # an extra
        except ImportError:
            hint = 'pip install "aerodft[geo]"; rows() and to_geojson() need nothing'
            raise InputError("geopandas is not installed", hint=hint) from None
        crs = None if self.sample.origin is None else "EPSG:4326"
        return GeoDataFrame.from_features(self.to_geojson()["features"], crs=crs, columns=["geometry", *COLUMNS])


@dataclass(frozen=True, slots=True, repr=False)
class RiverSurvey:
    """What a river's width came to.

    Attributes:
        document: The JSON document (schema ``aerodft.river/1``).
        found: The river, or why there is none.
        images: What was looked at; None for one image alone.
        view: The first view, whose place positions are from.
    """

    document: dict[str, Any]
    found: River | Reach | NoRiver
    images: RiverImages | None
    view: RiverView

    def __repr__(self) -> str:
        """What a console shows: not the megabytes of images and masks."""
        width = "" if self.width_m is None else f", {self.width_m['median']:.2f} m in the median"
        return f"<RiverSurvey: {self.status}, {len(self.transects)} transects{width}>"

    @property
    def status(self) -> str:
        """``ok``, or why there is no width."""
        return str(self.document["status"])

    @property
    def reasons(self) -> list[str]:
        """What to know of the answer, or of why there is none, a sentence each."""
        return list(self.document["reasons"])

    @property
    def width_m(self) -> dict[str, Any] | None:
        """``median`` of the measured widths with ``std`` and ``ci95``, ``min``, ``max``; None where there is none."""
        width: dict[str, Any] | None = self.document["width_m"]
        return width

    @property
    def transects(self) -> Transects:
        """The lines across the river, with their widths."""
        return Transects(self.document, self.view.sample)

    def save(self, folder: str | Path) -> list[str]:
        """Write the document, a table, a map and a plate; nothing where there is no river.

        Returns:
            The files.

        Raises:
            InputError: The folder cannot be written.
        """
        if isinstance(self.found, River):
            write_river(Path(folder), self.document, self.found, self.view)
        elif isinstance(self.found, Reach) and self.images is not None:
            write_reach(Path(folder), self.document, self.found, self.images)
        return list(self.document["files"])


def survey_river(  # noqa: PLR0913 - what a caller may choose
    what: str | Path,
    camera: Camera | None = None,
    pose: CameraPose | None = None,
    *,
    calibration: str | Path | None = None,
    config: str | Path | None = None,
    settings: Settings = NO_SETTINGS,
    elevation_m: float = 0.0,
    max_range_m: float | None = None,
    spacing_m: float = 1.0,
    flow_deg: float | None = None,
    hints: RiverHints | None = None,
    images: int = MOST_IMAGES,
    water_model: str | Path | None = None,
    despite_contradiction: bool = False,
    progress: Progress = no_progress,
) -> RiverSurvey:
    """Measure a river's width at transects along it, with the banks found in the images.

    Args:
        what: A recording, whose telemetry says the poses; or an image, or a fixed camera's video, of a known pose; or a
            drone's photograph, which says its own.
        camera: The camera of an image or a video; None for that of the calibration, or of the photograph.
        pose: Its pose; None for that of the calibration, or of the photograph.
        calibration: A calibration file.
        config: Station file to use in place of a recording's own; the alignment of the recorded video is kept unless
            the file states a clock.
        settings: Values that replace those of a recording's configuration, by key of the station file, such as
            ``{"telemetry.height.home_above_plane_m": 3.0}``.
        elevation_m: Height of the water above the ground that heights are counted from.
        max_range_m: Water farther than this is left out; None for no limit.
        spacing_m: Of the transects along the river.
        flow_deg: Where the river flows to, clockwise from north: left is then its left bank.
        hints: What you say is water or land, in pixels of the image, or of the first one that is looked at.
        images: How many images of a recording or a video are looked at, evenly spread.
        water_model: A network of your own (ONNX) that says where water is.
        despite_contradiction: Give the widths of images that contradict each other beyond their stated errors too;
            their status stays ``CONTRADICTORY``.
        progress: Called with looks done, and how many there are.

    Returns:
        The survey; where its ``status`` is not ``ok``, ``reasons`` say why there is no width.

    Raises:
        AerodftError: Something cannot be read, is impossible, or does not go together.

    Examples:
        >>> import aerodft as ad
        >>> camera = ad.load_camera("configs/cameras/demo-1080p.toml")
        >>> std = ad.PoseStd(height_m=0.1, tilt_deg=0.2)
        >>> pose = ad.CameraPose(height_m=7.93, tilt_deg=62.3, roll_deg=-0.6, std=std)
        >>> reach = ad.survey_river("configs/calibration/bridge.jpg", camera, pose, spacing_m=2)
        >>> f"{reach.status}: {reach.width_m['median']:.1f} m"
        'ok: 9.5 m'
        >>> rows = reach.transects.rows()
        >>> len(rows) == len(reach.transects)
        True
    """
    in_range("images", images, 1, LARGEST, "at least 1")
    source = Path(what)
    surface = MeasuredSurface(elevation_m, 0.0, max_range_m)
    network = None if water_model is None else WaterNetwork.read(Path(water_model))
    question = river_question(hints or RiverHints(), spacing_m, flow_deg, network)
    if is_recording(source):
        if camera is not None or pose is not None:
            raise UsageError("a camera or a pose beside a recording", expected="neither: the recording has them")
        own = None if config is None else Path(config)
        known = None if calibration is None else Path(calibration)
        views = recorded_images(source, own, known, surface, images, settings)
        return survey_images(views, question, progress, despite_contradiction=despite_contradiction)
    if settings:
        raise UsageError("`settings` without a recording", expected="them with a recording")
    if pose is None and calibration is None and source.suffix.lower() in STILLS:
        taken = read_photograph(source, camera=camera)
        camera, pose = taken.camera, taken.pose
    setup, sample = image_setup(camera, pose, calibration=calibration, surface=surface)
    if source.suffix.lower() in VIDEO_SUFFIXES:
        views = filmed_images(source, setup, sample, images, no_progress)
        return survey_images(views, question, progress, despite_contradiction=despite_contradiction)
    return survey_still(source, setup, sample, question)


def river_question(
    hints: RiverHints,
    spacing_m: float,
    flow_deg: float | None,
    network: WaterNetwork | None = None,
    bank_std_px: float | None = None,
) -> RiverQuestion:
    """What is asked of each image; ``bank_std_px`` is what banks are seen off by at the least.

    Raises:
        InputError: A value is impossible.
    """
    if not 0 < spacing_m <= LARGEST:
        raise InputError("`spacing_m`", got=f"{spacing_m:g}", expected="m, above 0")
    if flow_deg is not None and not abs(flow_deg) <= 360:  # noqa: PLR2004 - one turn
        raise InputError("`flow_deg`", got=f"{flow_deg:g}", expected="-360 to 360 deg clockwise from north")
    return RiverQuestion(
        hints=hints,
        spacing_m=spacing_m,
        flow_rad=None if flow_deg is None else math.radians(flow_deg),
        least_std_px=RiverQuestion().least_std_px if bank_std_px is None else bank_std_px,
        network=WaterNetwork.shipped() if network is None else network,
    )


def survey_still(image: Path, setup: Setup, sample: PoseSample, question: RiverQuestion) -> RiverSurvey:
    """Measure a river in one image, as the camera stored it.

    Raises:
        InputError: The image cannot be read, or is not the camera's.
    """
    pixels = read_camera_image(image, setup.camera, "`camera` has to describe this very image")
    return survey_image(RiverView(0, setup, sample, lambda: pixels), question)


def survey_image(view: RiverView, question: RiverQuestion) -> RiverSurvey:
    """Measure a river in one image of the camera's size."""
    pixels = view.pixels()
    found = find_river(pixels, view.setup, view.pose, question)
    document = refusal_document(found) if isinstance(found, NoRiver) else river_document(found, view)
    return RiverSurvey(document, found, None, view)


def survey_images(
    images: RiverImages,
    question: RiverQuestion,
    progress: Progress = no_progress,
    *,
    despite_contradiction: bool = False,
) -> RiverSurvey:
    """Measure a river over many images; ``progress`` is called with looks done and how many there are.

    Images that contradict each other beyond their stated errors have no width, unless ``despite_contradiction``.

    Raises:
        InputError: An image cannot be read.
    """
    looks = 2 * len(images.views)
    found: Reach | NoRiver = measure_reach(images.views, question, lambda done: progress(done, looks))
    if isinstance(found, Reach) and not despite_contradiction:
        found = contradiction_refusal(found, images) or found
    document = refusal_document(found, images) if isinstance(found, NoRiver) else reach_document(found, images)
    return RiverSurvey(document, found, images, images.views[0])


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
    folder: Path,
    config: Path | None,
    calibration: Path | None,
    surface: MeasuredSurface,
    most: int,
    settings: Settings = NO_SETTINGS,
) -> RiverImages:
    """Images of a recording, evenly spread, with the poses that its telemetry gives them.

    Raises:
        InputError: There is no recording, or it lacks its configuration.
        NoAnswerError: No image was recorded, or none has a pose.
    """
    recording = Recording(folder)
    was, station = stations_of(recording, config, calibration, settings)
    source = _PixelSource(reoffset(RecordingSource(recording, pixels=True), was, station))
    samples = list(_samples(station, source))
    if not source.pixels:
        hint = "record.image_hz says how many are kept; `import_flight` takes them as `video` or `images`"
        raise NoAnswerError("no images in the recording", where=folder, hint=hint)
    kept = [(index, sample) for index, sample in samples if index in source.pixels]
    without_pose = dict(Counter(str(sample.status) for _, sample in kept if sample.status is not Status.OK))
    pipeline = station.pipeline
    setup = surface.on(Setup(camera=pipeline.camera, max_range_m=pipeline.max_range_m, config_id=pipeline.config_id))
    posed = [(index, sample) for index, sample in kept if sample.status is Status.OK]
    if not posed:
        got = ", ".join(f"{count} {status}" for status, count in without_pose.items())
        raise NoAnswerError("no image has a pose", where=folder, got=Reason(got), hint="see `diagnose`")
    stamps = np.array([sample.stamp_ns for _, sample in posed])
    views = []
    for row in _rows(len(posed), most):
        (index, sample), after = posed[row], _soon_after(stamps, row)
        view = RiverView(index, *zoomed(setup, sample), source.pixels[index])
        if after is not None:
            then, pixels = zoomed(setup, posed[after][1]), source.pixels[posed[after][0]]
            view = replace(view, later=_later(view, *then, partial(_copied, pixels)))
        views.append(view)
    computed_from = {
        "recording": str(folder.resolve()),
        "config": station.pipeline.config_id,
        "calibration": None if station.calibration is None else station.calibration.id,
        "settings": dict(settings),
    }
    return RiverImages(tuple(views), len(kept), without_pose, is_utc=True, computed_from=computed_from)


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
