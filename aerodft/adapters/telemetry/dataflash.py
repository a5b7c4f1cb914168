"""ArduPilot's self-describing log format (.bin): messages found in a file, and decoded to telemetry tracks.

A FMT message names the fields of every other message.
"""

import math
import re
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.files import looks_like
from aerodft.adapters.telemetry.log_file import LogFile, Piece
from aerodft.adapters.telemetry.mavlink import (
    AT_SYNC,
    JUMP_US,
    MAX_STAMP_US,
    N_OK,
    N_SKIPPED,
    N_TRUNCATED,
    ORIENTATION_DOWN,
    Bytes,
    FollowedIds,
    payload_rows,
    plausible_stamps,
)
from aerodft.adapters.telemetry.tracks import Rows, height_track, mount_track, no_height, position_track, vehicle_track
from aerodft.jit import njit, njit_inline
from aerodft.model import (
    BoolArray,
    ClockTrack,
    Event,
    FloatArray,
    GimbalSource,
    HeightSource,
    ImageArray,
    IntArray,
    RawBlock,
    Track,
    WireProtocol,
)

HEAD: Final = (0xA3, 0x95)
HEAD_SIZE: Final = 3
FMT_TYPE: Final = 128
FMT_SIZE: Final = 89
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
# From each Unix time on: GPS minus UTC in seconds (leap seconds that autopilot logs can meet).
_LEAPS: Final = ((1_230_768_000, 15), (1_341_100_800, 16), (1_435_708_800, 17), (1_483_228_800, 18))
_GPS_FIX_3D: Final = 3
_WEEK_MS: Final = 7 * 86_400_000
_MAX_WEEK: Final = 11_480  # in the year 2200
_RANGEFINDER_GOOD: Final = 4
_TERRAIN_OK: Final = 2
_NUMBERS: Final = ("i", "u", "f")
_DEG: Final = math.radians(1)


_FIRST, _SECOND = HEAD
_FMT_FORMAT_AT, _FMT_COLUMNS_AT = 9, 25
_TIME_COLUMN: Final = np.frombuffer(b"TimeUS", dtype=np.uint8)
_TIMED: Final = 1 << 8  # beside a type's length: the message starts with TimeUS
_TIME_SIZE: Final = 8
_WHOLE_ODDS: Final = 1 / 3  # before noise, of a whole message to one that is overwritten from some byte on
_FILL_BYTES: Final = 8  # as many equal ones behind a message are a fill, as of zeros
_NEAR_US: Final = 10_000_000  # of two messages side by side; one that stands there by chance is years away
_TYPES: Final = 256
_MOST_HALF_HEADS: Final = 8  # one behind the other, where a log goes on
_SECTION_BYTES: Final = 1 << 19  # of a log: a message is judged by those of its own and of the sections beside it
_BLOCK_MESSAGES: Final = 1 << 15
_FIRST_MESSAGES: Final = 1 << 12

PROTOCOL: Final = WireProtocol.DATAFLASH
TITLE: Final = "an ArduPilot .bin log"


def recognises(head: bytes) -> bool:
    """Whether a message stands at the beginning."""
    return head.startswith(bytes(HEAD))


def open_source(path: Path) -> "DataflashSource":
    """A .bin log as blocks of messages."""
    return DataflashSource(path)


def new_decoder(followed: FollowedIds) -> "DataflashDecoder":  # noqa: ARG001 - a log of its own vehicle alone
    """A decoder that learns the messages' layouts on the way."""
    return DataflashDecoder()


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
    starts_ns = np.array([start * 10**9 for start, _ in _LEAPS[1:]])
    leaps_ns = np.array([leap * 10**9 for _, leap in _LEAPS])
    leap_ns: IntArray = leaps_ns[np.searchsorted(starts_ns, gps_ns - leaps_ns[-1], side="right")]
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


def _gps(rows: Rows, rejected: Counter[str]) -> Track:
    no_fix = rows.payload["Status"] < _GPS_FIX_3D
    faults = {
        **_another_instance(rows),
        "no UTC yet": no_fix | (rows.payload["GWk"] == 0),
        "GMS is no time of a week": rows.payload["GMS"] >= _WEEK_MS,
        "impossible year": rows.payload["GWk"] >= _MAX_WEEK,
    }
    good = rows.accepted(rejected, faults)
    return ClockTrack(unix_ns=gps_to_unix_ns(good.payload["GWk"], good.payload["GMS"]), **good.stamps())


def _att(rows: Rows, rejected: Counter[str]) -> Track:
    return vehicle_track(rows, rejected, ("Yaw", "Pitch", "Roll"), _DEG)


def _mnt(rows: Rows, rejected: Counter[str]) -> Track:
    return mount_track(GimbalSource.DATAFLASH_MNT, rows, rejected, ("YawB", "Pitch", "Roll"), _another_instance(rows))


def _pos(rows: Rows, rejected: Counter[str]) -> Track:
    return position_track(rows, rejected, ("Lat", "Lng", "Alt", "RelHomeAlt"), per_deg=1.0, per_m=1.0)


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


_Maker = Callable[[Rows, Counter[str]], Track | None]
_PARAMETER: Final = "PARM"
# By message the fields that it must have, and what makes a track of them.
_MAKERS: Final[dict[str, tuple[tuple[str, ...], _Maker]]] = {
    "GPS": (("Status", "GMS", "GWk"), _gps),
    "ATT": (("Roll", "Pitch", "Yaw"), _att),
    "MNT": (("Roll", "Pitch", "YawB"), _mnt),
    "POS": (("Lat", "Lng", "Alt", "RelHomeAlt"), _pos),
    "TERR": (("Status", "Spacing", "CHeight"), _terr),
}


class DataflashDecoder:
    """Decodes an ArduPilot log's messages; learns their formats on the way. A ``service.ports.TelemetryDecoder``.

    Attributes:
        rejected: Rows left out, by ``MESSAGE: reason``.
        formats: What the log has declared so far, by type number.
    """

    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()
        self.formats: dict[int, MessageFormat] = {}
        sensors = Rangefinders()
        self._makers: dict[str, tuple[tuple[str, ...], _Maker]] = {
            **_MAKERS,
            _PARAMETER: (("Value",), partial(_parm, sensors)),
            "RFND": (("Dist", "Stat", "Orient"), partial(_rfnd, sensors)),
        }

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's messages, at most one a message and layout; no message is an error.

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
        tracks = (self._track(kind, np.flatnonzero(kinds == kind), block) for kind in wanted)
        return tuple(track for track in tracks if track is not None)

    def _learn(self, block: RawBlock, index: IntArray) -> int:
        """Take in what FMT messages declare; returns the row of the first one that changes a layout, 0 for none."""
        for row, offset, length in zip(
            index.tolist(), block.offset[index].tolist(), block.length[index].tolist(), strict=True
        ):
            kind, layout = parse_format(block.data[offset : offset + length]) or (FMT_TYPE, None)
            if layout is None:
                continue
            if row and self.formats.get(kind, layout) is not layout:
                return int(row)
            self.formats[kind] = layout
        return 0

    def _track(self, kind: int, index: IntArray, block: RawBlock) -> Track | None:
        """The track of one message's rows."""
        layout = self.formats[kind]
        if not len(index) or _kind(layout.dtype, "TimeUS") != "u":
            return None
        places = np.stack([block.offset[index] + HEAD_SIZE, block.length[index] - HEAD_SIZE])
        payload = payload_rows(block, places, layout.dtype)
        late = payload["TimeUS"] >= MAX_STAMP_US
        boot_ns = np.where(late, 0, payload["TimeUS"]).astype(np.int64) * 1000
        rows = Rows(layout.name, payload, block.arrival_ns[index], boot_ns, layout.scale)
        rows = rows.accepted(self.rejected, {"impossible time": late})
        columns, make = self._makers[layout.name]
        if not len(rows.payload) or not _has(rows, *columns):
            return None
        track = make(rows, self.rejected)
        return track if track is not None and len(track.arrival_ns) else None


@njit_inline
def _starts(data: Bytes, at: int) -> bool:
    """Whether the two bytes stand here that every message starts with."""
    return at + 1 < len(data) and data[at] == _FIRST and data[at + 1] == _SECOND


@njit_inline
def _may_hold_head(data: Bytes) -> bool:
    """Whether the first byte of a head is among the bytes; the loop has no early end, so that it is vectorised."""
    found = False
    for i in range(len(data)):
        found |= data[i] == _FIRST
    return found


@njit
def _goes_on(data: Bytes, at: int, types: IntArray) -> bool:
    """Whether a message starts at ``at``, or the log ends.

    A head with one wrong byte is one where the log goes on behind the message that it is the head of; of heads that
    were cut off, their first byte may be left.
    """
    for _ in range(_MOST_HALF_HEADS):
        if at >= len(data):
            break
        first, second = data[at] == _FIRST, at + 1 >= len(data) or data[at + 1] == _SECOND
        if first and second:
            return True
        if first and data[at + 1] == _FIRST:
            at += 1
            continue
        size = types[data[at + 2]] & 0xFF if at + 2 < len(data) else 0
        if size == 0 or not (first or second):
            return False
        at += size
    return at == len(data)


@njit
def _is_near(data: Bytes, one: int, other: int, types: IntArray) -> bool:
    """Whether messages that start at two places were logged at nearly one time; not where one has none."""
    for at in (one, other):
        if at + HEAD_SIZE + _TIME_SIZE > len(data) or not types[data[at + 2]] & _TIMED:
            return False
    one_us, other_us = _time_us(data, one + HEAD_SIZE), _time_us(data, other + HEAD_SIZE)
    return min(one_us, other_us) >= 0 and abs(one_us - other_us) < _NEAR_US


@njit
def _holds_another(data: Bytes, at: int, end: int, types: IntArray) -> bool:
    """Whether another message starts before a message ends, by their bytes from ``at`` to ``end``.

    A head may stand there by chance: then no other comes soon, the log does not go on behind its message, and its time
    is another one, while what follows at the end is of the message's own.
    """
    if _starts(data, end - 2):
        return True
    for inner in range(at + len(HEAD), min(end, len(data) - HEAD_SIZE + 1)):
        if not _starts(data, inner) or types[data[inner + 2]] == 0:
            continue
        if inner < at + HEAD_SIZE and _starts(data, end) and not _is_near(data, inner, end, types):
            continue  # a type and a time that look like a head, not a head without a type
        if (
            not types[data[inner + 2]] & _TIMED
            or _is_near(data, at, inner, types)
            or not _is_near(data, at, end, types)
        ):
            return True
        inner_end = inner + (types[data[inner + 2]] & 0xFF)
        if inner_end != end and _goes_on(data, inner_end, types):
            return True
        for soon in range(inner + HEAD_SIZE, inner + HEAD_SIZE + _TIME_SIZE):
            if _starts(data, soon):
                return True
    return False


@njit
def _time_us(data: Bytes, at: int) -> int:
    """The time since boot of a message that begins with it, at ``at``; -1 where it is none."""
    stamp = 0
    for i in range(7, -1, -1):
        if stamp >= MAX_STAMP_US >> 8:
            return -1
        stamp = stamp << 8 | int(data[at + i])
    return stamp


@njit
def _learn_type(data: Bytes, at: int, types: IntArray) -> None:
    """Take in the size of the type that a FMT message declares, and whether it starts with a time."""
    size = int(data[at + 4])
    timed = data[at + _FMT_FORMAT_AT] == ord("Q")
    for i in range(len(_TIME_COLUMN)):
        timed = timed and data[at + _FMT_COLUMNS_AT + i] == _TIME_COLUMN[i]
    if size >= HEAD_SIZE and data[at + 3] != FMT_TYPE:
        types[data[at + 3]] = size | (_TIMED if timed else 0)


@njit
def scan_dataflash(
    data: Bytes, start: int, limit: int, types: IntArray, rows: IntArray, state: IntArray
) -> tuple[int, int]:
    """Find messages from ``start``, until ``rows`` is full or ``limit`` is passed.

    Args:
        data: The whole file.
        start: Where to go on.
        limit: Where to stop looking.
        types: ``(256,)`` size of each known type, and the mark of those that start with a time; learns.
        rows: ``(3, n)`` filled with each message's offset, its size, negative where damage follows, and its time
            since boot in us, -1 where it has none.
        state: ``(STATE_SIZE,)``, updated.

    Returns:
        Number of messages, and where to go on.
    """
    at, found, stop = start, 0, len(data)
    while at < min(stop, limit) and found < rows.shape[1]:
        kind, synced = 0, at == state[AT_SYNC]
        if at + HEAD_SIZE <= stop and data[at] == _FIRST and data[at + 1] == _SECOND:
            kind = types[data[at + 2]]
        size = kind & 0xFF
        end = at + size
        is_whole, is_sure = size > 0 and end <= stop, True
        if is_whole and (not _starts(data, end) or _may_hold_head(data[at + len(HEAD) : end])):  # seldom
            is_whole = not _holds_another(data, at, end, types)
            is_sure = _goes_on(data, end, types) or not kind & _TIMED  # without a time it reaches no pose
        if not is_whole:
            if synced and (end > stop or stop - at < HEAD_SIZE):
                state[N_TRUNCATED] += 1
            state[N_SKIPPED] += 1
            at += 1
            continue
        if data[at + 2] == FMT_TYPE:
            _learn_type(data, at, types)
        timed = kind & _TIMED and at + HEAD_SIZE + 8 <= stop
        rows[0, found], rows[1, found] = at, size if is_sure else -size
        rows[2, found] = _time_us(data, at + HEAD_SIZE) if timed else -1
        found += 1
        state[N_OK] += 1
        state[AT_SYNC] = end
        at = end
    return found, at


def _resemble(doubtful: ImageArray, after: ImageArray, sure: ImageArray) -> BoolArray:
    """Whether messages before damage are whole, rather than overwritten from some byte on, each as likely as another.

    Args:
        doubtful: ``(m, size)`` their bytes.
        after: ``(m, k)`` what follows each: noise, or a fill of equal bytes.
        sure: ``(n, size)`` the bytes of whole messages of the same type.

    Returns:
        ``(m,)``. By the frequencies of whole messages' values at each place, the last bytes, however many, are likelier
        than noise; before a fill, so many last bytes that are of the fill are likelier than a place of its beginning.
    """
    size, places = sure.shape[1], np.arange(sure.shape[1])
    counts = np.bincount((places * 256 + sure).ravel(), minlength=size * 256).reshape(-1, 256)
    new_values = np.count_nonzero(counts, axis=1, keepdims=True)  # of n, as 1 in 256 of noise's
    bits = np.log2(np.maximum(256 * counts / len(sure), new_values / (len(sure) + 1)))[places, doubtful]
    whole: BoolArray = np.cumsum(bits[:, ::-1], axis=1).min(axis=1) > -np.log2(_WHOLE_ODDS * size)
    is_fill = (after == after[:, :1]).all(axis=1)
    for value in np.unique(after[is_fill, 0]).tolist():
        filled = np.flatnonzero(is_fill & (after[:, 0] == value))
        ends = np.bincount(_end_bytes(sure, value), minlength=size + 1)
        end = _end_bytes(doubtful[filled], value)
        whole[filled] = (end == 0) | (ends[end] * size > len(sure))  # an even chance: logs are allocated ahead
    return whole


def _end_bytes(messages: ImageArray, value: int) -> IntArray:
    """``(n,)`` how many of the last bytes of messages ``(n, size)`` have a value."""
    others = messages[:, ::-1] != value
    ends: IntArray = np.where(others.any(axis=1), others.argmax(axis=1), messages.shape[1])
    return ends


@dataclass(frozen=True)
class _Found:
    """Messages that were found one behind the other.

    Attributes:
        piece: The part of the log that they are in.
        rows: ``(3, n)`` as of ``scan_dataflash``, with at least one.
    """

    piece: Piece
    rows: IntArray

    @cached_property
    def is_sure(self) -> BoolArray:
        """``(n,)`` whether no damage follows a message."""
        is_sure: BoolArray = self.rows[1] > 0
        return is_sure

    @cached_property
    def layouts(self) -> IntArray:
        """``(n,)`` one number for each type and size."""
        layouts: IntArray = self.bytes_at(HEAD_SIZE - 1, 1)[:, 0] * np.int64(_TYPES) + np.abs(self.rows[1])
        return layouts

    @cached_property
    def sure(self) -> dict[int, IntArray]:
        """The messages of each layout that no damage follows."""
        index = np.flatnonzero(self.is_sure)
        index = index[np.argsort(self.layouts[index], kind="stable")]
        layouts, starts = np.unique(self.layouts[index], return_index=True)
        return dict(zip(layouts.tolist(), np.split(index, starts[1:]), strict=True))

    @property
    def last_section(self) -> int:
        """The section of the log that the last message starts in."""
        return int(self.sections(slice(-1, None))[0])

    def sections(self, index: slice | IntArray) -> IntArray:
        """``(m,)`` the sections of the log that some messages start in."""
        sections: IntArray = (self.piece.first + self.rows[0, index]) // _SECTION_BYTES
        return sections

    def bytes_at(self, skip: int, size: int, index: slice | IntArray = slice(None)) -> ImageArray:
        """``(m, size)`` bytes that stand so many behind the start of some messages."""
        data = np.frombuffer(self.piece.raw, dtype=np.uint8)
        places = self.rows[0, index, None] + skip + np.arange(size)
        found: ImageArray = data[np.minimum(places, len(data) - 1)]
        return found

    def is_surrounded(self, last: "_Found") -> bool:
        """Whether all that this is judged by was found, up to the last."""
        return bool(self.is_sure.all()) or last.last_section > self.last_section + 1

    def is_whole(self, surroundings: Iterable["_Found"], before_us: int) -> BoolArray:
        """``(n,)`` whether no damage has reached a message, as far as bytes tell; its time where no other is like it.

        Args:
            surroundings: What was found in the same sections and in those beside them.
            before_us: The last time since boot before the first message.
        """
        is_whole, doubtful = self.is_sure.copy(), np.flatnonzero(~self.is_sure)
        timed = np.flatnonzero(self.rows[2] >= 0)
        is_whole[timed] |= np.abs(np.diff(self.rows[2, timed], prepend=before_us)) < _NEAR_US
        places = np.stack([self.sections(doubtful), self.layouts[doubtful]])
        alike, number = np.unique(places, axis=1, return_inverse=True)
        for k, (section, layout) in enumerate(alike.T.tolist()):
            size, index = layout % _TYPES, doubtful[number == k]
            sure = np.concatenate([each.sure_bytes(section, layout, size) for each in surroundings])
            if len(sure):
                doubted, after = self.bytes_at(0, size, index), self.bytes_at(size, _FILL_BYTES, index)
                is_whole[index] = _resemble(doubted, after, sure)
        return is_whole

    def sure_bytes(self, section: int, layout: int, size: int) -> ImageArray:
        """``(m, size)`` bytes of messages of a layout, in a section or beside it, that no damage follows."""
        index = self.sure.get(layout, np.empty(0, dtype=np.int64))
        return self.bytes_at(0, size, index[np.abs(self.sections(index) - section) <= 1])


def _with_surroundings(batches: Iterable[_Found]) -> Iterator[tuple[_Found, Iterable[_Found]]]:
    """Each batch, and all that have messages of the same sections of the log or of those beside them."""
    held: deque[_Found] = deque()
    turn = 0
    for batch in chain(batches, (None,)):
        if batch is not None:
            held.append(batch)
        while turn < len(held) and (batch is None or held[turn].is_surrounded(batch)):
            yield held[turn], held
            while held[0].last_section < held[turn].last_section - 1:
                held.popleft()
                turn -= 1
            turn += 1


def _with_following(batches: Iterable[_Found]) -> Iterator[tuple[_Found, int]]:
    """Each batch, and the first time since boot (us) that can be read behind it, where its last one needs it; else -1.

    A batch is not held back without need: what was just found is decoded in half the time.
    """
    held: list[_Found] = []
    for batch in batches:
        times_us = batch.rows[2]
        if held and (first_us := _first_time(times_us)) >= 0:
            yield from ((each, first_us) for each in held)
            held = []
        if held or times_us[-2:].min() < 0 or np.ptp(times_us[-2:]) > JUMP_US or len(times_us) == 1:
            held.append(batch)
        else:
            yield batch, -1
    yield from ((each, -1) for each in held)


def _first_time(times_us: IntArray) -> int:
    """The first time since boot that can be read, of some; -1 where none can."""
    return int(times_us[np.argmax(times_us >= 0)])


class DataflashSource(LogFile):
    """A .bin log as blocks of raw messages, the ones that describe the format included.

    Arrival is UTC: the first good GPS message ties the log's time since boot to it; without one the file's
    modification time is taken as the log's end.

    Args:
        path: The file.

    Raises:
        InputError: The file is missing, a folder, unreadable, empty, or no such log.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, TITLE)
        self._first_us, self._unix_minus_boot_ns, self._has_gps = self._boot_to_utc()

    def events(self) -> Iterator[Event]:
        """All messages in order, in blocks of bounded size; memory does not grow with the file."""
        for block in self._scan():
            # What comes before the first stamp (the format's description) arrives with it.
            time_ns = np.maximum(block.arrival_ns, self._first_us * 1000)
            yield replace(block, arrival_ns=time_ns + self._unix_minus_boot_ns)

    def _scan(self, most: int = _BLOCK_MESSAGES) -> Iterator[RawBlock]:
        """Blocks of at most so many, whose arrival is still the time since boot, 0 before the first stamp."""
        types = np.zeros(_TYPES, dtype=np.int64)
        types[FMT_TYPE] = FMT_SIZE
        last_us = 0

        def scan(data: Bytes, start: int, limit: int, rows: IntArray, state: IntArray) -> tuple[int, int]:
            return scan_dataflash(data, start, limit, types, rows, state)

        found = (_Found(piece, rows) for piece, rows in self.scan_pieces(scan, most, self.size))
        for batch, following_us in _with_following(self._whole(found)):
            stamps_us = batch.rows[2]
            plausible_stamps(stamps_us, last_us, following_us)
            last_us = int(stamps_us[-1])
            yield batch.piece.block(batch.rows, WireProtocol.DATAFLASH, self.path.name)

    def _whole(self, batches: Iterable[_Found]) -> Iterator[_Found]:
        """Batches without messages that damage has reached."""
        last_us = 0
        for batch, surroundings in _with_surroundings(batches):
            before_us, last_us = last_us, max(_first_time(batch.rows[2, ::-1]), 0) or last_us
            if batch.is_sure.all():
                yield batch
                continue
            is_whole, rows = batch.is_whole(surroundings, before_us), batch.rows
            self._state[N_OK] -= np.count_nonzero(~is_whole)
            self._state[N_SKIPPED] += np.abs(rows[1, ~is_whole]).sum()
            if is_whole.any():
                yield _Found(batch.piece, np.stack([rows[0], np.abs(rows[1]), rows[2]])[:, is_whole])

    def _boot_to_utc(self) -> tuple[int, int, bool]:
        """First stamp (us since boot), UTC minus time since boot (ns), and whether that came from GPS.

        Raises:
            InputError: The first messages declare no format.
        """
        decoder = DataflashDecoder()
        first_ns, last_ns = 0, 0
        for block in self._scan(_FIRST_MESSAGES):
            last_ns = int(block.arrival_ns[-1])
            first_ns = first_ns or int(block.arrival_ns[block.arrival_ns > 0].min(initial=last_ns))
            for track in decoder.decode(block):
                if isinstance(track, ClockTrack):
                    return first_ns // 1000, int(track.unix_ns[0] - track.boot_ns[0]), True
            if not decoder.formats:
                break
        if not decoder.formats:
            raise self.wrong_type(f"{looks_like(self.path)} without a valid message")
        return first_ns // 1000, self.path.stat().st_mtime_ns - last_ns, False

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each kind of damage met so far; complete once ``events`` has ended."""
        counts = self.counts
        sentences = []
        if not self._has_gps:
            sentences.append(
                f"{self.path}: no GPS time in the log; the file's modification time is taken as its end, so stamps"
                " may be off by hours"
            )
        if counts.truncated:
            sentences.append(f"{self.path}: the log is cut off; everything before the cut was read")
        elif counts.skipped_bytes:
            sentences.append(f"{self.path}: {counts.skipped_bytes} damaged bytes left out")
        return tuple(sentences)
