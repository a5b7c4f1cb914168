"""One page about a recording or a river for whoever was not there: HTML that needs no other file and no network."""

import base64
import hashlib
import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from matplotlib.figure import Figure

from aerodft.adapters.files import read_whole
from aerodft.dft import recorded_kind
from aerodft.errors import os_errors_as
from aerodft.geometry import east_north
from aerodft.model import FloatArray, GeoOrigin, ImageArray, Status
from aerodft.reports import style
from aerodft.reports.recording_plot import amounts, draw_recording, typical
from aerodft.reports.recording_series import RecordingSeries, Series
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

_STYLE: Final = """
:root { color-scheme: light }
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.7rem; margin-bottom: 0 } h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid #ccc }
.lead { font-size: 1.15rem } .small, figcaption { color: #555; font-size: .85rem }
figure { margin: 1rem 0 } figure svg, figure img { max-width: 100%; height: auto; display: block }
table { border-collapse: collapse; width: 100%; font-size: .85rem; font-variant-numeric: tabular-nums }
th, td { text-align: left; padding: .2rem .6rem .2rem 0; border-bottom: 1px solid #ddd; vertical-align: top }
td { overflow-wrap: break-word }
td.n, th.n { text-align: right; white-space: nowrap } td.hash { font-family: monospace; overflow-wrap: anywhere }
@media screen and (max-width: 50rem) { table { display: block; overflow-x: auto } }
@page { size: A4; margin: 15mm }
@media print { body { margin: 0; max-width: none; font-size: 10pt } thead { display: table-header-group }
  h2 { break-after: avoid } figure, tr { break-inside: avoid } figure svg { max-height: 24cm }
  figure img { max-height: 15.5cm; width: auto; margin: auto } }
"""
_POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_COVERS: Final = (
    "An interval holds the true value in 95 of 100 cases, as far as what is stated below is true. It does not cover a"
    " wrong height of the water or the ground, ground that is not as configured, or a camera file of another camera or"
    " mode."
)


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
    posed = found.poses.answered
    quantities = "1 quantity" if len(found.probes) == 1 else f"{len(found.probes)} quantities"
    lead = f"{quantities} in {found.images} images; for {posed} of these the camera's pose is known."
    parts = [
        heading(f"Measurements of {facts.station or facts.path.name}", f"{start} to {end} UTC"),
        f'<p class="lead">{lead}</p>',
        *(f"<p><strong>{escape(each)}</strong></p>" for each in facts.lacks),
        _section("What was measured", _summary(found.probes.values()), paragraph(_COVERS)),
    ]
    if facts.best is not None:
        index, pixels = facts.best
        bgr = cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
        data = bytes(cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1])
        words = f"Image {index}, in which most was measured; behind each value its 95 % interval."
        parts.append(_section("The image", picture(data, "jpeg", words)))
    drawn = _recording_map(found, list(found.probes.values()))
    if drawn is not None:
        parts.append(_section("The map", _drawing(drawn, _place_words(found))))
    over_time = draw_recording(found, probes, facts.station)
    words = f"Bands are 95 % intervals; {len(probes)} of {len(found.probes)} quantities are drawn."
    parts += [
        _section("Over time", _drawing(over_time, words)),
        _values(found.probes.values()),
        _section("What happened", _events(found)) if found.events else "",
        _section("What was stated and assumed", *_settings(facts.settings), _remarks(found)),
        _section("Provenance", _provenance(facts.path, found)),
    ]
    return page(f"Measurements of {facts.station}", parts)


def river_page(river: RiverFolder) -> str:
    """The page about a river's folder.

    Raises:
        InputError: One of its files cannot be read.
    """
    document, width = river.document, river.document["width_m"]
    used = [each for each in document["transects"] if each["status"] == Status.OK]
    if width is None:
        lead = f"No width was measured: {document['status']}."
    else:
        low, high = width["ci95"]
        digits = digits_of((high - low) / 2)
        lead = (
            f"The river is {width['median']:.{digits}f} m wide in the median, {low:.{digits}f} to {high:.{digits}f} m"
            f" (95 %); {width['min']:.{digits}f} to {width['max']:.{digits}f} m along {len(used)} of"
            f" {len(document['transects'])} transects."
        )
    images = document.get("images")
    seen = "" if images is None else f" {images.get('used', 0)} of {images['looked_at']} images show it."
    sure = f"Confidence in the water's outline: {100 * document['confidence']:.0f} %.{seen}"
    notes = document["reasons"] or ["Nothing more than its inputs' stated uncertainties was said of this answer."]
    parts = [
        heading("Width of a river", river.path.name),
        f'<p class="lead">{escape(lead)}</p>',
        paragraph(f"{sure} {_COVERS}"),
    ]
    plate = river.path / "plate.png"
    if plate.is_file():
        words = "Banks and transects in the image and from above, and the widths along the river."
        parts.append(_section("The plate", picture(_read(plate), "png", words)))
    parts.append(_section("The map", _drawing(_river_map(river), _river_place(river))))
    if used:
        words = f"The band is the {style.BAND} of each width."
        parts.append(_section("Along the river", _drawing(_profile(document["transects"]), words)))
    parts += [
        _section("Transects", _transects(document["transects"])),
        _section("What was assumed and what to know", bullets(notes)),
        _section("Provenance", _files(river.path), _made_by()),
    ]
    return page(f"Width of a river: {river.path.name}", parts)


def page(title: str, parts: Iterable[str]) -> str:
    """A whole page that needs no other file, of parts of HTML; empty ones are left out."""
    head = (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>"
    )
    return "\n".join([head, *filter(None, parts), "</body></html>\n"])


def heading(title: str, below: str) -> str:
    """The page's title, and what stands small below it."""
    return f'<h1>{escape(title)}</h1><p class="small">{escape(below)}</p>'


def _section(title: str, *parts: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{''.join(parts)}</section>"


def paragraph(text: str) -> str:
    """A text of its own."""
    return f"<p>{escape(text)}</p>"


def bullets(sentences: Iterable[str]) -> str:
    """A list of sentences."""
    return f"<ul>{''.join(f'<li>{escape(each)}</li>' for each in sentences)}</ul>"


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, words: int = 1, last_words: int = 0) -> str:
    """A table whose first columns, and some of the last, are words, the others numbers."""
    looks = [""] * words + [' class="n"'] * (len(head) - words - last_words) + [""] * last_words

    def line(tag: str, cells: Sequence[str]) -> str:
        return "".join(f"<{tag}{look}>{escape(cell)}</{tag}>" for look, cell in zip(looks, cells, strict=True))

    body = "".join(f"<tr>{line('td', cells)}</tr>" for cells in rows)
    return f"<table><thead><tr>{line('th', head)}</tr></thead><tbody>{body}</tbody></table>"


def picture(data: bytes, kind: str, words: str) -> str:
    """An image file's bytes, ``png`` or ``jpeg``, with words below."""
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    return f'<figure><img src="{source}" alt="{escape(words)}"><figcaption>{escape(words)}</figcaption></figure>'


@style.styled()
def _drawing(figure: Figure, words: str) -> str:
    """A figure as SVG in the page: without what names addresses, which HTML does not need."""
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None}, bbox_inches="tight")
    text = file.getvalue()
    head, rest = text[text.index("<svg") :].split(">", 1)
    label = f' role="img" aria-label="{escape(words)}"'
    drawn = f"{_NAMESPACES.sub('', head)}{label}>{_METADATA.sub('', rest)}"
    return f"<figure>{drawn}<figcaption>{escape(words)}</figcaption></figure>"


def _summary(probes: Iterable[Series]) -> str:
    """One row for each probe, of a place one for east and one for north: what it came to, in the median."""
    rows = []
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
    head = ("quantity", "kind", "answered", "median", "± (95 %)", "least to largest", "unit", "without a value")
    return table(head, rows, words=2, last_words=2)


def _values(probes: Iterable[Series]) -> str:
    """The section of the values of each probe over time, evenly thinned; nothing where there are none but places."""
    rows, thinned = [], False
    for each in probes:
        chosen = np.flatnonzero(np.isfinite(each.numbers("value")))
        thinned = thinned or len(chosen) > _MOST_ROWS
        for row in chosen[np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), _MOST_ROWS)).astype(int))]:
            value, low, high = (float(each.numbers(name)[row]) for name in ("value", "ci95_low", "ci95_high"))
            digits = digits_of((high - low) / 2)
            numbers = (f"{value:.{digits}f}", f"{low:.{digits}f} to {high:.{digits}f}", written_unit(each.unit))
            rows.append((each.name, time_utc(each.stamps_ns[row])[:-9].replace("T", " "), *numbers))
    if not rows:
        return ""
    note = f"At most {_MOST_ROWS} of each quantity, evenly spread; aerodft export writes all." if thinned else ""
    head = ("quantity", "UTC", "value", "95 % interval", "unit")
    return _section("Values", paragraph(note) * bool(note) + table(head, rows, words=2, last_words=1))


def _events(found: RecordingSeries) -> str:
    rows = [(style.second_utc(each.stamp_ns), each.kind, each.text) for each in found.events[: 5 * _MOST_ROWS]]
    return table(("UTC", "of", "what"), rows, words=3)


def _settings(settings: Sequence[tuple[str, str, bool]]) -> Iterator[str]:
    """Tables of stated and of default settings."""
    for title, is_default in (("Stated in the station file", False), ("Assumed: defaults of the software", True)):
        rows = [(key, value) for key, value, own in settings if own is is_default]
        if rows:
            yield f"<h3>{title}</h3>{table(('key, with its unit', 'value'), rows)}"


def _remarks(found: RecordingSeries) -> str:
    if not found.remarks:
        return ""
    said = [f"{text} ({count} values)" for text, count in found.remarks.most_common(_MOST_ROWS)]
    return f"<h3>What values say of themselves</h3>{bullets(said)}"


def _provenance(path: Path, found: RecordingSeries) -> str:
    made = ", ".join(f"{name} ({count} measurements)" for name, count in found.softwares.most_common())
    calibrations = [name for name in found.calibrations if name]
    lines = [f"Measured by {made}."] if made else []
    lines += [f"Calibrations: {', '.join(sorted(calibrations))}."] if calibrations else []
    return bullets(lines) * bool(lines) + _files(path) + _made_by()


def _made_by() -> str:
    return paragraph(f"Page written by {SOFTWARE} at {datetime.now(UTC).isoformat(timespec='seconds')}.")


def _files(path: Path) -> str:
    """Every file with its size and its SHA-256."""
    rows = []
    for each in sorted(path.iterdir()) if path.is_dir() else [path]:
        if each.is_file():
            with os_errors_as("the file cannot be read", where=each), each.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
                rows.append((each.name, digest, f"{each.stat().st_size:,}"))
    shown = table(("file", "SHA-256", "bytes"), rows, words=2)
    return re.sub(r"<td>([0-9a-f]{64})</td>", r'<td class="hash">\1</td>', shown)


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


def _place_words(found: RecordingSeries) -> str:
    if found.origin_deg is None:
        return "Metres from an origin whose place on Earth nobody said."
    lat_deg, lon_deg = found.origin_deg
    return f"Metres east and north of {lat_deg:.6f}°, {lon_deg:.6f}° (WGS84); the camera's track is grey."


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


def _river_place(river: RiverFolder) -> str:
    place = _local_m(river)[1]
    sides = "Left and right are as one looks downstream where the flow was stated, else guessed."
    if place is None:
        return f"Metres from the camera's foot, whose place on Earth nobody said. {sides}"
    return f"Metres east and north of {place[0]:.6f}°, {place[1]:.6f}° (WGS84). {sides}"


@style.styled()
def _profile(transects: Sequence[Mapping[str, Any]]) -> Figure:
    """Widths along the river with their 95 % intervals, with gaps where a transect has none."""
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    style.draw_widths(figure.add_subplot(), transects)
    return figure


def _transects(transects: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for each in transects:
        if each["ci95"] is None:
            rows.append((each["status"], f"{each['station_m']:.1f}", "", "", "", ""))
            continue
        low, high = each["ci95"]
        digits = digits_of((high - low) / 2)
        numbers = (f"{each['width_m']:.{digits}f}", f"{low:.{digits}f} to {high:.{digits}f}")
        bound = "at least" if each["bound"] else ""
        rows.append((each["status"], f"{each['station_m']:.1f}", bound, *numbers, f"{each['wetted_m']:.{digits}f}"))
    head = ("status", "along the river (m)", "bound", "width (m)", "95 % interval (m)", "wetted (m)")
    return table(head, rows)
