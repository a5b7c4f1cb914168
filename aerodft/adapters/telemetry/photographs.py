"""The log format of photographs that carry their poses: a folder of them, or a single one.

Each photograph is a frame: its EXIF and XMP as JSON, which arrives when the photograph was taken. A pose holds at its
own stamp alone; nothing is interpolated between two photographs.
"""

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.files import content_looks_like
from aerodft.adapters.images import STILLS, StillsFolderSource
from aerodft.adapters.photographs import Photo, PhotoPose, PhotoTags, of_one_flight, photo_tags, pose_of_tags
from aerodft.adapters.telemetry.mavlink import FollowedIds, FrameCounts
from aerodft.errors import InputError
from aerodft.model import (
    ClockTrack,
    Event,
    FloatArray,
    GimbalSource,
    GimbalTrack,
    HeightSource,
    HeightTrack,
    IntArray,
    PositionTrack,
    RawBlock,
    Track,
)
from aerodft.service import block_of

PROTOCOL: Final = "photograph"
TITLE: Final = "a drone's photograph or a folder of them"

_BLOCK_PHOTOS: Final = 64
_NUMBERS: Final = re.compile(r"[-+]?\d[\d.e+-]*")


def recognises(head: bytes) -> bool:
    """Whether a file begins like a photograph: JPEG or TIFF."""
    return content_looks_like(head) in {"a JPEG image", "a TIFF image"}


def recognises_folder(folder: Path) -> bool:
    """Whether a folder holds photographs."""
    return any(each.suffix.lower() in STILLS for each in folder.iterdir())


def open_source(path: Path) -> "PhotographLog":
    """The poses of a photograph, or of those in a folder."""
    return PhotographLog(path)


def new_decoder(followed: FollowedIds) -> "PhotographDecoder":
    """A decoder of photographs, which are of one camera."""
    del followed
    return PhotographDecoder()


class PhotographLog:
    """The poses of a folder's photographs, or of a single one, in order of their stamps.

    Args:
        path: The folder or the photograph.
        pattern: How a name tells the time, as for ``StillsFolderSource``; None to take EXIF.
        utc_offset: Whose time it is where neither name nor EXIF says so.

    Attributes:
        path: The folder or the photograph.
        first_photo: The earliest photograph with a pose.

    Raises:
        InputError: There is no photograph with a stamp, or none with a pose.
    """

    def __init__(self, path: Path, pattern: str | None = None, utc_offset: str | None = None) -> None:
        self.path = path
        self._clock = (pattern, utc_offset)
        self._paths: frozenset[Path] | None = None
        stamped = self.images(decode=False).stamped
        tags = {each: photo_tags(each) for _, each in stamped}
        known = [Photo(each, tags[each], pose) for each in tags if (pose := pose_of_tags(tags[each])) is not None]
        self._strangers = len(tags) - len(known)
        self._check_one_camera([photo.tags for photo in known])
        photos, self._left_out = of_one_flight(known, path)
        self._paths = frozenset(photo.path for photo in photos)
        self._poses = [photo.pose for photo in photos]
        stamps_ns = {each: stamp_ns for stamp_ns, each in stamped}
        self._photos = [(stamps_ns[photo.path], photo.tags) for photo in photos]
        self.first_photo = photos[0].path if photos else path
        if not any(pose.wxyz is not None for pose in self._poses):
            said = self._poses[0].remarks if self._poses else ()
            got = "; ".join(said) or f"{len(tags)} without EXIF or XMP of a drone that is known here"
            what = "no photograph says where its camera looked"
            raise InputError(what, where=path, got=got, expected="the photographs as the drone's camera stored them")

    @property
    def counts(self) -> FrameCounts:
        """Counts of the photographs."""
        return FrameCounts(frames=len(self._photos))

    def images(self, *, decode: bool = True) -> StillsFolderSource:
        """The photographs themselves, with the stamps of their poses."""
        pattern, utc_offset = self._clock
        return StillsFolderSource(
            self.path,
            pattern=pattern,
            utc_offset=utc_offset,
            decode=decode,
            unique_stamps=True,
            among=self._paths,
        )

    def stamped_by(self, pattern: str | None, utc_offset: str | None) -> "PhotographLog":
        """The same photographs, with stamps by other rules."""
        return self if self._clock == (pattern, utc_offset) else PhotographLog(self.path, pattern, utc_offset)

    def events(self) -> Iterator[Event]:
        """A block of photographs after another."""
        for start in range(0, len(self._photos), _BLOCK_PHOTOS):
            stamps_ns, tags = zip(*self._photos[start : start + _BLOCK_PHOTOS], strict=True)
            yield block_of(PROTOCOL, self.path.name, stamps_ns, [each.to_json() for each in tags])

    def warnings(self) -> tuple[str, ...]:
        """A sentence for each thing that photographs do not say, with how many; and for those without a pose."""
        counts, examples = Counter[str](), dict[str, str]()
        for pose in self._poses:
            for remark in pose.remarks:
                key = _NUMBERS.sub("#", remark)
                counts[key] += 1
                examples.setdefault(key, remark)
        of = f" of {len(self._poses)} photographs" if len(self._poses) > 1 else ""
        said = [f"{count}{of}: {examples[key]}" if of else examples[key] for key, count in counts.items()]
        if self._strangers:
            said.append(f"{self._strangers} stills beside them say no pose of a drone that is known here: left out")
        return tuple(f"{self.path.name}: {sentence}" for sentence in (*said, *self._left_out))

    def _check_one_camera(self, photos: Sequence[PhotoTags]) -> None:
        """Refuse photographs of several cameras by their names in EXIF data: one lens cannot measure in all of them."""
        cameras = Counter(str(tags.exif["Model"]) for tags in photos if tags.exif.get("Model"))
        if len(cameras) > 1:
            got = ", ".join(f"{name} ({count})" for name, count in sorted(cameras.items()))
            raise InputError(
                "photographs by several cameras", where=self.path, got=got, hint="put each camera's into a folder"
            )

    @property
    def dialects(self) -> dict[str, int]:
        """How many photographs are of which dialect."""
        return Counter(pose.dialect for pose in self._poses)


class PhotographDecoder:
    """Decodes photographs to tracks; each value is left out where the photograph does not say it."""

    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """Clock, attitudes, positions with heights above take-off, and heights above laser targets."""
        found = [(arrival_ns, pose) for arrival_ns, pose in self._poses(block) if pose is not None]
        if not found:
            return ()
        unix_ns = np.array([arrival_ns for arrival_ns, _ in found], dtype=np.int64)
        poses = [pose for _, pose in found]
        tracks: list[Track] = [ClockTrack(arrival_ns=unix_ns, boot_ns=unix_ns, unix_ns=unix_ns)]
        tracks += _attitudes(unix_ns, poses)
        tracks += _positions(unix_ns, poses)
        tracks += _heights(unix_ns, poses)
        return tuple(tracks)

    def _poses(self, block: RawBlock) -> Iterator[tuple[int, PhotoPose | None]]:
        rows = zip(block.arrival_ns.tolist(), block.offset.tolist(), block.length.tolist(), strict=True)
        for arrival_ns, offset, length in rows:
            try:
                tags = PhotoTags.from_json(block.data[offset : offset + length])
            except (ValueError, KeyError, TypeError):
                self.rejected["photograph: damaged"] += 1
                continue
            pose = pose_of_tags(tags)
            if pose is None or pose.wxyz is None:
                self.rejected["photograph: no camera attitude"] += 1
            yield arrival_ns, pose


def _attitudes(unix_ns: IntArray, poses: list[PhotoPose]) -> Iterator[Track]:
    rows = [row for row, pose in enumerate(poses) if pose.wxyz is not None]
    if not rows:
        return
    stds = [poses[row].std for row in rows]
    yield GimbalTrack(
        arrival_ns=unix_ns[rows],
        boot_ns=unix_ns[rows],
        source=GimbalSource.PHOTOGRAPH,
        wxyz=np.array([poses[row].wxyz for row in rows]),
        yaw_in_earth=np.ones(len(rows), dtype=np.bool_),
        std_rad=np.array([[std.tilt_rad, std.pan_rad, std.roll_rad, std.heading_rad] for std in stds]),
    )


def _positions(unix_ns: IntArray, poses: list[PhotoPose]) -> Iterator[Track]:
    rows = [row for row, pose in enumerate(poses) if pose.lat_rad is not None]
    if not rows:
        return
    yield PositionTrack(
        arrival_ns=unix_ns[rows],
        boot_ns=unix_ns[rows],
        lat_rad=_column([poses[row].lat_rad for row in rows]),
        lon_rad=_column([poses[row].lon_rad for row in rows]),
        alt_msl_m=_column([poses[row].altitude_m if poses[row].datum == "msl" else None for row in rows]),
        height_home_m=np.full(len(rows), np.nan),
        std_m=np.array([poses[row].std.horizontal_m for row in rows]),
    )


def _heights(unix_ns: IntArray, poses: list[PhotoPose]) -> Iterator[Track]:
    """Heights above the take-off point, and above the targets of laser rangefinders."""
    home = [(pose.height_home_m, pose.std.height_agl_m) if pose.height_home_m is not None else None for pose in poses]
    laser = [pose.laser_height for pose in poses]
    for source, heights in ((HeightSource.HOME, home), (HeightSource.RANGEFINDER, laser)):
        found = [(row, *height) for row, height in enumerate(heights) if height is not None]
        if not found:
            continue
        rows, value_m, std_m = map(list, zip(*found, strict=True))
        yield HeightTrack(
            arrival_ns=unix_ns[rows],
            boot_ns=unix_ns[rows],
            source=source,
            value_m=np.array(value_m),
            slant=False,
            std_m=np.array(std_m),
        )


def _column(values: list[float | None]) -> FloatArray:
    return np.array([math.nan if value is None else value for value in values])
