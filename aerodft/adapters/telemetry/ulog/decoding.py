"""Messages of a ULog file to telemetry tracks."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.lib.recfunctions import rename_fields

from aerodft.adapters.telemetry.mavlink import MAX_STAMP_US, ORIENTATION_DOWN, payload_rows
from aerodft.adapters.telemetry.tracks import (
    MAX_HEIGHT_M,
    MAX_UNIX_NS,
    MIN_UNIX_NS,
    Rows,
    estimator_track,
    gimbal_device_track,
    gimbal_failure_tracks,
    height_track,
    is_beyond,
    no_height,
)
from aerodft.adapters.telemetry.ulog.definitions import Definitions, Topic
from aerodft.adapters.telemetry.ulog.framing import DATA, FORMAT, HEAD_SIZE, ID_SIZE, KIND_AT, SUBSCRIPTION
from aerodft.model import (
    FIX_3D,
    BoolArray,
    ClockTrack,
    FloatArray,
    GpsTrack,
    HeightSource,
    HeightTrack,
    IntArray,
    PositionTrack,
    RawBlock,
    Track,
    TriggerSource,
    TriggerTrack,
    VehicleTrack,
)
from aerodft.service import HEIGHT_SOURCES

PROTOCOL: Final = "ulog"

_ATTITUDE: Final = "vehicle_attitude"
_HOME: Final = "home_position"
_GLOBAL: Final = "vehicle_global_position"
_LOCAL: Final = "vehicle_local_position"
_SENSOR: Final = "distance_sensor"
_GPS: Final = "vehicle_gps_position"
_RECEIVER: Final = "sensor_gps"  # of a log without the topic that PX4 selects a receiver for
_GIMBAL: Final = "gimbal_device_attitude_status"
_ESTIMATOR: Final = "estimator_status"
_CAPTURE: Final = "camera_capture"
_TRIGGER: Final = "camera_trigger"
_COLUMNS: Final[dict[str, tuple[str, ...]]] = {
    _ATTITUDE: ("q",),
    _HOME: ("z",),
    _GLOBAL: ("lat", "lon", "alt"),
    _LOCAL: ("z",),
    _SENSOR: ("current_distance", "min_distance", "max_distance", "variance", "orientation"),
    _GPS: ("time_utc_usec", "fix_type", "satellites_used", "eph", "epv"),
    _RECEIVER: ("time_utc_usec", "fix_type", "satellites_used", "eph", "epv"),
    _GIMBAL: ("q", "device_flags", "failure_flags"),
    _CAPTURE: ("result",),
    _TRIGGER: (),
    _ESTIMATOR: ("vel_test_ratio", "pos_test_ratio", "hgt_test_ratio", "mag_test_ratio", "solution_status_flags"),
}
"""Topics that are decoded, and the fields that each must have."""

USED_MESSAGES: Final = frozenset({_ATTITUDE, _GLOBAL, _LOCAL, _SENSOR, _GPS, _GIMBAL})
"""Topics that poses are made of."""

_OF_ANY_INSTANCE: Final = (_SENSOR, _GIMBAL)
_GIMBAL_NAMES: Final = {"device_flags": "flags"}  # MAVLink's names of the fields
_ESTIMATOR_NAMES: Final = {
    "vel_test_ratio": "vel_ratio",
    "pos_test_ratio": "pos_horiz_ratio",
    "hgt_test_ratio": "pos_vert_ratio",
    "mag_test_ratio": "mag_ratio",
    "solution_status_flags": "flags",
}
_RELATIVE: Final = "timestamp_time_relative"
_BITFIELD: Final = "dist_bottom_sensor_bitfield"
_BY_RANGE: Final = 1  # of that field; 2 is optical flow, whose height is the estimator's own
_OLD_GPS: Final = {"lat": 1e-7, "lon": 1e-7, "alt": 1e-3}  # until PX4 1.13
_NEW_GPS: Final = {"latitude_deg": 1.0, "longitude_deg": 1.0, "altitude_msl_m": 1.0}
_ESTIMATE: Final = {"lat": 1.0, "lon": 1.0, "alt": 1.0}
_MAX_FIX: Final = 8
_MOST_STD_M: Final = 1e5  # a receiver that says so states nothing
_MAX_LAT_DEG, _MAX_LON_DEG = 90.0, 180.0
_QUATERNION_NORM_SLACK: Final = 0.1
_QUALITY_INVALID: Final = 0  # of distance_sensor.signal_quality; -1 is unknown
_EARLIER: Final = -1  # than all messages of a block
_OTHER, _DEFINITION = -1, -2  # in place of a subscription's number
_MIN_UNIX_US, _MAX_UNIX_US = MIN_UNIX_NS // 1000, MAX_UNIX_NS // 1000


@dataclass(frozen=True, slots=True, eq=False)
class _Messages:
    """Messages ``(n,)`` of one topic in a block.

    Attributes:
        rows: Their data.
        order: ``(n,)`` row of each in the block, ascending.
        instance: ``(n,)`` of the topic.
    """

    rows: Rows
    order: IntArray
    instance: IntArray

    def where(self, chosen: BoolArray) -> "_Messages":
        """The messages that a mask ``(n,)`` chooses."""
        return _Messages(self.rows.rows(chosen), self.order[chosen], self.instance[chosen])

    def accepted(self, rejected: Counter[str], faults: dict[str, BoolArray]) -> "_Messages":
        """The messages without a fault, which counts as in ``Rows.accepted``."""
        self.rows.accepted(rejected, faults)
        return self.where(~np.logical_or.reduce(list(faults.values()))) if faults else self


class UlogDecoder:
    """Decodes a PX4 log's messages; learns their layouts on the way. A ``service.ports.TelemetryDecoder``.

    Heights above home are those of the local estimate against the home position, both measured down from the
    estimator's own origin: the origin's altitude may be unknown, and moves. Where the estimator has reset its height
    since home was set, the reset is part of the height's standard deviation.

    Attributes:
        rejected: Rows left out, by ``TOPIC: reason``.

    Args:
        gimbal: Number of the gimbal to follow; None for the first one that reports.
    """

    def __init__(self, gimbal: int | None = None) -> None:
        self.rejected: Counter[str] = Counter()
        self._definitions = Definitions()
        self._home_altitudes = np.array([_EARLIER]), np.array([np.nan])
        self._newest_us: dict[int, int] = {}
        self._since: dict[str, int] = {}  # by what has come: the message in the block, or _EARLIER
        self._gimbal = gimbal
        self._sensor: int | None = None
        self._home_z_m = self._home_alt_m = np.nan
        self._reset_m = self._reset_at_home_m = 0.0
        self._reset_counter: int | None = None

    def frame_names(self, block: RawBlock) -> tuple[IntArray, Mapping[int, str]]:
        """Key of each frame ``(n,)``, negative for what is no data; and topics by key."""
        return _numbers(block), {number: topic.name for number, topic in self._definitions.topics.items()}

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's messages; no message is an error.

        Raises:
            ValueError: The block is not of ULog.
        """
        if block.protocol != PROTOCOL:
            raise ValueError(f"got a block of {block.protocol}, must be {PROTOCOL}")
        numbers = _numbers(block)
        change = self._learn(block, numbers)
        if change:  # what is before it is of the layout that was known
            return (*self.decode(block.rows(slice(change))), *self.decode(block.rows(slice(change, None))))
        self._since = dict.fromkeys(self._since, _EARLIER)
        messages = self._messages(block, numbers)
        # The estimator's places and heights come behind the sensors' own, which they supersede.
        self._set_home_altitudes(messages.get(_HOME))
        places = list(self._global(messages.get(_GLOBAL)))
        heights = list(self._local(messages.get(_LOCAL), messages.get(_HOME), messages.get(_SENSOR)))
        tracks = [
            *self._attitudes(messages.get(_ATTITUDE)),
            *self._gps(messages.get(_GPS) if self._has_topic(_GPS) else messages.get(_RECEIVER)),
            *places,
            *self._distances(messages.get(_SENSOR)),
            *heights,
            *self._gimbals(messages.get(_GIMBAL)),
            *self._estimators(messages.get(_ESTIMATOR)),
            *self._captures(messages.get(_CAPTURE)),
            *self._triggers(messages.get(_TRIGGER)),
        ]
        return tuple(track for track in tracks if len(track.arrival_ns))

    def _learn(self, block: RawBlock, numbers: IntArray) -> int:
        """Take in definitions; returns the row of the first one that renews a subscription, 0 for none."""
        for row in np.flatnonzero(numbers == _DEFINITION).tolist():
            at, length = int(block.offset[row]), int(block.length[row])
            kind, payload = block.data[at + KIND_AT], block.data[at + HEAD_SIZE : at + length]
            found = self._definitions.subscription(payload) if kind == SUBSCRIPTION else None
            if row and found is not None and self._definitions.topics.get(found[0], found[1]) != found[1]:
                return int(row)
            self._definitions.learn(kind, payload)
        return 0

    def _has_topic(self, name: str) -> bool:
        return any(topic.name == name for topic in self._definitions.topics.values())

    def _messages(self, block: RawBlock, numbers: IntArray) -> dict[str, _Messages]:
        """The messages of each decoded topic; what has not the fields that it must have is left out."""
        found: dict[str, list[_Messages]] = {}
        for number, topic in self._definitions.topics.items():
            if topic.name not in _COLUMNS or (topic.instance and topic.name not in _OF_ANY_INSTANCE):
                continue
            own = self._of_subscription(number, topic, block, np.flatnonzero(numbers == number))
            if len(own.order) and not _has(own.rows, *_COLUMNS[topic.name]):
                self.rejected[f"{topic.name}: unknown layout"] += len(own.order)
            elif len(own.order):
                found.setdefault(topic.name, []).append(own)
        return {name: _joined(parts) for name, parts in found.items()}

    def _of_subscription(self, number: int, topic: Topic, block: RawBlock, index: IntArray) -> _Messages:
        """Messages of one subscription whose times go on."""
        lengths = block.length[index] - HEAD_SIZE - ID_SIZE
        least, most = self._definitions.sizes[:2, number].tolist()
        index = index[(lengths >= least) & (lengths <= most)]
        places = np.stack([block.offset[index] + HEAD_SIZE + ID_SIZE, block.length[index] - HEAD_SIZE - ID_SIZE])
        payload = payload_rows(block, places, topic.dtype)
        late = payload["timestamp"] >= MAX_STAMP_US
        time_us = np.where(late, 0, payload["timestamp"]).astype(np.int64)
        newest_us = np.maximum.accumulate(np.concatenate([[self._newest_us.get(number, -1)], time_us]))
        self._newest_us[number] = int(newest_us[-1])
        rows = Rows(topic.name, payload, block.arrival_ns[index], time_us * 1000, {})
        messages = _Messages(rows, index, np.full(len(index), topic.instance))
        faults = {"impossible time": late, "time does not go on": time_us <= newest_us[:-1]}
        return messages.accepted(self.rejected, faults)

    def _note(self, what: str, order: IntArray) -> None:
        """Note that something has come, by the first message of an ascending order."""
        if len(order):
            self._since.setdefault(what, int(order[0]))

    def _is_before(self, what: str, order: IntArray) -> BoolArray:
        """Whether something had not come by each message ``(n,)``."""
        return order < self._since[what] if what in self._since else np.ones(len(order), dtype=np.bool_)

    def _attitudes(self, messages: _Messages | None) -> Iterable[Track]:
        if messages is None:
            return
        wxyz = messages.rows.column("q")
        off = np.abs(np.sqrt(np.sum(wxyz * wxyz, axis=-1)) - 1)
        good = messages.rows.accepted(self.rejected, {"q is no rotation": is_beyond(off, _QUATERNION_NORM_SLACK)})
        wxyz = good.column("q")
        yield VehicleTrack(wxyz=wxyz / np.sqrt(np.sum(wxyz * wxyz, axis=-1, keepdims=True)), **good.stamps())

    def _global(self, messages: _Messages | None) -> Iterable[Track]:
        if messages is None:
            return
        flags = [name for name in ("lat_lon_valid", "alt_valid") if _has(messages.rows, name)]
        faults = {f"{name} is 0 yet": messages.rows.payload[name] == 0 for name in flags}
        good, track = self._position(messages.accepted(self.rejected, faults), _ESTIMATE)
        self._note(_GLOBAL, good.order)
        yield track

    def _gps(self, messages: _Messages | None) -> Iterable[Track]:
        if messages is None:
            return
        rows = messages.rows
        messages = messages.accepted(self.rejected, {"impossible fix type": rows.payload["fix_type"] > _MAX_FIX})
        rows = messages.rows
        yield self._clock(rows)
        yield GpsTrack(
            fix=rows.payload["fix_type"].astype(np.int64),
            satellites=rows.payload["satellites_used"].astype(np.int64),
            horizontal_std_m=_stated_m(rows, "eph"),
            vertical_std_m=_stated_m(rows, "epv"),
            **rows.stamps(),
        )
        fields = _NEW_GPS if _has(rows, *_NEW_GPS) else _OLD_GPS
        if _has(rows, *fields):
            has_fix = rows.payload["fix_type"] >= FIX_3D
            yield self._position(messages.where(has_fix & self._is_before(_GLOBAL, messages.order)), fields)[1]

    def _clock(self, rows: Rows) -> Track:
        """UTC of the receiver's reports; a simulator's time since boot is UTC itself."""
        boot_us, utc_us = rows.boot_ns // 1000, rows.payload["time_utc_usec"]
        is_unix, late = boot_us >= _MIN_UNIX_US, utc_us >= _MAX_UNIX_US
        faults = {
            "no UTC yet": ~is_unix & ((rows.payload["fix_type"] < FIX_3D) | (utc_us < _MIN_UNIX_US)),
            "impossible year": ~is_unix & late,
        }
        since_us = rows.payload[_RELATIVE].astype(np.int64) if _has(rows, _RELATIVE) else 0  # of the report
        unix_us = np.where(is_unix, boot_us, np.where(late, 0, utc_us).astype(np.int64) - since_us)
        keep = ~np.logical_or.reduce(list(faults.values()))
        return ClockTrack(unix_ns=unix_us[keep] * 1000, **rows.accepted(self.rejected, faults).stamps())

    def _position(self, messages: _Messages, fields: Mapping[str, float]) -> tuple[_Messages, Track]:
        """Places without heights above home, by the fields of degrees and metres and their units."""

        def degrees_and_metres(rows: Rows) -> list[FloatArray]:
            return [rows.column(name) * unit for name, unit in fields.items()]

        lat_deg, lon_deg, _ = degrees_and_metres(messages.rows)
        faults = {
            "no position yet": (lat_deg == 0) & (lon_deg == 0),
            "no latitude": is_beyond(lat_deg, _MAX_LAT_DEG),
            "no longitude": is_beyond(lon_deg, _MAX_LON_DEG),
        }
        good = messages.accepted(self.rejected, faults)
        lat_deg, lon_deg, alt_m = degrees_and_metres(good.rows)
        return good, PositionTrack(
            lat_rad=np.radians(lat_deg),
            lon_rad=np.radians(lon_deg),
            alt_msl_m=np.where(is_beyond(alt_m, MAX_HEIGHT_M), np.nan, alt_m),
            height_home_m=np.full(len(alt_m), np.nan),
            home_alt_msl_m=self._home_altitude_m(good.order),
            **good.rows.stamps(),
        )

    def _set_home_altitudes(self, home: _Messages | None) -> None:
        """Keep the altitudes of home that hold in a block, and from which message on."""
        since, alt_m = np.array([_EARLIER]), np.array([self._home_alt_m])
        if home is not None and _has(home.rows, "alt"):
            flag = "valid_alt" if _has(home.rows, "valid_alt") else "valid_lpos"
            good = home.where(~_is_zero(home.rows, flag) & ~is_beyond(home.rows.column("alt"), MAX_HEIGHT_M))
            since, alt_m = np.concatenate([since, good.order]), np.concatenate([alt_m, good.rows.column("alt")])
        self._home_altitudes, self._home_alt_m = (since, alt_m), float(alt_m[-1])

    def _home_altitude_m(self, order: IntArray) -> FloatArray:
        """Altitude of home at each message ``(n,)`` of the block; NaN until it is known."""
        since, alt_m = self._home_altitudes
        known: FloatArray = alt_m[np.searchsorted(since, order, side="right") - 1]
        return known

    def _local(self, messages: _Messages | None, home: _Messages | None, sensor: _Messages | None) -> Iterable[Track]:
        if sensor is not None:
            self._note(_SENSOR, sensor.order)
        if messages is None:
            self._set_home(home, np.empty(0, dtype=np.int64), np.empty(0))
            return
        yield self._above_home(messages, home)
        yield self._above_bottom(messages)

    def _resets_m(self, rows: Rows) -> FloatArray:
        """Sum of the sizes of all resets of the height up to each row ``(n,)``."""
        if not _has(rows, "z_reset_counter", "delta_z"):
            return np.full(len(rows.payload), self._reset_m)
        counters = rows.payload["z_reset_counter"].astype(np.int64)
        first = counters[0] if self._reset_counter is None else self._reset_counter
        is_reset = np.diff(counters, prepend=first) != 0
        steps_m = np.where(is_reset, np.nan_to_num(np.abs(rows.column("delta_z"))), 0.0)
        resets_m: FloatArray = self._reset_m + np.cumsum(np.minimum(steps_m, MAX_HEIGHT_M))
        self._reset_counter, self._reset_m = int(counters[-1]), float(resets_m[-1])
        return resets_m

    def _set_home(
        self, home: _Messages | None, order: IntArray, resets_m: FloatArray
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Home positions that hold in a block: from which message on, their z, and the resets until each was set."""
        since, z_m, reset_m = np.array([_EARLIER]), np.array([self._home_z_m]), np.array([self._reset_at_home_m])
        if home is not None:
            valid = home.rows.payload["valid_lpos"] != 0 if _has(home.rows, "valid_lpos") else True
            good = home.where(valid & ~is_beyond(home.rows.column("z"), MAX_HEIGHT_M))
            until_m = np.concatenate([[resets_m[0] if len(order) else self._reset_m], resets_m])
            since = np.concatenate([since, good.order])
            z_m = np.concatenate([z_m, good.rows.column("z")])
            reset_m = np.concatenate([reset_m, until_m[np.searchsorted(order, good.order)]])
            self._home_z_m, self._reset_at_home_m = float(z_m[-1]), float(reset_m[-1])
        return since, z_m, reset_m

    def _above_home(self, messages: _Messages, home: _Messages | None) -> Track:
        """Heights of the local estimate above the home position that holds at each time."""
        resets_m = self._resets_m(messages.rows)
        since, home_z_m, reset_at_home_m = self._set_home(home, messages.order, resets_m)
        which = np.searchsorted(since, messages.order, side="right") - 1
        home_z_m = np.where(np.isnan(home_z_m[which]), self._home_z_by_altitude_m(messages), home_z_m[which])
        faults = {
            "no home yet": np.isnan(home_z_m),
            "z is not valid yet": _is_zero(messages.rows, "z_valid"),
            **no_height(messages.rows, "z"),
        }
        keep = ~np.logical_or.reduce(list(faults.values()))
        good = messages.rows.accepted(self.rejected, faults)
        reset_m = (resets_m - reset_at_home_m[which])[keep]
        std_m = np.hypot(HEIGHT_SOURCES[HeightSource.HOME].std_m, reset_m)
        return HeightTrack(
            source=HeightSource.HOME,
            value_m=home_z_m[keep] - good.column("z"),
            slant=False,
            std_m=np.where(reset_m > 0, std_m, np.nan),
            **good.stamps(),
        )

    def _home_z_by_altitude_m(self, messages: _Messages) -> FloatArray:
        """Home's z ``(n,)`` by its altitude and the origin's: PX4 may know home's altitude before its local place."""
        rows = messages.rows
        if not _has(rows, "ref_alt", "z_global"):
            return np.full(len(rows.payload), np.nan)
        is_unknown = (rows.payload["z_global"] == 0) | is_beyond(rows.column("ref_alt"), MAX_HEIGHT_M)
        return np.where(is_unknown, np.nan, rows.column("ref_alt") - self._home_altitude_m(messages.order))

    def _above_bottom(self, messages: _Messages) -> Track:
        """The estimator's height above the ground, where a rangefinder measures it: else it assumes a flat one."""
        if not _has(messages.rows, "dist_bottom", "dist_bottom_valid"):
            messages = messages.where(np.zeros(len(messages.order), dtype=np.bool_))
            return height_track(HeightSource.RANGEFINDER, messages.rows, np.empty(0), slant=False)
        if _has(messages.rows, _BITFIELD):
            assumed = (messages.rows.payload[_BITFIELD] & _BY_RANGE) == 0
        else:
            assumed = self._is_before(_SENSOR, messages.order)
        messages = messages.where(~assumed)
        faults = {
            "dist_bottom is not valid": messages.rows.payload["dist_bottom_valid"] == 0,
            **no_height(messages.rows, "dist_bottom"),
            "dist_bottom is not above 0": ~(messages.rows.column("dist_bottom") > 0),
        }
        good = messages.accepted(self.rejected, faults)
        self._note("dist_bottom", good.order)
        value_m = good.rows.column("dist_bottom")
        return height_track(HeightSource.RANGEFINDER, good.rows, value_m, slant=False)

    def _distances(self, messages: _Messages | None) -> Iterable[Track]:
        """A rangefinder's own readings, until the estimator gives heights by it: PX4 logs few of them."""
        if messages is None:
            return
        messages = messages.where(self._is_before("dist_bottom", messages.order))
        rows, limit_m = messages.rows, messages.rows.column("max_distance")
        distance_m = rows.column("current_distance")
        invalid = rows.payload["signal_quality"] == _QUALITY_INVALID if _has(rows, "signal_quality") else False
        faults = {
            "does not look down": rows.payload["orientation"] != ORIENTATION_DOWN,
            "signal quality is invalid": np.broadcast_to(invalid, len(distance_m)),
            **no_height(rows, "current_distance"),
            "distance is not above 0": ~(distance_m > 0),
            "below the sensor's minimum": distance_m < rows.column("min_distance"),
            "at the sensor's maximum or above": (limit_m > 0) & (distance_m >= limit_m),
        }
        good = messages.accepted(self.rejected, faults)
        if self._sensor is None and len(good.instance):
            self._sensor = int(good.instance[0])
        another = {f"of another sensor than number {self._sensor}": good.instance != self._sensor}
        good_rows = good.accepted(self.rejected, another).rows
        variance_m2 = good_rows.column("variance")
        yield HeightTrack(
            source=HeightSource.RANGEFINDER,
            value_m=good_rows.column("current_distance"),
            slant=True,
            std_m=np.where(variance_m2 > 0, np.sqrt(np.where(variance_m2 > 0, variance_m2, 1.0)), np.nan),
            **good_rows.stamps(),
        )

    def _gimbals(self, messages: _Messages | None) -> Iterable[Track]:
        """The followed gimbal's attitudes: flags and failures are MAVLink's."""
        if messages is None:
            return
        rows = messages.rows
        has_number = _has(rows, "gimbal_device_id")
        number = rows.payload["gimbal_device_id"].astype(np.int64) if has_number else messages.instance
        if self._gimbal is None:
            self._gimbal = int(number[0])
        rows = rows.accepted(self.rejected, {f"of another gimbal than number {self._gimbal}": number != self._gimbal})
        rows = _renamed(rows, _GIMBAL_NAMES)
        yield from gimbal_failure_tracks(rows)
        yield gimbal_device_track(rows, self.rejected)

    def _estimators(self, messages: _Messages | None) -> Iterable[Track]:
        """The estimator's test ratios; of several estimators no message here says which one is used."""
        count = sum(topic.name == _ESTIMATOR for topic in self._definitions.topics.values())
        if messages is not None and count == 1:
            yield estimator_track(_renamed(messages.rows, _ESTIMATOR_NAMES), self.rejected)

    def _captures(self, messages: _Messages | None) -> Iterable[Track]:
        """The camera's own reports of images."""
        if messages is not None:
            failed = messages.rows.payload["result"] != 1
            good = messages.rows.accepted(self.rejected, {"no image was captured": failed})
            yield _trigger_track(TriggerSource.ULOG_CAPTURE, good)

    def _triggers(self, messages: _Messages | None) -> Iterable[Track]:
        """Commands to the camera; a row with feedback repeats one when the camera's flash shoe says so."""
        if messages is not None:
            is_command = messages.rows.payload["feedback"] == 0 if _has(messages.rows, "feedback") else None
            rows = messages.rows if is_command is None else messages.rows.rows(is_command)
            yield _trigger_track(TriggerSource.ULOG_TRIGGER, rows)


def _trigger_track(source: TriggerSource, rows: Rows) -> Track:
    return TriggerTrack(source=source, unix_ns=np.zeros(len(rows.payload), dtype=np.int64), **rows.stamps())


def _numbers(block: RawBlock) -> IntArray:
    """Subscription of each frame ``(n,)``; ``_DEFINITION`` or ``_OTHER`` of what is no data."""
    data = np.frombuffer(block.data, dtype=np.uint8)
    whole = (block.offset >= 0) & (block.length >= HEAD_SIZE + ID_SIZE) & (block.offset + block.length <= len(data))
    at = np.where(whole, block.offset, 0)
    if not len(at) or not np.any(whole):
        return np.full(len(at), _OTHER)
    kind = data[at + KIND_AT]
    number = data[at + HEAD_SIZE].astype(np.int64) | data[at + HEAD_SIZE + 1].astype(np.int64) << 8
    is_definition = (kind == FORMAT) | (kind == SUBSCRIPTION)
    return np.where(whole, np.where(kind == DATA, number, np.where(is_definition, _DEFINITION, _OTHER)), _OTHER)


def _joined(parts: list[_Messages]) -> _Messages:
    """Messages of all instances of one topic, in order."""
    if len(parts) == 1:
        return parts[0]
    dtype = parts[0].rows.payload.dtype
    parts = [part for part in parts if part.rows.payload.dtype == dtype]
    order = np.concatenate([part.order for part in parts])
    ascending = np.argsort(order)
    columns = ("payload", "arrival_ns", "boot_ns")
    payload, arrival_ns, boot_ns = (
        np.concatenate([getattr(part.rows, name) for part in parts])[ascending] for name in columns
    )
    instance = np.concatenate([part.instance for part in parts])[ascending]
    return _Messages(Rows(parts[0].rows.name, payload, arrival_ns, boot_ns, {}), order[ascending], instance)


def _has(rows: Rows, *columns: str) -> bool:
    """Whether the log's version of the topic has these fields, as numbers."""
    dtype = rows.payload.dtype
    return all(name in (dtype.names or ()) and dtype[name].base.kind in "iuf" for name in columns)


def _is_zero(rows: Rows, field: str) -> BoolArray:
    """Whether a field that not every version has is 0 ``(n,)``."""
    return rows.payload[field] == 0 if _has(rows, field) else np.zeros(len(rows.payload), dtype=np.bool_)


def _stated_m(rows: Rows, field: str) -> FloatArray:
    std_m = rows.column(field)
    return np.where((std_m > 0) & (std_m < _MOST_STD_M), std_m, np.nan)


def _renamed(rows: Rows, names: Mapping[str, str]) -> Rows:
    """Rows whose fields have MAVLink's names."""
    return Rows(rows.name, rename_fields(rows.payload, dict(names)), rows.arrival_ns, rows.boot_ns, rows.scale)
