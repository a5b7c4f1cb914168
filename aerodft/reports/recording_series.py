"""A recording's values, poses and events over time, as figures and pages show them."""

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from aerodft.adapters.recording import Channel
from aerodft.adapters.wire.measurement import MEASUREMENT_SCHEMA, MEASUREMENTS_SCHEMA, split_measurements
from aerodft.adapters.wire.pose import HEIGHT_SWITCH_SCHEMA, POSE_SCHEMA
from aerodft.adapters.wire.status import CAMERA_MOTION_SCHEMA, STATUS_SCHEMA
from aerodft.dft import PROBE_KINDS
from aerodft.errors import InputError, Reason, located, printable
from aerodft.model import FloatArray, IntArray, ProbeKind, Status
from replay.export import Item, parse_measurement, row_of
from replay.recordings import Recording

_MEASURED: Final = frozenset({MEASUREMENT_SCHEMA, MEASUREMENTS_SCHEMA})
_WANTED: Final = _MEASURED | {POSE_SCHEMA, HEIGHT_SWITCH_SCHEMA, CAMERA_MOTION_SCHEMA, STATUS_SCHEMA}
_EAST, _NORTH = 0, 1


class Event(NamedTuple):
    """An event in a station's life.

    Attributes:
        stamp_ns: When, UTC.
        kind: ``height``, ``attitude``, ``calibration``, ``camera``, ``station`` or ``gap``.
        text: What, in a few words.
    """

    stamp_ns: int
    kind: str
    text: str


@dataclass(slots=True)
class Series:
    """Rows over time, by column; NaN where something is not known.

    Attributes:
        name: Of the probe.
        kind: Of the probe.
        unit: Of its values.
        stamps_ns: Of each row.
        statuses: Of each row.
        columns: Numbers of each row, by name.
        texts: Texts of each row, by name.
        points_m: East and north of each row's points from the station's origin, ``(k, 2)``.
    """

    name: str = ""
    kind: str = ""
    unit: str = "m"
    stamps_ns: list[int] = field(default_factory=list)
    statuses: list[str] = field(default_factory=list)
    columns: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    texts: defaultdict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    points_m: list[FloatArray] = field(default_factory=list)

    def numbers(self, name: str) -> FloatArray:
        """A column, ``(n,)``."""
        return np.asarray(self.columns[name], dtype=np.float64)

    @property
    def stamps(self) -> IntArray:
        """``(n,)`` UTC ns."""
        return np.asarray(self.stamps_ns, dtype=np.int64)

    @property
    def answered(self) -> int:
        """Number of rows with a value, or for a position with a place."""
        return self.statuses.count(Status.OK)

    def add(self, stamp_ns: int, status: str, **numbers: object) -> None:
        """Add a row; None is not known."""
        self.stamps_ns.append(stamp_ns)
        self.statuses.append(status)
        for name, value in numbers.items():
            self.columns[name].append(float("nan") if value is None else float(value))  # type: ignore[arg-type]


@dataclass(slots=True)
class RecordingSeries:
    """Series of a recording that figures and pages show.

    Attributes:
        probes: By name and kind.
        poses: ``height_m``, ``tilt_deg`` and their stds; ``telemetry_age_s``; ``east_m``, ``north_m``;
            ``height_source`` as texts.
        events: In order of time.
        remarks: What measurements with a value say of themselves, and how many say it.
        softwares: What made the measurements, and how many.
        calibrations: What they were calibrated with, and how many; "" for none.
        origin_deg: Latitude and longitude of the station's origin; None where its place is not known.
        zero_ns: What seconds count from: the first image, UTC.
    """

    probes: dict[tuple[str, str], Series] = field(default_factory=dict)
    poses: Series = field(default_factory=Series)
    events: list[Event] = field(default_factory=list)
    remarks: Counter[str] = field(default_factory=Counter)
    softwares: Counter[str] = field(default_factory=Counter)
    calibrations: Counter[str] = field(default_factory=Counter)
    origin_deg: tuple[float, float] | None = None
    zero_ns: int = 0

    @property
    def images(self) -> int:
        """Instants at which something was to be measured."""
        return len(self.poses.stamps_ns)


def read_series(recording: Recording) -> RecordingSeries:
    """Read a recording's values, poses and events, in one go.

    Raises:
        InputError: The recording or something in it is damaged.
    """
    found, reader = RecordingSeries(zero_ns=recording.zero_utc_ns), _Reader()

    def is_wanted(channel: Channel) -> bool:
        return channel.schema in _WANTED

    with located(recording.folder):
        for message in recording.messages(wanted=is_wanted):
            try:
                if message.channel.schema == MEASUREMENT_SCHEMA:
                    _add_measurement(found, parse_measurement(message.data))
                elif message.channel.schema == MEASUREMENTS_SCHEMA:
                    for _, payload in split_measurements(message.data):
                        _add_measurement(found, parse_measurement(payload))
                else:
                    reader.add(found, message.channel.schema, parse_measurement(message.data))
            except (KeyError, TypeError, ValueError, IndexError) as error:
                got = Reason(f"{message.channel.topic}: {type(error).__name__} {error}")
                raise InputError("a recorded message is damaged", got=got) from error
    for gap in recording.left_out().gaps:
        if gap.from_ns is not None:
            found.events.append(Event(gap.from_ns, "gap", "recording damaged or missing"))
    found.events.sort()
    return found


def _add_measurement(found: RecordingSeries, item: Item) -> None:
    row: dict[str, Any] = row_of(item)
    key = row["name"], row["kind"]
    if key not in found.probes:
        kind = PROBE_KINDS.get(row["kind"])
        unit = row["unit"] if kind is None else kind.unit
        found.probes[key] = Series(printable(row["name"]), printable(row["kind"]), printable(unit))
    series, points = found.probes[key], row["enu_m"] or []
    known = [point[:2] for point in points if None not in point[:2]]
    place = known[0] if known and row["kind"] in {ProbeKind.POSITION, ProbeKind.TRACK} else (None, None)
    names = ("value", "std", "ci95_low", "ci95_high", "cov_east_m2", "cov_north_m2")
    numbers = {name: row[name] for name in names}
    series.add(row["stamp_ns"], row["status"], east_m=place[_EAST], north_m=place[_NORTH], **numbers)
    series.points_m.append(np.asarray(known, dtype=np.float64).reshape(-1, 2))
    found.softwares[row["software"]] += 1
    if row["status"] == Status.OK:
        found.remarks.update(item["reasons"])
        found.calibrations[row["calibration"] or ""] += 1


class _Reader:
    """Reads what a station says of itself; remembers the last of each, as only changes are events."""

    def __init__(self) -> None:
        self._last: dict[str, str] = {}

    def add(self, found: RecordingSeries, schema: str, item: Item) -> None:
        """Take a message."""
        stamp_ns = int(item["stamp_ns"])
        if schema == POSE_SCHEMA:
            std, place = item["std"] or {}, item["position_enu_m"] or (None, None)
            has_pose, poses = item["tilt_deg"] is not None, found.poses
            poses.add(
                stamp_ns,
                item["status"],
                height_m=item["height_agl_m"],
                height_std_m=std.get("height_agl_m") if has_pose else None,
                tilt_deg=item["tilt_deg"],
                tilt_std_deg=std.get("tilt_deg") if has_pose else None,
                telemetry_age_s=item["telemetry_age_s"],
                east_m=place[_EAST],
                north_m=place[_NORTH],
            )
            poses.texts["height_source"].append(item["height_source"] or "")
            origin = item.get("origin")
            if origin and origin["lat_deg"] is not None and origin["lon_deg"] is not None:
                found.origin_deg = origin["lat_deg"], origin["lon_deg"]
            if has_pose:
                self._changed(found, stamp_ns, "attitude", item["attitude_source"])
                self._changed(found, stamp_ns, "calibration", item["calibration"])
        elif schema == HEIGHT_SWITCH_SCHEMA:
            step = "" if item["step_m"] is None else f", {float(item['step_m']):+.2f} m"
            found.events.append(Event(stamp_ns, "height", f"{item['before']} to {item['after']}{step}"))
        elif schema == CAMERA_MOTION_SCHEMA:
            self._changed(found, stamp_ns, "camera", item["state"])
        else:
            self._changed(found, stamp_ns, "station", item["text"] or item["state"])

    def _changed(self, found: RecordingSeries, stamp_ns: int, kind: str, text: str | None) -> None:
        """Enter an event where something is another than the last time; the first is none."""
        if text and self._last.setdefault(kind, text) != text:
            found.events.append(Event(stamp_ns, kind, text))
            self._last[kind] = text


def runs(values: list[str]) -> Iterator[tuple[int, int, str]]:
    """Runs of equal values: first row, the row after the last, and the value."""
    first = 0
    for row in range(1, len(values) + 1):
        if row == len(values) or values[row] != values[first]:
            yield first, row, values[first]
            first = row
