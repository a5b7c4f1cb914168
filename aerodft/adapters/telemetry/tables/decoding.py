"""Rows of flight tables to telemetry tracks."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
import orjson

from aerodft.adapters.telemetry.tables.layouts import Layout
from aerodft.adapters.telemetry.tracks import MAX_HEIGHT_M
from aerodft.geometry import from_yaw_pitch_roll
from aerodft.model import (
    BoolArray,
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
)

PROTOCOL: Final = "table"
_BOOT_NS: Final = 10**15  # a steady count: of UTC what is left of eleven days
_LAYOUT: Final = b"\0"  # what a frame of the layout begins with; no row does
_MAX_ANGLE_DEG: Final = 360.0
_MAX_LAT_DEG, _MAX_LON_DEG = 90.0, 180.0
_GIMBAL: Final = ("gimbal_yaw_deg", "gimbal_pitch_deg", "gimbal_roll_deg")
_BODY: Final = ("yaw_deg", "pitch_deg", "roll_deg")


def layout_frame(layout: Layout) -> bytes:
    """The frame that tells decoders, of a recording too, where values stand."""
    content = {"tool": layout.tool, "delimiter": layout.delimiter, "columns": dict(layout.columns)}
    return _LAYOUT + orjson.dumps(content)


def _layout_from(frame: bytes) -> Layout | None:
    try:
        content = orjson.loads(frame[len(_LAYOUT) :])
        columns = {str(key): int(place) for key, place in content["columns"].items()}
        layout = Layout(str(content["tool"]), str(content["delimiter"])[:1] or ",", columns)
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return layout if all(place >= 0 for place in columns.values()) else None


class TableDecoder:
    """Decodes a table's rows. A ``service.ports.TelemetryDecoder``.

    A row's arrival is its UTC: the source makes it of the table's columns of time.

    Attributes:
        rejected: Values left out, by ``TABLE: reason``.
    """

    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()
        self._layout: Layout | None = None

    def frame_names(self, block: RawBlock) -> tuple[IntArray, Mapping[int, str]]:
        """All rows are of one name; the layout's frame is not listed."""
        data = np.frombuffer(block.data, dtype=np.uint8)
        is_layout = data[block.offset] == 0 if len(data) else np.zeros(len(block.offset), dtype=np.bool_)
        return np.where(is_layout, -1, 0), {0: "TABLE"}

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's rows; no row is an error.

        Raises:
            ValueError: The block is not of a table.
        """
        if block.protocol != PROTOCOL:
            raise ValueError(f"got a block of {block.protocol}, must be {PROTOCOL}")
        rows: list[dict[str, float]] = []
        arrivals: list[int] = []
        spans = zip(block.offset.tolist(), block.length.tolist(), block.arrival_ns.tolist(), strict=True)
        for at, size, arrival_ns in spans:
            frame = block.data[at : at + size]
            if frame.startswith(_LAYOUT):
                self._layout = _layout_from(frame) or self._layout
            elif self._layout is None:
                self.rejected["TABLE: its layout is not known"] += 1
            else:
                rows.append(self._layout.values(self._layout.cells(frame)))
                arrivals.append(arrival_ns)
        if not rows:
            return ()
        arrival = np.array(arrivals, dtype=np.int64)
        stamps = {"arrival_ns": arrival, "boot_ns": arrival % _BOOT_NS}
        clock = ClockTrack(unix_ns=arrival, **stamps)
        parts = (self._heights, self._places, self._attitudes)
        tracks = [clock, *(track for part in parts for track in part(rows, stamps))]
        return tuple(track for track in tracks if len(track.arrival_ns))

    def _heights(self, rows: list[dict[str, float]], stamps: Mapping[str, Any]) -> Iterable[Track]:
        for name, source in (("height_home_m", HeightSource.HOME), ("height_ground_m", HeightSource.TERRAIN)):
            value_m = _column(rows, name)
            known = self._checked(name, value_m, MAX_HEIGHT_M)
            yield HeightTrack(
                source=source,
                value_m=value_m[known],
                slant=False,
                std_m=np.full(int(known.sum()), math.nan),
                **_chosen(stamps, known),
            )

    def _places(self, rows: list[dict[str, float]], stamps: Mapping[str, Any]) -> Iterable[Track]:
        lat_deg, lon_deg = _column(rows, "lat_deg"), _column(rows, "lon_deg")
        known = self._checked("lat_deg", lat_deg, _MAX_LAT_DEG) & self._checked("lon_deg", lon_deg, _MAX_LON_DEG)
        no_fix = known & (lat_deg == 0) & (lon_deg == 0)
        if no_fix.any():
            self.rejected["TABLE: no position yet"] += int(no_fix.sum())
        known &= ~no_fix
        nothing = np.full(int(known.sum()), math.nan)
        yield PositionTrack(
            lat_rad=np.radians(lat_deg[known]),
            lon_rad=np.radians(lon_deg[known]),
            alt_msl_m=nothing,
            height_home_m=nothing,
            **_chosen(stamps, known),
        )

    def _attitudes(self, rows: list[dict[str, float]], stamps: Mapping[str, Any]) -> Iterable[Track]:
        wxyz, known = self._angles(rows, _GIMBAL)
        in_earth = np.ones(len(wxyz), dtype=np.bool_)
        yield GimbalTrack(source=GimbalSource.TABLE, wxyz=wxyz, yaw_in_earth=in_earth, **_chosen(stamps, known))
        wxyz, known = self._angles(rows, _BODY)
        yield VehicleTrack(wxyz=wxyz, **_chosen(stamps, known))

    def _angles(self, rows: list[dict[str, float]], names: tuple[str, ...]) -> tuple[FloatArray, BoolArray]:
        """Attitudes ``(k, 4)`` of the rows that state yaw, pitch and roll, and which these are."""
        angles_deg = [_column(rows, name) for name in names]
        checked = [self._checked(name, each, _MAX_ANGLE_DEG) for name, each in zip(names, angles_deg, strict=True)]
        known = np.logical_and.reduce(checked)
        return from_yaw_pitch_roll(*(np.radians(each[known]) for each in angles_deg)), known

    def _checked(self, name: str, values: FloatArray, limit: float) -> BoolArray:
        """Which values ``(n,)`` are there and possible; impossible ones are counted."""
        there = np.isfinite(values)
        impossible = there & ~(np.abs(np.where(there, values, 0.0)) <= limit)
        if impossible.any():
            self.rejected[f"TABLE: impossible {name}"] += int(impossible.sum())
        return there & ~impossible


def _column(rows: list[dict[str, float]], name: str) -> FloatArray:
    return np.array([row.get(name, math.nan) for row in rows])


def _chosen(stamps: Mapping[str, Any], chosen: BoolArray) -> dict[str, Any]:
    return {name: values[chosen] for name, values in stamps.items()}
