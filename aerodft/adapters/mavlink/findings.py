"""A survey's problems as plain sentences, and the survey as one JSON document."""

from typing import Any, Final

from aerodft.adapters.mavlink.ambiguity import senders
from aerodft.adapters.mavlink.configured import contradictions
from aerodft.adapters.mavlink.contradictions import clock_document, clock_sentences
from aerodft.adapters.mavlink.signing_words import signing_document, signing_sentences
from aerodft.adapters.mavlink.survey_report import USED, SurveyReport, ValueSource
from aerodft.model.telemetry import ReportFrame
from aerodft.service.gimbal_frame import FrameEvidence

_EARLY_END_S: Final = 5.0
_LOW_M: Final = 1.0
_HOST_OFFSET_S: Final = 1.0
_MAX_GAPS: Final = 5
_UNLIKELY: Final = 0.02
_AUTO: Final = 'telemetry.attitude.frame = "auto"'


def problems(report: SurveyReport) -> list[str]:
    """One sentence for each thing that limits what can be measured; empty where all is well."""
    if report.first_ns is None and report.signing is not None and report.signing.refused:
        return signing_sentences(report.signing)
    if report.first_ns is None:
        return ["nothing was received: is the sender on, and does it send to this address?"]
    return [
        *_missing(report),
        *_doubtful(report),
        *_frames(report),
        *report.height_pairs.sentences(),
        *_clock(report),
        *clock_sentences(report.clock_health),
        *_interruptions(report),
        *_damage(report),
        *report.health.sentences(report.camera),
        *([] if report.settings is None else contradictions(report, report.settings)),
        *(request.sentence() for request in report.requests),
        *([] if report.signing is None else signing_sentences(report.signing)),
        *report.warnings,
    ]


def _missing(report: SurveyReport) -> list[str]:
    sentences = []
    if not report.heights:
        sentences.append("no height: neither a rangefinder, nor terrain data, nor a position with a height above home")
    elif {source.name for source in report.heights} == {"home"}:
        sentences.append(
            "heights are above home only: where the river lies lower or higher than home, set height.home_above_plane_m"
        )
    if not report.attitudes and report.vehicle_attitude:
        sentences.append("no gimbal attitude: only a camera that is fixed to the vehicle can be used")
    elif not report.attitudes:
        sentences.append("no attitude: neither a gimbal nor the vehicle reports one")
    elif not report.vehicle_attitude:
        sentences.append("no vehicle attitude: a gimbal's yaw against the vehicle cannot be turned to north")
    return sentences


def _doubtful(report: SurveyReport) -> list[str]:
    sentences = senders(report)
    measured = [source for source in report.heights if source.name in {"rangefinder", "terrain"}]
    sentences += [
        f"{source.name} says {source.low:.2f} m at its lowest: nothing is measured below the minimum height"
        for source in measured
        if source.low < _LOW_M
    ]
    if report.rangefinder is not None and report.rangefinder.high < _LOW_M:
        sentences.append(
            f"RANGEFINDER never says more than {report.rangefinder.high:.2f} m: was the vehicle in the air at all?"
        )
    if any(source.name == "MOUNT_STATUS" for source in report.attitudes):
        sentences.append("MOUNT_STATUS has no time stamp of its own: its arrival is used, late by the link's delay")
    totals: dict[str, int] = {}
    for stream in report.streams:
        totals[stream.name] = totals.get(stream.name, 0) + stream.count
    for reason, count in report.rejected.items():
        name = reason.partition(":")[0]
        sentences.append(f"{reason} in {count} of {totals.get(name, count)} messages, which are left out")
    return sentences


def _frames(report: SurveyReport) -> list[str]:
    """What gimbals' roll and pitch are against, where that is not simply the horizon."""
    sentences = []
    for name, evidence in report.frames.items():
        undid = f"it undid {evidence.undone} of the vehicle's {evidence.motions} motions ({evidence.motion_s:.0f} s)"
        if evidence.contradictory:
            sentences.append(f'{name} contradicts itself: {undid}; set telemetry.attitude.frame = "earth" or "body"')
        elif evidence.frame is ReportFrame.BODY:
            sentences.append(
                f"{name} is body-frame (against the vehicle, not the horizon): {undid}; "
                f'{_AUTO} corrects that once it is found, "body" from the start'
            )
        elif evidence.frame is None and evidence.body_probability > _UNLIKELY:
            sentences.append(
                f"whether {name} is earth-frame or body-frame (against the horizon or the vehicle) cannot be told from "
                f"the vehicle's {evidence.motions} motions: {_AUTO} takes the horizon with a wider std; "
                'for a servo mount set "body"'
            )
    return sentences


def _clock(report: SurveyReport) -> list[str]:
    after_s, offset_s = report.clock.known_after_s, report.clock.host_minus_utc_s
    if after_s is None or offset_s is None:
        return ["no UTC: the vehicle never knew the time, so the recording machine's clock is taken"]
    if abs(offset_s) > _HOST_OFFSET_S:
        way = "ahead of" if offset_s > 0 else "behind"
        return [f"the recording machine's clock is {abs(offset_s):.1f} s {way} the vehicle's UTC"]
    return []


def _interruptions(report: SurveyReport) -> list[str]:
    by_message: dict[str, list[str]] = {}
    for gap in report.gaps:
        by_message.setdefault(gap.message, []).append(f"{gap.duration_s:.1f} s at {gap.start_s:.1f} s")
    sentences = []
    for message, gaps in by_message.items():
        more = f" and {len(gaps) - _MAX_GAPS} more" if len(gaps) > _MAX_GAPS else ""
        sentences.append(f"{message} is silent for {', '.join(gaps[:_MAX_GAPS])}{more}")
    used = [stream.last_ns for stream in report.streams if stream.name in USED]
    if used and report.first_ns is not None and report.last_ns is not None:
        early_s = (report.last_ns - max(used)) / 1e9
        if early_s > _EARLY_END_S:
            end_s = (max(used) - report.first_ns) / 1e9
            sentences.append(f"telemetry ends at {end_s:.1f} s, {early_s:.1f} s before the log does")
    return sentences


def _damage(report: SurveyReport) -> list[str]:
    counts = report.counts
    sentences = []
    if counts.bad_crc and not report.warnings:
        sentences.append(
            f"{counts.bad_crc} damaged frames left out ({counts.skipped_bytes} bytes belong to no good frame)"
        )
    if counts.unknown:
        sentences.append(f"{counts.unknown} frames of messages that are not known here left out")
    return sentences


def document(report: SurveyReport) -> dict[str, Any]:
    """The report as plain JSON values; stamps as decimal strings, unknown fields null."""
    return {
        "schema": "aerodft.doctor/1",
        "target": report.target,
        "usable": report.usable,
        "first_ns": None if report.first_ns is None else str(report.first_ns),
        "last_ns": None if report.last_ns is None else str(report.last_ns),
        "duration_s": report.duration_s,
        "streams": [
            {
                "message": stream.name,
                "system": stream.system,
                "component": stream.component,
                "count": stream.count,
                "rate_hz": round(stream.rate_hz, 3),
                "first_ns": str(stream.first_ns),
                "last_ns": str(stream.last_ns),
            }
            for stream in report.streams
        ],
        "heights": [_source(source) for source in report.heights],
        "attitudes": [{**_source(source), **_frame(report.frames.get(source.name))} for source in report.attitudes],
        "vehicle_attitude": _source(report.vehicle_attitude) if report.vehicle_attitude else None,
        "clock": {
            "utc_known_after_s": report.clock.known_after_s,
            "host_minus_utc_s": report.clock.host_minus_utc_s,
            **clock_document(report.clock_health),
        },
        "height_differences": report.height_pairs.documents(),
        "gaps": [{"message": gap.message, "start_s": gap.start_s, "duration_s": gap.duration_s} for gap in report.gaps],
        "followed": {"system": report.system, "component": report.component},
        "systems": list(report.systems),
        "rejected": report.rejected,
        "frames": {
            "good": report.counts.frames,
            "bad_crc": report.counts.bad_crc,
            "unknown": report.counts.unknown,
            "skipped_bytes": report.counts.skipped_bytes,
            "truncated": report.counts.truncated,
        },
        "signing": None if report.signing is None else signing_document(report.signing),
        "health": report.health.document(),
        "requests": [request.document() for request in report.requests],
        "problems": problems(report),
    }


def _source(source: ValueSource) -> dict[str, Any]:
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
