"""When telemetry was silent or ended, in sentences: silences of several messages at one time are one."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from aerodft.adapters.mavlink.streams import Stream
from aerodft.adapters.mavlink.survey_report import USED, Gap, SurveyReport
from aerodft.conventions import SECOND_NS

_EARLY_END_S: Final = 5.0
_SLOW_PERIODS: Final = 3
_MOST_TOLD: Final = 5
_ATTITUDES: Final = frozenset(
    {"ATTITUDE", "ATT", "GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION", "MOUNT_STATUS", "MNT"}
)
_CONSEQUENCE: Final = {
    "GPS_RAW_INT": "from then on it is not known how good the fix is",
    "EKF_STATUS_REPORT": "from then on it is not known whether the estimator is well",
    "ESTIMATOR_STATUS": "from then on it is not known whether the estimator is well",
    "HEARTBEAT": "from then on nothing is measured",
}


@dataclass(slots=True)
class _Silence:
    """Gaps that overlap."""

    start_s: float
    end_s: float
    messages: set[str]

    @property
    def words(self) -> str:
        return f"{self.end_s - self.start_s:.1f} s at {self.start_s:.1f} s"


def interruptions(report: SurveyReport) -> list[str]:
    """One sentence for all silences of the same messages, for all messages that stop, and for an early end."""
    return [*_silences(report), *_ends(report)]


def _silences(report: SurveyReport) -> Iterator[str]:
    silences = _merged(report.gaps)
    if len(silences) > _MOST_TOLD:
        longest = max(silences, key=lambda each: each.end_s - each.start_s)
        names = ", ".join(sorted(set.union(*(each.messages for each in silences))))
        yield (
            f"telemetry ({names}) is silent {len(silences)} times for more than a second, the longest time for "
            f"{longest.words}{_consequence(set(names.split(', ')))}"
        )
        return
    by_messages: dict[tuple[str, ...], list[_Silence]] = {}
    for each in silences:
        by_messages.setdefault(tuple(sorted(each.messages)), []).append(each)
    for messages, own in by_messages.items():
        verb = "is" if len(messages) == 1 else "are"
        times = ", ".join(each.words for each in own)
        yield f"{', '.join(messages)} {verb} silent for {times}{_consequence(set(messages))}"


def _consequence(messages: set[str]) -> str:
    return ": images stamped then have no answer" if messages & _ATTITUDES else ""


def _merged(gaps: tuple[Gap, ...]) -> list[_Silence]:
    silences: list[_Silence] = []
    for gap in sorted(gaps, key=lambda each: each.start_s):
        end_s = gap.start_s + gap.duration_s
        if silences and gap.start_s < silences[-1].end_s:
            silences[-1].end_s = max(silences[-1].end_s, end_s)
            silences[-1].messages.add(gap.message)
        else:
            silences.append(_Silence(gap.start_s, end_s, {gap.message}))
    return silences


def _ends(report: SurveyReport) -> Iterator[str]:
    own = [each for each in report.streams if each.system == report.system]
    used = [each.last_ns for each in own if each.name in USED]
    if not used or report.first_ns is None or report.last_ns is None:
        return
    end_ns = max(used)
    for stream in own:
        if stream.name in USED | _CONSEQUENCE.keys() and _stops(stream, end_ns):
            at_s, early_s = (stream.last_ns - report.first_ns) / SECOND_NS, (end_ns - stream.last_ns) / SECOND_NS
            then = f": {_CONSEQUENCE[stream.name]}" if stream.name in _CONSEQUENCE else ""
            yield f"{stream.name} stops at {at_s:.1f} s, {early_s:.1f} s before the telemetry does{then}"
    early_s = (report.last_ns - end_ns) / SECOND_NS
    if early_s > _EARLY_END_S:
        yield (
            f"telemetry ends at {(end_ns - report.first_ns) / SECOND_NS:.1f} s, {early_s:.1f} s before the log does: "
            "nothing is measured after that"
        )


def _stops(stream: Stream, end_ns: int) -> bool:
    """Whether a message that came regularly has not come for long at the end."""
    period_s = 1 / stream.rate_hz if stream.rate_hz else float("inf")
    return end_ns - stream.last_ns > max(_EARLY_END_S, _SLOW_PERIODS * period_s) * SECOND_NS
