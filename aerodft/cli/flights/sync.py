"""``aerodft sync``: a video and a log in, offset and drift of their clocks and the gimbal's lag out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.table import Table

from aerodft.cli.options import LOG_FORMATS, ConfigOption, JsonOption, TopicOption, parse_topics, parse_utc
from aerodft.cli.output import print_json, progress, say, tables
from aerodft.errors import UsageError, located

if TYPE_CHECKING:
    from aerodft.app.align import VideoAlignment

_NOTABLE_RATIO: Final = 0.01


def sync(
    video: Annotated[Path, typer.Argument(help="Video file.")],
    log: Annotated[Path, typer.Argument(help=f"The flight's log: {LOG_FORMATS}, or an MCAP file with MAVLink.")],
    camera: Annotated[Path | None, typer.Option(help="Camera file (TOML); else the configuration's.")] = None,
    config: ConfigOption = None,
    video_start: Annotated[
        str | None, typer.Option(help="UTC of the video's first image; else the configuration's, or the file's.")
    ] = None,
    max_offset: Annotated[float, typer.Option(help="Seconds by which that may be wrong, either way.")] = 20.0,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder for a plot of both, sync.png.")] = None,
    topic: TopicOption = None,
    json: JsonOption = False,
) -> None:
    r"""Align a video with a log by how the camera turned, and say what to write into the configuration.

    The ground is followed from image to image; how the camera turned is compared with what gimbal and vehicle say.
    Offset and drift (of the video's clock against the log's) and the gimbal's lag come with stds; where the camera
    hardly turns, or moves so regularly that several offsets fit, there is no answer (exit 4).

    \b
    Example:
      aerodft sync flight.mp4 flight.tlog --camera configs/cameras/demo-1080p.toml -o sync
      aerodft sync flight.mp4 flight.tlog --config station.toml --video-start 2026-11-21T10:00:00Z --json
    """
    from aerodft.adapters.config.station import load_station
    from aerodft.app.align import MAX_OFFSET_LIMIT_S, align

    if not 0 < max_offset <= MAX_OFFSET_LIMIT_S:
        expected = f"above 0, at most {MAX_OFFSET_LIMIT_S:g} s"
        raise UsageError("--max-offset", got=f"{max_offset:g}", expected=expected)
    if camera is None and config is None:
        raise UsageError("no camera", expected="--camera FILE or --config FILE")
    station = None if config is None else load_station(config)
    with located(config or ""), progress("following the ground") as followed:
        found = align(
            video,
            log,
            station=station,
            camera=camera,
            video_start_ns=None if video_start is None else parse_utc("--video-start", video_start),
            max_offset_s=max_offset,
            topics=parse_topics(topic, None if station is None else station.topics),
            progress=followed,
        )
    files = []
    if output is not None:
        from aerodft.reports.comparison import draw_alignment

        files.append(str(draw_alignment(found.solution, output)))
    if json:
        print_json(found.to_dict() | {"files": files})
    else:
        _show(found)
    for file in files if not json else ():
        say(f"aerodft: wrote {file}")


def _show(found: "VideoAlignment") -> None:
    """The alignment for a person: a table and the configuration's lines on stdout, the rest on stderr."""
    from aerodft.adapters.timestamps import unix_ns_to_iso

    solution, console = found.solution, tables()
    offset_std_s, drift_std, lag_std_s = solution.stds.tolist()
    table = Table("what", "value", "std", "95 % interval")
    table.add_row("offset", *_cells(solution.offset_s, offset_std_s, 1.0, "s"))
    table.add_row("drift", *_cells(solution.drift, drift_std, 100.0, "%"))
    table.add_row("lag", *_cells(solution.lag_s, lag_std_s, 1.0, "s"))
    table.add_row("offset less lag", *_cells(solution.offset_s - solution.lag_s, solution.attitude_std_s(), 1.0, "s"))
    console.print(table)
    console.print(
        f"A stamp t of the video is t + offset + drift (t - {unix_ns_to_iso(solution.reference_ns)}) in the log's UTC;"
        f" the camera is where {solution.source} said it was the lag before. {next_best(solution.peak_ratio)}",
        soft_wrap=True,
    )
    console.print(f"This is for --video-start {unix_ns_to_iso(found.start_ns)}; the lines for a station's file:")
    console.print(f"\n{found.to_toml()}", soft_wrap=True)
    for sentence in found.reasons:
        say(f"aerodft: {sentence}")


def next_best(peak_ratio: float) -> str:
    """Sentence on how much worse the next best offset fits, by its share of the best one's evidence."""
    if peak_ratio < _NOTABLE_RATIO:
        return "No other offset fits."
    return f"No other offset fits as well: the next best one explains {peak_ratio:.0%} of what this one does."


def _cells(value: float, std: float, scale: float, unit: str) -> tuple[str, str, str]:
    from aerodft.app.align import interval95

    low, high = (scale * end for end in interval95(value, std))
    return f"{scale * value:+.4f} {unit}", f"{scale * std:.4f} {unit}", f"{low:+.4f} ... {high:+.4f} {unit}"
