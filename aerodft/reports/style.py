"""The one look of all figures: colours that the colour-blind tell apart (Okabe and Ito, 2008), bands, maps, files."""

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke, withStroke
from matplotlib.ticker import MaxNLocator

from aerodft.adapters.files import check_ending
from aerodft.model import FloatArray
from replay.export import time_utc

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PURPLE, SKY, YELLOW, BLACK, GREY = "#CC79A7", "#56B4E9", "#F0E442", "#000000", "#999999"
COLOURS: Final = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY, YELLOW)
"""In the order in which things get them; red is vermillion."""

BANKS: Final = (RED, YELLOW)
"""A river's left and right bank; with ``OUTLINED`` they are told from any ground, and from white."""
OUTLINED: Final = (Stroke(linewidth=2.4, foreground=BLACK), Normal())

BAND: Final = "95 % interval"
NORMAL_95: Final = 1.96
"""Standard deviations to each side of a normal distribution's middle that hold 95 % of it."""

FORMATS: Final = frozenset({"png", "svg", "pdf"})

_DPI: Final = 110
_TO_SECONDS: Final = 19  # characters of a time in ISO 8601
_GAP_STEPS: Final = 5  # usual steps from one row to the next
_SCALE_SHARE: Final = 0.3  # of the map's width, at the most
_LOOK: Final = {
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.prop_cycle": cycler(color=COLOURS),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": "medium",
    "font.size": 9,
    "grid.alpha": 0.3,
    "legend.fontsize": "small",
    "legend.framealpha": 0.9,
    "svg.hashsalt": "aerodft",
    "text.parse_math": False,  # names are what they are
}


def colours_of(names: Iterable[str]) -> dict[str, tuple[int, int, int]]:
    """RGB of each name, in the order in which things get their colours."""
    return {
        name: tuple(bytes.fromhex(colour.removeprefix("#")))  # type: ignore[misc]  # three of them
        for name, colour in zip(names, cycle(COLOURS), strict=False)
    }


def second_utc(stamp_ns: int) -> str:
    """A stamp's UTC to whole seconds, as figures and pages show it."""
    return time_utc(stamp_ns)[:_TO_SECONDS].replace("T", " ")


@contextmanager
def styled() -> Iterator[None]:
    """The look, while something is drawn; as a decorator or a block."""
    with mpl.rc_context(_LOOK), warnings.catch_warnings():  # type: ignore[arg-type]  # names are those of matplotlib
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # names are in any script
        yield


def figure_format(path: Path) -> str:
    """Format of a figure by its file's ending; PNG without one.

    Raises:
        UsageError: It says another.
    """
    check_ending(path, *sorted(f".{each}" for each in FORMATS))
    return path.suffix.lower().removeprefix(".") or "png"


@styled()
def save_figure(figure: Figure, path: Path, form: str) -> None:
    """Write a figure, without the time of writing: equal figures are equal files.

    Raises:
        OSError: It cannot be written.
    """
    date = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(form)
    figure.savefig(path, format=form, dpi=_DPI, metadata=date)


def draw_band(
    axes: Axes, x: FloatArray, low: FloatArray, high: FloatArray, colour: str, *, label: str | None = None
) -> None:
    """Draw an interval along ``x``; what stands alone between gaps (NaN) gets a bar of its own."""
    axes.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=0, label=label)
    known = np.pad(np.isfinite(low) & np.isfinite(high), 1)
    alone = known[1:-1] & ~known[:-2] & ~known[2:]
    axes.vlines(x[alone], low[alone], high[alone], color=colour, alpha=0.35, linewidth=2)


def draw_widths(axes: Axes, transects: Sequence[Mapping[str, Any]]) -> None:
    """Draw the widths of a river's document along it, with gaps where a transect has none."""
    columns = ("station_m", "width_m", "wetted_m")
    at, width, wetted = np.array([[each[name] for each in transects] for name in columns], dtype=np.float64)
    low, high = np.array([each["ci95"] or (None, None) for each in transects], dtype=np.float64).T
    draw_band(axes, at, low, high, BLUE, label=BAND)
    axes.plot(at, width, ".-", color=BLUE, markersize=3, linewidth=0.8, label="width")
    if any((each["channels"] or 1) > 1 for each in transects):
        axes.plot(at, wetted, ":", color=BLACK, linewidth=0.8, label="wetted, without islands")
    axes.set(xlabel="along the river (m)", ylabel="width (m)")
    axes.legend(loc="best")


def with_gaps(x: FloatArray, *columns: FloatArray) -> tuple[FloatArray, ...]:
    """``x`` and its columns, ``(n,)`` each, with NaN where nothing was for long: no band is drawn across that."""
    steps = np.diff(x)
    behind = np.flatnonzero(steps > _GAP_STEPS * np.median(steps)) + 1 if len(steps) else np.zeros(0, dtype=np.int64)
    return np.insert(x, behind, x[behind]), *(np.insert(each, behind, np.nan) for each in columns)


def set_visible_range(axes: Axes, lows: FloatArray, highs: FloatArray) -> int:
    """Let few intervals that are far wider than all others not flatten these; how many then leave the panel."""
    low, high = lows[np.isfinite(lows)], highs[np.isfinite(highs)]
    if not len(low) or not len(high):
        return 0
    bottom, top = float(np.quantile(low, 0.05)), float(np.quantile(high, 0.95))
    spare = max(0.5 * (top - bottom), 1e-9)
    if low.min() >= bottom - 2 * spare and high.max() <= top + 2 * spare:
        return 0
    axes.set_ylim(bottom - spare, top + spare)
    return int(np.count_nonzero((lows < bottom - spare) | (highs > top + spare)))


def as_map(axes: Axes, points_m: Iterable[FloatArray]) -> None:
    """Make axes a map in metres: as long east as north, with a scale bar and north; numbers stand in full.

    Args:
        axes: With everything drawn.
        points_m: What is drawn, ``(n, 2)`` each.
    """
    everything = np.concatenate([each[np.isfinite(each).all(axis=-1)] for each in points_m])
    low, high = everything.min(axis=0), everything.max(axis=0)
    size = max(float(np.max(high - low)), 1.0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 0.3 * size) + 0.12 * size
    axes.set(xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1]))
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5))
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.set(xlabel="east (m)", ylabel="north (m)")
    power = 10.0 ** np.floor(np.log10(_SCALE_SHARE * 2 * half[0]))
    bar_m = max(step * power for step in (1, 2, 5) if step * power <= _SCALE_SHARE * 2 * half[0])
    left, bottom = middle[0] - 0.94 * half[0], middle[1] - 0.92 * half[1]
    axes.plot([left, left + bar_m], [bottom, bottom], color=BLACK, linewidth=3, solid_capstyle="butt")
    box = {"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 1}
    axes.annotate(f"{bar_m:g} m", (left + bar_m / 2, bottom), (0, 4), textcoords="offset points", ha="center", bbox=box)
    halo = [withStroke(linewidth=3, foreground="white")]
    arrow = {"arrowstyle": "-|>", "color": BLACK, "linewidth": 1.5, "path_effects": halo}
    axes.annotate(
        "N", (0.96, 0.98), (0.96, 0.86), xycoords="axes fraction", textcoords="axes fraction", ha="center", va="top",
        arrowprops=arrow, fontweight="bold", path_effects=halo,
    )  # fmt: skip
