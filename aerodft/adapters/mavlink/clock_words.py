"""What happened to clocks over a survey: sentences and JSON values."""

from typing import Any, Final

from aerodft.adapters.mavlink.survey_report import ClockSummary
from aerodft.service.timing import ClockHealth

_MOST_JUMPS: Final = 5
_HOST_OFFSET_S: Final = 1.0


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
    """What happened to the clocks, and when, where something did."""
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
            "another clock stamps (--video) may be matched wrongly by as much as the two differ"
        )
    if abs(offset_s) > _HOST_OFFSET_S:
        way = "ahead of" if offset_s > 0 else "behind"
        return (
            f"the recording machine's clock is {abs(offset_s):.1f} s {way} the vehicle's UTC: images that it stamps,"
            " or a --video-start by it, are as far off"
        )
    return ""


def _when(at_s: tuple[float, ...]) -> str:
    """Times since the start, as far as they are listed."""
    if not at_s:
        return ""
    more = " ..." if len(at_s) > _MOST_JUMPS else ""
    return f" about {', '.join(f'{each:.0f}' for each in at_s[:_MOST_JUMPS])}{more} s after the start"
