"""What ``aerodft sync`` prints: the alignment, its intervals, and the lines for the configuration."""

from typing import Any, Final

from rich.table import Table

from aerodft import __version__
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.cli.output import say, tables
from aerodft.cli.sync_lines import SyncLines
from aerodft.cli.sync_run import SyncRun
from calibration.sync import Alignment

_SIGMAS_95: Final = 1.96
_NOTABLE_RATIO: Final = 0.01


def describe_sync(run: SyncRun, lines: SyncLines, files: list[str]) -> dict[str, Any]:
    """The alignment as a document.

    Args:
        run: The alignment.
        lines: What it makes of the station.
        files: What was written.
    """
    found = run.alignment
    offset_std_s, drift_std, lag_std_s = found.stds.tolist()
    attitude_s = found.offset_s - found.lag_s
    return {
        "schema": "aerodft.sync/1",
        "status": "ok",
        "video": str(run.video),
        "log": str(run.log),
        "video_start": unix_ns_to_iso(run.start_ns),
        "video_start_ns": str(run.start_ns),
        "source": str(found.source),
        "reference": unix_ns_to_iso(found.reference_ns),
        "reference_ns": str(found.reference_ns),
        "offset_s": found.offset_s,
        "offset_std_s": offset_std_s,
        "offset_ci95_s": _interval(found.offset_s, offset_std_s),
        "drift": found.drift,
        "drift_std": drift_std,
        "drift_ci95": _interval(found.drift, drift_std),
        "lag_s": found.lag_s,
        "lag_std_s": lag_std_s,
        "lag_ci95_s": _interval(found.lag_s, lag_std_s),
        "lag_told": found.lag_told,
        "time_constant_s": found.time_constant_s,
        "attitude_offset_s": attitude_s,
        "attitude_offset_std_s": found.attitude_std_s(),
        "attitude_offset_ci95_s": _interval(attitude_s, found.attitude_std_s()),
        "covariance": found.cov.tolist(),
        "peak_ratio": found.peak_ratio,
        "seconds": run.seconds,
        "pairs": run.pairs,
        "reasons": reasons(found),
        "config": lines.text(),
        "files": files,
        "software": f"aerodft {__version__}",
    }


def reasons(found: Alignment) -> list[str]:
    """What to know about the numbers, in sentences."""
    if not found.lag_told:
        sentence = (
            "the data do not tell the gimbal's lag from the clocks' offset: a typical lag is taken, and its uncertainty"
            " is part of the offset's; the camera's attitude is found all the same"
        )
        return [sentence]
    if found.time_constant_s > found.lag_s / 2:
        sentence = (
            f"the camera sets off at once and catches up slowly (time constant {found.time_constant_s:.2f} s): the"
            " delay is the mean, and `lag_s` allows for the rest"
        )
        return [sentence]
    return []


def say_sync(run: SyncRun, lines: SyncLines, files: list[str]) -> None:
    """The alignment for a person: a table and the configuration's lines on stdout, the rest on stderr."""
    found = run.alignment
    table = Table("what", "value", "std", "95 % interval")
    offset_std_s, drift_std, lag_std_s = found.stds.tolist()
    table.add_row("offset", *_cells(found.offset_s, offset_std_s, 1.0, "s"))
    table.add_row("drift", *_cells(found.drift, drift_std, 100.0, "%"))
    table.add_row("lag", *_cells(found.lag_s, lag_std_s, 1.0, "s"))
    table.add_row("offset less lag", *_cells(found.offset_s - found.lag_s, found.attitude_std_s(), 1.0, "s"))
    tables().print(table)
    tables().print(
        f"A stamp t of the video is t + offset + drift (t - {unix_ns_to_iso(found.reference_ns)}) in the log's UTC; the"
        f" camera is where {found.source} said it was the lag before. {next_best(found.peak_ratio)}",
        soft_wrap=True,
    )
    tables().print(f"This is for --video-start {unix_ns_to_iso(run.start_ns)}; the lines for a station's file:")
    tables().print(f"\n{lines.text()}", soft_wrap=True)
    for sentence in reasons(found):
        say(f"aerodft: {sentence}")
    for file in files:
        say(f"aerodft: wrote {file}")


def next_best(peak_ratio: float) -> str:
    """How far any other offset is from fitting as well, by the share of the best one's evidence that it has."""
    if peak_ratio < _NOTABLE_RATIO:
        return "No other offset fits."
    return f"No other offset fits as well: the next best one explains {peak_ratio:.0%} of what this one does."


def _interval(value: float, std: float) -> list[float]:
    return [value - _SIGMAS_95 * std, value + _SIGMAS_95 * std]


def _cells(value: float, std: float, scale: float, unit: str) -> tuple[str, str, str]:
    low, high = (scale * end for end in _interval(value, std))
    return f"{scale * value:+.4f} {unit}", f"{scale * std:.4f} {unit}", f"{low:+.4f} ... {high:+.4f} {unit}"
