"""What a run says when it is over: what was recorded and measured, and what was lost."""

import math
from collections.abc import Mapping
from datetime import UTC, datetime

import typer

from aerodft.adapters.recording.write import RecordingTotals
from aerodft.app.assembly import RunStatistics
from aerodft.cli.output import LOSS, end_with_gaps, print_json, say
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError
from aerodft.model import CameraMotionEstimate
from aerodft.service import Counts


def report(
    totals: RecordingTotals,
    statistics: RunStatistics,
    counts: Counts,
    *,
    as_json: bool,
    warnings: tuple[str, ...] = (),
    live: bool = False,
    seen: Mapping[str, object] | None = None,
    left_out: Mapping[str, int] | None = None,
) -> None:
    """Say what a run made.

    Args:
        totals: What was recorded.
        statistics: What was measured.
        counts: How many observations could not be used.
        as_json: Print a JSON document as well.
        warnings: What was wrong with the input, one sentence each.
        live: Whether it may have ended before its first image.
        seen: What became of looking at the images, where somebody did.
        left_out: What of the input could not be read, by what it is.

    Raises:
        NoAnswerError: Not one pose had an answer, or there was no image.
        Exit: With 5, where the recording is incomplete, or what it was made of.
    """
    missing = totals.lost + totals.shed_messages
    if as_json:
        document = {
            "recording": str(totals.folder),
            "images": statistics.images,
            "poses": dict(statistics.poses),
            "measurements": dict(statistics.measurements),
            "reasons": statistics.reasons,
            "warnings": warnings,
            **(left_out or {}),
            "lost": missing,
            "recorded": totals.counts,
        }
        print_json({**document, **_calibrated(statistics), **(seen or {})})
    for sentence in warnings:
        say(f"aerodft: {sentence}")
    _say_statistics(totals, statistics)
    _say_unused(counts)
    if missing:
        why = "could not be written" if totals.lost else "came faster than they could be written"
        say(f"aerodft: {totals.folder}: {missing} messages are not in the recording: they {why}")
    if live and not statistics.poses:
        say("nothing was measured: no image came")
    else:
        _refuse_emptiness(totals, statistics)
    end_with_gaps(left_out or {})
    if missing:
        raise typer.Exit(LOSS)


def _calibrated(statistics: RunStatistics) -> dict[str, object]:
    """What became of landmarks, and whether a watched camera still looks where it looked: where the station has any."""
    found: dict[str, object] = {}
    if (last := statistics.estimate) is not None:
        found["landmarks"] = {"used": last.updates, "refused": last.refused, "restarts": last.restarts}
    if statistics.steadiness is not None:
        found["steadiness"] = _steadiness_document(statistics.steadiness)
    return found


def _say_statistics(totals: RecordingTotals, statistics: RunStatistics) -> None:
    say(f"recording: {totals.folder}; {statistics.images} images; poses: {_listed(statistics.poses)}")
    say(f"measurements: {_listed(statistics.measurements)}")
    if statistics.estimate is not None:
        say(f"landmarks: {statistics.estimate.updates} used, {statistics.estimate.refused} refused")
    if statistics.steadiness is not None:
        say(f"camera: {_steadiness_sentence(statistics.steadiness)}")


def _say_unused(counts: Counts) -> None:
    for count, why in (
        (counts.unknown_probe, "name a probe that the configuration does not observe"),
        (
            counts.wrong_pixel_count,
            "do not have the pixels that their probe takes, or an outline that it can be measured by",
        ),
    ):
        if count:
            say(f"{count} observations {why}; they are recorded")


def _refuse_emptiness(totals: RecordingTotals, statistics: RunStatistics) -> None:
    if statistics.poses.get("ok"):
        return
    got = ", then ".join(f"{status} ({why})" for status, why in statistics.reasons.items()) or "no image"
    hint = "the recording is kept"
    raise NoAnswerError("no image has a usable pose", where=totals.folder, got=got, hint=hint)


def _listed(counter: dict[str, int]) -> str:
    return ", ".join(f"{number} {status}" for status, number in counter.items()) or "none"


def _steadiness_document(estimate: CameraMotionEstimate) -> dict[str, object]:
    """What a run's summary says of the camera at the end."""
    return {
        "state": estimate.state,
        "since": _utc(estimate.since_ns),
        "turned_deg": _turned_deg(estimate),
        "moved_since": None if estimate.moved_ns is None else _utc(estimate.moved_ns),
        "points": estimate.points,
    }


def _steadiness_sentence(estimate: CameraMotionEstimate) -> str:
    """Whether a watched camera still looks where it looked, for people."""
    said = f"{estimate.state} since {_utc(estimate.since_ns)}"
    if estimate.moved_ns is not None:
        return f"{said}; turned by {_turned_deg(estimate):.2f} deg at {_utc(estimate.moved_ns)}"
    return f"{said}; turned by {_turned_deg(estimate):.3f} deg, within the limit"


def _turned_deg(estimate: CameraMotionEstimate) -> float:
    return math.degrees(math.hypot(*estimate.turn_rad))


def _utc(stamp_ns: int) -> str:
    return f"{datetime.fromtimestamp(stamp_ns // SECOND_NS, UTC):%Y-%m-%dT%H:%M:%SZ}"
