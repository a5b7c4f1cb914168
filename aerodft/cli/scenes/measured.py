"""What ``aerodft measure`` measures, as it is printed: one model's numbers, or both models' side by side."""

import math
from collections.abc import Sequence
from itertools import zip_longest
from typing import Any

import typer
from rich.table import Table

from aerodft.adapters.wire.measurement import measurement_payload
from aerodft.app.measure import measured_document
from aerodft.cli.output import print_json, say, tables
from aerodft.dft import Request, Setup, Share, advice, measure
from aerodft.dft import explain as explain_request
from aerodft.dft.paper import ModelDifference, compare_models
from aerodft.geometry import camera_angles
from aerodft.model import FloatArray, Measurement, PoseBatch, PoseSample, Status


def show_measurements(
    setup: Setup, sample: PoseSample, requests: tuple[Request, ...], *, explain: bool, as_json: bool
) -> None:
    """Measure and print; to explain, also where each uncertainty comes from.

    Raises:
        typer.Exit: With 3 for a pixel outside the image, with 4 where nothing was measured.
    """
    measurements = measure(setup, PoseBatch.from_samples([sample]), requests)[0]
    budgets = [explain_request(setup, sample, request) for request in requests] if explain else []
    if as_json:
        print_json([measured_document(*each) for each in zip_longest(measurements, budgets)])
    else:
        _print_measurements(measurements, budgets)
    _finish(measurements)


def _finish(measurements: list[Measurement]) -> None:
    statuses = {measurement.status for measurement in measurements}
    bad = [measurement for measurement in measurements if measurement.status is not Status.OK]
    for sentence in dict.fromkeys(f"{item.name}: {item.status}: {'; '.join(item.reasons)}" for item in bad):
        say(f"aerodft: {sentence}")
    if Status.OUT_OF_IMAGE in statuses:
        raise typer.Exit(3)
    if Status.OK not in statuses:
        raise typer.Exit(4)


def _print_measurements(measurements: list[Measurement], budgets: list[tuple[Share, ...]]) -> None:
    """A table, and of each budget a table with the largest part of an uncertainty first, and what to improve."""
    table = Table("probe", "kind", "value", "95 % interval", "ground X, Y (m)", "status")
    for item in measurements:
        value = "" if item.value is None else f"{item.value:.3f} {item.unit}"
        interval = "" if item.ci95 is None else f"{item.ci95[0]:.3f} ... {item.ci95[1]:.3f}"
        if item.ellipse95 is not None:
            interval = f"ellipse {item.ellipse95.semi_major_m:.3f} x {item.ellipse95.semi_minor_m:.3f} m"
        ground = "; ".join(f"{x:.2f}, {y:.2f}" for x, y, _ in item.ground_m or ())
        status = str(item.status) if item.status is Status.OK else f"{item.status}: {'; '.join(item.reasons)}"
        table.add_row(item.name, item.kind, value, interval, ground, status)
    console = tables()
    console.print(table)
    answered = [item for item in measurements if item.status is Status.OK]
    for reason in dict.fromkeys(reason for item in answered for reason in item.reasons):
        console.print(reason, soft_wrap=True, markup=False)
    for item, budget in zip(measurements, budgets, strict=False):
        if not budget:
            console.print(f"{item.name}: no single number whose uncertainty could be divided", soft_wrap=True)
            continue
        shares = Table("from", "share of the variance", "part (one std)", title=item.name, title_justify="left")
        for part in budget:
            shares.add_row(part.source, f"{100 * part.share:.0f} %", f"{part.std:.3g} {item.unit}")
        console.print(shares)
        console.print(f"{item.name}: {advice(budget)}", soft_wrap=True)


def show_models(setup: Setup, sample: PoseSample, requests: tuple[Request, ...], *, as_json: bool) -> None:
    """Measure under both models, and print the comparison; raises as ``show_measurements`` does."""
    differences = compare_models(setup, sample, requests)
    if as_json:
        document = {
            "pinhole": [measurement_payload(item.pinhole) for item in differences],
            "dft": [measurement_payload(item.dft) for item in differences],
            "difference": [_difference(item) for item in differences],
        }
        print_json(document)
    else:
        _print_models(differences, sample)
    _finish([measurement for item in differences for measurement in (item.pinhole, item.dft)])


def _print_models(differences: Sequence[ModelDifference], sample: PoseSample) -> None:
    """A table, and a sentence on what Eq. 5 does at this tilt."""
    table = Table("probe", "", "pinhole", "dft", "difference", "%", "by Eq. 5 (m)", "by angles (m)")
    for item in differences:
        _add(table, item)
    console = tables()
    console.print(table)
    if sample.pose is None:
        return
    tilt_rad, _, _ = camera_angles(sample.pose.wxyz)
    console.print(
        f"In the image's middle, at a tilt of {math.degrees(tilt_rad):.1f} deg, Eq. 5 gives"
        f" {math.sin(tilt_rad):.2f} of the true X; the rest is the paper's angles, linear in pixels."
    )


def _difference(item: ModelDifference) -> dict[str, Any]:
    apart, percent = _apart(item)
    return {
        "name": item.pinhole.name,
        "kind": item.pinhole.kind,
        "value": item.value,
        "unit": item.pinhole.unit,
        "percent": item.percent,
        "ground_m": _listed(item.ground_m),
        "apart_m": apart,
        "apart_percent_of_range": percent,
        "equation_5_m": _listed(item.equation_5_m),
        "angles_m": _listed(item.angles_m),
    }


def _listed(values: FloatArray | None) -> list[Any] | None:
    return None if values is None else values.tolist()


def _apart(item: ModelDifference) -> tuple[list[float] | None, list[float] | None]:
    """Distances between both models' ground points, in m and in percent of the pinhole's slant range."""
    if item.ground_m is None or item.pinhole.range_m is None:
        return None, None
    apart = [math.hypot(*row) for row in item.ground_m.tolist()]
    return apart, [100 * m / away for m, away in zip(apart, item.pinhole.range_m, strict=True)]


def _add(table: Table, item: ModelDifference) -> None:
    pinhole, dft = item.pinhole, item.dft
    if pinhole.value is not None or item.ground_m is None:
        values = [str(m.status) if m.value is None else f"{m.value:.3f} {m.unit}" for m in (pinhole, dft)]
        table.add_row(pinhole.name, pinhole.kind, *values, _signed(item.value), _signed(item.percent, 1))
    if item.ground_m is None or pinhole.ground_m is None or dft.ground_m is None:
        return
    _, percents = _apart(item)
    for index, shift in enumerate(item.ground_m.tolist()):
        for axis, letter in enumerate("XY"):
            first = index == axis == 0 and pinhole.value is None
            table.add_row(
                pinhole.name if first else "",
                f"{letter} {index} (m)",
                f"{pinhole.ground_m[index][axis]:.3f}",
                f"{dft.ground_m[index][axis]:.3f}",
                _signed(shift[axis]),
                "" if percents is None or axis else f"{percents[index]:.1f} of range",
                "" if item.equation_5_m is None or axis else _signed(float(item.equation_5_m[index])),
                "" if item.angles_m is None else _signed(float(item.angles_m[index, axis])),
            )


def _signed(number: float | None, digits: int = 3) -> str:
    return "" if number is None else f"{number:+.{digits}f}"
