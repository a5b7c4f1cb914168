"""``aerodft export``, ``plot``, ``report``, ``frames``: a recording as tables, maps, video, figure, page, stills."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from aerodft.cli.options import JsonOption, OverwriteOption, parse_instant
from aerodft.cli.output import end_with_gaps, print_json, say
from aerodft.errors import UsageError


def export(
    recording: Annotated[
        Path, typer.Argument(metavar="RECORDING|RIVER-FOLDER", help="A recording; or for a map what river wrote.")
    ],
    form: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="<name>",
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
    from aerodft.app.recordings import choose_exporter, exported_text, open_recording
    from aerodft.app.recordings import export as export_recording

    exporter = choose_exporter(form, output, crs)
    if output is None and (json or not exporter.is_text):
        what = "--json" if json else f"--format {exporter.name}"
        raise UsageError(f"{what} without --output", expected="-o FILE: stdout has room for one document")
    if output == Path("-"):
        raise UsageError("--output", got="-", expected="a file", hint="without --output, text goes to stdout")
    if output is None:
        source = open_recording(recording)
        sys.stdout.writelines(exported_text(source, exporter, crs))
        end_with_gaps(source.reader.left_out())
        return
    summary = export_recording(recording, output, form=form, crs=crs, overwrite=overwrite)
    if json:
        print_json(summary.to_dict())
    else:
        contents = ", ".join(f"{count} {what.replace('_', ' ')}" for what, count in summary.counts.items() if count)
        say(f"{output}: {contents}")
    end_with_gaps(summary.left_out)


def plot(
    recording: Annotated[Path, typer.Argument(help="The recording.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Figure to write: .png, .svg or .pdf.")],
    probe: Annotated[
        list[str] | None, typer.Option("--probe", help="Name of a probe to draw; may be repeated. By default all.")
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    r"""Draw values with 95 % intervals over time and along the river, heights by source, tilt, statuses and events.

    \b
    Example:
      aerodft plot recordings/flight -o flight.png
      aerodft plot recordings/flight --probe bridge -o bridge.pdf
    """
    from aerodft.app.recordings import open_recording

    opened = open_recording(recording)
    drawn = opened.plot(output, probe or (), overwrite=overwrite)
    say(f"{output}: {', '.join(drawn) or 'no probes'}, height, tilt and events")
    end_with_gaps(opened.reader.left_out())


def report(
    what: Annotated[
        Path, typer.Argument(metavar="RECORDING|RIVER-FOLDER", help="A recording, or the folder that river wrote.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The page to write: HTML in one file.")],
    overwrite: OverwriteOption = False,
) -> None:
    r"""Write one page: what was measured and how surely, picture, map, plots, table, assumptions, files and hashes.

    It opens in any browser without network, and prints on A4. Exit 5 where parts of the recording are missing.

    \b
    Example:
      aerodft report recordings/flight -o flight.html
      aerodft report reach -o river.html
    """
    from aerodft.app.recordings import open_recording
    from aerodft.app.recordings import report as write_report
    from aerodft.reports.river_folder import is_river_folder

    recording = None if is_river_folder(what) else open_recording(what)
    say(f"{write_report(recording or what, output, overwrite=overwrite)}: open it in a browser")
    if recording is not None:
        end_with_gaps(recording.reader.left_out(images=True))


def frames(
    source: Annotated[Path, typer.Argument(metavar="RECORDING|VIDEO|PHOTO", help="Where the images are.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the PNG files.")],
    at: Annotated[
        list[str] | None, typer.Option(help="Seconds from the first image, UTC ns, or ISO 8601; may be repeated.")
    ] = None,
    every: Annotated[float | None, typer.Option(help="Instead: an image every so many seconds.")] = None,
    overlay: Annotated[bool, typer.Option("--overlay", help="Draw values, intervals and statuses in.")] = False,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    r"""Write the images nearest to some instants as PNG, pixel for pixel, or with what was measured drawn in.

    \b
    Example:
      aerodft frames flight.mp4 --at 12.5 --at 30 -o stills
      aerodft frames recordings/flight --every 10 --overlay -o stills
    """
    from aerodft.app.frames import open_reel, write_stills

    reel = open_reel(source)
    stills = write_stills(
        reel,
        output,
        at_ns=[parse_instant("--at", text, reel.zero_ns) for text in at or ()],
        every_s=every,
        with_overlay=overlay,
        overwrite=overwrite,
    )
    if json:
        print_json([asdict(each) | {"path": str(each.path), "stamp_ns": str(each.stamp_ns)} for each in stills])
        return
    for each in stills:
        say(f"{each.path}: image {each.image}, at {each.seconds:.3f} s")
