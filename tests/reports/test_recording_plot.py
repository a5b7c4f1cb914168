"""The figure of a recording: what is drawn is what was measured, and nothing stands on anything else."""

from dataclasses import replace
from itertools import combinations, product
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.text import Text

from aerodft.conventions import SECOND_NS
from aerodft.model import ProbeKind, Status
from aerodft.reports.recording_plot import (
    MOST_PROBES,
    amounts,
    chosen_probes,
    draw_recording,
    typical,
    write_recording_plot,
)
from aerodft.reports.recording_series import Event, Series, read_series
from aerodft.reports.style import COLOURS, with_gaps
from replay.recordings import Recording
from tests.replay.test_side_by_side import START_NS, a_measurement, record

FROZEN = Path("tests/cli/frozen-0.1")
STEP_NS = SECOND_NS // 10


def one(index):
    value = 20.0 + index % 3
    return a_measurement(index, value, stamp_ns=START_NS + index * STEP_NS, ci95=(value - 0.5, value + 1.0))


@pytest.fixture
def found(tmp_path):
    """Ten values, five instants without one, ten values."""
    none = {"value": None, "std": None, "ci95": None, "status": Status.NO_HEIGHT}
    values = [one(index) if not 10 <= index < 15 else replace(one(index), **none) for index in range(25)]
    return read_series(Recording(record(tmp_path / "r", values)))


def test_bands_are_the_measured_intervals_and_end_where_there_is_none(found):
    (panel, *_) = draw_recording(found, chosen_probes(found, ()), "s").axes
    band = panel.collections[0]
    spans = sorted(path.get_extents().intervalx.tolist() for path in band.get_paths())
    np.testing.assert_allclose(spans, [[0.0, 0.9], [1.5, 2.4]], atol=1e-6)
    corners = np.concatenate([path.vertices for path in band.get_paths()])
    for index in (0, 4, 20):
        at = corners[np.abs(corners[:, 0] - index / 10) < 1e-6, 1]
        assert {19.5 + index % 3, 21.0 + index % 3} <= set(np.round(at, 9))


def test_times_without_a_value_are_spans_of_their_status(found):
    figure = draw_recording(found, chosen_probes(found, ()), "s")
    (span,) = [each for each in figure.axes[0].patches if each.get_facecolor()[3] == pytest.approx(0.3)]
    np.testing.assert_allclose([span.get_x(), span.get_x() + span.get_width()], [1.0, 1.5], atol=1e-6)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[:2] == ["measured", "95 % interval"]
    assert "no value: NO_HEIGHT" in labels


def test_the_heading_says_the_median_and_how_surely(found):
    (series,) = chosen_probes(found, ())
    assert typical(*amounts(series)[""]) == (21.0, 0.75)
    title = draw_recording(found, [series], "s").axes[0].get_title(loc="left")
    assert title == "w (distance): median 21.00 m, typically ± 0.75 m (95 %); 20 of 25 answered"


def test_a_river_is_drawn_along_its_course(tmp_path):
    """Transects 20 m to 30 m wide every 5 m towards the north-east, seen in eight looks."""
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    at = np.arange(0.0, 50.0, 5.0)
    widths = 20.0 + at / 5
    ends = np.stack([np.stack([at, widths / 2], -1), np.stack([at, -widths / 2], -1)], axis=1) @ turn.T
    enu = tuple((float(east), float(north), 0.0) for east, north in ends.reshape(-1, 2))
    pixels = tuple((float(row), 1.0) for row in range(len(enu)))
    looks = [
        a_measurement(index, 24.5, kind=ProbeKind.RIVER, enu_m=enu, pixels=pixels, ci95=(24.0, 25.0))
        for index in range(8)
    ]
    found = read_series(Recording(record(tmp_path / "r", looks)))
    panel = draw_recording(found, chosen_probes(found, ()), "s").axes[-1]
    assert "95 %" in panel.get_title(loc="left")
    stations, drawn = panel.lines[0].get_data()
    order = np.argsort(drawn)
    np.testing.assert_allclose(drawn[order], np.repeat(widths, 8), atol=1e-6)
    np.testing.assert_allclose(np.ptp(stations), 45.0, rtol=0.01)


def test_no_words_stand_on_each_other(found):
    words = ("gps to home, +0.42 m", "home to rangefinder, -1.20 m", "ok; the gimbal may still be turning")
    stamps = START_NS + np.array([0.1, 0.2, 0.25, 0.9, 1.3, 1.31, 1.6, 2.3, 2.35]) * SECOND_NS
    for row, stamp_ns in enumerate(stamps.astype(int).tolist()):
        found.events += [Event(stamp_ns, ("height", "station")[row % 2], words[row % 3])]
    recordings = (found, read_series(Recording(FROZEN)))
    for series in recordings:
        figure = draw_recording(series, chosen_probes(series, ()), "a station")
        renderer = FigureCanvasAgg(figure).get_renderer()
        figure.draw(renderer)
        shown = [each for each in figure.findobj(Text) if each.get_visible() and each.get_text().strip()]
        boxes = [(each.get_text(), each.get_window_extent(renderer)) for each in shown]
        ticks = {each for axes in figure.axes for axis in (axes.xaxis, axes.yaxis) for each in axis.get_ticklabels()}
        page = figure.bbox.padded(1)
        marks = [line for axes in figure.axes for line in axes.lines if line.get_marker() == "|"]
        for line, (text, box) in product(marks, boxes):
            ends = line.get_window_extent(renderer)  # a square around the stroke
            assert not box.contains((ends.x0 + ends.x1) / 2, (ends.y0 + ends.y1) / 2), text
        for (one_text, box), (other_text, other) in combinations(
            [pair for pair, each in zip(boxes, shown, strict=True) if each not in ticks], 2
        ):
            is_apart = box.x1 <= other.x0 or other.x1 <= box.x0 or box.y1 <= other.y0 or other.y1 <= box.y0
            assert is_apart, (one_text, other_text)
        for (text, box), each in zip(boxes, shown, strict=True):
            if each not in ticks:
                assert max(page.x0 - box.x0, box.x1 - page.x1, page.y0 - box.y0, box.y1 - page.y1) <= 0, text


def test_of_many_probes_those_with_most_answers_are_drawn(found):
    few, most = list(found.probes.values()), []
    for index in range(2 * MOST_PROBES):
        series = Series(
            name=f"p{index}", kind="distance", stamps_ns=[START_NS], statuses=["ok" if index % 2 else "LOST"]
        )
        for name in ("value", "ci95_low", "ci95_high"):
            series.columns[name].append(1.0 if index % 2 else np.nan)
        found.probes[series.name, series.kind] = series
        most += [series.name] * (index % 2)
    assert [each.name for each in chosen_probes(found, ())] == [few[0].name, *most[: MOST_PROBES - 1]]


def test_silence_breaks_every_column():
    x, low, high = with_gaps(np.array([0.0, 1, 2, 3, 40, 41]), np.arange(6.0), np.arange(6.0) + 1)
    np.testing.assert_array_equal(np.isnan(low), [0, 0, 0, 0, 1, 0, 0])
    np.testing.assert_array_equal(np.isnan(high), np.isnan(low))
    assert len(x) == 7


def simulated(colour, matrix):
    """A colour as somebody sees it whose eyes lack one kind of cone (Machado et al., 2009, severity 1)."""
    linear = np.where(
        np.array(colour) <= 0.04045, np.array(colour) / 12.92, ((np.array(colour) + 0.055) / 1.055) ** 2.4
    )
    return matrix @ linear


@pytest.mark.parametrize(
    "matrix",
    [
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    ],
    ids=["protanopia", "deuteranopia"],
)
def test_the_colours_are_told_apart_without_red_or_green_cones(matrix):
    seen = [simulated(to_rgb(each), np.array(matrix)) for each in COLOURS]
    apart = [np.linalg.norm(one - other) for one, other in combinations(seen, 2)]
    assert min(apart) > 0.12


def test_names_may_be_anything(tmp_path):
    """Mathematics that is none, other scripts, markup, control characters, and no end."""
    names = ("$\\frac{$", "河", "<b>&amp;</b>\x1b[31m", "n" * 3000, "_hidden")
    values = [a_measurement(index, name=name, ci95=(0.0, 9.0)) for index, name in enumerate(names)]
    found = read_series(Recording(record(tmp_path / "r", values)))
    write_recording_plot(found, chosen_probes(found, ()), "$\\x$", tmp_path / "x.png", "png")
    shown = cv2.imread(str(tmp_path / "x.png"))
    assert shown.shape[1] == 1210
