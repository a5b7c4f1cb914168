"""``aerodft cameras``: the library of cameras that many people have, and their camera files."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from aerodft.cli.options import JsonOption
from aerodft.cli.output import print_json, say, tables
from aerodft.errors import UsageError

if TYPE_CHECKING:
    from aerodft.adapters.config.camera import KnownCamera


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
            raise UsageError("--output", got=f"{len(found)} cameras: {names}", expected="one, by more of its name")
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
