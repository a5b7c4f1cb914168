"""``aerodft view``: an image or a recording in the browser, to look, click and measure."""

import threading
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aerodft.cli.interrupts import wait_in_main_thread
from aerodft.cli.options import PageOptions, grouped
from aerodft.cli.output import say
from aerodft.cli.scenes.image_options import PoseOptions, given_options, refuse_beside

if TYPE_CHECKING:
    from aerodft.app.viewing import View


@grouped
def view(
    source: Annotated[Path, typer.Argument(metavar="RECORDING|IMAGE|VIDEO", help="What to look at.")],
    scene: PoseOptions,
    page: PageOptions,
    home_above_plane: Annotated[
        float | None, typer.Option(help="Of a drone's photograph: height of the take-off point above the water, m.")
    ] = None,
    station: Annotated[Path | None, typer.Option(help="Station file that probes are saved into.")] = None,
    browser: Annotated[bool, typer.Option("--open", help="Open it in the browser of this machine.")] = False,
) -> None:
    r"""Show an image, a video or a recording as a page: zoom, click, and read distances with their intervals.

    \b
    Example:
      aerodft view demo/recording --open
      aerodft view DJI_0024.JPG --home-above-plane 1.5
      aerodft view bridge.jpg --camera camera.toml
      aerodft view bridge.jpg --camera camera.toml --height 10.5 --tilt 67 --std height=0.1,tilt=0.2
    """
    from replay.recordings import is_mcap

    is_recording = source.is_dir() or (source.exists() and is_mcap(source))
    if is_recording:
        refuse_beside({"home-above-plane": home_above_plane}, "a recording")
    shown = _recording(source, scene) if is_recording else _fixed(source, scene, home_above_plane)

    shown.station_file, shown.std_px = station, scene.stds.px
    with suppress(KeyboardInterrupt), page.page_of(shown) as address:
        say(f"{shown.title}: open {address} in a browser; stop with Ctrl-C")
        if browser:
            import webbrowser

            webbrowser.open(address)
        wait_in_main_thread(threading.Event())


def _recording(source: Path, scene: PoseOptions) -> "View":
    from aerodft.app.recordings import open_recording
    from aerodft.app.viewing import RecordingView

    refuse_beside(given_options(scene), "a recording")
    return RecordingView(open_recording(source))


def _fixed(source: Path, scene: PoseOptions, home_above_plane_m: float | None) -> "View":
    from aerodft.adapters.config.camera import load_camera
    from aerodft.adapters.images import STILLS
    from aerodft.app.measure import carries_pose
    from aerodft.app.viewing import PHOTOGRAPH, FixedCameraView

    named = given_options(scene).items()  # files by paths that hold anywhere, for command lines that people copy
    options = {name: str(value.absolute() if isinstance(value, Path) else value) for name, value in named}
    photo = source if source.suffix.lower() in STILLS and carries_pose(source) else None
    if photo is not None:
        options |= {PHOTOGRAPH: str(photo.absolute())}
        options |= {} if home_above_plane_m is None else {"home_above_plane": str(home_above_plane_m)}
    if photo is None and scene.camera is not None and not {"height", "tilt", "calibration"} & options.keys():
        refuse_beside(scene.stated_pose(), "a pose that is still to be found")
        shown = FixedCameraView(source, load_camera(scene.camera), None, options, scene.surface)
    else:
        found = scene.scene(photo=photo, home_above_plane_m=home_above_plane_m)
        shown = FixedCameraView(source, found[0].camera, found, options, scene.surface)
    shown.pixels(0)  # a video that cannot be decoded is refused before a page opens
    return shown
