"""What ``aerodft sync`` prints: the alignment, its intervals, and the lines for the configuration."""

import math
from typing import Any, Final

from rich.table import Table

from aerodft import __version__
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.cli.output import say, tables
from aerodft.cli.sync_run import SyncRun
from calibration.sync import Alignment

_SIGMAS_95: Final = 1.96
_NOTABLE_RATIO: Final = 0.01


def describe_sync(run: SyncRun, files: list[str]) -> dict[str, Any]:
    """The alignment as a document.

    Args:
        run: The alignment.
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
        "config": config_text(run),
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


def config_text(run: SyncRun) -> str:
    """The lines of a station's file that say what was found."""
    found = run.alignment
    worst_s = max(found.attitude_std_s(run.seconds / 2), found.attitude_std_s(-run.seconds / 2))
    return (
        "[images]\n"
        f"time_offset_s = {found.offset_s:.6f}\n"
        f"time_drift = {found.drift:.8f}\n"
        f'time_reference = "{unix_ns_to_iso(found.reference_ns)}"\n'
        f"time_std_s = {math.ceil(worst_s * 1e4) / 1e4:g}\n"
        "\n"
        "[telemetry.attitude]\n"
        f"delay_s = {max(found.lag_s, 0.0):.4f}\n"
    ) + (f"lag_s = {found.lateness_s:.4f}\n" if found.lag_told else "")


def say_sync(run: SyncRun, files: list[str]) -> None:
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
    tables().print(f"\n{config_text(run)}", soft_wrap=True)
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
