"""What a run says when it is over: what was recorded and measured, and what was lost."""

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import typer

from aerodft.cli.output import LOSS, end_with_gaps, print_json, say
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError, Reason

if TYPE_CHECKING:
    from aerodft.app.assembly import RunResult, RunStatistics
    from aerodft.model import CameraMotionEstimate


def report(
    result: "RunResult",
    *,
    as_json: bool,
    live: bool = False,
    details: Mapping[str, object] | None = None,
) -> None:
    """Say what a run recorded and measured.

    Args:
        result: What it did.
        as_json: Print a JSON document as well.
        live: Whether it may have ended before its first image.
        details: What else the document says; None for what became of looking at the images.

    Raises:
        NoAnswerError: Not one pose had an answer, or there was no image.
        Exit: With 5, where the recording is incomplete, or what it was made of.
    """
    totals, statistics = result.totals, result.statistics
    warnings = (*result.warnings, *statistics.pitches.sentences())
    if as_json:
        document = {
            "recording": str(result.recording),
            "images": statistics.images,
            "unmeasured": dict(result.unmeasured),
            "poses": dict(statistics.poses),
            "measurements": dict(statistics.measurements),
            "reasons": statistics.reasons,
            "warnings": warnings,
            **result.left_out.document(),
            "lost": result.lost,
            "recorded": totals.counts,
        }
        print_json({**document, **_calibrated(statistics), **(result.observers if details is None else details)})
    for sentence in warnings:
        say(f"aerodft: {sentence}")
    _say_statistics(result)
    if result.lost:
        why = "could not be written" if totals.lost else "came faster than they could be written"
        say(f"aerodft: {result.recording}: {result.lost} messages are not in the recording: they {why}")
    if live and not statistics.poses:
        say("nothing was measured: no image came")
    elif not statistics.poses.get("ok"):
        got = ", then ".join(f"{status} ({why})" for status, why in statistics.reasons.items()) or "no image came"
        hint = "the recording is kept"
        raise NoAnswerError("no image has a usable pose", where=result.recording, got=Reason(got), hint=hint)
    end_with_gaps(result.left_out)
    if result.lost:
        raise typer.Exit(LOSS)


def _calibrated(statistics: "RunStatistics") -> dict[str, object]:
    """Lines on landmarks, and on the motion of a watched camera, where the station has any."""
    found: dict[str, object] = {}
    if (last := statistics.estimate) is not None:
        found["landmarks"] = {"used": last.updates, "refused": last.refused, "restarts": last.restarts}
    if statistics.camera_motion is not None:
        found["steadiness"] = _camera_motion_document(statistics.camera_motion)
    return found


def _say_statistics(result: "RunResult") -> None:
    statistics, counts = result.statistics, result.counts
    say(f"recording: {result.recording}; {statistics.images} images; poses: {_listed(statistics.poses)}")
    if any(result.unmeasured.values()):
        say(f"images that were never measured: {_listed({why: n for why, n in result.unmeasured.items() if n})}")
    say(f"measurements: {_listed(statistics.measurements)}")
    if statistics.estimate is not None:
        say(f"landmarks: {statistics.estimate.updates} used, {statistics.estimate.refused} refused")
    if statistics.camera_motion is not None:
        say(f"camera: {_camera_motion_sentence(statistics.camera_motion)}")
    for count, why in (
        (counts.unknown_probe, "name a probe that the configuration does not observe"),
        (
            counts.wrong_pixel_count,
            "do not have the pixels that their probe takes, or an outline that it can be measured by",
        ),
    ):
        if count:
            say(f"{count} observations {why}; they are recorded")


def _listed(counter: dict[str, int]) -> str:
    return ", ".join(f"{number} {status}" for status, number in counter.items()) or "none"


def _camera_motion_document(estimate: "CameraMotionEstimate") -> dict[str, object]:
    """The camera's motion at the end of a run, for its summary."""
    return {
        "state": estimate.state,
        "since": _utc(estimate.since_ns),
        "turned_deg": _turned_deg(estimate),
        "moved_since": None if estimate.moved_ns is None else _utc(estimate.moved_ns),
        "points": estimate.points,
    }


def _camera_motion_sentence(estimate: "CameraMotionEstimate") -> str:
    """Whether a watched camera still looks where it looked, for people."""
    said = f"{estimate.state} since {_utc(estimate.since_ns)}"
    if estimate.moved_ns is not None:
        return f"{said}; turned by {_turned_deg(estimate):.2f} deg at {_utc(estimate.moved_ns)}"
    return f"{said}; turned by {_turned_deg(estimate):.3f} deg, within the limit"


def _turned_deg(estimate: "CameraMotionEstimate") -> float:
    return math.degrees(math.hypot(*estimate.turn_rad))


def _utc(stamp_ns: int) -> str:
    return f"{datetime.fromtimestamp(stamp_ns // SECOND_NS, UTC):%Y-%m-%dT%H:%M:%SZ}"
