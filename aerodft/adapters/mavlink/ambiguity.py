"""Several vehicles, autopilots or gimbals on one link: which of them is followed, and how to choose."""

from typing import Final

from aerodft.adapters.mavlink.selection import is_peripheral
from aerodft.adapters.mavlink.survey_report import SurveyReport

_OF_AUTOPILOTS: Final = ("ATTITUDE", "GLOBAL_POSITION_INT")
_OF_GIMBALS: Final = ("GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION", "MOUNT_STATUS")


def senders(report: SurveyReport) -> list[str]:
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
    for name in _OF_GIMBALS:
        gimbals = _components(report, name)
        if len(gimbals) > 1:
            sentences.append(
                f"{name} comes from more than one gimbal (components {_listed(gimbals)}): the first one heard is"
                " followed, or the one that telemetry.gimbal names"
            )
    return sentences


def _components(report: SurveyReport, *names: str) -> list[int]:
    """Who of the followed system sends one of these messages."""
    found = {s.component for s in report.streams if s.system == report.system and s.name in names}
    return sorted(component for component in found if component is not None)


def _listed(ids: tuple[int, ...] | list[int]) -> str:
    return ", ".join(map(str, ids))
