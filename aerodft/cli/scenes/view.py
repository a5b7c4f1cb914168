"""``aerodft view``: an image or a recording in the browser, to look, click and measure."""

import threading
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from aerodft.cli.interrupts import wait_in_main_thread
from aerodft.cli.output import say
from aerodft.cli.page_options import HostOption, PortOption, ReadOnlyOption, TilesOption, page_of
from aerodft.cli.scenes.image_options import (
    CameraOption,
    HeadingOption,
    HeightOption,
    LatOption,
    LonOption,
    RollOption,
    StdOption,
    TiltOption,
    parse_stds,
    refuse_beside,
    scene_of_options,
)

if TYPE_CHECKING:
    from aerodft.app.viewing import View


def view(
    source: Annotated[Path, typer.Argument(metavar="RECORDING|IMAGE|VIDEO", help="What to look at.")],
    camera: CameraOption = None,
    height: HeightOption = None,
    tilt: TiltOption = None,
    roll: RollOption = 0.0,
    heading: HeadingOption = 0.0,
    lat: LatOption = None,
    lon: LonOption = None,
    std: StdOption = None,
    calibration: Annotated[Path | None, typer.Option(help="Take pose and lens of a calibration file.")] = None,
    station: Annotated[Path | None, typer.Option(help="Station file that probes are saved into.")] = None,
    host: HostOption = "127.0.0.1",
    port: PortOption = 0,
    read_only: ReadOnlyOption = False,
    tiles: TilesOption = None,
    browser: Annotated[bool, typer.Option("--open", help="Open it in the browser of this machine.")] = False,
) -> None:
    r"""Show an image, a video or a recording as a page: zoom, click, and read distances with their intervals.

    \b
    Example:
      aerodft view demo/recording --open
      aerodft view bridge.jpg --camera camera.toml
      aerodft view bridge.jpg --camera camera.toml --height 10.5 --tilt 67 --std height=0.1,tilt=0.2
    """
    pose: dict[str, Any] = {"height": height, "tilt": tilt, "roll": roll or None, "heading": heading or None}
    pose |= {"lat": lat, "lon": lon, "covariance": None}
    given = pose | {"camera": camera, "calibration": calibration, "std": std}
    shown = _recording(source, given) if source.is_dir() or _is_recording(source) else _fixed(source, given)

    shown.station_file = station
    with (
        suppress(KeyboardInterrupt),
        page_of(shown, host, port, read_only=read_only, tiles=tiles, std_px=parse_stds(std).px) as address,
    ):
        say(f"{shown.title}: open {address} in a browser; stop with Ctrl-C")
        if browser:
            import webbrowser

            webbrowser.open(address)
        wait_in_main_thread(threading.Event())


def _is_recording(source: Path) -> bool:
    from replay.recordings import is_mcap

    return source.exists() and is_mcap(source)


def _recording(source: Path, given: dict[str, Any]) -> "View":
    from aerodft.app.recordings import open_recording
    from aerodft.app.viewing import RecordingView

    refuse_beside(given, "a recording")
    return RecordingView(open_recording(source))


def _fixed(source: Path, given: dict[str, Any]) -> "View":
    from aerodft.adapters.config.camera import load_camera
    from aerodft.app.measure import MeasuredSurface
    from aerodft.app.viewing import FixedCameraView

    pose = {name: value for name, value in given.items() if name not in {"camera", "calibration", "std"}}
    stds = parse_stds(given["std"])
    surface = MeasuredSurface(0.0, stds.elevation_m, None)
    options = {name: str(value) for name, value in given.items() if value is not None}
    if given["camera"] is not None and all(given[name] is None for name in ("height", "tilt", "calibration")):
        refuse_beside(pose, "a pose that is still to be found")
        shown = FixedCameraView(source, load_camera(given["camera"]), None, options, surface)
    else:
        setup, sample = scene_of_options(pose, given["camera"], given["calibration"], given["std"], surface)
        if stds.px is None:
            sample = replace(sample, reasons=(*sample.reasons, "std of pixels assumed: 1 px"))
        shown = FixedCameraView(source, setup.camera, (setup, sample), options, surface)
    shown.pixels(0)  # a video that cannot be decoded is refused before a page opens
    return shown
