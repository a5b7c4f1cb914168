"""The demo's pictures: the last river image with what was measured in it, and widths over time with their band."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np

from aerodft.model.arrays import FloatArray, ImageArray

mpl.use("Agg")
from matplotlib import pyplot as plt

_SILENCE_S = 0.6
_WHITE, _BLACK, _YELLOW = (255, 255, 255), (0, 0, 0), (0, 220, 255)


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


def plot_widths(answers: Mapping[str, Sequence[Answer]], start_ns: int, path: Path) -> None:
    """Width over time with its 95 % band and the truth, one panel a probe, as PNG."""
    figure, panels = plt.subplots(len(answers), 1, sharex=True, figsize=(9, 2.6 * len(answers)), squeeze=False)
    for panel, (name, series) in zip(panels[:, 0], answers.items(), strict=True):
        rows = np.array([(a.stamp_ns - start_ns, a.value_m, a.truth_m, *a.ci95_m) for a in series], dtype=np.float64)
        time_s, value, truth, low, high = _with_breaks(rows * [1e-9, 1, 1, 1, 1]).T
        panel.fill_between(time_s, low, high, alpha=0.3, label="95 % interval")
        panel.plot(time_s, value, ".", markersize=4, label="measured")
        panel.plot(time_s, truth, "k-", linewidth=1, label="truth")
        panel.set_ylabel(f"{name} (m)")
        panel.grid(alpha=0.3)
    panels[0, 0].legend(loc="best", fontsize="small")
    panels[-1, 0].set_xlabel("time since the first image (s)")
    figure.suptitle("River widths of the simulated flight")
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _with_breaks(rows: FloatArray) -> FloatArray:
    """Rows ``(n, m)`` in order of their first column (s), with a NaN row in every silence: no line is drawn there."""
    gaps = np.flatnonzero(np.diff(rows[:, 0]) > _SILENCE_S) + 1
    return np.insert(rows, gaps, np.nan, axis=0)


def draw_measurements(image: ImageArray, measurements: Sequence[dict[str, Any]]) -> ImageArray:
    """The image with the pixels of every measurement, its name, value and interval.

    Args:
        image: ``(h, w, 3)`` uint8 BGR; not changed.
        measurements: Measurements as on the wire.
    """
    canvas = image.copy()
    for item in measurements:
        points = np.rint(np.array(item["pixels"])).astype(int)
        for u, v in points.tolist():
            cv2.drawMarker(canvas, (u, v), _BLACK, cv2.MARKER_CROSS, 22, 5, cv2.LINE_AA)
            cv2.drawMarker(canvas, (u, v), _YELLOW, cv2.MARKER_CROSS, 20, 2, cv2.LINE_AA)
        if len(points) > 1:
            cv2.polylines(canvas, [points.reshape(-1, 1, 2)], isClosed=False, color=_YELLOW, thickness=2)
        _write(canvas, _label(item), points.mean(axis=0))
    return canvas


def _label(item: dict[str, Any]) -> str:
    if item["value"] is None:
        return str(item["name"])
    return f"{item['name']}: {item['value']:.2f} m +- {(item['ci95'][1] - item['ci95'][0]) / 2:.2f}"


def _write(canvas: ImageArray, text: str, near_px: np.ndarray) -> None:
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 1)
    rows, columns = canvas.shape[:2]
    u = int(np.clip(near_px[0] - width / 2, 5, columns - width - 5))
    v = int(np.clip(near_px[1] - 14, height + 5, rows - 8))
    cv2.rectangle(canvas, (u - 4, v - height - 4), (u + width + 4, v + 6), _BLACK, cv2.FILLED)
    cv2.putText(canvas, text, (u, v), cv2.FONT_HERSHEY_SIMPLEX, 0.6, _WHITE, 1, cv2.LINE_AA)
