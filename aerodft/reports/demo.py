"""The demo's report: truth beside measurement, figures, tables and maps."""

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure

from aerodft.reports.style import BAND, BLACK, BLUE, draw_band, save_figure, styled, with_gaps
from replay.export import EXPORTERS, MapCrs, best_image
from replay.recordings import Recording


@dataclass(frozen=True, slots=True)
class Answer:
    """One measured width beside its truth."""

    name: str
    stamp_ns: int
    truth_m: float
    value_m: float
    ci95_m: tuple[float, float]

    @property
    def inside(self) -> bool:
        """Whether the interval holds the truth."""
        return self.ci95_m[0] <= self.truth_m <= self.ci95_m[1]


@styled()
def plot_widths(answers: Mapping[str, Sequence[Answer]], start_ns: int, path: Path) -> None:
    """Width over time with its 95 % band and the truth, one panel a probe, as PNG."""
    figure = Figure(figsize=(9, 2.6 * len(answers)), layout="constrained")
    panels = figure.subplots(len(answers), 1, sharex=True, squeeze=False)[:, 0]
    for panel, (name, series) in zip(panels, answers.items(), strict=True):
        rows = np.array([(a.stamp_ns - start_ns, a.value_m, a.truth_m, *a.ci95_m) for a in series], dtype=np.float64)
        time_s, value, truth, low, high = with_gaps(*(rows * [1e-9, 1, 1, 1, 1]).T)
        draw_band(panel, time_s, low, high, BLUE, label=BAND)
        panel.plot(time_s, value, ".", color=BLUE, markersize=4, label="measured")
        panel.plot(time_s, truth, "-", color=BLACK, linewidth=1, label="truth")
        panel.set_ylabel(f"{name} (m)")
    panels[0].legend(loc="best")
    panels[-1].set_xlabel("time since the first image (s)")
    figure.suptitle("River widths of the simulated flight")
    save_figure(figure, path, "png")


def report_demo(flight: Path, recording: Recording, out: Path) -> dict[str, Any]:
    """Write ``widths.png``, ``annotated.png``, ``measurements.csv`` and ``.geojson``.

    Args:
        flight: Folder of the simulated flight, with its truth.
        recording: What was recorded of it.
        out: Folder to write to.

    Returns:
        By probe: truth and measurement in one image, and how many of all 95 % intervals hold the truth.
    """
    measured = [json.loads(payload) for payload in recording.measurements()]
    answers = _answers(flight / "truth.jsonl", measured)
    start_ns = min(int(item["stamp_ns"]) for item in measured)
    plot_widths(answers, start_ns, out / "widths.png")
    best = best_image(recording)
    if best is not None:
        cv2.imwrite(str(out / "annotated.png"), cv2.cvtColor(best[1], cv2.COLOR_RGB2BGR))
    for name in ("csv", "geojson"):
        EXPORTERS[name].write(recording, out / f"measurements.{name}", MapCrs.wgs84())
    return {name: _summary(series) for name, series in answers.items()}


def _answers(truth_file: Path, measured: list[dict[str, Any]]) -> dict[str, list[Answer]]:
    with truth_file.open(encoding="utf-8") as lines:
        truths = {(line["name"], int(line["stamp_ns"])): line["value"] for line in map(json.loads, lines)}
    answers: dict[str, list[Answer]] = defaultdict(list)
    for item in measured:
        key = (item["name"], int(item["stamp_ns"]))
        truth = truths.get(key)
        if truth is not None and item["value"] is not None:
            low, high = item["ci95"]
            answers[key[0]].append(Answer(key[0], key[1], truth, item["value"], (low, high)))
    return dict(sorted(answers.items()))


def _summary(series: list[Answer]) -> dict[str, Any]:
    shown = series[len(series) // 2]
    return {
        "truth_m": shown.truth_m,
        "measured_m": shown.value_m,
        "ci95_m": shown.ci95_m,
        "inside": shown.inside,
        "intervals": len(series),
        "intervals_with_truth": sum(answer.inside for answer in series),
    }
