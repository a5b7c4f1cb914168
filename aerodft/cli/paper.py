"""``aerodft paper``: the paper's tables and figures, beside what it prints."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from aerodft.cli.options import JsonOption
from aerodft.cli.output import print_json, say, tables


def paper(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the figures.")] = Path("paper"),
    json: JsonOption = False,
) -> None:
    r"""Compute Tables 1 to 3 of the Depth-from-Triangulation paper and draw its Figures 12 and 14.

    Every difference from what the paper prints is shown and explained.

    \b
    Example:
      aerodft paper -o paper
    """
    from aerodft.reports.paper import reproduce_paper

    document = reproduce_paper(output)
    if json:
        print_json(document)
    else:
        _print(document)
    say(f"drew {document['figure12']['png']} and {document['figure14']['png']}")


def _print(document: dict[str, Any]) -> None:
    console = tables()
    for key, title, make in (
        ("table1", "Table 1: cameras 10 m high, pitch (deg) for a greatest depth of 150 m", _table_1),
        ("table2", "Table 2: depths, Canon 1000D 10.48 m high at 67.0 deg", _table_2),
        ("table3", "Table 3: errors in percent of the camera height", _table_3),
    ):
        table = make(document[key]["rows"])
        table.title, table.title_justify = title, "left"
        console.print(table)
        _notes(console, document[key]["notes"])
    for name, key in (("Figure 12", "figure12"), ("Figure 14", "figure14")):
        console.print(f"{name}: {document[key]['png']}", style="bold", soft_wrap=True)
        _notes(console, document[key]["notes"])


def _notes(console: Console, notes: Sequence[str]) -> None:
    for note in notes:
        console.print(f"- {note}")
    console.print()


def _table_1(rows: Sequence[dict[str, Any]]) -> Table:
    table = Table(
        "camera",
        "pitch\nprinted",
        "for\nZ = 150 m",
        "for\nY = 150 m",
        "depth at printed pitch\nmiddle / corner (m)",
        "error at 150 m\nthe text says (m)",
        "computed\n(m)",
    )
    for row in rows:
        text = row["text_error_at_150_m"]
        table.add_row(
            f"{row['label']} {row['camera']}",
            f"{row['printed_pitch_deg']:.1f}",
            f"{row['pitch_for_z_150_deg']:.2f}",
            f"{row['pitch_for_y_150_deg']:.2f}",
            f"{row['depth_at_printed_pitch_m']:.1f} / {row['corner_depth_at_printed_pitch_m']:.1f}",
            "" if text is None else _range(*text),
            f"{row['error_at_150_m']:.2f}",
        )
    return table


def _range(low: float, high: float) -> str:
    if low == high:
        return f"{high:.1f}"
    return f"{low:.1f} - {high:.1f}" if low else f"below {high:.1f}"


def _table_2(rows: Sequence[dict[str, Any]]) -> Table:
    table = Table(
        "case",
        "truth\n(m)",
        "printed\nestimate (m)",
        "psi\n(deg)",
        "row\n(px)",
        "at whole\nrow (m)",
        "error: printed\n(m, %)",
        "computed\n(m, %)",
        "quanti-\nzation (m)",
        "error\n(px)",
        "pitch\n(deg)",
        "pinhole\n(m)",
    )
    for row in rows:
        table.add_row(
            f"{row['case']}",
            f"{row['truth_m']:.2f}",
            f"{row['printed_depth_m']:.2f}",
            f"{row['psi_deg']:.3f}",
            f"{row['row_px']:.1f}",
            f"{row['depth_at_whole_row_m']:.2f}",
            f"{row['printed_error_m']:.2f}, {row['printed_error_percent']:.2f}",
            f"{row['error_m']:.2f}, {row['error_percent']:.2f}",
            f"{row['quantization_m']:.3f}",
            f"{row['error_px']:.0f}",
            f"+{row['pitch_error_deg']:.2f}",
            f"{row['pinhole_depth_m']:.2f}",
        )
    return table


def _table_3(rows: Sequence[dict[str, Any]]) -> Table:
    table = Table("input", "error", "psi, phi (deg)", "X: derivative\n(change)", "Y", "Z")
    for row in rows:
        printed, holds = row["printed_percent"], row["holds_at"]
        table.add_row(row["input"], row["error"], "printed", *(f"{printed[axis]:.2f}" for axis in "XYZ"))
        shift = f"dpsi {row['delta_psi_deg']:.1f}, dphi {row['delta_phi_deg']:.1f}"
        where = f"{holds['psi_deg']:.0f}, {holds['phi_deg']:.0f}: printed X, Y hold"
        table.add_row("", shift, where, *_percents(holds))
        for true in row["true"]:
            table.add_row("", "", f"{true['psi_deg']:.0f}, {true['phi_deg']:.1f}", *_percents(true))
        table.add_section()
    return table


def _percents(direction: dict[str, Any]) -> list[str]:
    derivative, change = direction["derivative_percent"], direction["change_percent"]
    return [f"{derivative[axis]:.2f} ({change[axis]:.2f})" for axis in "XYZ"]
