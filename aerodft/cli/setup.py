"""``aerodft init`` and ``cameras``: first station and camera files, for what one has or out of the library."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from aerodft.cli.options import JsonOption, OverwriteOption, as_typed
from aerodft.cli.output import print_json, say, tables
from aerodft.errors import UsageError, counted

if TYPE_CHECKING:
    from aerodft.adapters.config.camera import KnownCamera
    from aerodft.app.setup import StationDraft


def init(
    sources: Annotated[
        list[str] | None, typer.Argument(metavar="SOURCES...", help="A log or link; a video, photo, folder or stream.")
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for station.toml and camera.toml.")] = Path(),
    camera: Annotated[str | None, typer.Option(help="Camera file, or a name out of `aerodft cameras`.")] = None,
    home_above_plane: Annotated[
        float | None, typer.Option(help="Height of the take-off point above the water, m.")
    ] = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    r"""Write station.toml and camera.toml for what you have, commented, and say what you must still measure.

    On a terminal it asks for the height of the take-off point above the water; elsewhere it says what it assumes.

    \b
    Example:
      aerodft init flight.tlog flight.mp4 --camera "Mini 4 Pro" -o mine
      aerodft init rtsp://192.168.1.10/stream -o yard
    """
    from aerodft.app.setup import draft_station

    if home_above_plane is None and sys.stdin.isatty() and sys.stderr.isatty() and not json:
        text = "Height of the take-off point above the water in metres (Enter: not known yet)"
        answer = typer.prompt(text, default="", show_default=False, err=True)
        home_above_plane = float(answer) if answer.replace(".", "", 1).lstrip("-").isdigit() else None
    draft = draft_station(
        sources or (), output, camera=camera, home_above_plane_m=home_above_plane, overwrite=overwrite
    )
    if json:
        print_json(
            {
                "station": str(draft.station),
                "camera": str(draft.camera),
                "taken": draft.taken,
                "to_do": [as_typed(each) for each in draft.to_do],
                "next_command": _next_command(draft),
            }
        )
        return
    console = tables()
    console.print(f"wrote {draft.station} (camera: {draft.camera})", soft_wrap=True)
    for each in draft.taken:
        console.print(f"  {as_typed(each)}", soft_wrap=True)
    for number, each in enumerate(draft.to_do, start=1):
        console.print(f"{number}. {as_typed(each)}", soft_wrap=True)
    say(f"next: {_next_command(draft)}")


def _next_command(draft: "StationDraft") -> str:
    if draft.is_live:
        return f"aerodft serve {draft.station}"
    if draft.view is not None:
        return f"aerodft view {draft.view} --camera {draft.camera} --open"
    log = "".join(f"{each} " for each in (draft.log, *draft.later) if each is not None)
    sync = "--sync auto " if draft.needs_sync else ""
    return f"aerodft import {log}--config {draft.station} {sync}-o {draft.station.parent / 'recording'}"


def cameras(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME|IMAGE|VIDEO", help="Part of a name, or an image whose EXIF data tell.")
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Camera file of the one found (TOML).")] = None,
    json: JsonOption = False,
) -> None:
    r"""List the cameras of the library, or those of a name or an image, and write a camera file.

    Focal lengths are from public facts, with a standard deviation of 1.5 to 6 %; `--json` names the sources.

    \b
    Example:
      aerodft cameras
      aerodft cameras "Mavic 3 Enterprise photo" -o camera.toml
    """
    from aerodft.app.setup import find_cameras, write_camera

    found = find_cameras(name)
    if output is not None:
        if len(found) > 1:
            names = "; ".join(each.camera.name for each in found[:6])
            raise UsageError(
                "--output", got=f"{counted(len(found), 'camera')}: {names}", expected="one, by more of its name"
            )
        write_camera(found[0], output)
        say(f"aerodft: wrote {output}: {found[0].camera.name}")
    if json:
        print_json([_document(each) for each in found])
    elif output is None:
        table = Table("camera", "mode", "size, px", "focal, px", "std")
        for each in found:
            row = _document(each)
            size, focal = f"{row['width_px']} x {row['height_px']}", f"{row['fx_px']:.0f}"
            std = f"{row['std_percent']:.1f} %"
            table.add_row(each.name, each.kind, size, focal, std)
        tables().print(table)


def _document(known: "KnownCamera") -> dict[str, str | float | None]:
    camera = known.camera
    return {
        "name": known.name,
        "device": None if camera.mode is None else camera.mode.device,
        "kind": known.kind,
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "fx_px": camera.fx_px,
        "std_percent": round(100 * camera.std.focal_px / camera.fx_px, 2),
        "known_from": known.known_from,
        "source": known.source,
    }
