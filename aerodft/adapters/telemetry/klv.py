"""MISB ST 0601 metadata (KLV): UAS local sets in an MPEG-TS or in a file of their own.

A set is a 16-byte key, a BER length and items of tag, length and value; item 2 is its UTC, item 1 at its end the sum
of all bytes before it. Angles of the sensor are relative to the platform: yaw, then elevation, then roll, behind the
platform's heading, pitch and roll.
"""

import math
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from aerodft.adapters.files import looks_like, read_whole
from aerodft.adapters.telemetry.data_tracks import DataTrackLog, Packet, StampedFrame, carries, data_packets, is_video
from aerodft.adapters.telemetry.log_file import HEAD_BYTES
from aerodft.adapters.telemetry.mavlink import FollowedIds
from aerodft.adapters.telemetry.tracks import MAX_UNIX_NS, MIN_UNIX_NS
from aerodft.errors import InputError, counted, os_errors_as
from aerodft.geometry import from_yaw_pitch_roll, matrix, multiply
from aerodft.model import (
    BoolArray,
    CameraTrack,
    ClockTrack,
    FloatArray,
    GimbalSource,
    GimbalTrack,
    HeightSource,
    HeightTrack,
    IntArray,
    PositionTrack,
    RawBlock,
    Track,
    VehicleTrack,
    ZoomSource,
)

PROTOCOL: Final = "klv"
TITLE: Final = "MISB KLV metadata (a file of them, or an MPEG-TS video with them)"
KEY: Final = bytes.fromhex("060e2b34020b01010e01030101000000")
"""Universal key of a UAS local set (ST 0601)."""

_MESSAGE: Final = "KLV"
_LONG_FORM: Final = 0x80
_MOST_LENGTH_BYTES: Final = 3
_CHECKSUM, _STAMP, _CENTRE = 1, 2, 25  # tags
_CHECKSUM_ITEM: Final = bytes([_CHECKSUM, 2])
_US_NS: Final = 1000
_BOOT_NS: Final = 10**15  # a steady count: of UTC what is left of eleven days
_TIME_STD_S: Final = 0.1  # of asynchronous metadata beside images: three images at 30 per second
_EARTH_RADIUS_M: Final = 6_371_000.0
_SLACK_RAD: Final = math.radians(5)  # by which a frame centre may lie beside the optical axis
_SLACK_M: Final = 1.0  # altitudes have steps of 0.3 m


@dataclass(frozen=True, slots=True)
class _Item:
    """How the value of a tag is read: its struct, its full scale, and the value at its lowest code."""

    name: str
    code: str
    span: float
    low: float = 0.0

    def value(self, raw: bytes) -> float:
        """The value; NaN for the code that says that it is unknown.

        Raises:
            struct.error: The item has another length.
        """
        (number,) = struct.unpack(f">{self.code}", raw)
        bits = 8 * struct.calcsize(self.code)
        if self.code.islower():  # the lowest code of signed items says "out of range"
            return math.nan if number == -(1 << bits - 1) else number * self.span / (2**bits - 2)
        return float(self.low + number * self.span / (2**bits - 1))


_ITEMS: Final[dict[int, _Item]] = {
    5: _Item("heading_deg", "H", 360.0),
    6: _Item("pitch_deg", "h", 40.0),
    7: _Item("roll_deg", "h", 100.0),
    13: _Item("lat_deg", "i", 180.0),
    14: _Item("lon_deg", "i", 360.0),
    15: _Item("alt_msl_m", "H", 19_900.0, -900.0),
    16: _Item("hfov_deg", "H", 180.0),
    18: _Item("azimuth_deg", "I", 360.0),
    19: _Item("elevation_deg", "i", 360.0),
    20: _Item("sensor_roll_deg", "I", 360.0),
    23: _Item("centre_lat_deg", "i", 180.0),
    24: _Item("centre_lon_deg", "i", 360.0),
    _CENTRE: _Item("centre_msl_m", "H", 19_900.0, -900.0),
    90: _Item("full_pitch_deg", "i", 180.0),
    91: _Item("full_roll_deg", "i", 180.0),
}
"""Tags that are decoded, by ST 0601's tables; 90 and 91 replace 6 and 7, whose ranges are 20 and 50 degrees."""


def recognises(head: bytes) -> bool:
    """Whether a local set stands at the beginning."""
    return head.startswith(KEY)


def recognises_video(path: Path) -> bool:
    """Whether a video carries local sets."""
    return carries(path, _holds_key)


def _holds_key(data: bytes) -> bool:
    return KEY in data


def open_source(path: Path) -> DataTrackLog:
    """The local sets of a file or of a video's data track.

    Raises:
        InputError: It cannot be read, or holds no intact local set with a time.
    """
    with os_errors_as("cannot be read", where=path, expected=TITLE):
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        packets = data_packets(path, _holds_key) if is_video(head) else [Packet(None, 0, read_whole(path))]
    frames, faults, has_centre = [], Counter[str](), False
    for packet, local_set in _joined(packets):
        values, fault = _read_set(local_set)
        unix_ns = values.get(_STAMP, -1)
        if fault or not MIN_UNIX_NS <= unix_ns < MAX_UNIX_NS:
            faults[fault or ("impossible year" if _STAMP in values else "no time (tag 2)")] += 1
            continue
        has_centre |= _CENTRE in values
        frames.append(StampedFrame(round(unix_ns), packet.media_ns, local_set))
    if not frames:
        got = "; ".join(f"{counted(count, 'set')}: {fault}" for fault, count in faults.items()) or looks_like(path)
        raise InputError("no intact KLV local set", where=path, got=got, expected=TITLE)
    notes = [f"{count} of {len(frames) + faults.total()} KLV sets left out: {fault}" for fault, count in faults.items()]
    if has_centre:
        notes.append(
            "heights are above the frame centre's elevation, of the terrain that the sensor's system knows: state "
            'telemetry.height.manual_m and order = ["manual"] where the water is known better'
        )
    else:
        notes.append(
            "no frame centre elevation: altitudes above the sea are no heights; state telemetry.height.manual_m"
        )
    return DataTrackLog(path, PROTOCOL, frames, notes, _TIME_STD_S)


def new_decoder(followed: FollowedIds) -> "KlvDecoder":  # noqa: ARG001 - of one platform alone
    """A decoder of local sets."""
    return KlvDecoder()


def _joined(packets: list[Packet]) -> Iterator[tuple[Packet, bytes]]:
    """Local sets and the packets in which they begin; a set may go on in the next packet."""
    data = b"".join(packet.data for packet in packets)
    starts = np.cumsum([0, *(len(packet.data) for packet in packets)])
    at = data.find(KEY)
    while at >= 0:
        end = _set_end(data, at)
        packet = packets[int(np.searchsorted(starts, at, side="right")) - 1]
        after = data.find(KEY, at + len(KEY))
        if end is None or end > len(data) or 0 <= after < end:  # cut, or another set begins within it
            end = after if after >= 0 else len(data)
        yield packet, data[at:end]
        at = data.find(KEY, end)


def _set_end(data: bytes, at: int) -> int | None:
    length = _ber(data, at + len(KEY))
    return None if length is None else length[1] + length[0]


def _ber(data: bytes, at: int) -> tuple[int, int] | None:
    """A BER length at an offset, and where its bytes end; None where it is cut, indefinite or too long."""
    if at >= len(data):
        return None
    first = data[at]
    if first < _LONG_FORM:
        return first, at + 1
    count = first & ~_LONG_FORM
    if not 0 < count <= _MOST_LENGTH_BYTES or at + 1 + count > len(data):
        return None
    return int.from_bytes(data[at + 1 : at + 1 + count], "big"), at + 1 + count


def _read_set(frame: bytes) -> tuple[dict[int, float], str]:
    """Values of a local set by tag (the time in ns), and why it is none; empty for an intact one."""
    length = _ber(frame, len(KEY)) if frame.startswith(KEY) else None
    if length is None or length[1] + length[0] != len(frame):
        return {}, "cut off, or of a wrong length"
    if frame[-4:-2] != _CHECKSUM_ITEM:
        return {}, "no checksum (tag 1) at its end"
    if _sum(frame[:-2]) != int.from_bytes(frame[-2:], "big"):
        return {}, "wrong checksum"
    try:
        return _values(frame, length[1]), ""
    except ValueError as error:
        return {}, str(error)


def _values(frame: bytes, at: int) -> dict[int, float]:
    """Values of a set's items from an offset on, by tag.

    Raises:
        ValueError: An item is longer than the set, or of a wrong length.
    """
    values: dict[int, float] = {}
    while at < len(frame):
        tag, at = _tag(frame, at)
        size = _ber(frame, at)
        if size is None or size[1] + size[0] > len(frame):
            raise ValueError("an item is longer than its set")
        raw, at = frame[size[1] : size[1] + size[0]], size[1] + size[0]
        try:
            if tag == _STAMP:
                values[tag] = struct.unpack(">Q", raw)[0] * _US_NS
            elif tag in _ITEMS and raw:  # an item without a value says that it is unknown
                values[tag] = _ITEMS[tag].value(raw)
        except struct.error:
            raise ValueError(f"tag {tag} has a wrong length") from None
    return values


def _tag(frame: bytes, at: int) -> tuple[int, int]:
    """A BER-OID tag, and where it ends."""
    tag = 0
    while at < len(frame):
        tag = tag << 7 | (frame[at] & ~_LONG_FORM)
        at += 1
        if frame[at - 1] < _LONG_FORM:
            break
    return tag, at


def _sum(data: bytes) -> int:
    """ST 0601's checksum: the sum of 16-bit words, modulo 2^16; an odd last byte is a word's upper half."""
    padded = data + b"\0" if len(data) % 2 else data
    return int(np.frombuffer(padded, dtype=">u2").sum(dtype=np.int64)) & 0xFFFF


class KlvDecoder:
    """Decodes local sets, each on its own. A ``service.ports.TelemetryDecoder``.

    Attributes:
        rejected: Values left out, by ``KLV: reason``.
    """

    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()

    def frame_names(self, block: RawBlock) -> tuple[IntArray, Mapping[int, str]]:
        """All sets are of one name."""
        return np.zeros(len(block.offset), dtype=np.int64), {0: _MESSAGE}

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's sets; no set is an error.

        Raises:
            ValueError: The block is not of KLV.
        """
        if block.protocol != PROTOCOL:
            raise ValueError(f"got a block of {block.protocol}, must be {PROTOCOL}")
        rows: list[dict[int, float]] = []
        arrivals: list[int] = []
        spans = zip(block.offset.tolist(), block.length.tolist(), block.arrival_ns.tolist(), strict=True)
        for at, size, arrival_ns in spans:
            values, fault = _read_set(block.data[at : at + size])
            if fault:
                self.rejected[f"{_MESSAGE}: {fault}"] += 1
            else:
                rows.append(values)
                arrivals.append(arrival_ns)
        if not rows:
            return ()
        arrival = np.array(arrivals, dtype=np.int64)
        stamps = {"arrival_ns": arrival, "boot_ns": arrival % _BOOT_NS}
        columns = {item.name: np.array([row.get(tag, math.nan) for row in rows]) for tag, item in _ITEMS.items()}
        tracks = [ClockTrack(unix_ns=arrival, **stamps), *self._tracks(columns, stamps)]
        return tuple(track for track in tracks if len(track.arrival_ns))

    def _tracks(self, values: Mapping[str, FloatArray], stamps: Mapping[str, Any]) -> Iterator[Track]:
        has_place = self._has_place(values)
        yield PositionTrack(
            lat_rad=np.radians(values["lat_deg"][has_place]),
            lon_rad=np.radians(values["lon_deg"][has_place]),
            alt_msl_m=values["alt_msl_m"][has_place],
            height_home_m=np.full(int(has_place.sum()), np.nan),
            **_chosen(stamps, has_place),
        )
        pitch_deg = np.where(np.isnan(values["full_pitch_deg"]), values["pitch_deg"], values["full_pitch_deg"])
        roll_deg = np.where(np.isnan(values["full_roll_deg"]), values["roll_deg"], values["full_roll_deg"])
        platform, has_platform = _attitudes(values["heading_deg"], pitch_deg, roll_deg)
        sensor, has_sensor = _attitudes(values["azimuth_deg"], values["elevation_deg"], values["sensor_roll_deg"])
        has_camera = has_platform & has_sensor
        camera = multiply(platform, sensor)
        height_m = values["alt_msl_m"] - values["centre_msl_m"]
        is_contradicted = has_camera & _looks_elsewhere(camera, values, height_m)
        self._count(is_contradicted, "the camera's angles and its frame centre contradict each other")
        is_good = has_camera & ~is_contradicted
        yield VehicleTrack(wxyz=platform[has_platform], **_chosen(stamps, has_platform))
        yield GimbalTrack(
            source=GimbalSource.KLV,
            wxyz=camera[is_good],
            yaw_in_earth=np.ones(int(is_good.sum()), dtype=np.bool_),
            **_chosen(stamps, is_good),
        )
        is_above = np.isfinite(height_m) & (height_m > 0) & ~is_contradicted
        self._count(height_m <= 0, "the sensor is not above its frame centre")
        yield HeightTrack(
            source=HeightSource.TERRAIN,
            value_m=height_m[is_above],
            slant=False,
            std_m=np.full(int(is_above.sum()), np.nan),
            **_chosen(stamps, is_above),
        )
        yield _zooms(values["hfov_deg"], stamps)

    def _has_place(self, values: Mapping[str, FloatArray]) -> BoolArray:
        lat_deg, lon_deg = values["lat_deg"], values["lon_deg"]
        no_fix = (lat_deg == 0) & (lon_deg == 0)
        self._count(no_fix, "no position yet")
        has_place: BoolArray = np.isfinite(lat_deg) & np.isfinite(lon_deg) & ~no_fix
        return has_place

    def _count(self, where: BoolArray, reason: str) -> None:
        if where.any():
            self.rejected[f"{_MESSAGE}: {reason}"] += int(where.sum())


def _attitudes(yaw_deg: FloatArray, pitch_deg: FloatArray, roll_deg: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Attitudes ``(n, 4)`` of yaw, pitch and roll, and where all three are stated."""
    angles = np.stack([yaw_deg, pitch_deg, roll_deg])
    known: BoolArray = np.all(np.isfinite(angles), axis=0)
    return from_yaw_pitch_roll(*np.radians(np.where(known, angles, 0.0))), known


def _looks_elsewhere(camera: FloatArray, values: Mapping[str, FloatArray], height_m: FloatArray) -> BoolArray:
    """Whether the optical axis ``(n,)`` passes a stated frame centre by more than its errors; false where unknown."""
    lat_rad = np.radians(values["lat_deg"])
    north_m = np.radians(values["centre_lat_deg"] - values["lat_deg"]) * _EARTH_RADIUS_M
    east_m = np.radians(values["centre_lon_deg"] - values["lon_deg"]) * _EARTH_RADIUS_M * np.cos(lat_rad)
    away_m = np.stack([north_m, east_m, height_m], axis=-1)
    range_m = np.sqrt(np.sum(away_m**2, axis=-1))
    known: BoolArray = np.isfinite(range_m) & (height_m > 0)
    axis = matrix(camera)[..., 0]
    cosine = np.sum(axis * np.where(known[:, None], away_m, 0.0), axis=-1) / np.where(known, range_m, 1.0)
    off_rad = np.arccos(np.clip(cosine, -1.0, 1.0))
    drop_rad = np.where(known, range_m, 0.0) / _EARTH_RADIUS_M  # the earth's curvature
    is_off: BoolArray = off_rad > _SLACK_RAD + drop_rad + np.arctan2(_SLACK_M, np.where(known, range_m, 1.0))
    return known & is_off


def _zooms(hfov_deg: FloatArray, stamps: Mapping[str, Any]) -> Track:
    known = np.isfinite(hfov_deg) & (hfov_deg > 0)
    none = np.zeros(int(known.sum()), dtype=np.int64)
    return CameraTrack(
        source=ZoomSource.KLV,
        device=none + 1,
        stream=none,
        hfov_rad=np.radians(hfov_deg[known]),
        level=np.full(len(none), math.nan),
        size_px=np.zeros((len(none), 2), dtype=np.int64),
        **_chosen(stamps, known),
    )


def _chosen(stamps: Mapping[str, Any], chosen: BoolArray) -> dict[str, Any]:
    return {name: values[chosen] for name, values in stamps.items()}
