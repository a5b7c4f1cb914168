"""Setting up one's own station: cameras of the library, and first station files."""

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import orjson
import tomli_w

from aerodft.adapters.config.camera import KnownCamera, camera_document, known_cameras, load_camera
from aerodft.adapters.config.station import load_station
from aerodft.adapters.files import check_is_local, looks_like, whole_file
from aerodft.adapters.images import (
    STILLS,
    VIDEO_SUFFIXES,
    StillsFolderSource,
    depend_on_zone,
    facts_of_still,
    video_info,
)
from aerodft.adapters.telemetry import (
    SubtitleLog,
    are_subtitles,
    carries_subtitles,
    carries_telemetry,
    hfov_deg,
    unread_tracks,
)
from aerodft.adapters.telemetry.mavlink import is_link
from aerodft.adapters.timestamps import offset_text, unix_ns_to_iso, zone_hint
from aerodft.app.diagnose import diagnose
from aerodft.app.measure import UNSTATED_HOME_STD_M, camera_of_photograph, carries_pose, lens_in_photograph
from aerodft.conventions import SECOND_NS
from aerodft.diagnosis import DiagnosisReport
from aerodft.errors import InputError, NoAnswerError, UsageError, os_errors_as
from aerodft.model import Camera, CameraStd

_ASSUMED_HFOV_DEG: Final = 70.0  # most drones' wide cameras: 60 to 80
_ASSUMED_STD: Final = 0.15
_EQUIVALENT_STD: Final = 0.08  # of a focal length equivalent to 35 mm film: between a 4:3 and a 16:9 picture's diagonal
_ASSUMED_FLIGHT_M: Final = 40.0  # low flights over rivers: 20 to 80 m
_ASSUMED_SIZE_PX: Final = (1920, 1080)
_STREAMS: Final = ("rtsp://", "rtmp://", "udp://", "tcp://", "http://", "https://", "srt://")
_HEIGHTS: Final = ("rangefinder", "terrain", "home")


def find_cameras(wanted: str | Path | None = None) -> tuple[KnownCamera, ...]:
    """The modes of the library's cameras that are wanted.

    Args:
        wanted: Words of a camera's name, its name in EXIF data, ``photo`` or ``video``, a size like ``3840x2160``, or
            parts of them; or a photo, whose EXIF data and size tell; or a video, whose size tells alone; None for all.

    Raises:
        NoAnswerError: There are none.
        InputError: The photo or video cannot be read.

    Examples:
        >>> import aerodft as ad
        >>> [found.camera.fx_px for found in ad.find_cameras("FC6310R photo")]
        [3666.8]
    """
    cameras, path = known_cameras(), Path(str(wanted))
    if wanted is None:
        return cameras
    if path.is_file() and path.suffix.lower() in STILLS:
        facts = facts_of_still(path)
        size_px, mode = facts.size_px, facts.mode
        found = [*_camera_in(path), *(each for each in cameras if each.shows(size_px, mode))]
        of_device = [each for each in cameras if each.is_of(mode)]
        if not of_device or any(each.has_lens_of(mode) for each in of_device):
            found = found or [*_by_exif(path)]
        got = f'{size_px[0]} x {size_px[1]} px of "{mode.device or "no device"}"'
    elif path.is_file():
        info = video_info(path)
        size_px = (info.width_px, info.height_px)
        found = [
            each
            for each in cameras
            if each.kind == "video" and size_px == (each.camera.width_px, each.camera.height_px)
        ]
        got = f"{info.width_px} x {info.height_px} px"
    else:
        words = str(wanted).casefold().split()
        found = [each for each in cameras if set(words) <= set(_words(each).split())]
        found = found or [each for each in cameras if all(word in _words(each) for word in words)]
        got = str(wanted)
    if not found:
        hint = "calibrate the lens with `calibrate_lens`, or write a camera file with its field of view"
        raise NoAnswerError("no camera of the library", where=wanted if path.is_file() else "", got=got, hint=hint)
    return tuple(found)


def _camera_in(photo: Path) -> Iterator[KnownCamera]:
    """The camera that a photo's own XMP data describe, if they do."""
    lens = lens_in_photograph(photo)
    if lens is not None:
        yield KnownCamera(
            name=f"{lens.camera.name}, this photo",
            kind="photo",
            known_from="photo",
            source=lens.source,
            focal_35mm_mm=None,
            camera=lens.camera,
        )


def _by_exif(photo: Path) -> Iterator[KnownCamera]:
    """The camera of a photo's EXIF data, if they state a focal length."""
    try:
        camera, _ = camera_of_photograph(photo)
    except InputError:
        return
    name = f"{camera.name}, this photo"
    about = "the focal length in its EXIF data"
    yield KnownCamera(name=name, kind="photo", known_from="photo", source=about, focal_35mm_mm=None, camera=camera)


def write_camera(known: KnownCamera, path: Path, *, overwrite: bool = False) -> None:
    """Write the camera file of a camera of the library, with where its figures are from.

    Args:
        known: The camera.
        path: The TOML file.
        overwrite: Whether one that exists is replaced.

    Raises:
        InputError: It exists, or cannot be written.

    Examples:
        >>> import aerodft as ad
        >>> ad.write_camera(ad.find_cameras("FC7303 4000x3000")[0], Path("mini2.toml"))
        >>> ad.load_camera("mini2.toml").width_px
        4000
    """
    share = 100 * known.camera.std.focal_px / known.camera.fx_px
    about = (
        f"# {known.camera.name}. Focal length from: {known.source} ({known.known_from}), to {share:.1f} % (1 sigma).\n"
    )
    if not known.camera.distortion:
        about += (
            "# No distortion is stated. `aerodft calibrate-lens` finds both for your own copy, ten times as well.\n"
        )
    _write(path, about + tomli_w.dumps(camera_document(known.camera)), overwrite=overwrite)


def _words(known: KnownCamera) -> str:
    device = "" if known.camera.mode is None else known.camera.mode.device
    return f"{known.camera.name} {device}".casefold().replace(",", "")


@dataclass(frozen=True, slots=True, kw_only=True)
class StationDraft:
    """A first station file and its camera file, as written.

    Attributes:
        station: The station file.
        camera: The camera file.
        taken: One sentence for each thing that was taken from somewhere, with from where.
        to_do: One sentence for each thing that is assumed, and that only the user can measure; what counts most first.
        log: The log that they are for; None for a link or a fixed camera.
        later: Parts of a cut video that follow it, with their subtitles.
        is_live: Whether telemetry or images come live.
        needs_sync: Whether the video's start is known to seconds only: `sync` of `import_flight` then finds it.
        view: Photo or video of a fixed camera, whose pose is still to be found; None for others.
    """

    station: Path
    camera: Path
    taken: tuple[str, ...]
    to_do: tuple[str, ...]
    log: Path | None
    later: tuple[Path, ...]
    is_live: bool
    needs_sync: bool
    view: Path | None


@dataclass(slots=True)
class _Sources:
    """Inputs of a station: at most one of telemetry, and one of images.

    ``is_carried``: whether the log is a data track of the video itself.
    """

    log: Path | None = None
    is_carried: bool = False
    link: str | None = None
    images: Path | None = None
    stream: str | None = None
    subtitles: SubtitleLog | None = None
    later: list[Path] = field(default_factory=list)

    @property
    def telemetry(self) -> str | None:
        return self.link if self.log is None else str(self.log)


@dataclass(slots=True)
class _Draft:
    lines: list[str] = field(default_factory=list)
    taken: list[str] = field(default_factory=list)
    to_do: list[str] = field(default_factory=list)
    needs_sync: bool = False


def _write(path: Path, text: str, *, overwrite: bool) -> None:
    check_is_local(path)
    with os_errors_as("the file cannot be written", where=path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path, overwrite=overwrite) as partial:
        partial.write_text(text, encoding="utf-8")


def draft_station(
    sources: Sequence[str | Path],
    folder: str | Path,
    *,
    camera: str | Path | None = None,
    home_above_plane_m: float | None = None,
    overwrite: bool = False,
) -> StationDraft:
    """Write ``station.toml`` and ``camera.toml`` for what there is, commented; they work as they are.

    Args:
        sources: A log (.tlog, .bin, MCAP) or link (``udpin:14550``), and a video, photo, folder of photos or the URL of
            a stream; each at most once. Without a log or link the camera is taken to be a fixed one.
        folder: Where to write; made where it is missing.
        camera: Camera file to use as it is, or words of a camera of the library; None to tell it by the images.
        home_above_plane_m: Height of the take-off point above the water, metres; None where nobody knows it yet: 0.
        overwrite: Whether files that exist are replaced.

    Raises:
        UsageError: No source, or two of one kind.
        InputError: A source cannot be read, or the files exist or cannot be written.
        NoAnswerError: No camera of the library has this name.

    Examples:
        >>> import aerodft as ad
        >>> draft = ad.draft_station(["samples/copter.tlog"], "mine")
        >>> draft.to_do[0].partition(":")[0]
        'Measure how high the take-off point lies above the water'
    """
    found, folder = _sorted(sources), Path(folder)
    station, own_camera = folder / "station.toml", folder / "camera.toml"
    draft = _Draft()
    size_px = _write_camera(draft, found, camera, own_camera, overwrite=overwrite)
    used = Path(camera) if camera is not None and Path(camera).is_file() else own_camera
    report = None if found.telemetry is None else diagnose(found.telemetry).report
    draft.lines += [
        "# A first station file, by `aerodft init`. What is left out takes its default; the site lists all keys.",
        "[station]",
        f'name = "{_slug(folder.absolute().name)}"           # part of every key on the bus',
        "",
        "[camera]",
        f"file = {_from(folder, used)}",
        "",
        *(_fixed(draft, found.images) if report is None else _telemetry(draft, found, report, home_above_plane_m)),
        "",
        *_images(draft, found, report, folder),
        *_probes(size_px),
    ]
    _write(station, "\n".join(draft.lines) + "\n", overwrite=overwrite)
    load_station(station)
    return StationDraft(
        station=station,
        camera=used,
        taken=tuple(draft.taken),
        to_do=tuple(draft.to_do),
        log=found.log,
        later=tuple(found.later),
        is_live=found.link is not None or (found.stream is not None and found.log is None),
        needs_sync=draft.needs_sync,
        view=(_photo(found.images) or found.images) if report is None and found.link is None else None,
    )


def _sorted(sources: Sequence[str | Path]) -> _Sources:
    """The sources by their kind: log, link, video, photos, stream.

    Raises:
        UsageError: None at all, or two of one kind.
        InputError: A file is missing.
    """
    found = _Sources()
    for source in sources:
        path, text = Path(source), str(source)
        kind: str
        if text.startswith(_STREAMS):
            kind, value = "stream", source
        elif is_link(text):
            kind, value = "link", source
        elif not path.exists():
            raise InputError("no such file or folder", where=source, expected="a log, link, video, photo or stream")
        else:
            kind, value = ("images" if _is_images(path) else "log"), path
        if kind == "images" and found.images is not None and _is_video(found.images) and _is_video(Path(source)):
            found.later.append(Path(source))
            continue
        if getattr(found, kind) is not None:
            raise UsageError("two sources of one kind", got=f"{getattr(found, kind)} and {source}", expected="one")
        setattr(found, kind, value)
    if found == _Sources():
        expected = "a log or link, and a video, photo, folder of photos or stream"
        raise UsageError("nothing to measure from", got="no source", expected=expected)
    _find_own_telemetry(found)
    if None not in (found.log, found.link) or None not in (found.images, found.stream):
        raise UsageError("two sources of one kind", got="a file and a live one", expected="one of them")
    return found


def _find_own_telemetry(found: _Sources) -> None:
    """Take images that say where they were taken for the log: photographs with poses, videos with telemetry.

    Subtitles that are named themselves have the video beside them, unless another one is named too.

    Raises:
        UsageError: Several videos without subtitles.
        InputError: One of several videos has none, or they do not fit.
    """
    images = found.images
    if found.log is not None and are_subtitles(found.log):
        found.subtitles = SubtitleLog([found.log])
        found.images = images or next((video for video, _ in found.subtitles.videos), None)
        if images is not None and not found.later and _is_video(images):
            found.subtitles.check_video(images)
    elif found.telemetry is None and images is not None:
        photo = _photo(images)
        if photo is not None and carries_pose(photo):
            found.log = images
        elif photo is None and not found.later and carries_telemetry(images):
            found.log, found.is_carried = images, True
        elif photo is None and carries_subtitles(images):
            found.subtitles = SubtitleLog([images, *found.later])
            found.images, *found.later = found.subtitles.paths
            found.log = found.images
            return
    if found.later:
        raise UsageError(
            "several videos without subtitles",
            got=", ".join(map(str, (images, *found.later))),
            expected="one, or the parts of a cut video with a drone's subtitles beside each of them",
        )


def _is_video(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() not in STILLS


def _is_images(path: Path) -> bool:
    """Whether this is a photo, a folder of photos or a video: no log, and no recording.

    Raises:
        InputError: It is a video that cannot be read.
    """
    if path.is_dir():
        return any(each.suffix.lower() in STILLS for each in path.iterdir())
    if path.suffix.lower() in STILLS:
        return True
    try:
        video_info(path)
    except InputError:
        if path.suffix.lower() in VIDEO_SUFFIXES or looks_like(path).endswith("video"):
            raise  # a damaged video is no log
        return False
    return True


def _write_camera(
    draft: _Draft, found: _Sources, wanted: str | Path | None, path: Path, *, overwrite: bool
) -> tuple[int, int]:
    """Write the camera file, unless one is given, and return its image size in pixels."""
    images = found.images
    if wanted is not None and (Path(wanted).is_file() or Path(wanted).suffix == ".toml"):
        camera = load_camera(wanted)
        draft.taken.append(f"camera: {camera.name}, from {wanted}")
        return camera.width_px, camera.height_px
    photo = _photo(images)
    lens = None if photo is None or wanted is not None else lens_in_photograph(photo)
    if lens is not None:
        share = 100 * lens.camera.std.focal_px / lens.camera.fx_px
        draft.taken.append(
            f"camera: by {lens.source}, of {photo}; its focal length is known to {share:.1f} % (1 sigma)"
        )
        about = f"# {lens.camera.name}. Focal length: {lens.source}, to {share:.1f} % (1 sigma).\n"
        _write(path, about + tomli_w.dumps(camera_document(lens.camera)), overwrite=overwrite)
        return lens.camera.width_px, lens.camera.height_px
    known = _known(wanted, images if photo is None else photo)
    if known is not None:
        write_camera(known, path, overwrite=overwrite)
        share = 100 * known.camera.std.focal_px / known.camera.fx_px
        by = "by its name" if wanted is not None else f"by the EXIF data of {photo}"
        draft.taken.append(f"camera: {known.camera.name}, {by}; its focal length is known to {share:.1f} % (1 sigma)")
        if share > 2:  # noqa: PLR2004 - percent, of a calibration
            draft.to_do.append(f"Calibrate the lens (`calibrate_lens`): widths are uncertain by {share:.1f} %")
        return known.camera.width_px, known.camera.height_px
    if found.subtitles is not None and found.subtitles.focal_mm is not None and images is not None:
        return _subtitled_camera(draft, images, found.subtitles.focal_mm, path, overwrite=overwrite)
    return _unknown_camera(draft, images, photo, path, overwrite=overwrite)


def _subtitled_camera(draft: _Draft, video: Path, focal_mm: float, path: Path, *, overwrite: bool) -> tuple[int, int]:
    """A camera file of the 35 mm-equivalent focal length by a video's subtitles; and its image size in pixels."""
    width_px, height_px = _size_px(video)
    focal_px = width_px / 2 / math.tan(math.radians(hfov_deg(focal_mm)) / 2)
    std = CameraStd(focal_px=_EQUIVALENT_STD * focal_px, principal_point_px=0.005 * width_px)
    name = _slug(path.absolute().parent.name)
    camera = Camera.of_focal(name=name, width_px=width_px, height_px=height_px, focal_px=focal_px, std=std)
    said = f"{focal_mm:g} mm equivalent to 35 mm film, by the subtitles of {video}"
    draft.taken.append(f"camera: {said}; its focal length is known to {100 * _EQUIVALENT_STD:.0f} % (1 sigma)")
    draft.to_do.append(
        "Name your camera (`camera`; `find_cameras` lists them) or calibrate its lens: which part of the sensor a "
        f"video shows is not stated, widths are uncertain by {100 * _EQUIVALENT_STD:.0f} %"
    )
    about = f"# Focal length: {said}. `aerodft calibrate-lens` finds it, with the distortion.\n"
    _write(path, about + tomli_w.dumps(camera_document(camera)), overwrite=overwrite)
    return width_px, height_px


def _photo(images: Path | None) -> Path | None:
    """The photo, or the first one of a folder; None for a video or nothing."""
    if images is None or not (images.is_dir() or images.suffix.lower() in STILLS):
        return None
    return images if images.is_file() else min(each for each in images.iterdir() if each.suffix.lower() in STILLS)


def _known(wanted: str | Path | None, image: Path | None) -> KnownCamera | None:
    """The camera of the library by name and size of the image, or by the image's EXIF data; None where it has none.

    Raises:
        NoAnswerError: It has none of this name.
    """
    if wanted is not None:
        found = find_cameras(wanted)
        if image is not None:
            size_px = _size_px(image)
            of_size = [each for each in found if (each.camera.width_px, each.camera.height_px) == size_px]
            of_size += filter(None, (each.resized(*size_px) for each in found))
            if not of_size:
                sizes = ", ".join(f"{each.camera.width_px} x {each.camera.height_px}" for each in found)
                got = f"{size_px[0]} x {size_px[1]} px of {image}"
                raise NoAnswerError("no mode of this camera", where=wanted, got=got, expected=f"one of {sizes}")
            return of_size[0]
        return found[0]
    if image is None or image.suffix.lower() not in STILLS:
        return None
    try:
        return find_cameras(image)[0]
    except NoAnswerError:
        return None


def _size_px(image: Path) -> tuple[int, int]:
    if image.suffix.lower() in STILLS:
        return facts_of_still(image).size_px
    info = video_info(image)
    return info.width_px, info.height_px


def _unknown_camera(
    draft: _Draft, images: Path | None, photo: Path | None, path: Path, *, overwrite: bool
) -> tuple[int, int]:
    """A camera file by EXIF data of a mode that the library lacks, or of a usual field of view; and its image size.

    Raises:
        InputError: EXIF data state a focal length that tells no camera, as of a fisheye.
    """
    mode = None if photo is None else facts_of_still(photo).mode
    if photo is not None and mode is not None and mode.focal_35mm_mm is not None:
        camera, said = camera_of_photograph(photo)
        draft.taken.append(said)
        _write(path, f"# {said}.\n" + tomli_w.dumps(camera_document(camera)), overwrite=overwrite)
        return camera.width_px, camera.height_px
    image = photo or images
    width_px, height_px = _ASSUMED_SIZE_PX if image is None else _size_px(image)
    focal_px = width_px / 2 / math.tan(math.radians(_ASSUMED_HFOV_DEG) / 2)
    std = CameraStd(focal_px=_ASSUMED_STD * focal_px, principal_point_px=0.005 * width_px)
    name = _slug(path.absolute().parent.name)
    camera = Camera.of_focal(name=name, width_px=width_px, height_px=height_px, focal_px=focal_px, std=std)
    source = f"assumed: {_ASSUMED_HFOV_DEG:g} deg across, as most drones have about"
    to_do = "Name your camera (`camera`; `find_cameras` lists them) or calibrate its lens: its field of view is assumed"
    draft.to_do.append(f"{to_do}, to {100 * _ASSUMED_STD:.0f} %")
    about = f"# Focal length: {source}. `aerodft calibrate-lens` finds it, with the distortion.\n"
    _write(path, about + tomli_w.dumps(camera_document(camera)), overwrite=overwrite)
    return camera.width_px, camera.height_px


def _telemetry(
    draft: _Draft, found: _Sources, report: DiagnosisReport, home_above_plane_m: float | None
) -> Iterator[str]:
    """The tables of telemetry: which heights and attitudes the log has."""
    heights = {each.name: each for each in report.heights if each.count}
    attitudes = [each.name for each in report.attitudes if each.count]
    if home_above_plane_m is None and ("home" in heights or not heights):
        said = "until then heights count from the take-off point; `river` and `recompute` take `home_above_plane_m` too"
        draft.to_do.insert(0, f"Measure how high the take-off point lies above the water: home_above_plane_m; {said}")
    yield "[telemetry]"
    if found.link is not None:
        yield f"connection = {_quoted(found.link)}"
    yield "\n[telemetry.height]"
    if (report.photographs or found.subtitles is not None or found.is_carried) and not heights:
        yield from _stated_height(draft)
        yield from _stated_attitude(draft, attitudes, is_subtitled=found.subtitles is not None)
        return
    order = [name for name in _HEIGHTS if name in heights] or ["home"]
    yield f"order = [{', '.join(map(_quoted, order))}]   # the first that has a value counts"
    said = "as you stated" if home_above_plane_m is not None else "MEASURE THIS"
    yield f"home_above_plane_m = {float(home_above_plane_m or 0.0)}   # take-off point above the water, m: {said}"
    if (report.photographs or found.subtitles is not None) and home_above_plane_m is None:
        yield f"home_above_plane_std_m = {UNSTATED_HOME_STD_M}   # as long as nobody has measured that: 1 sigma"
    for name in order:
        if name in heights:
            each = heights[name]
            draft.taken.append(f"height: {name}, {each.count} values from {each.low:.1f} to {each.high:.1f} m")
    yield from _stated_attitude(draft, attitudes, is_subtitled=found.subtitles is not None)


def _stated_height(draft: _Draft) -> Iterator[str]:
    """Keys of a height that nobody has stated yet, of photographs or subtitles that say none."""
    draft.to_do[:] = [each for each in draft.to_do if "home_above_plane_m" not in each]
    draft.to_do.insert(0, "State the camera's height above the water (manual_m): no height is stated")
    yield 'order = ["manual"]          # no height is stated'
    yield f"manual_m = {_ASSUMED_FLIGHT_M}             # ASSUMED: the camera above the water, m: MEASURE THIS"
    yield f"std_m = {{ manual = {_ASSUMED_FLIGHT_M / 2} }}   # 1 sigma"


def _stated_attitude(draft: _Draft, attitudes: list[str], *, is_subtitled: bool) -> Iterator[str]:
    """The table of attitudes: those of a log, else of a camera that is fixed to the vehicle."""
    yield "\n[telemetry.attitude]"
    if attitudes:
        yield f"order = [{', '.join(map(_quoted, attitudes))}]"
        draft.taken.append(f"camera's attitude: {', '.join(attitudes)}")
        return
    levelled = " levelled by its gimbal" if is_subtitled else " bolted to the vehicle"
    yield f'order = ["fixed"]           # no angles of the camera are stated: it is taken to be{levelled}, looking down'
    yield "fixed_mount = { yaw_deg = 0.0, pitch_deg = -90.0, roll_deg = 0.0 }"
    what = (
        "State the camera's tilt (fixed_mount, or `tilt_deg` of `import_flight`)"
        if is_subtitled
        else ("State how the camera is mounted (fixed_mount)")
    )
    draft.to_do.append(f"{what}: no gimbal speaks, straight down is assumed")


def _fixed(draft: _Draft, view: Path | None) -> Iterator[str]:
    """The table of a fixed camera's pose, which nobody knows yet."""
    tracks = [] if view is None or not _is_video(view) else unread_tracks(view)
    if tracks:
        draft.to_do.append(
            f"Give the flight's log, or the .SRT beside {view}, if a drone took it: its own data ({', '.join(tracks)}) "
            "cannot be read; a fixed camera is assumed"
        )
    draft.to_do.insert(
        0,
        "Find where the camera hangs and looks: by landmarks and whatever else is known of its view, with `calibrate`",
    )
    yield "[pose]                     # ASSUMED: find it with `aerodft calibrate`"
    yield '# calibration = "calibration.toml"   # then this, instead of the numbers below'
    yield "height_agl_m = 5.0         # of the lens above the ground or water"
    yield "tilt_deg = 60.0            # from straight down: 0 looks at its own foot, 90 at the horizon"
    yield "roll_deg = 0.0             # right side down is positive"
    yield "std = { height_m = 1.0, tilt_deg = 5.0, pan_deg = 2.0, roll_deg = 2.0 }   # 1 sigma"


def _images(draft: _Draft, found: _Sources, report: DiagnosisReport | None, folder: Path) -> Iterator[str]:
    """The table of where images come from."""
    yield "[images]"
    if found.is_carried and found.images is not None:
        yield f"video = {_from(folder, found.images)}"
        draft.taken.append("video's start: by its own telemetry, on one time line")
    elif found.log is not None and found.log == found.images and found.subtitles is None:
        yield "# the photographs that say the poses"
        draft.taken.append(f"images: the photographs of {found.images}, each with its own pose")
    elif found.stream is not None:
        yield f"stream = {_quoted(found.stream)}"
    elif found.images is None:
        yield "rate_hz = 10               # no images: numbers at this rate; or video = ..., stills = ..., stream = ..."
    elif (photo := _photo(found.images)) is not None:
        yield f"stills = {_from(folder, photo.parent)}"
        yield from _stills_stamps(draft, photo.parent, report)
    else:
        yield f"video = {_from(folder, found.images)}"
        if found.subtitles is not None:
            draft.taken.append("video's start: by its subtitles, on one time line")
            return
        yield from _video_start(draft, found.images, report)


def _stills_stamps(draft: _Draft, folder: Path, report: DiagnosisReport | None) -> Iterator[str]:
    """How the times of photos are told: by EXIF, in a zone, or not at all."""
    count = sum(each.suffix.lower() in STILLS for each in folder.iterdir())
    try:
        stills = StillsFolderSource(folder, decode=False)
    except InputError:
        yield '# pattern = "IMG_%Y%m%d_%H%M%S.jpg"   # how names tell the time: EXIF has no dates'
        draft.taken.append(f"images: the {count} photos of {folder}; their EXIF data have no dates")
        draft.to_do.append(f"State how the names of the photos of {folder} tell the time (images.pattern)")
        return
    draft.taken.append(f"images: those of {folder}, {len(stills)} of {count} stamped by their EXIF data")
    if not depend_on_zone(folder):
        return
    yield '# utc_offset = "+02:00"    # whose time EXIF means: it does not say, UTC is assumed'
    hint = ""
    if report is not None and report.first_ns is not None and report.last_ns is not None:
        first_ns, last_ns = stills.span_ns
        if last_ns < report.first_ns or first_ns > report.last_ns:
            span_ns = report.first_ns, report.last_ns
            hint = zone_hint(stills.span_ns, span_ns, lambda ahead: f'utc_offset = "{offset_text(ahead)}"')
    draft.to_do.append(f"State whose time the photos tell (images.utc_offset): {hint or 'UTC is assumed'}")


def _video_start(draft: _Draft, video: Path, report: DiagnosisReport | None) -> Iterator[str]:
    """Start of a video: as its container says, else the log's."""
    sync = "`import_flight` with `sync` finds it to milliseconds where the camera turned, and so does `align`"
    draft.needs_sync = report is not None
    info = video_info(video)
    start_ns = info.start_ns
    if start_ns is not None and report is not None and report.first_ns is not None and report.last_ns is not None:
        hint = zone_hint((start_ns, start_ns + (info.duration_ns or 0)), (report.first_ns, report.last_ns))
        if hint and not report.first_ns <= start_ns <= report.last_ns:
            draft.to_do.append(f"State when the video begins (images.start): {hint}")
    if start_ns is not None:
        yield "# start = ...               # UTC of its first image; the file says " + unix_ns_to_iso(start_ns)
        is_rounded = start_ns % SECOND_NS == 0
        how = "it says so to whole seconds" if is_rounded else "of the camera's clock, until sync finds it"
        yield f"time_std_s = 0.6           # {how}"
        digits = ", to whole seconds" if is_rounded else ""
        draft.taken.append(f"video's start: {unix_ns_to_iso(start_ns)}, as the file says{digits}")
        if report is not None:
            draft.to_do.append(f"Align the video with the log: {sync}")
        return
    first_ns = 0 if report is None or report.first_ns is None else report.first_ns
    yield f'start = "{unix_ns_to_iso(first_ns)}"   # ASSUMED: the file does not say'
    if report is not None:
        draft.to_do.append(f"State when the video begins (images.start): the log's start is assumed; {sync}")


def _probes(size_px: tuple[int, int]) -> Iterator[str]:
    """One probe in the middle, and what others look like."""
    u, v = (size_px[0] - 1) / 2, (size_px[1] - 1) / 2
    yield from (
        "",
        "[[probe]]                  # where the middle of the image is",
        'name = "centre"',
        'kind = "position"',
        f"pixels = [[{u}, {v}]]",
        "",
        "# [[probe]]                # the river's width, its banks found in the images",
        '# name = "river"',
        '# kind = "river"',
        "# observed = true",
        "# [river]",
    )


def _from(folder: Path, path: Path) -> str:
    """A path as the station file has it, in quotes: from its own folder."""
    return _quoted(Path(os.path.relpath(path.absolute(), folder.absolute())).as_posix())


def _quoted(name: str) -> str:
    return orjson.dumps(name).decode()  # a string of JSON is one of TOML


def _slug(name: str) -> str:
    kept = "".join(each if each.isascii() and (each.isalnum() or each in "._-") else "-" for each in name)
    return kept.strip("._-") or "station"
