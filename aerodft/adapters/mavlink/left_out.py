"""What was received and is not used: rows without a value, frames that are damaged or not known; in sentences."""

from collections.abc import Iterator
from typing import Final

from aerodft.adapters.mavlink.ambiguity import is_of_another
from aerodft.adapters.mavlink.dialect import message_name
from aerodft.adapters.mavlink.survey_report import SurveyReport

_NOTABLE: Final = 0.01  # share of a message's rows
_NOT_YET: Final = " yet"
_LANDED: Final = frozenset({"below the sensor's minimum", "distance is zero"})  # as long as it flies at all
_ESTIMATOR: Final = "EKF_STATUS_REPORT"
_MOST_IDS: Final = 5


def rows_left_out(report: SurveyReport) -> Iterator[str]:
    """One sentence for a message whose rows hold no value, where that is not rare; one for a vehicle that starts up."""
    totals: dict[str, int] = {}
    for stream in report.streams:
        if stream.system == report.system:
            totals[stream.name] = totals.get(stream.name, 0) + stream.count
    faults: dict[str, dict[str, int]] = {}
    for reason, count in report.rejected.items():
        name, _, why = reason.partition(": ")
        if not is_of_another(reason):
            faults.setdefault(name, {})[why] = count
    if report.ready_s:
        yield (
            f"the vehicle starts up in this log: it knows neither UTC nor its place until {report.ready_s:.0f} s after "
            "the start"
        )
    for name, counts in faults.items():
        total = totals.get(name, sum(counts.values()))
        is_all = sum(counts.values()) >= total
        told = {why: count for why, count in counts.items() if is_all or not (why.endswith(_NOT_YET) or why in _LANDED)}
        if sum(told.values()) >= max(_NOTABLE * total, 1):
            said = ", ".join(f"{why} in {count}" for why, count in told.items())
            yield f"{name}: {said} of {total} messages, which are left out{_hint(report, name, is_all=is_all)}"


def _hint(report: SurveyReport, name: str, *, is_all: bool) -> str:
    if name != _ESTIMATOR or not is_all:
        return ""
    kind = report.parameters.values.get("AHRS_EKF_TYPE")
    why = f" (AHRS_EKF_TYPE = {kind[-1]:g})" if kind else ""
    return f": whether the estimator is well will not be known{why}"


def damage(report: SurveyReport) -> Iterator[str]:
    """Frames that do not pass their check, and those of messages that are not known."""
    counts = report.counts
    if counts.bad_crc and not report.warnings:
        yield f"{counts.bad_crc} damaged frames left out ({counts.skipped_bytes} bytes belong to no good frame)"
    if counts.unknown:
        ids = report.unknown_ids.most_common(_MOST_IDS)
        said = ", ".join(f"{count} of {_called(message_id)}" for message_id, count in ids)
        more = ", ..." if len(report.unknown_ids) > _MOST_IDS else ""
        yield (
            f"{counts.unknown} frames of messages that are not known here left out"
            f"{f' (by id: {said}{more})' if said else ''}"
        )


def _called(message_id: int) -> str:
    name = message_name(message_id)
    return str(message_id) if name.startswith("UNKNOWN") else f"{message_id} ({name} of another length)"
