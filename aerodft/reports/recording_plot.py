"""The figure of a recording: its values over time and along the river, the camera's height and tilt, what happened."""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError, UsageError
from aerodft.model import FloatArray, IntArray, ProbeKind, Status
from aerodft.reports import style
from aerodft.reports.recording_series import Event, RecordingSeries, Series, runs
from replay.export import digits_of, written_unit

MOST_PROBES: Final = 12
"""More have no room in a figure."""

_MOST_POINTS: Final = 3000
_MOST_SPANS: Final = 1000
_WIDTH_IN, _PANEL_IN = 11.0, 1.9
_HATCHES: Final = ("", "///", "\\\\\\", "...")
_STATUS_COLOURS: Final = ("#D55E00", "#E69F00", "#CC79A7", "#56B4E9", "#F0E442", "#999999")
_MOST_LETTERS: Final = 40  # of a name, or of an event
_LETTER_SHARE: Final = 0.0075  # of the figure's width
_TIMES: Final = ((3 * 3600, 3600, "hours"), (600, 60, "minutes"), (0, 1, "seconds"))


def amounts(series: Series) -> dict[str, tuple[FloatArray, FloatArray]]:
    """A probe's values with half their 95 % intervals, ``(n,)`` each, under ""; of a place its ``east`` and ``north``.

    East and north are in metres from the station's origin; NaN where there is none.
    """
    value, low, high = (series.numbers(name) for name in ("value", "ci95_low", "ci95_high"))
    if series.kind not in {ProbeKind.POSITION, ProbeKind.TRACK} or np.isfinite(value).any():
        return {"": (value, (high - low) / 2)}
    variances = {axis: np.maximum(series.numbers(f"cov_{axis}_m2"), 0.0) for axis in ("east", "north")}
    return {axis: (series.numbers(f"{axis}_m"), style.NORMAL_95 * np.sqrt(each)) for axis, each in variances.items()}


def typical(value: FloatArray, half: FloatArray) -> tuple[float, float]:
    """Median of values and of half their 95 % intervals; NaN where there is none."""
    known, halves = value[np.isfinite(value)], half[np.isfinite(half)]
    return float(np.median(known)) if len(known) else math.nan, float(np.median(halves)) if len(halves) else math.nan


def chosen_probes(found: RecordingSeries, names: Sequence[str]) -> list[Series]:
    """The probes of some names; without names those with most answers, as many as have room, in their order.

    Raises:
        UsageError: There is no probe of a name, or there are more names than have room.
        NoAnswerError: Nothing was to be measured, and there is no pose.
    """
    series = list(found.probes.values())
    if not series and not found.poses.stamps_ns:
        raise NoAnswerError("the recording holds neither measurements nor poses")
    there = [each.name for each in series]
    for name in names:
        if name not in there:
            raise UsageError("`probes`", got=name, expected=f"of {', '.join(there) or 'none'}")
    chosen = [each for each in series if each.name in names] if names else series
    if names and len(chosen) > MOST_PROBES:
        raise UsageError("`probes`", got=f"{len(chosen)}", expected=f"{MOST_PROBES} at the most")
    most = sorted(chosen, key=lambda each: -each.answered)[:MOST_PROBES]
    return [each for each in chosen if any(each is one for one in most)]


class _Clock:
    """Time along the axis, from the first image and in a unit that suits the length."""

    def __init__(self, zero_ns: int, start_ns: int, end_ns: int) -> None:
        length_s = (end_ns - start_ns) / SECOND_NS
        _, self._unit_s, name = next(each for each in _TIMES if length_s >= each[0])
        self._zero_ns = zero_ns
        zero, start, end = map(style.second_utc, (zero_ns, start_ns, end_ns))
        self.label, self.span = f"{name} since {zero} UTC", f"{start} to {end} UTC"

    def of(self, stamps_ns: IntArray) -> FloatArray:
        return np.asarray((stamps_ns - self._zero_ns) / (SECOND_NS * self._unit_s), dtype=np.float64)


@style.styled()
def draw_recording(found: RecordingSeries, probes: Sequence[Series], station: str) -> Figure:
    """Draw values with their 95 % intervals, heights by source, tilt, statuses as coloured spans, and events.

    Args:
        found: The recording.
        probes: Whose values; at most ``MOST_PROBES``.
        station: Its name.
    """
    stamps = [each.stamps for each in (*probes, found.poses) if each.stamps_ns]
    start_ns, end_ns = min(int(each.min()) for each in stamps), max(int(each.max()) for each in stamps)
    clock, events = (
        _Clock(found.zero_ns, start_ns, end_ns),
        [each for each in found.events if start_ns <= each.stamp_ns <= end_ns],
    )
    rivers = [each for each in probes if each.kind == ProbeKind.RIVER and each.answered]
    has_events = bool(events)
    count = len(probes) + 2 + has_events
    heights = [1.0] * (count - has_events) + [0.25 + 0.2 * len({each.kind for each in events})] * has_events
    heights += [1.3] * len(rivers)
    figure = Figure(figsize=(_WIDTH_IN, 1.3 + _PANEL_IN * sum(heights)), layout="constrained")
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    axes = [figure.add_subplot(grid[0])]
    axes += [figure.add_subplot(grid[row], sharex=axes[0]) for row in range(1, count)]
    spans = _Spans()
    for panel, series in zip(axes, probes, strict=False):
        _draw_values(panel, series, clock)
        spans.draw(panel, series, clock)
    sources = _draw_height(axes[len(probes)], found.poses, clock)
    _draw_tilt(axes[len(probes) + 1], found.poses, clock)
    for panel in axes[len(probes) : len(probes) + 2]:
        spans.draw(panel, found.poses, clock)
    ends = clock.of(np.array([start_ns, end_ns]))
    spare = max(0.01 * float(ends[1] - ends[0]), 0.01)
    axes[0].set_xlim(ends[0] - spare, ends[1] + spare)
    if has_events:
        _draw_events(axes[count - 1], events, clock, axes[:-1])
    for panel in axes[:-1]:
        panel.tick_params(labelbottom=False)
    axes[-1].set_xlabel(clock.label)
    for row, series in enumerate(rivers, start=count):
        _draw_along(figure.add_subplot(grid[row]), series)
    figure.align_ylabels(axes)
    handles = [
        Line2D([], [], color=style.BLUE, marker=".", linestyle="", label="measured"),
        Patch(color=style.GREY, alpha=0.5, label=style.BAND),
        *(Line2D([], [], color=colour, label=f"height: {name}") for name, colour in sources.items()),
        *spans.handles(),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 6), frameon=False)
    some = f" ({len(probes)} of {len(found.probes)} probes)" if len(probes) < len(found.probes) else ""
    figure.suptitle(f"{_short(station)}: {clock.span}{some}", x=0.01, ha="left", fontweight="bold")
    return figure


def write_recording_plot(found: RecordingSeries, probes: Sequence[Series], station: str, path: Path, form: str) -> None:
    """Draw a recording's figure into a file of a format of ``FORMATS``.

    Raises:
        OSError: It cannot be written.
    """
    style.save_figure(draw_recording(found, probes, station), path, form)


def _draw_values(axes: Axes, series: Series, clock: _Clock) -> None:
    """One probe's values, or of a position its east and north from where it is in the median."""
    name, unit = f"{_short(series.name)} ({_short(series.kind)})", written_unit(series.unit)
    known = f"{series.answered} of {len(series.stamps_ns)} answered"
    found = amounts(series)
    if "" not in found:
        for (axis, (place, halves)), colour in zip(found.items(), (style.BLUE, style.RED), strict=True):
            off = place - typical(place, halves)[0]
            _draw_line(axes, clock.of(series.stamps), off, (off - halves, off + halves), colour)
            axes.plot([], [], ".", color=colour, label=axis)
        axes.legend(loc="upper right", ncols=2)
        axes.set(title=f"{name}: from its median place; {known}", ylabel="m")
        return
    value, half = typical(*found[""])
    digits = digits_of(half)
    middle = (
        "" if math.isnan(value) else f"median {value:.{digits}f} {unit}, typically ± {half:.{digits}f} {unit} (95 %); "
    )
    ends = series.numbers("ci95_low"), series.numbers("ci95_high")
    beyond = _draw_line(axes, clock.of(series.stamps), series.numbers("value"), ends, style.BLUE)
    axes.set(title=f"{name}: {middle}{known}{_cut(beyond)}", ylabel=unit)


def _draw_line(axes: Axes, x: FloatArray, value: FloatArray, ends: tuple[FloatArray, FloatArray], colour: str) -> int:
    """Values with their interval; how many intervals leave the panel."""
    rows = _thinned(value)
    x, value, low, high = style.with_gaps(x[rows], value[rows], ends[0][rows], ends[1][rows])
    style.draw_band(axes, x, low, high, colour)
    axes.plot(x, value, ".", color=colour, markersize=3)
    return style.set_visible_range(axes, *ends)


def _short(name: str) -> str:
    """A name or a few words that have room."""
    return name if len(name) <= _MOST_LETTERS else f"{name[: _MOST_LETTERS - 1]}…"


def _cut(beyond: int) -> str:
    """Heading's remark on intervals that reach beyond a panel."""
    return f"; {beyond} interval{'s reach' if beyond > 1 else ' reaches'} beyond the panel" if beyond else ""


def _thinned(value: FloatArray) -> IntArray:
    """Rows to draw: the least and the largest value in each of as many runs as can be told apart."""
    if len(value) <= _MOST_POINTS:
        return np.arange(len(value))
    bounds = np.linspace(0, len(value), _MOST_POINTS // 2 + 1).astype(int)
    safe = np.where(np.isfinite(value), value, 0.0)
    ends = [low + np.array([safe[low:high].argmin(), safe[low:high].argmax()]) for low, high in pairwise(bounds)]
    return np.unique(np.concatenate(ends))


def _draw_height(axes: Axes, poses: Series, clock: _Clock) -> dict[str, str]:
    """Heights above what is measured, by source; the sources' colours."""
    height, half = poses.numbers("height_m"), style.NORMAL_95 * poses.numbers("height_std_m")
    names = poses.texts["height_source"]
    sources = dict(zip(sorted({*names} - {""}), (style.GREEN, style.RED, style.BLUE, *style.COLOURS[3:]), strict=False))
    x = clock.of(poses.stamps)
    beyond = 0
    for name, colour in sources.items():
        own = np.where([each == name for each in names], height, np.nan)
        beyond = _draw_line(axes, x, own, (own - half, own + half), colour)
    axes.set(title=f"camera's height above the measured surface, by source{_cut(beyond)}", ylabel="m")
    return sources


def _draw_tilt(axes: Axes, poses: Series, clock: _Clock) -> None:
    tilt, half = poses.numbers("tilt_deg"), style.NORMAL_95 * poses.numbers("tilt_std_deg")
    beyond = _draw_line(axes, clock.of(poses.stamps), tilt, (tilt - half, tilt + half), style.BLACK)
    axes.set(title=f"camera's tilt: 0 straight down, 90 to the horizon{_cut(beyond)}", ylabel="degrees")


class _Spans:
    """Colours of statuses, kept through all panels."""

    def __init__(self) -> None:
        self._looks: dict[str, tuple[str, str]] = {}

    def draw(self, axes: Axes, series: Series, clock: _Clock) -> None:
        """Shade the times without a value by their status; each lasts until the next row, or a usual step."""
        if not series.stamps_ns:
            return
        order = np.argsort(series.stamps, kind="stable")
        stamps, statuses = series.stamps[order], [series.statuses[row] for row in order]
        step = int(np.median(np.diff(stamps))) if len(stamps) > 1 else SECOND_NS // 10
        found = [
            (
                stamps[first],
                min(stamps[last] if last < len(stamps) else stamps[-1] + step, stamps[last - 1] + step),
                name,
            )
            for first, last, name in runs(statuses)
            if name != Status.OK
        ]
        for start, end, name in sorted(found, key=lambda each: each[0] - each[1])[:_MOST_SPANS]:
            number = len(self._looks)
            look = _STATUS_COLOURS[number % len(_STATUS_COLOURS)], _HATCHES[number // len(_STATUS_COLOURS) % 4]
            colour, hatch = self._looks.setdefault(name, look)
            ends = clock.of(np.array([start, end]))
            axes.axvspan(ends[0], ends[1], facecolor=colour, alpha=0.3, linewidth=0, hatch=hatch, zorder=0)

    def handles(self) -> list[Patch]:
        """Handles for the legend."""
        return [
            Patch(facecolor=colour, alpha=0.3, hatch=hatch, label=f"no value: {name}")
            for name, (colour, hatch) in self._looks.items()
        ]


def _draw_events(axes: Axes, events: Sequence[Event], clock: _Clock, panels: Sequence[Axes]) -> None:
    """A row for each kind of event; a word beside each that has room, and a line through all panels."""
    kinds = sorted({each.kind for each in events})
    at = clock.of(np.array([each.stamp_ns for each in events]))
    low, high = panels[0].get_xlim()
    for panel in panels:
        for x in at[:_MOST_SPANS]:
            panel.axvline(x, color=style.BLACK, linewidth=0.7, linestyle=":", alpha=0.6)
    for row, kind in enumerate(kinds):
        own = [(x, event.text) for x, event in zip(at.tolist(), events, strict=True) if event.kind == kind]
        free = low  # to the left of what comes next
        for (x, words), following in zip(own, [*(x for x, _ in own[1:]), high], strict=True):
            axes.plot(x, row, "|", color=style.BLACK, markersize=9)
            text = _short(words)
            width = (len(text) + 2) * _LETTER_SHARE * (high - low)
            is_right = x + width <= following
            if is_right or x - width >= free:
                side, away = ("left", 4) if is_right else ("right", -4)
                axes.annotate(
                    text, (x, row), (away, 0), textcoords="offset points", ha=side, va="center", fontsize="small",
                    annotation_clip=True,
                )  # fmt: skip
            free = x + width * is_right
    axes.set(ylim=(len(kinds) - 0.4, -0.6), title="events, in words where there is room")
    axes.set_yticks(range(len(kinds)), kinds)


def _draw_along(axes: Axes, series: Series) -> None:
    """Widths at the transects of all looks along the river, with what holds 95 % of the looks around each place.

    Looks see different reaches: transects are laid along the principal axis of all their middles, from the first.
    """
    ends = [points.reshape(-1, 2, 2) for points in series.points_m if len(points) and len(points) % 2 == 0]
    across = np.concatenate(ends) if ends else np.zeros((0, 2, 2))
    if not len(across):
        return
    middles, widths = across.mean(axis=1), np.linalg.norm(across[:, 0] - across[:, 1], axis=-1)
    along = np.linalg.svd(middles - middles.mean(axis=0), full_matrices=False)[2][0]
    stations = (middles - middles.mean(axis=0)) @ along
    stations -= stations.min()
    axes.plot(stations, widths, ".", color=style.BLUE, markersize=2, alpha=0.5)
    edges = np.linspace(0.0, max(float(stations.max()), 1e-9), int(np.clip(len(stations) // 20, 1, 60)) + 1)
    bins = np.clip(np.digitize(stations, edges) - 1, 0, len(edges) - 2)
    rows = [
        (float(np.mean(edges[row : row + 2])), *np.quantile(widths[bins == row], (0.025, 0.5, 0.975)))
        for row in np.unique(bins)
    ]
    at, low, middle, high = np.array(rows).T
    style.draw_band(axes, at, low, high, style.BLUE)
    axes.plot(at, middle, color=style.BLUE, linewidth=1)
    axes.set(
        title=f"{series.name} along the river: transects of {len(ends)} looks; the band holds 95 % of them",
        xlabel="along the river (m)",
        ylabel="width (m)",
    )
