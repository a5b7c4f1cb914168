"""What the demo measured against what the simulator knows."""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
from rich.console import Console
from rich.table import Table

from aerodft.cli.demo_plots import Answer, draw_measurements, plot_widths
from aerodft.model.image import Image
from replay.export import ExportFormat, export_text
from replay.recording import Recording
from replay.source import RecordingSource


def report_demo(flight: Path, recording: Recording, out: Path) -> dict[str, Any]:
    """Write pictures, CSV and GeoJSON to ``out``, print the table, and return it as a document."""
    measured = [json.loads(payload) for payload in recording.measurements()]
    answers = _answers(flight / "truth.jsonl", measured)
    _print_table(answers)
    start_ns = min(int(item["stamp_ns"]) for item in measured)
    plot_widths(answers, start_ns, out / "widths.png")
    _annotate(recording, measured, out / "annotated.png")
    for form, name in ((ExportFormat.CSV, "measurements.csv"), (ExportFormat.GEOJSON, "measurements.geojson")):
        (out / name).write_text("".join(export_text(recording.measurements(), form)), encoding="utf-8")
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


def _print_table(answers: dict[str, list[Answer]]) -> None:
    table = Table("probe", "truth", "measured", "95 % interval", "inside?", "of all intervals", title="One image each")
    for name, series in answers.items():
        row = _summary(series)
        low, high = row["ci95_m"]
        table.add_row(
            name,
            f"{row['truth_m']:.2f} m",
            f"{row['measured_m']:.2f} m",
            f"{low:.2f} ... {high:.2f} m",
            "yes" if row["inside"] else "no",
            f"{row['intervals_with_truth']} of {row['intervals']} hold the truth",
        )
    Console().print(table)


def _annotate(recording: Recording, measured: list[dict[str, Any]], path: Path) -> None:
    """Draw the image with the most answers, the later the better."""
    by_image: dict[int, list[dict[str, Any]]] = defaultdict(list)
    for item in measured:
        if item["value"] is not None and item["image"] is not None:
            by_image[item["image"]].append(item)
    best: Image | None = None
    for event in RecordingSource(recording, pixels=True).events():
        if isinstance(event, Image) and event.pixels is not None:
            rank = len(by_image[event.index])
            if best is None or rank >= len(by_image[best.index]):
                best = event
    if best is not None and best.pixels is not None:
        cv2.imwrite(str(path), draw_measurements(best.pixels(), by_image[best.index]))
