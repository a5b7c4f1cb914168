"""A survey's problems as plain sentences: what matters most first, each with what to do, one for a cause."""

from collections.abc import Iterator

from aerodft.adapters.mavlink.address import is_link
from aerodft.adapters.mavlink.ambiguity import senders
from aerodft.adapters.mavlink.clock_words import clock_sentences
from aerodft.adapters.mavlink.configured import contradictions
from aerodft.adapters.mavlink.interruptions import interruptions
from aerodft.adapters.mavlink.left_out import damage, rows_left_out
from aerodft.adapters.mavlink.signing_words import signing_sentences, unchecked
from aerodft.adapters.mavlink.sources_words import frames, missing, switched_off
from aerodft.adapters.mavlink.sources_words import notes as source_notes
from aerodft.adapters.mavlink.survey_report import SurveyReport


def problems(report: SurveyReport) -> list[str]:
    """One sentence for each thing that limits what can be measured; empty where all is well."""
    signing = [] if report.signing is None else signing_sentences(report.signing)
    if report.first_ns is None and report.signing is not None and report.signing.refused:
        return signing
    if report.first_ns is None:
        return ["nothing was received: is the sender on, and does it send to this address?"]
    if is_link(report.target) and report.signed_frames and report.signing is None:
        signing = [unchecked(report.signed_frames, report.counts.frames)]
    if not report.is_heard:
        return [_not_heard(report), *signing, *damage(report), *report.warnings]
    return [*_silence(report), *signing, *_of_telemetry(report), *report.warnings]


def _of_telemetry(report: SurveyReport) -> Iterator[str]:
    settings = report.settings
    if report.poses.spans and (problem := report.poses.problem()):
        yield problem
    yield from missing(report)
    yield from senders(report)
    yield from () if settings is None else contradictions(report, settings)
    yield from report.health.sentences(report.camera, settings, report.ready_s)
    yield from clock_sentences(report.clock_health, report.clock)
    yield from rows_left_out(report)
    yield from frames(report)
    yield from report.height_pairs.sentences(0.0 if settings is None else settings.height.home_above_plane_m)
    yield from interruptions(report)
    yield from (request.sentence() for request in report.requests)
    yield from switched_off(report)
    yield from damage(report)


def _not_heard(report: SurveyReport) -> str:
    """Which of the ids that were asked for does not come, by the option that asked for it."""
    settings = report.settings
    what, asked, heard = "system", report.system, set(report.heard)
    if report.system is None or report.system in report.heard:
        own = (each.component for each in report.streams if report.system in {None, each.system})
        what, asked, heard = "component", report.component, {each for each in own if each is not None}
    is_configured = settings is not None and getattr(settings, what) == asked
    option = f"telemetry.{what}" if is_configured else f"--{what}"
    return (
        f"{option} = {asked} is not heard, {what}s {', '.join(map(str, sorted(heard)))} are: nothing would be measured"
    )


def _silence(report: SurveyReport) -> list[str]:
    if not report.is_silent_since:
        return []
    return ["the vehicle is silent since it was asked: what follows is of the time before"]


def notes(report: SurveyReport) -> list[str]:
    """What is good to know, and no problem."""
    is_told = not report.poses.spans or report.poses.problem()
    return [*([] if is_told else [report.poses.note()]), *source_notes(report)]
