"""Layouts of a .bin log's messages, and their decoding to telemetry tracks."""

import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache, partial
from itertools import chain
from typing import Final

import numpy as np

from aerodft.adapters.telemetry.dataflash.framing import FMT_SIZE, FMT_TYPE, HEAD_SIZE
from aerodft.adapters.telemetry.mavlink import MAX_STAMP_US, ORIENTATION_DOWN, payload_rows
from aerodft.adapters.telemetry.tracks import (
    NO_SCALE,
    Rows,
    climb_track,
    height_track,
    mount_track,
    no_height,
    position_track,
    vehicle_track,
)
from aerodft.model import (
    BoolArray,
    ClockTrack,
    FloatArray,
    GimbalSource,
    HeightSource,
    IntArray,
    RawBlock,
    Track,
    TriggerSource,
    TriggerTrack,
    WireProtocol,
)
from aerodft.service import AngleScale

_FMT_DTYPE: Final = np.dtype([("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")])
_CODES: Final = {
    "a": ("<i2", (32,), 1.0),
    "b": ("i1", (), 1.0),
    "B": ("u1", (), 1.0),
    "g": ("<f2", (), 1.0),
    "h": ("<i2", (), 1.0),
    "H": ("<u2", (), 1.0),
    "i": ("<i4", (), 1.0),
    "I": ("<u4", (), 1.0),
    "f": ("<f4", (), 1.0),
    "n": ("S4", (), 1.0),
    "N": ("S16", (), 1.0),
    "Z": ("S64", (), 1.0),
    "c": ("<i2", (), 0.01),
    "C": ("<u2", (), 0.01),
    "e": ("<i4", (), 0.01),
    "E": ("<u4", (), 0.01),
    "L": ("<i4", (), 1e-7),
    "d": ("<f8", (), 1.0),
    "M": ("u1", (), 1.0),
    "q": ("<i8", (), 1.0),
    "Q": ("<u8", (), 1.0),
}
# ArduPilot's AP_RangeFinder_Params: RNGFND1_MIN and _MAX in metres, before 4.7 RNGFND1_MIN_CM and _MAX_CM. The sensor
# is counted from 1 there, in hexadecimal; from 0 in RFND.
_LIMIT: Final = re.compile(r"RNGFND([1-9A-F])_(MIN|MAX)(_CM)?")
_UNIT_M: Final = {None: 1.0, "_CM": 0.01}
_EPOCH_NS: Final = 315_964_800 * 10**9  # 1980-01-06 as Unix time
_WEEK_NS: Final = 604_800 * 10**9
# From each Unix time on: GPS minus UTC in seconds. Leap seconds by the IERS (Bulletin C; leap-seconds.list of the IANA
# time zone data) from 2006-01-01, 2009-01-01, 2012-07-01, 2015-07-01 and 2017-01-01; none since.
_LEAPS: Final = (
    (1_136_073_600, 14),
    (1_230_768_000, 15),
    (1_341_100_800, 16),
    (1_435_708_800, 17),
    (1_483_228_800, 18),
)
_GPS_FIX_3D: Final = 3
_WEEK_MS: Final = 7 * 86_400_000
_MAX_WEEK: Final = 11_480  # in the year 2200
_RANGEFINDER_GOOD: Final = 4
_TERRAIN_OK: Final = 2
_NUMBERS: Final = ("i", "u", "f")
_DEG: Final = math.radians(1)


class MessageFormat:
    """One message's layout.

    Attributes:
        name: For instance ``GPS``.
        dtype: The structured type of a message without its three-byte head.
        scale: What a field's integer is multiplied by.
    """

    def __init__(self, name: str, codes: str, columns: list[str]) -> None:
        self.name = name
        self.dtype = np.dtype([(column, *_CODES[code][:2]) for code, column in zip(codes, columns, strict=True)])
        self.scale = {column: _CODES[code][2] for code, column in zip(codes, columns, strict=True)}


@lru_cache(maxsize=1024)  # every log declares the same few hundred, and is read more than once
def parse_format(message: bytes) -> tuple[int, MessageFormat] | None:
    """The type number and layout that a FMT message declares.

    Args:
        message: The whole message, head included.

    Returns:
        None where it contradicts itself or uses an unknown code.
    """
    if len(message) != FMT_SIZE:
        return None
    fmt = np.frombuffer(message, dtype=_FMT_DTYPE, offset=HEAD_SIZE)[0]
    name, codes, columns = (fmt[key].decode("ascii", "replace") for key in ("name", "format", "columns"))
    names = columns.split(",") if columns else []
    if len(names) != len(codes) or len(set(names)) != len(names) or not set(codes) <= _CODES.keys():
        return None
    layout = MessageFormat(name, codes, names)
    return (int(fmt["type"]), layout) if layout.dtype.itemsize + HEAD_SIZE == int(fmt["length"]) else None


class Rangefinders:
    """Rangefinder limits that the log has stated so far."""

    def __init__(self) -> None:
        self._limits: dict[tuple[int, str], list[tuple[int, float]]] = defaultdict(list)
        self._followed: float | None = None

    def learn(self, names: Iterable[str], values: Iterable[float], boot_ns: Iterable[int]) -> None:
        """Take in parameters in the order of the log; those that are no limit of a rangefinder change nothing."""
        for name, value, at_ns in zip(names, values, boot_ns, strict=True):
            found = _LIMIT.fullmatch(name)
            if found and np.isfinite(value):
                changes = self._limits[int(found[1], 16) - 1, found[2]]
                while changes and changes[-1][0] > at_ns:  # a damaged time: the log goes on before it
                    changes.pop()
                changes.append((at_ns, value * _UNIT_M[found[3]]))

    def limit_m(self, bound: str, sensor: FloatArray, boot_ns: IntArray) -> FloatArray:
        """The limit of each reading ``(n,)``, NaN where none was known by then.

        Args:
            bound: ``MIN`` or ``MAX``.
            sensor: ``(n,)`` counted from 0.
            boot_ns: ``(n,)``.
        """
        limit_m = np.full(len(sensor), np.nan)
        for (number, kind), changes in self._limits.items():
            own = sensor == number
            if kind == bound and own.any():
                times_ns, values_m = zip(*changes, strict=True)
                limit_m[own] = np.array([np.nan, *values_m])[np.searchsorted(times_ns, boot_ns[own], side="right")]
        return limit_m

    def others(self, sensor: FloatArray, good: BoolArray) -> dict[str, BoolArray]:
        """A fault for the readings ``(n,)`` of other sensors than the first that gave a good one."""
        if self._followed is None and good.any():
            self._followed = float(sensor[np.argmax(good)])
        if self._followed is None:
            return {}
        return {f"of another sensor than number {self._followed:g}": sensor != self._followed}


def gps_to_unix_ns(week: IntArray, week_ms: IntArray) -> IntArray:
    """UTC as Unix ns from GPS week and milliseconds of the week, shapes ``(n,)``; leap seconds taken off."""
    gps_ns = _EPOCH_NS + week.astype(np.int64) * _WEEK_NS + week_ms.astype(np.int64) * 1_000_000
    gps_starts_ns = np.array([(start + leap) * 10**9 for start, leap in _LEAPS[1:]])
    leaps_ns = np.array([leap * 10**9 for _, leap in _LEAPS])
    leap_ns: IntArray = leaps_ns[np.searchsorted(gps_starts_ns, gps_ns, side="right")]
    return gps_ns - leap_ns


def _kind(dtype: np.dtype[np.void], column: str) -> str | None:
    """The letter of numpy for what a field holds (arrays are V); None where there is no such field."""
    return dtype[column].kind if column in (dtype.names or ()) else None


def _has(rows: Rows, *columns: str) -> bool:
    """Whether the log's version of the message has these fields, as numbers."""
    return all(_kind(rows.payload.dtype, column) in _NUMBERS for column in columns)


def _another_instance(rows: Rows) -> dict[str, BoolArray]:
    """Rows of a second receiver or mount."""
    return {"another instance": rows.payload["I"] != 0} if _has(rows, "I") else {}


def _gps_clock(week: str, week_ms: str, rows: Rows, rejected: Counter[str]) -> Track:
    """UTC of GPS, from the fields of the week and of the milliseconds in it."""
    no_fix = rows.payload["Status"] < _GPS_FIX_3D
    faults = {
        **_another_instance(rows),
        "no UTC yet": no_fix | (rows.payload[week] == 0),
        f"{week_ms} is no time of a week": rows.payload[week_ms] >= _WEEK_MS,
        "impossible year": rows.payload[week] >= _MAX_WEEK,
    }
    good = rows.accepted(rejected, faults)
    return ClockTrack(unix_ns=gps_to_unix_ns(good.payload[week], good.payload[week_ms]), **good.stamps())


def _gps_position(rows: Rows, rejected: Counter[str]) -> Track:
    """Position of GPS before Copter 3.3, whose RelAlt is the estimator's height above home; later POS has it."""
    with_fix = rows.rows(rows.payload["Status"] >= _GPS_FIX_3D)  # ``_gps_clock`` counts the others
    return position_track(with_fix, rejected, ("Lat", "Lng", "Alt", "RelAlt"), per_deg=1.0, per_m=1.0, down=None)


def _att(rows: Rows, rejected: Counter[str]) -> Track:
    return vehicle_track(rows, rejected, ("Yaw", "Pitch", "Roll"), _DEG)


def _mnt(rows: Rows, rejected: Counter[str]) -> Track:
    return mount_track(GimbalSource.DATAFLASH_MNT, rows, rejected, ("YawB", "Pitch", "Roll"), _another_instance(rows))


def _pos(rows: Rows, rejected: Counter[str]) -> Track:
    return position_track(rows, rejected, ("Lat", "Lng", "Alt", "RelHomeAlt"), per_deg=1.0, per_m=1.0, down=None)


def _estimator(rows: Rows, rejected: Counter[str]) -> Track:
    """Vertical speed of the first of several estimators (XKF1, NKF1)."""
    if _has(rows, "C"):
        rows = rows.rows(rows.payload["C"] == 0)
    return climb_track(rows, rejected, "VD")


def _rfnd(sensors: Rangefinders, rows: Rows, rejected: Counter[str]) -> Track:
    payload = rows.payload
    sensor = rows.column("Instance") if _has(rows, "Instance") else np.zeros(len(payload))
    looks_away, is_bad = payload["Orient"] != ORIENTATION_DOWN, payload["Stat"] != _RANGEFINDER_GOOD
    distance_m = rows.column("Dist")
    least_m, most_m = (sensors.limit_m(bound, sensor, rows.boot_ns) for bound in ("MIN", "MAX"))
    faults = {
        "does not look down": looks_away,
        "status is not good": is_bad,
        **sensors.others(sensor, ~looks_away & ~is_bad),
        **no_height(rows, "Dist"),
        "below the sensor's minimum": distance_m < least_m,
        "at the sensor's maximum or above": (most_m > 0) & (distance_m >= most_m),
    }
    good = rows.accepted(rejected, faults)
    return height_track(HeightSource.RANGEFINDER, good, good.column("Dist"), slant=True)


def _parm(sensors: Rangefinders, rows: Rows, _rejected: Counter[str]) -> Track | None:
    if _kind(rows.payload.dtype, "Name") == "S":
        index = np.flatnonzero(np.char.startswith(rows.payload["Name"], b"RNGFND"))
        names = (value.decode("ascii", "replace") for value in rows.payload["Name"][index].tolist())
        sensors.learn(names, rows.column("Value")[index].tolist(), rows.boot_ns[index].tolist())
    return None


def _terr(rows: Rows, rejected: Counter[str]) -> Track:
    faults = {
        "spacing is 0": rows.payload["Spacing"] == 0,
        "status is not good": rows.payload["Status"] != _TERRAIN_OK,
        **no_height(rows, "CHeight"),
    }
    good = rows.accepted(rejected, faults)
    return height_track(HeightSource.TERRAIN, good, good.column("CHeight"), slant=False)


def _trigger(source: TriggerSource, rows: Rows, rejected: Counter[str]) -> Track:
    good = rows.accepted(rejected, _another_instance(rows))
    return TriggerTrack(source=source, unix_ns=np.zeros(len(good.payload), dtype=np.int64), **good.stamps())


_Maker = Callable[[Rows, Counter[str]], Track | None]
_PARAMETER: Final = "PARM"
_Makers = tuple[tuple[tuple[str, ...], _Maker], ...]
_MAKERS: Final[dict[str, _Makers]] = {
    "GPS": (
        (("Status", "GMS", "GWk"), partial(_gps_clock, "GWk", "GMS")),
        (("Status", "TimeMS", "Week"), partial(_gps_clock, "Week", "TimeMS")),
        (("Status", "TimeMS", "Week", "Lat", "Lng", "Alt", "RelAlt"), _gps_position),
    ),
    "ATT": ((("Roll", "Pitch", "Yaw"), _att),),
    "MNT": ((("Roll", "Pitch", "YawB"), _mnt),),
    "POS": ((("Lat", "Lng", "Alt", "RelHomeAlt"), _pos),),
    "TERR": ((("Status", "Spacing", "CHeight"), _terr),),
    "XKF1": ((("VD",), _estimator),),
    "NKF1": ((("VD",), _estimator),),
    "CAM": (((), partial(_trigger, TriggerSource.DATAFLASH_CAM)),),
    "TRIG": (((), partial(_trigger, TriggerSource.DATAFLASH_TRIG)),),
}
"""By message the fields that it must have, and what makes a track of them; a message makes all tracks that it can."""
_BOOT_TIMES: Final = (("TimeUS", 1), ("T", 1000), ("TimeMS", 1000))
"""Fields of the time since boot, and their unit in us. GPS with T has in TimeMS the week's time."""


class DataflashDecoder:
    """Decodes an ArduPilot log's messages; learns their formats on the way. A ``service.ports.TelemetryDecoder``.

    A message that is one byte longer than its format is doubtful (``scan_dataflash``): no track holds it.

    Args:
        angle_scales: As in ``FollowedIds``.

    Attributes:
        rejected: Rows left out, by ``MESSAGE: reason``.
        formats: What the log has declared so far, by type number.
    """

    def __init__(self, angle_scales: Mapping[str, AngleScale] | None = None) -> None:
        self._angle_scales = angle_scales or {}
        self.rejected: Counter[str] = Counter()
        self.formats: dict[int, MessageFormat] = {}
        sensors = Rangefinders()
        self._makers: dict[str, _Makers] = {
            **_MAKERS,
            _PARAMETER: ((("Value",), partial(_parm, sensors)),),
            "RFND": ((("Dist", "Stat", "Orient"), partial(_rfnd, sensors)),),
        }

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's messages; no message is an error.

        Raises:
            ValueError: The block is not DataFlash.
        """
        if block.protocol != WireProtocol.DATAFLASH:
            raise ValueError(f"got a block of {block.protocol}, must be {WireProtocol.DATAFLASH}")
        data = np.frombuffer(block.data, dtype=np.uint8)
        whole = (block.offset >= 0) & (block.length >= HEAD_SIZE) & (block.offset + block.length <= len(data))
        kinds = np.full(len(whole), -1, dtype=np.int16)
        kinds[whole] = data[block.offset[whole] + HEAD_SIZE - 1]
        change = self._learn(block, np.flatnonzero(kinds == FMT_TYPE))
        if change:  # what is before it is of the layout that was known
            return (*self.decode(block.rows(slice(change))), *self.decode(block.rows(slice(change, None))))
        wanted = sorted(kind for kind, layout in self.formats.items() if layout.name in self._makers)
        wanted.sort(key=lambda kind: self.formats[kind].name != _PARAMETER)  # those of a block hold for its readings
        return tuple(chain.from_iterable(self._tracks(kind, np.flatnonzero(kinds == kind), block) for kind in wanted))

    def _learn(self, block: RawBlock, index: IntArray) -> int:
        """Take in what FMT messages declare; returns the row of the first one that changes a layout, 0 for none."""
        lengths = np.minimum(block.length[index], FMT_SIZE)  # a doubtful one is believed where it is consistent
        for row, offset, length in zip(index.tolist(), block.offset[index].tolist(), lengths.tolist(), strict=True):
            kind, layout = parse_format(block.data[offset : offset + length]) or (FMT_TYPE, None)
            if layout is None:
                continue
            if row and self.formats.get(kind, layout) is not layout:
                return int(row)
            self.formats[kind] = layout
        return 0

    def _tracks(self, kind: int, index: IntArray, block: RawBlock) -> Iterator[Track]:
        """The tracks of one message's rows."""
        layout = self.formats[kind]
        time = next((each for each in _BOOT_TIMES if _kind(layout.dtype, each[0]) == "u"), None)
        if not len(index) or time is None:
            return
        places = np.stack([block.offset[index] + HEAD_SIZE, block.length[index] - HEAD_SIZE])
        payload = payload_rows(block, places, layout.dtype)
        field, unit_us = time
        late = payload[field] >= MAX_STAMP_US // unit_us
        boot_ns = np.where(late, 0, payload[field]).astype(np.int64) * unit_us * 1000
        scale = self._angle_scales.get(layout.name, NO_SCALE)
        rows = Rows(layout.name, payload, block.arrival_ns[index], boot_ns, layout.scale, scale)
        is_doubtful = places[1] > layout.dtype.itemsize
        rows = rows.accepted(self.rejected, {"impossible time": late, "may be damaged": is_doubtful})
        if not len(rows.payload):
            return
        tracks = (make(rows, self.rejected) for columns, make in self._makers[layout.name] if _has(rows, *columns))
        yield from (track for track in tracks if track is not None and len(track.arrival_ns))
