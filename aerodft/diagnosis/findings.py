"""A survey's problems as plain sentences, what matters most first, each with what to do; and a survey as JSON."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Final

from aerodft.adapters.telemetry import signing_document, signing_sentences, unchecked_sentence
from aerodft.adapters.telemetry.mavlink import GIMBAL_MESSAGES, OF_ANOTHER_ADDRESS, is_link, is_peripheral, message_name
from aerodft.conventions import SECOND_NS
from aerodft.diagnosis.log_diagnosis import USED, ClockSummary, DiagnosisReport, SourceSummary, StreamGap
from aerodft.diagnosis.message_requests import SWITCHED_OFF_BY
from aerodft.diagnosis.streams import Stream
from aerodft.model import GimbalSource, HeightSource, ReportFrame
from aerodft.service import DEMAND_TILT_STD_RAD, GIMBAL_SOURCES, TelemetrySettings
from aerodft.service.attitude import FrameEvidence
from aerodft.service.clocks import ClockHealth

_OF_AUTOPILOTS: Final = ("ATTITUDE", "GLOBAL_POSITION_INT")
_SUBTITLES: Final = "SRT"
_ANOTHER_GIMBAL: Final = ": of another gimbal than number "
_NOTABLE: Final = 0.01  # share of a message's rows
_NOT_YET: Final = " yet"
_LANDED: Final = frozenset({"below the sensor's minimum", "distance is zero"})  # as long as it flies at all
_ESTIMATOR: Final = "EKF_STATUS_REPORT"
_MOST_IDS: Final = 5
_EARLY_END_S: Final = 5.0
_SLOW_PERIODS: Final = 3
_MOST_TOLD: Final = 5
_ATTITUDES: Final = frozenset(
    {
        *("ATTITUDE", *(each.name for each in GIMBAL_MESSAGES)),
        *("ATT", "MNT"),
        *("vehicle_attitude", "gimbal_device_attitude_status"),
    }
)
_CONSEQUENCE: Final = {
    "GPS_RAW_INT": "from then on it is not known how good the fix is",
    "EKF_STATUS_REPORT": "from then on it is not known whether the estimator is well",
    "ESTIMATOR_STATUS": "from then on it is not known whether the estimator is well",
    "HEARTBEAT": "from then on nothing is measured",
}
_LOW_M: Final = 1.0
_UNLIKELY: Final = 0.02
_AUTO: Final = 'telemetry.attitude.frame = "auto"'
_FIXED: Final = (
    'for a camera that is bolted to the vehicle set telemetry.attitude.order = ["fixed"] and fixed_mount, its angles '
    "against the vehicle"
)
_MOST_JUMPS: Final = 5
_HOST_OFFSET_S: Final = 1.0


def _other_senders(report: DiagnosisReport) -> list[str]:
    """One sentence for each kind of sender that there is more than one of."""
    sentences = []
    if len(report.systems) > 1:
        sentences.append(
            f"more than one vehicle (systems {_listed(report.systems)}): system {report.system} is followed;"
            " choose with telemetry.system"
        )
    autopilots = [c for c in _components(report, *_OF_AUTOPILOTS) if not is_peripheral(c)]
    if len(autopilots) > 1:
        sentences.append(
            f"system {report.system} has more than one autopilot (components {_listed(autopilots)}): component"
            f" {report.component} is followed; choose with telemetry.component"
        )
    for reason, count in report.rejected.items():
        if reason.startswith(OF_ANOTHER_ADDRESS):
            sentences.append(
                f"two autopilots speak as system {report.system}, component {report.component}, or one over two ways:"
                f" {count} frames from another address than {reason.rpartition(' than ')[2]} are left out; give one of"
                " them another system id (SYSID_THISMAV, from 4.7 on MAV_SYSID)"
            )
    for name in (each.name for each in reversed(GIMBAL_MESSAGES)):
        gimbals = _components(report, name)
        if len(gimbals) > 1:
            sentences.append(
                f"{name} comes from more than one gimbal (components {_listed(gimbals)}): component"
                f" {_followed_gimbal(report, name, gimbals)} is followed; choose with telemetry.gimbal"
            )
    for reason, count in report.rejected.items():
        name, is_another, number = reason.partition(_ANOTHER_GIMBAL)
        if is_another and not report.attitudes:
            sentences.append(f"{name} of gimbal number {number} is not heard, others are: choose with telemetry.gimbal")
        elif is_another:
            sentences.append(
                f"{name} comes from more than one gimbal: number {number} is followed, {count} messages of others are"
                " left out; choose with telemetry.gimbal"
            )
    return sentences


def _is_of_another(reason: str) -> bool:
    """Whether rows were left out because they are of somebody else than who is followed."""
    return reason.startswith(OF_ANOTHER_ADDRESS) or _ANOTHER_GIMBAL in reason


def _followed_gimbal(report: DiagnosisReport, name: str, gimbals: list[int]) -> int:
    """The one that was asked for, else the one that was heard first."""
    first_ns = {s.component: s.first_ns for s in report.streams if s.system == report.system and s.name == name}
    return report.gimbal if report.gimbal in gimbals else min(gimbals, key=lambda each: first_ns[each])


def _components(report: DiagnosisReport, *names: str) -> list[int]:
    """Components of the followed system that send one of these messages."""
    found = {s.component for s in report.streams if s.system == report.system and s.name in names}
    return sorted(component for component in found if component is not None)


def _listed(ids: tuple[int, ...] | list[int]) -> str:
    return ", ".join(map(str, ids))


def _height_checks(report: DiagnosisReport, settings: TelemetrySettings) -> Iterator[str]:
    """One sentence for each setting of heights that does not fit what came."""
    available = {each.name for each in report.heights} | {str(HeightSource.MANUAL)}
    missing = [str(each) for each in settings.height.order if str(each) not in available]
    if len(missing) == len(settings.height.order):
        yield f"telemetry.height.order lists {', '.join(missing)}, and none of them comes: no image would have a height"
    elif missing:
        yield f"telemetry.height.order lists {', '.join(missing)}, which does not come: the next in the order is taken"
    above_m = {str(HeightSource.HOME): settings.height.home_above_plane_m}
    order = {str(each) for each in settings.height.order}
    highest_m = [each.high + above_m.get(each.name, 0.0) for each in report.heights if each.name in order]
    if highest_m and max(highest_m) < settings.height.min_m:
        yield (
            f"telemetry.height.min_m is {settings.height.min_m:g} m, and the highest flown is {max(highest_m):.1f} m: "
            "no image would have an answer"
        )


def _attitude_checks(report: DiagnosisReport, settings: TelemetrySettings) -> Iterator[str]:
    """One sentence for each setting of attitudes that does not fit what came."""
    available = {each.name for each in report.attitudes}
    if report.vehicle_attitude is not None:
        available.add(str(GimbalSource.FIXED_MOUNT))
    order = [str(each) for each in settings.attitude.order]
    if not available & set(order):
        names = ", ".join(order)
        yield f"telemetry.attitude.order lists {names}, and none of them comes: no image would have an attitude"
    stated = settings.attitude.frame
    for name, evidence in report.frames.items():
        if stated is not None and evidence.frame is not None and evidence.frame is not stated:
            against = "the vehicle" if evidence.frame is ReportFrame.BODY else "the horizon"
            yield f'telemetry.attitude.frame = "{stated}", but {name} reports against {against}: set "auto"'


def _rejected_rows(report: DiagnosisReport) -> Iterator[str]:
    """One sentence for a message whose rows hold no value, where that is not rare; one for a vehicle that starts up."""
    totals: dict[str, int] = {}
    for stream in report.streams:
        if stream.system == report.system:
            totals[stream.name] = totals.get(stream.name, 0) + stream.count
    faults: dict[str, dict[str, int]] = {}
    for reason, count in report.rejected.items():
        name, _, why = reason.partition(": ")
        if not _is_of_another(reason):
            faults.setdefault(name, {})[why] = count
    if report.ready_s:
        yield (
            f"the vehicle starts up in this log: it knows neither UTC nor its place until {report.ready_s:.0f} s after "
            "the start"
        )
    for name, counts in faults.items():
        total = totals.get(name, sum(counts.values()))
        is_all = sum(counts.values()) >= total
        notable = {
            why: count for why, count in counts.items() if is_all or not (why.endswith(_NOT_YET) or why in _LANDED)
        }
        if sum(notable.values()) >= max(_NOTABLE * total, 1):
            listed = ", ".join(f"{why} in {count}" for why, count in notable.items())
            yield f"{name}: {listed} of {total} messages, which are left out{_hint(report, name, is_all=is_all)}"


def _hint(report: DiagnosisReport, name: str, *, is_all: bool) -> str:
    if name != _ESTIMATOR or not is_all:
        return ""
    kind = report.parameters.values.get("AHRS_EKF_TYPE")
    why = f" (AHRS_EKF_TYPE = {kind[-1]:g})" if kind else ""
    return f": whether the estimator is well will not be known{why}"


def _damage(report: DiagnosisReport) -> Iterator[str]:
    """Frames that do not pass their check, and those of messages that are not known."""
    counts = report.counts
    if counts.bad_crc and not report.warnings:
        yield f"{counts.bad_crc} damaged frames left out ({counts.skipped_bytes} bytes belong to no good frame)"
    if counts.unknown:
        listed = ", ".join(
            f"{count} of {number}" + ("" if name.startswith("UNKNOWN") else f" ({name} of another length)")
            for number, count in report.unknown_ids.most_common(_MOST_IDS)
            for name in [message_name(number)]
        )
        more = ", ..." if len(report.unknown_ids) > _MOST_IDS else ""
        yield (
            f"{counts.unknown} frames of messages that are not known here left out"
            f"{f' (by id: {listed}{more})' if listed else ''}"
        )


@dataclass(slots=True)
class _Silence:
    """Gaps that overlap."""

    start_s: float
    end_s: float
    messages: set[str]

    @property
    def text(self) -> str:
        return f"{self.end_s - self.start_s:.1f} s at {self.start_s:.1f} s"


def _silences(report: DiagnosisReport) -> Iterator[str]:
    """One sentence for all silences of the same messages; one for all where they are many."""
    silences = _merged(report.gaps)
    if len(silences) > _MOST_TOLD:
        longest = max(silences, key=lambda each: each.end_s - each.start_s)
        names = ", ".join(sorted(set.union(*(each.messages for each in silences))))
        yield (
            f"telemetry ({names}) is silent {len(silences)} times for more than a second, the longest time for "
            f"{longest.text}{_consequence(set(names.split(', ')))}"
        )
        return
    by_messages: dict[tuple[str, ...], list[_Silence]] = {}
    for each in silences:
        by_messages.setdefault(tuple(sorted(each.messages)), []).append(each)
    for messages, own in by_messages.items():
        verb = "is" if len(messages) == 1 else "are"
        times = ", ".join(each.text for each in own)
        yield f"{', '.join(messages)} {verb} silent for {times}{_consequence(set(messages))}"


def _consequence(messages: set[str]) -> str:
    return ": images stamped then have no answer" if messages & _ATTITUDES else ""


def _merged(gaps: tuple[StreamGap, ...]) -> list[_Silence]:
    silences: list[_Silence] = []
    for gap in sorted(gaps, key=lambda each: each.start_s):
        end_s = gap.start_s + gap.duration_s
        if silences and gap.start_s < silences[-1].end_s:
            silences[-1].end_s = max(silences[-1].end_s, end_s)
            silences[-1].messages.add(gap.message)
        else:
            silences.append(_Silence(gap.start_s, end_s, {gap.message}))
    return silences


def _ends(report: DiagnosisReport) -> Iterator[str]:
    """One sentence for each message that stops, and for telemetry that ends before the log."""
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


def _missing(report: DiagnosisReport) -> Iterator[str]:
    """Sentences on lacking inputs without which nothing, or not without a setting, is measured."""
    if not report.heights:
        yield (
            "no height: neither a rangefinder, nor terrain data, nor a height above home; an altitude above the sea is "
            'none. Of a camera that kept its height state it: telemetry.height.order = ["manual"] and manual_m'
        )
    elif {source.name for source in report.heights} == {"home"} and not _settings(report).height.home_above_plane_m:
        yield (
            "heights are above home only: where the river lies lower or higher than home, set "
            "telemetry.height.home_above_plane_m"
        )
    if {each.name for each in report.streams} == {_SUBTITLES}:
        return  # their reader says what they lack
    if not report.attitudes and not report.vehicle_attitude:
        yield "no attitude: neither a gimbal nor the vehicle reports one"
    elif (
        not report.attitudes
        and not any(map(_is_of_another, report.rejected))
        and _settings(report).attitude.fixed_mount is None
    ):
        setting = report.parameters.switch_off(*SWITCHED_OFF_BY["GIMBAL_DEVICE_ATTITUDE_STATUS"])
        off = f" (switched off by {setting}: the type of a gimbal, if there is one)" if setting else ""
        yield f"no gimbal attitude{off}: {_FIXED}"
    elif report.attitudes and not report.vehicle_attitude:
        yield "no vehicle attitude: a gimbal's yaw against the vehicle cannot be turned to north"
    if report.rangefinder is not None and report.rangefinder.high < _LOW_M:
        yield f"RANGEFINDER never says more than {report.rangefinder.high:.2f} m: was the vehicle in the air at all?"


def _settings(report: DiagnosisReport) -> TelemetrySettings:
    return report.settings or TelemetrySettings()


def _switched_off(report: DiagnosisReport) -> Iterator[str]:
    """Heights that do not come because the vehicle's own parameters say so."""
    heights = {source.name for source in report.heights}
    for source, message, then in (
        ("rangefinder", "DISTANCE_SENSOR", "if the vehicle has one, set that to its type"),
        ("terrain", "TERRAIN_REPORT", "set that to 1 if the ground station has terrain data"),
    ):
        setting = report.parameters.switch_off(*SWITCHED_OFF_BY[message])
        if setting and source not in heights:
            yield f"heights of the {source} are switched off by {setting}: {then}"


def _frames(report: DiagnosisReport) -> Iterator[str]:
    """Sentences on the reference of gimbals' roll and pitch, where that is not the horizon; and on demands."""
    stated = _settings(report).attitude
    for name, evidence in report.frames.items():
        undid = f"it undid {evidence.undone} of the vehicle's {evidence.motions} motions ({evidence.motion_s:.0f} s)"
        if evidence.contradictory:
            yield f'{name} contradicts itself: {undid}; set telemetry.attitude.frame = "earth" or "body"'
        elif evidence.frame is ReportFrame.BODY and stated.frame is None:
            yield (
                f"{name} is body-frame (against the vehicle, not the horizon): {undid}; "
                f'{_AUTO} corrects that once it is found, "body" from the start'
            )
        elif evidence.frame is None and evidence.body_probability > _UNLIKELY and stated.frame is None:
            yield (
                f"the vehicle did not move enough to tell the gimbal's frame: {name} may be earth-frame or body-frame "
                f"(against the horizon or the vehicle), and {_AUTO} takes the horizon with a wider std; "
                'for a servo mount set "body"'
            )
    demands = [name for name, is_demand in report.demands.items() if is_demand]
    if demands and stated.is_demand is None:
        yield (
            f"{', '.join(demands)} may be what the gimbal was told, not where it is: the tilt's std is at least "
            f"{math.degrees(DEMAND_TILT_STD_RAD):g} deg, and larger after every move; for a gimbal that measures set "
            'telemetry.attitude.feedback = "measured"'
        )
    unstamped = {str(each.name) for each in GIMBAL_SOURCES.values() if not each.is_stamped}
    for source in report.attitudes:
        if source.name in unstamped:
            yield f"{source.name} has no time stamp of its own: its arrival is used, late by the link's delay"


def _gimbal_notes(report: DiagnosisReport) -> Iterator[str]:
    """Notes on gimbals that are no problems."""
    for name, evidence in report.frames.items():
        if evidence.frame is ReportFrame.EARTH and not evidence.contradictory:
            kept = evidence.motions - evidence.undone
            yield (
                f"{name} is earth-frame (against the horizon, as the standard says): it kept still through {kept} of "
                f"the vehicle's {evidence.motions} motions ({evidence.motion_s:.0f} s)"
            )
    measured = [name for name, is_demand in report.demands.items() if not is_demand]
    if measured and _settings(report).attitude.is_demand is None:
        yield f"{', '.join(measured)} is measured: no two reports are alike, and they keep to the horizon"


def clock_document(health: ClockHealth, summary: ClockSummary) -> dict[str, Any]:
    """Plain JSON values."""
    return {
        "utc_known_after_s": summary.known_after_s,
        "host_minus_utc_s": summary.host_minus_utc_s,
        "drift_ppm": None if health.drift is None else round(1e6 * health.drift, 2),
        "reboots": health.restarts,
        "reboots_at_s": list(summary.reboots_at_s),
        "wraps": health.wraps,
        "jumps_s": [round(jump_s, 3) for jump_s in health.jumps_s],
        "jumps_at_s": list(summary.jumps_at_s),
        "rows_of_other_clocks": health.left_out,
        "two_clocks": health.rivals,
    }


def clock_sentences(health: ClockHealth, summary: ClockSummary) -> list[str]:
    """Sentences on jumps, drift and restarts of the clocks."""
    sentences = []
    if health.jumps_s:
        jumps = ", ".join(f"{jump_s:+.3f} s" for jump_s in health.jumps_s[:_MOST_JUMPS])
        more = f" and {len(health.jumps_s) - _MOST_JUMPS} more" if len(health.jumps_s) > _MOST_JUMPS else ""
        sentences.append(
            f"the vehicle's UTC jumped by {jumps}{more}{_when(summary.jumps_at_s)}: images that a clock of their own "
            "has stamped shortly before and after have no answer"
        )
    if health.rivals:
        sentences.append(
            "two autopilots speak with the same ids, each with its own time since boot: the first one heard is "
            f"followed, {health.left_out} messages of the other one are left out; give one of them another system id "
            "(SYSID_THISMAV, from 4.7 on MAV_SYSID)"
        )
    if health.restarts:
        times = "once" if health.restarts == 1 else f"{health.restarts} times"
        sentences.append(
            f"the vehicle rebooted {times}{_when(summary.reboots_at_s)}: no pose is made of what came before and after,"
            " and heights above home may count from elsewhere since"
        )
    against = _against_host(summary)
    return [*sentences, against] if against else sentences


def _against_host(summary: ClockSummary) -> str:
    after_s, offset_s = summary.known_after_s, summary.host_minus_utc_s
    if after_s is None or offset_s is None:
        return (
            "no UTC: the vehicle never said what time it is, so the recording machine's clock is taken: images that "
            "another clock stamps (a video's) may be matched wrongly by as much as the two differ"
        )
    if abs(offset_s) > _HOST_OFFSET_S:
        way = "ahead of" if offset_s > 0 else "behind"
        return (
            f"the recording machine's clock is {abs(offset_s):.1f} s {way} the vehicle's UTC: images that it stamps,"
            " or a video's start by it, are as far off"
        )
    return ""


def _when(at_s: tuple[float, ...]) -> str:
    """Times since the start, as far as they are listed."""
    if not at_s:
        return ""
    more = " ..." if len(at_s) > _MOST_JUMPS else ""
    return f" about {', '.join(f'{each:.0f}' for each in at_s[:_MOST_JUMPS])}{more} s after the start"


def problems(report: DiagnosisReport) -> list[str]:
    """One sentence for each thing that limits what can be measured; empty where all is well."""
    signing = [] if report.signing is None else signing_sentences(report.signing)
    if report.first_ns is None and report.signing is not None and report.signing.refused:
        return signing
    if report.first_ns is None:
        return ["nothing was received: is the sender on, and does it send to this address?"]
    if is_link(report.target) and report.signed_frames and report.signing is None:
        signing = [unchecked_sentence(report.signed_frames, report.counts.frames)]
    if not report.is_heard:
        return [_not_heard(report), *signing, *_damage(report), *report.warnings]
    if report.photographs:
        return [*_of_photographs(report), *report.warnings]
    silent = "the vehicle is silent since it was asked: what follows is of the time before"
    return [*([silent] if report.is_silent_since else []), *signing, *_of_telemetry(report), *report.warnings]


def _of_telemetry(report: DiagnosisReport) -> Iterator[str]:
    settings = report.settings
    if report.poses.spans and (problem := report.poses.problem()):
        yield problem
    yield from report.pitch_faults
    yield from _missing(report)
    yield from _other_senders(report)
    if settings is not None:
        yield from _height_checks(report, settings)
        yield from _attitude_checks(report, settings)
    yield from report.health.sentences(report.camera, settings, report.ready_s)
    yield from clock_sentences(report.clock_health, report.clock)
    yield from _rejected_rows(report)
    yield from _frames(report)
    yield from report.height_pairs.sentences(0.0 if settings is None else settings.height.home_above_plane_m)
    yield from _silences(report)
    yield from _ends(report)
    yield from (request.sentence(is_live=is_link(report.target)) for request in report.requests)
    yield from _switched_off(report)
    yield from _damage(report)


def _of_photographs(report: DiagnosisReport) -> Iterator[str]:
    """What photographs that carry their poses leave open."""
    count, measurable = round(report.poses.seconds), round(report.poses.ok_s)
    reasons = [each.text for status in report.poses.spans.values() for each in status.values() if each.text]
    if measurable < count:
        yield f"{count - measurable} of {count} photographs cannot be measured: {reasons[0] if reasons else 'no pose'}"
    settings = _settings(report).height
    if any(source.name == "home" for source in report.heights) and not (
        settings.home_above_plane_m or settings.home_above_plane_std_m
    ):
        yield (
            "heights are above the take-off point: where the water lies lower or higher, set"
            " telemetry.height.home_above_plane_m, or home_above_plane_std_m where nobody knows it"
        )
    if report.settings is not None:
        yield from _height_checks(report, report.settings)
        yield from _attitude_checks(report, report.settings)
    yield from _damage(report)


def _not_heard(report: DiagnosisReport) -> str:
    """Which of the ids that were asked for does not come, by the option that asked for it."""
    settings = report.settings
    what, wanted, heard = "system", report.system, set(report.heard)
    if report.system is None or report.system in report.heard:
        own = (each.component for each in report.streams if report.system in {None, each.system})
        what, wanted, heard = "component", report.component, {each for each in own if each is not None}
    is_configured = settings is not None and getattr(settings, what) == wanted
    option = f"telemetry.{what}" if is_configured else f"`{what}`"
    return (
        f"{option} = {wanted} is not heard, {what}s {', '.join(map(str, sorted(heard)))} are: nothing would be measured"
    )


def notes(report: DiagnosisReport) -> list[str]:
    """Notes worth knowing that are no problems."""
    if report.photographs:
        return [*report.photographs, f"{report.poses.ok_s:.0f} of {report.poses.seconds:.0f} can be measured"]
    is_told = not report.poses.spans or report.poses.problem()
    return [*([] if is_told else [report.poses.note()]), *_gimbal_notes(report)]


def document(report: DiagnosisReport) -> dict[str, Any]:
    """The report as plain JSON values; stamps as decimal strings, unknown fields null."""
    return {
        "schema": "aerodft.doctor/1",
        "target": report.target,
        "usable": report.usable,
        "poses": report.poses.document(),
        "first_ns": None if report.first_ns is None else str(report.first_ns),
        "last_ns": None if report.last_ns is None else str(report.last_ns),
        "duration_s": report.duration_s,
        "streams": [_stream(stream) for stream in report.streams],
        "heights": [_source(source) for source in report.heights],
        "attitudes": [
            {
                **_source(source),
                **_frame(report.frames.get(source.name)),
                "feedback": {None: None, True: "demand", False: "measured"}[report.demands.get(source.name)],
            }
            for source in report.attitudes
        ],
        "vehicle_attitude": _source(report.vehicle_attitude) if report.vehicle_attitude else None,
        "clock": clock_document(report.clock_health, report.clock),
        "height_differences": report.height_pairs.documents(),
        "gaps": [asdict(gap) for gap in report.gaps],
        "followed": {"system": report.system, "component": report.component},
        "systems": list(report.systems),
        "rejected": report.rejected,
        "frames": {
            "good": report.counts.frames,
            "bad_crc": report.counts.bad_crc,
            "unknown": report.counts.unknown,
            "unknown_ids": {str(message_id): count for message_id, count in report.unknown_ids.most_common()},
            "skipped_bytes": report.counts.skipped_bytes,
            "truncated": report.counts.truncated,
            "signed": report.signed_frames,
        },
        "signing": None if report.signing is None else signing_document(report.signing),
        "health": report.health.document(),
        "requests": [request.document() for request in report.requests],
        "notes": notes(report),
        "problems": problems(report),
    }


def _stream(stream: Stream) -> dict[str, Any]:
    return {
        "message": stream.name,
        "system": stream.system,
        "component": stream.component,
        "count": stream.count,
        "rate_hz": round(stream.rate_hz, 3),
        "first_ns": str(stream.first_ns),
        "last_ns": str(stream.last_ns),
    }


def _source(source: SourceSummary) -> dict[str, Any]:
    return {
        "source": source.name,
        "count": source.count,
        "unit": source.unit,
        "low": round(source.low, 3),
        "high": round(source.high, 3),
    }


def _frame(evidence: FrameEvidence | None) -> dict[str, Any]:
    if evidence is None:
        return {"frame": None, "contradictory": False, "body_probability": None, "motions": 0, "undone": 0}
    return {
        "frame": evidence.frame,
        "contradictory": evidence.contradictory,
        "body_probability": round(evidence.body_probability, 6),
        "motions": evidence.motions,
        "undone": evidence.undone,
    }
