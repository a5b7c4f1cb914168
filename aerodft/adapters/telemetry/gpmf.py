"""GoPro's metadata (GPMF): places and UTC of GPS5 and GPS9, in an MP4's track or in a file of payloads.

An item is a key, a type, a size, a count and its samples, all big-endian and padded to 4 bytes; items of type 0 hold
others. The camera's own attitude is not read: CORI counts from the start of the recording, IORI changes with the
stabilisation of the image, and the signs of GRAV's axes are not documented.
"""

import math
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from aerodft.adapters.files import looks_like, read_whole
from aerodft.adapters.images import video_info
from aerodft.adapters.telemetry.data_tracks import DataTrackLog, Packet, StampedFrame, carries, data_packets, is_video
from aerodft.adapters.telemetry.log_file import HEAD_BYTES
from aerodft.adapters.telemetry.mavlink import FollowedIds
from aerodft.adapters.telemetry.tracks import MAX_UNIX_NS, MIN_UNIX_NS
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, os_errors_as
from aerodft.geometry import from_yaw_pitch_roll
from aerodft.model import BoolArray, ClockTrack, GpsTrack, IntArray, PositionTrack, RawBlock, Track, VehicleTrack

PROTOCOL: Final = "gpmf"
TITLE: Final = "GoPro metadata (a GPMF file, or a GoPro's MP4)"

_MESSAGE: Final = "GPMF"
_DEVICE: Final = b"DEVC"
_STREAM: Final = b"STRM"
_PLACES: Final = (b"GPS9", b"GPS5")
_DESCRIBES: Final = (b"SCAL", b"TYPE", b"GPSF", b"GPSP")  # what a sample's stream says of it
_HEAD: Final = struct.Struct(">4sBBH")
_NESTED: Final = 0
_MOST_DEPTH: Final = 4
_CODES: Final = dict(zip(b"bBsSlLjJfd", "bBhHiIqQfd", strict=True))  # of struct, by a sample's type
_COMPLEX: Final = ord("?")
_LAT, _LON, _DAYS, _SECONDS, _DOP9, _FIX9 = 0, 1, 5, 6, 7, 8  # of GPS9
_MIN_FIX: Final = 2  # GPSF: 0 none, 2 and 3 of so many dimensions
_DOP_SCALE: Final = 0.01
_STD_PER_DOP_M: Final = 5.0  # chosen: of a consumer receiver's range error, halved and doubled by trees and open sky
_EPOCH_S: Final = datetime(2000, 1, 1, tzinfo=UTC).timestamp()  # from which GPS9 counts days
_DAY_S: Final = 86_400
_PER_MS: Final = 1000  # resolution of GPS9's times
_PAYLOAD_NS: Final = SECOND_NS  # GoPro writes one payload per second
_LONGEST_NS: Final = 3 * SECOND_NS
_CLOCK_OFF_S: Final = 60.0  # chosen: more than a camera's clock drifts in a month
_TIME_STD_S: Final = 0.3  # chosen: a receiver's places are that old, and the time of GPS5 is that of its payload
_BOOT_NS: Final = 10**15  # a steady count: of UTC what is left of eleven days
_MAX_LAT_DEG, _MAX_LON_DEG = 90.0, 180.0
_NOTES: Final = (
    "no height: GPS altitudes of GoPros are of no stated datum; state telemetry.height.manual_m",
    (
        "no camera angles are read (GRAV, CORI and IORI are not against north and the horizon): state `tilt_deg` or "
        "telemetry.attitude.fixed_mount; a gimbal is taken to keep the camera level"
    ),
)


@dataclass(frozen=True, slots=True)
class _Item:
    """An item: its key, the type and size of a sample, and its samples' bytes; ``raw`` with head and padding."""

    key: bytes
    kind: int
    size: int
    data: bytes
    raw: bytes

    def numbers(self, types: bytes = b"") -> list[tuple[float, ...]]:
        """Samples as numbers; empty where its type has none, or sizes contradict each other."""
        if not self.size:
            return []
        kinds = types if self.kind == _COMPLEX else bytes([self.kind])
        if not kinds or not set(kinds) <= _CODES.keys():
            return []
        one = struct.calcsize(">" + "".join(_CODES[each] for each in kinds))
        if self.size % one:
            return []
        sample = struct.Struct(">" + "".join(_CODES[each] for each in kinds) * (self.size // one))
        return list(sample.iter_unpack(self.data[: len(self.data) // self.size * self.size]))


def recognises(head: bytes) -> bool:
    """Whether a payload stands at the beginning."""
    return head.startswith(_DEVICE)


def recognises_video(path: Path) -> bool:
    """Whether a video carries payloads."""
    return carries(path, recognises)


def open_source(path: Path) -> DataTrackLog:
    """The places of a file of payloads or of a GoPro's MP4.

    Raises:
        InputError: It cannot be read, holds no place, or says nowhere when it was recorded.
    """
    with os_errors_as("cannot be read", where=path, expected=TITLE):
        with path.open("rb") as file:
            in_video = is_video(file.read(HEAD_BYTES))
        packets = data_packets(path, recognises) if in_video else _payloads(read_whole(path))
    streams = [(packet, items) for packet in packets for items in _streams(packet.data)]
    streams = [(packet, items) for packet, items in streams if any(key in items for key in _PLACES)]
    if not streams:
        got = f"{looks_like(path)} without GPS5 or GPS9" if in_video else "GPMF without GPS5 or GPS9"
        raise InputError("GoPro metadata without places", where=path, got=got, hint="was GPS switched off?")
    if any(b"GPS9" in items for _, items in streams):  # newer cameras write both
        streams = [(packet, items) for packet, items in streams if b"GPS9" in items]
    notes = list(_NOTES)
    frames = _with_own_times(streams) or _with_times_of_payloads(path, streams, notes)
    if not frames:
        raise InputError("GoPro metadata without places", where=path, got="GPS that had no fix", expected=TITLE)
    return DataTrackLog(path, PROTOCOL, frames, notes, _TIME_STD_S)


def new_decoder(followed: FollowedIds) -> "GpmfDecoder":  # noqa: ARG001 - of one camera alone
    """A decoder of places."""
    return GpmfDecoder()


def _payloads(data: bytes) -> list[Packet]:
    """The payloads of a file without times."""
    return [Packet(None, 0, item.raw) for item in _items(data) if item.key == _DEVICE]


def _items(data: bytes) -> Iterator[_Item]:
    """The items of some bytes, as far as they are whole."""
    at = 0
    while at + _HEAD.size <= len(data):
        key, kind, size, count = _HEAD.unpack_from(data, at)
        begin, end = at + _HEAD.size, at + _HEAD.size + size * count
        if end > len(data):
            return
        stop = begin + (size * count + 3) // 4 * 4
        yield _Item(key, kind, size, data[begin:end], data[at:stop].ljust(stop - at, b"\0"))
        at = stop


def _streams(data: bytes, depth: int = 0) -> Iterator[dict[bytes, _Item]]:
    """The items of each stream in a payload, by key."""
    for item in _items(data):
        if item.kind == _NESTED and item.key == _STREAM:
            yield {each.key: each for each in _items(item.data)}
        elif item.kind == _NESTED and depth < _MOST_DEPTH:
            yield from _streams(item.data, depth + 1)


def _one_by_one(items: Mapping[bytes, _Item], key: bytes) -> list[bytes]:
    """Each sample of a stream as a stream of its own: what the stream says of its samples, and the sample."""
    said = b"".join(items[each].raw for each in _DESCRIBES if each in items)
    item = items[key]
    if not item.size:
        return []
    samples = [item.data[at : at + item.size] for at in range(0, len(item.data) - item.size + 1, item.size)]
    padding = bytes(-item.size % 4)
    return [said + _HEAD.pack(key, item.kind, item.size, 1) + sample + padding for sample in samples]


def _with_own_times(streams: list[tuple[Packet, dict[bytes, _Item]]]) -> list[StampedFrame]:
    """Samples of GPS9, each of which has its UTC."""
    frames: list[StampedFrame] = []
    for packet, items in streams:
        samples = _one_by_one(items, b"GPS9") if b"GPS9" in items else []
        for k, frame in enumerate(samples):
            values = _values(frame)
            if len(values) <= _FIX9 or not values[_FIX9] >= _MIN_FIX:
                continue
            unix_s = _EPOCH_S + values[_DAYS] * _DAY_S + values[_SECONDS]
            if MIN_UNIX_NS <= unix_s * SECOND_NS < MAX_UNIX_NS:
                unix_ns = round(unix_s * _PER_MS) * (SECOND_NS // _PER_MS)
                frames.append(StampedFrame(unix_ns, _media_ns(packet, k, len(samples)), frame))
    return frames


def _with_times_of_payloads(
    path: Path, streams: list[tuple[Packet, dict[bytes, _Item]]], notes: list[str]
) -> list[StampedFrame]:
    """Samples of GPS5, spread over their payload, whose UTC is GPSU; samples without a fix are left out."""
    fixed = [
        (packet, items, unix_ns)
        for packet, items in streams
        if b"GPS5" in items and _fix(items) >= _MIN_FIX and (unix_ns := _utc_ns(items)) is not None
    ]
    if len(fixed) < len(streams):
        notes.append(f"no GPS fix in {len(streams) - len(fixed)} of {len(streams)} payloads, which are left out")
    offsets = sorted(unix_ns - packet.media_ns for packet, _, unix_ns in fixed if packet.media_ns is not None)
    frames: list[StampedFrame] = []
    for row, (packet, items, unix_ns) in enumerate(fixed):
        samples = _one_by_one(items, b"GPS5")
        if packet.media_ns is None or not offsets:
            following_ns = fixed[row + 1][2] if row + 1 < len(fixed) else unix_ns + _PAYLOAD_NS
            long_ns = following_ns - unix_ns
            long_ns = long_ns if 0 < long_ns <= _LONGEST_NS else _PAYLOAD_NS
            frames += [
                StampedFrame(unix_ns + k * long_ns // len(samples), None, frame) for k, frame in enumerate(samples)
            ]
            continue
        for k, frame in enumerate(samples):
            media_ns = _media_ns(packet, k, len(samples)) or 0
            frames.append(StampedFrame(offsets[len(offsets) // 2] + media_ns, media_ns, frame))
    spread_s = (offsets[-1] - offsets[0]) / SECOND_NS if offsets else 0.0
    if spread_s > _LONGEST_NS / SECOND_NS:
        notes.append(f"its GPS times are up to {spread_s:.1f} s apart from the video's time line: the median is taken")
    if frames and frames[0].media_ns is not None and (made_ns := video_info(path).start_ns) is not None:
        apart_s = abs(frames[0].unix_ns - made_ns) / SECOND_NS
        if apart_s > _CLOCK_OFF_S:
            notes.append(f"the camera's own clock is {apart_s:.0f} s off its GPS, whose UTC is taken")
    return frames


def _media_ns(packet: Packet, k: int, count: int) -> int | None:
    """Time of a payload's sample on the video's time line."""
    if packet.media_ns is None:
        return None
    return packet.media_ns + k * (packet.duration_ns or _PAYLOAD_NS) // max(count, 1)


def _fix(items: Mapping[bytes, _Item]) -> int:
    numbers = items[b"GPSF"].numbers() if b"GPSF" in items else []
    return int(numbers[0][0]) if numbers else 0


def _utc_ns(items: Mapping[bytes, _Item]) -> int | None:
    """UTC of GPSU, ``yymmddhhmmss.sss``."""
    text = items[b"GPSU"].data.decode("ascii", "replace") if b"GPSU" in items else ""
    if not text[:12].isdigit():
        return None
    try:
        whole = datetime.strptime(text[:12], "%y%m%d%H%M%S").replace(tzinfo=UTC)
        return round(whole.timestamp()) * SECOND_NS + round(float(f"0{text[12:16]}") * SECOND_NS)
    except ValueError:
        return None


def _values(frame: bytes) -> tuple[float, ...]:
    """The scaled numbers of a frame's sample; empty where it has none, or scales contradict it."""
    items = {item.key: item for item in _items(frame)}
    key = next((each for each in _PLACES if each in items), None)
    if key is None:
        return ()
    samples = items[key].numbers(items[b"TYPE"].data.rstrip(b"\0") if b"TYPE" in items else b"")
    scales = [number for row in (items[b"SCAL"].numbers() if b"SCAL" in items else []) for number in row]
    if not samples or len(scales) not in {1, len(samples[0])} or 0 in scales:
        return ()
    scales *= len(samples[0]) if len(scales) == 1 else 1
    return tuple(number / scale for number, scale in zip(samples[0], scales, strict=True))


class GpmfDecoder:
    """Decodes places, each on its own. A ``service.ports.TelemetryDecoder``.

    The vehicle's attitude is level with an unknown heading, for a camera whose tilt is stated.

    Attributes:
        rejected: Values left out, by ``GPMF: reason``.
    """

    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()

    def frame_names(self, block: RawBlock) -> tuple[IntArray, Mapping[int, str]]:
        """All samples are of one name."""
        return np.zeros(len(block.offset), dtype=np.int64), {0: _MESSAGE}

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's samples; no sample is an error.

        Raises:
            ValueError: The block is not of GPMF.
        """
        if block.protocol != PROTOCOL:
            raise ValueError(f"got a block of {block.protocol}, must be {PROTOCOL}")
        spans = zip(block.offset.tolist(), block.length.tolist(), strict=True)
        rows = [self._row(block.data[at : at + size]) for at, size in spans]
        known = np.array([row is not None for row in rows], dtype=np.bool_)
        if not known.any():
            return ()
        arrival = block.arrival_ns
        stamps = {"arrival_ns": arrival, "boot_ns": arrival % _BOOT_NS}
        lat_deg, lon_deg, fix, std_m = np.array([row for row in rows if row is not None]).T
        level = np.zeros(len(arrival))
        nothing = np.full(len(lat_deg), math.nan)
        return (
            ClockTrack(unix_ns=arrival, **stamps),
            PositionTrack(
                lat_rad=np.radians(lat_deg),
                lon_rad=np.radians(lon_deg),
                alt_msl_m=nothing,
                height_home_m=nothing,
                std_m=std_m,
                **_chosen(stamps, known),
            ),
            GpsTrack(
                fix=fix.astype(np.int64),
                satellites=np.full(len(fix), -1),
                horizontal_std_m=nothing,
                vertical_std_m=nothing,
                **_chosen(stamps, known),
            ),
            VehicleTrack(wxyz=from_yaw_pitch_roll(level, level, level), heading_std_rad=level + math.pi, **stamps),
        )

    def _row(self, frame: bytes) -> tuple[float, float, float, float] | None:
        """Latitude and longitude (degrees), fix, and standard deviation (m) of a sample; None where it has none."""
        values, items = _values(frame), {item.key: item for item in _items(frame)}
        if len(values) <= _LON:
            self.rejected[f"{_MESSAGE}: damaged sample"] += 1
            return None
        lat_deg, lon_deg = values[_LAT], values[_LON]
        if len(values) > _FIX9:
            fix, dop = values[_FIX9], values[_DOP9]
        else:
            said = items[b"GPSP"].numbers() if b"GPSP" in items else []
            fix, dop = _fix(items), said[0][0] * _DOP_SCALE if said else math.nan
        faults = {
            "no fix": not fix >= _MIN_FIX,
            "no position yet": lat_deg == 0 and lon_deg == 0,
            "impossible position": not (abs(lat_deg) <= _MAX_LAT_DEG and abs(lon_deg) <= _MAX_LON_DEG),
        }
        fault = next((each for each, is_so in faults.items() if is_so), None)
        if fault is not None:
            self.rejected[f"{_MESSAGE}: {fault}"] += 1
            return None
        return lat_deg, lon_deg, float(fix), dop * _STD_PER_DOP_M if dop > 0 else math.nan


def _chosen(stamps: Mapping[str, Any], chosen: BoolArray) -> dict[str, Any]:
    return {name: values[chosen] for name, values in stamps.items()}
