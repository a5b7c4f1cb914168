"""Several vehicles, autopilots or gimbals on one link: which of them is followed, and how to choose."""

from typing import Final

from aerodft.adapters.mavlink.one_address import OF_ANOTHER_ADDRESS
from aerodft.adapters.mavlink.selection import is_peripheral
from aerodft.adapters.mavlink.survey_report import SurveyReport

_OF_AUTOPILOTS: Final = ("ATTITUDE", "GLOBAL_POSITION_INT")
_ANOTHER_GIMBAL: Final = ": of another gimbal than number "
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
    for reason, count in report.rejected.items():
        if reason.startswith(OF_ANOTHER_ADDRESS):
            sentences.append(
                f"two autopilots speak as system {report.system}, component {report.component}, or one over two ways:"
                f" {count} frames from another address than {reason.rpartition(' than ')[2]} are left out; give one of"
                " them another system id (SYSID_THISMAV, from 4.7 on MAV_SYSID)"
            )
    for name in _OF_GIMBALS:
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


def is_of_another(reason: str) -> bool:
    """Whether rows were left out because they are of somebody else than who is followed."""
    return reason.startswith(OF_ANOTHER_ADDRESS) or _ANOTHER_GIMBAL in reason


def _followed_gimbal(report: SurveyReport, name: str, gimbals: list[int]) -> int:
    """The one that was asked for, else the one that was heard first."""
    first_ns = {s.component: s.first_ns for s in report.streams if s.system == report.system and s.name == name}
    return report.gimbal if report.gimbal in gimbals else min(gimbals, key=lambda each: first_ns[each])


def _components(report: SurveyReport, *names: str) -> list[int]:
    """Who of the followed system sends one of these messages."""
    found = {s.component for s in report.streams if s.system == report.system and s.name in names}
    return sorted(component for component in found if component is not None)


def _listed(ids: tuple[int, ...] | list[int]) -> str:
    return ", ".join(map(str, ids))
