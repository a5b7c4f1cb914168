"""``aerodft export``: a recording's measurements as tables, maps, one file or a video."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from aerodft.cli.options import JsonOption, OverwriteOption
from aerodft.cli.output import end_with_gaps, print_json, say
from aerodft.errors import UsageError


def export(
    recording: Annotated[
        Path, typer.Argument(metavar="RECORDING|RIVER-FOLDER", help="A recording; or for a map what river wrote.")
    ],
    form: Annotated[
        Literal["csv", "geojson", "gpkg", "kml", "jsonl", "parquet", "mcap", "mp4"] | None,
        typer.Option(
            "--format",
            help="Tables (csv, parquet), maps (gpkg with layers and a QGIS style, kml, geojson), JSON lines (jsonl),"
            " the whole recording as one file (mcap), the recorded images with what was measured in them (mp4). By"
            " default the output's ending, or csv.",
        ),
    ] = None,
    crs: Annotated[
        str | None, typer.Option("--crs", help="Of a GeoPackage or GeoJSON, as EPSG:25832; by default WGS84.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File to write; without it, text goes to stdout.")
    ] = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    r"""Write a recording's measurements as a table or a map, its segments as one file, or its images as a video.

    docs/tables.md says what the columns are. One MCAP file holds all messages by time, and what lies beside the
    segments as attachments. Exit 5 where damaged or missing parts of the recording are not in it.

    \b
    Example:
      aerodft export flights/2026-11-21 -o widths.gpkg --crs EPSG:25832
      aerodft export reach -o river.kml
      aerodft export flights/2026-11-21 --format mp4 -o flight.mp4
    """
    from aerodft.app.recordings import export as export_recording
    from aerodft.app.recordings import export_format, exported_text, open_recording
    from replay.export import TEXT_FORMATS

    chosen = export_format(form, output, crs)
    if output is None and (json or chosen not in TEXT_FORMATS):
        what = "--json" if json else f"--format {chosen}"
        raise UsageError(f"{what} without --output", expected="-o FILE: stdout has room for one document")
    if output == Path("-"):
        raise UsageError("--output", got="-", expected="a file", hint="without --output, text goes to stdout")
    if output is None:
        source = open_recording(recording)
        sys.stdout.writelines(exported_text(source, chosen, crs))
        end_with_gaps(source.reader.left_out())
        return
    summary = export_recording(recording, output, form=chosen, crs=crs, overwrite=overwrite)
    if json:
        print_json(summary.to_dict())
    else:
        contents = ", ".join(f"{count} {what.replace('_', ' ')}" for what, count in summary.counts.items() if count)
        say(f"{output}: {contents}")
    end_with_gaps(summary.left_out)
