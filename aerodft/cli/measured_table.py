"""Measurements as a table on stdout, and where the uncertainty of one comes from."""

from collections.abc import Iterable, Sequence

from rich.table import Table

from aerodft.cli.output import tables
from aerodft.dft.budget import Share, advice
from aerodft.model.measurement import Measurement
from aerodft.model.status import Status


def print_measurements(measurements: Iterable[Measurement]) -> None:
    """A table on stdout."""
    table = Table("probe", "kind", "value", "95 % interval", "ground X, Y (m)", "status")
    for item in measurements:
        value = "" if item.value is None else f"{item.value:.3f} {item.unit}"
        interval = "" if item.ci95 is None else f"{item.ci95[0]:.3f} ... {item.ci95[1]:.3f}"
        if item.ellipse95 is not None:
            interval = f"ellipse {item.ellipse95.semi_major_m:.3f} x {item.ellipse95.semi_minor_m:.3f} m"
        ground = "; ".join(f"{x:.2f}, {y:.2f}" for x, y, _ in item.ground_m or ())
        status = str(item.status) if item.status is Status.OK else f"{item.status}: {'; '.join(item.reasons)}"
        table.add_row(item.name, item.kind, value, interval, ground, status)
    tables().print(table)


def print_budget(measurement: Measurement, budget: Sequence[Share]) -> None:
    """Where one measurement's uncertainty comes from, the largest part first, on stdout."""
    parts = ", ".join(f"{part.source} {100 * part.share:.0f} % ({part.std:.3g} {measurement.unit})" for part in budget)
    sentence = f"{parts}. {advice(tuple(budget))}" if budget else "no single number whose uncertainty could be divided"
    tables().print(f"{measurement.name}: {sentence}", soft_wrap=True)
