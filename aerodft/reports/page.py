"""One page about a recording or a river for whoever was not there: HTML that needs no other file and no network."""

import hashlib
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from aerodft.adapters.files import read_whole
from aerodft.dft import recorded_kind
from aerodft.errors import os_errors_as
from aerodft.geometry import east_north
from aerodft.model import FloatArray, GeoOrigin, ImageArray, Status
from aerodft.reports import style
from aerodft.reports.recording_plot import amounts, draw_recording, typical
from aerodft.reports.recording_series import RecordingSeries, Series
from aerodft.reports.rendering import image_source, render_html
from aerodft.reports.river_folder import RiverFolder
from aerodft.version import SOFTWARE
from replay.export import digits_of, time_utc, written_unit

_MOST_ROWS: Final = 40
"""Of one probe in the table of values."""
_MOST_LINES: Final = 200
"""Of one probe on the map."""
_JPEG_QUALITY: Final = 88
_NAMESPACES: Final = re.compile(r'\s+xmlns(:\w+)?="[^"]*"')
_METADATA: Final = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)
_ENDS: Final = 2


@dataclass(frozen=True, slots=True)
class RecordingFacts:
    """Facts on a recording that its page shows beside the values.

    Attributes:
        path: The recording.
        station: Its station.
        start_ns: UTC of its first message.
        end_ns: UTC of its last message.
        settings: Numbers and names of its station file: key, value, and whether the value is the default.
        lacks: What is damaged or missing, a sentence each.
        best: Index of the image in which most was measured, and that image with values drawn in, RGB; None without.
    """

    path: Path
    station: str
    start_ns: int
    end_ns: int
    settings: Sequence[tuple[str, str, bool]]
    lacks: Sequence[str]
    best: tuple[int, ImageArray] | None


def recording_page(found: RecordingSeries, probes: Sequence[Series], facts: RecordingFacts) -> str:
    """The page about a recording.

    Args:
        found: Its values.
        probes: Those to draw.
        facts: What else is known of it.

    Raises:
        InputError: One of its files cannot be read.
    """
    start, end = (style.second_utc(stamp_ns) for stamp_ns in (facts.start_ns, facts.end_ns))
    values, is_thinned = _values(found.probes.values())
    track = _recording_map(found, list(found.probes.values()))
    return render_html(
        "recording",
        station=facts.station,
        name=facts.path.name,
        start=start,
        end=end,
        probe_count=len(found.probes),
        image_count=found.images,
        pose_count=found.poses.answered,
        lacks=facts.lacks,
        summary=_summary(found.probes.values()),
        image=None if facts.best is None else {"index": facts.best[0], "source": _jpeg_source(facts.best[1])},
        map=None if track is None else _drawing(track),
        origin_deg=found.origin_deg,
        over_time=_drawing(draw_recording(found, probes, facts.station)),
        drawn_count=len(probes),
        values=values,
        thinned_to=_MOST_ROWS if is_thinned else None,
        events=[(style.second_utc(each.stamp_ns), each.kind, each.text) for each in found.events[: 5 * _MOST_ROWS]],
        stated=[(key, value) for key, value, is_default in facts.settings if not is_default],
        assumed=[(key, value) for key, value, is_default in facts.settings if is_default],
        remarks=found.remarks.most_common(_MOST_ROWS),
        softwares=found.softwares.most_common(),
        calibrations=sorted(filter(None, found.calibrations)),
        **_provenance(facts.path),
    )


def river_page(river: RiverFolder) -> str:
    """The page about a river's folder.

    Raises:
        InputError: One of its files cannot be read.
    """
    document, plate = river.document, river.path / "plate.png"
    used = [each for each in document["transects"] if each["status"] == Status.OK]
    place = _local_m(river)[1]
    return render_html(
        "river",
        name=river.path.name,
        status=document["status"],
        width=None if document["width_m"] is None else _width(document["width_m"]),
        used_count=len(used),
        confidence=document["confidence"],
        images=document.get("images"),
        plate=image_source(_read(plate), "png") if plate.is_file() else None,
        map=_drawing(_river_map(river)),
        origin_deg=place,
        profile=_drawing(_profile(document["transects"])) if used else None,
        transects=_transects(document["transects"]),
        reasons=document["reasons"],
        **_provenance(river.path),
    )


class Drawing(NamedTuple):
    """A figure as SVG in a page: its tag without the last bracket, and what follows that."""

    tag: Markup
    rest: Markup


@style.styled()
def _drawing(figure: Figure) -> Drawing:
    """A figure as SVG, without what names addresses, which HTML does not need."""
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None}, bbox_inches="tight")
    text = file.getvalue()
    tag, rest = text[text.index("<svg") :].split(">", 1)
    return Drawing(Markup(_NAMESPACES.sub("", tag)), Markup(_METADATA.sub("", rest)))  # noqa: S704 - matplotlib escapes


def _jpeg_source(rgb: ImageArray) -> str:
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    return image_source(bytes(cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]), "jpeg")


def _summary(probes: Iterable[Series]) -> list[tuple[str, ...]]:
    """One row for each probe, of a place one for east and one for north: what it came to, in the median."""
    rows = list[tuple[str, ...]]()
    for each in probes:
        others = {name: each.statuses.count(name) for name in sorted({*each.statuses} - {Status.OK})}
        why = ", ".join(f"{count} {name}" for name, count in others.items())
        for axis, (value, half) in amounts(each).items():
            known, middle = value[np.isfinite(value)], typical(value, half)
            form = f"z.{digits_of(middle[1])}f"
            shown = [format(number, form) for number in middle] if len(known) else ["", ""]
            span = f"{known.min():{form}} to {known.max():{form}}" if len(known) else ""
            unit = written_unit(each.unit) if len(known) or axis else ""
            unit += f" {axis} of the origin" if axis else ""
            answered = f"{each.answered} of {len(each.stamps_ns)}"
            rows.append((each.name, each.kind, answered, *shown, span, unit, why))
    return rows


def _values(probes: Iterable[Series]) -> tuple[list[tuple[str, ...]], bool]:
    """Rows of the values of each probe over time, none of places; whether they are thinned, which is done evenly."""
    rows, thinned = list[tuple[str, ...]](), False
    for each in probes:
        chosen = np.flatnonzero(np.isfinite(each.numbers("value")))
        thinned = thinned or len(chosen) > _MOST_ROWS
        for row in chosen[np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), _MOST_ROWS)).astype(int))]:
            value, low, high = (float(each.numbers(name)[row]) for name in ("value", "ci95_low", "ci95_high"))
            digits = digits_of((high - low) / 2)
            numbers = (f"{value:.{digits}f}", f"{low:.{digits}f} to {high:.{digits}f}", written_unit(each.unit))
            rows.append((each.name, time_utc(each.stamps_ns[row])[:-9].replace("T", " "), *numbers))
    return rows, thinned


def _provenance(path: Path) -> dict[str, Any]:
    """Every file with its size and its SHA-256, and who writes the page when.

    Raises:
        InputError: A file cannot be read.
    """
    files = []
    for each in sorted(path.iterdir()) if path.is_dir() else [path]:
        if each.is_file():
            with os_errors_as("the file cannot be read", where=each), each.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
                files.append({"name": each.name, "sha256": digest, "size_bytes": each.stat().st_size})
    return {"files": files, "software": SOFTWARE, "written_at": datetime.now(UTC).isoformat(timespec="seconds")}


def _read(path: Path) -> bytes:
    with os_errors_as("the file cannot be read", where=path):
        return read_whole(path)


def _thin(things: Sequence[FloatArray]) -> list[FloatArray]:
    """At most ``_MOST_LINES`` of some things, evenly spread."""
    return [
        things[row] for row in np.unique(np.linspace(0, len(things) - 1, min(len(things), _MOST_LINES)).astype(int))
    ]


@style.styled()
def _recording_map(found: RecordingSeries, probes: Sequence[Series]) -> Figure | None:
    """Map of the camera's way and of what was measured, in metres; None where nothing has a place."""
    poses = np.stack([found.poses.numbers("east_m"), found.poses.numbers("north_m")], axis=-1)
    track = poses[np.isfinite(poses).all(axis=-1)]
    shown = {
        each.name: _thin([points for points, status in zip(each.points_m, each.statuses, strict=True)
                          if len(points) and status == Status.OK])
        for each in probes
    }  # fmt: skip
    everything = [track, *(points for lines in shown.values() for points in lines)]
    if not sum(map(len, everything)):
        return None
    figure = Figure(figsize=(9, 7), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(*track.T, ".-", color=style.GREY, markersize=3, linewidth=0.8, label="camera")
    kinds = {each.name: recorded_kind(each.kind) for each in probes}
    for row, (name, lines) in enumerate(shown.items()):
        for number, points in enumerate(lines):
            pieces = [points[line] for line in kinds[name].lines(len(points))]
            for piece in pieces:
                closed = np.vstack([piece, piece[:1]]) if kinds[name].is_closed else piece
                label = name[:40] if not number and piece is pieces[0] else None
                axes.plot(
                    *closed.T,
                    "." if len(closed) < _ENDS else "-",
                    color=style.COLOURS[row % len(style.COLOURS)],
                    markersize=3,
                    alpha=0.6,
                    label=label,
                )
    style.as_map(axes, everything)
    axes.legend(loc="upper left")
    return figure


_Shape = tuple[str, Mapping[str, Any], list[FloatArray]]


def _local_m(river: RiverFolder) -> tuple[list[_Shape], tuple[float, float] | None]:
    """The river's features as lines in metres, and the place that they count from; None where nobody said it."""
    shapes = []
    for layer, geometry, properties in river.features:
        if geometry is not None:
            parts = geometry["coordinates"] if geometry["type"] == "Polygon" else [geometry["coordinates"]]
            shapes.append((layer, properties, [np.asarray(part, dtype=np.float64)[:, :2] for part in parts]))
    if river.is_local or not shapes:
        return shapes, None
    middle = np.mean(np.concatenate([part for _, _, parts in shapes for part in parts]), axis=0)
    lon_rad, lat_rad = np.radians(middle).tolist()
    origin = GeoOrigin(lat_rad=lat_rad, lon_rad=lon_rad, alt_msl_m=0.0)
    moved = [
        (layer, properties, [east_north(origin, *np.radians(part[:, ::-1].T)) for part in parts])
        for layer, properties, parts in shapes
    ]
    return moved, (float(middle[1]), float(middle[0]))


@style.styled()
def _river_map(river: RiverFolder) -> Figure:
    """Water, banks, transects and centreline."""
    figure = Figure(figsize=(9, 6), layout="constrained")
    axes, shapes = figure.add_subplot(), _local_m(river)[0]
    looks: dict[str, dict[str, Any]] = {
        "centreline": {"color": style.BLACK, "linestyle": "--", "linewidth": 0.9},
        "transects": {"color": style.GREY, "linewidth": 0.6},
        "left bank": {"color": style.BANKS[0], "linewidth": 1.3, "path_effects": style.OUTLINED},
        "right bank": {"color": style.BANKS[1], "linewidth": 1.3, "path_effects": style.OUTLINED},
    }
    said = set()
    for layer, properties, parts in shapes:
        name = f"{properties.get('side')} bank" if layer == "banks" else layer
        if layer == "water":
            axes.fill(*parts[0].T, color=style.SKY, alpha=0.25, linewidth=0, label=name)
            for hole in parts[1:]:
                axes.fill(*hole.T, color="white")
            continue
        for part in parts:
            axes.plot(*part.T, label=None if name in said else name, **looks.get(name, {"color": style.GREY}))
            said.add(name)
    if shapes:
        style.as_map(axes, [part for _, _, parts in shapes for part in parts])
        axes.legend(loc="upper left")
    return figure


@style.styled()
def _profile(transects: Sequence[Mapping[str, Any]]) -> Figure:
    """Widths along the river with their 95 % intervals, with gaps where a transect has none."""
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    style.draw_widths(figure.add_subplot(), transects)
    return figure


def _width(width: Mapping[str, Any]) -> dict[str, str]:
    """Width of a river and its interval's ends, with as many digits as are known."""
    low, high = width["ci95"]
    numbers = {"median": width["median"], "low": low, "high": high, "min": width["min"], "max": width["max"]}
    return {name: f"{value:.{digits_of((high - low) / 2)}f}" for name, value in numbers.items()}


def _transects(transects: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """One row for each transect: status, station, bound, width, interval, wetted width."""
    rows = list[tuple[str, ...]]()
    for each in transects:
        if each["ci95"] is None:
            rows.append((each["status"], f"{each['station_m']:.1f}", "", "", "", ""))
            continue
        low, high = each["ci95"]
        digits = digits_of((high - low) / 2)
        numbers = (f"{each['width_m']:.{digits}f}", f"{low:.{digits}f} to {high:.{digits}f}")
        bound = "at least" if each["bound"] else ""
        rows.append((each["status"], f"{each['station_m']:.1f}", bound, *numbers, f"{each['wetted_m']:.{digits}f}"))
    return rows
