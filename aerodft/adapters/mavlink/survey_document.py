"""A survey as one JSON document."""

from typing import Any

from aerodft.adapters.mavlink.findings import clock_document, notes, problems
from aerodft.adapters.mavlink.framing import FrameCounts
from aerodft.adapters.mavlink.signing import signing_document
from aerodft.adapters.mavlink.streams import Stream
from aerodft.adapters.mavlink.survey_report import SurveyReport, ValueSource
from aerodft.service.gimbal_frame import FrameEvidence


def document(report: SurveyReport) -> dict[str, Any]:
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
        "attitudes": [_attitude(report, source) for source in report.attitudes],
        "vehicle_attitude": _source(report.vehicle_attitude) if report.vehicle_attitude else None,
        "clock": clock_document(report.clock_health, report.clock),
        "height_differences": report.height_pairs.documents(),
        "gaps": [{"message": gap.message, "start_s": gap.start_s, "duration_s": gap.duration_s} for gap in report.gaps],
        "followed": {"system": report.system, "component": report.component},
        "systems": list(report.systems),
        "rejected": report.rejected,
        "frames": _frames(report.counts, report),
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


def _frames(counts: FrameCounts, report: SurveyReport) -> dict[str, Any]:
    return {
        "good": counts.frames,
        "bad_crc": counts.bad_crc,
        "unknown": counts.unknown,
        "unknown_ids": {str(message_id): count for message_id, count in report.unknown_ids.most_common()},
        "skipped_bytes": counts.skipped_bytes,
        "truncated": counts.truncated,
        "signed": report.signed_frames,
    }


def _attitude(report: SurveyReport, source: ValueSource) -> dict[str, Any]:
    is_demand = report.demands.get(source.name)
    feedback = {None: None, True: "demand", False: "measured"}[is_demand]
    return {**_source(source), **_frame(report.frames.get(source.name)), "feedback": feedback}


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
