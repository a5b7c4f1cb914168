"""What there is to measure with, and what is missing or doubtful about it, in sentences."""

import math
from collections.abc import Iterator
from typing import Final

from aerodft.adapters.mavlink.ambiguity import is_of_another
from aerodft.adapters.mavlink.requests import OFF
from aerodft.adapters.mavlink.survey_report import SurveyReport
from aerodft.model.telemetry import ReportFrame
from aerodft.service.settings import DEMAND_TILT_STD_RAD, TelemetrySettings

_LOW_M: Final = 1.0
_UNLIKELY: Final = 0.02
_AUTO: Final = 'telemetry.attitude.frame = "auto"'
_FIXED: Final = (
    'for a camera that is bolted to the vehicle set telemetry.attitude.order = ["fixed"] and fixed_mount, its angles '
    "against the vehicle"
)


def missing(report: SurveyReport) -> Iterator[str]:
    """What no image can be measured without, or only with a setting."""
    if not report.heights:
        yield "no height: neither a rangefinder, nor terrain data, nor a position with a height above home"
    elif {source.name for source in report.heights} == {"home"} and not _settings(report).height.home_above_plane_m:
        yield (
            "heights are above home only: where the river lies lower or higher than home, set "
            "telemetry.height.home_above_plane_m"
        )
    if not report.attitudes and not report.vehicle_attitude:
        yield "no attitude: neither a gimbal nor the vehicle reports one"
    elif (
        not report.attitudes
        and not any(map(is_of_another, report.rejected))
        and _settings(report).attitude.fixed_mount is None
    ):
        setting = report.parameters.switch_off(*OFF["GIMBAL_DEVICE_ATTITUDE_STATUS"])
        off = f" (switched off by {setting}: the type of a gimbal, if there is one)" if setting else ""
        yield f"no gimbal attitude{off}: {_FIXED}"
    elif report.attitudes and not report.vehicle_attitude:
        yield "no vehicle attitude: a gimbal's yaw against the vehicle cannot be turned to north"
    if report.rangefinder is not None and report.rangefinder.high < _LOW_M:
        yield f"RANGEFINDER never says more than {report.rangefinder.high:.2f} m: was the vehicle in the air at all?"


def _settings(report: SurveyReport) -> TelemetrySettings:
    return report.settings or TelemetrySettings()


def switched_off(report: SurveyReport) -> Iterator[str]:
    """Heights that do not come because the vehicle's own parameters say so."""
    heights = {source.name for source in report.heights}
    for source, message, then in (
        ("rangefinder", "DISTANCE_SENSOR", "if the vehicle has one, set that to its type"),
        ("terrain", "TERRAIN_REPORT", "set that to 1 if the ground station has terrain data"),
    ):
        setting = report.parameters.switch_off(*OFF[message])
        if setting and source not in heights:
            yield f"heights of the {source} are switched off by {setting}: {then}"


def frames(report: SurveyReport) -> Iterator[str]:
    """What gimbals' roll and pitch are against, where that is not simply the horizon; and demands."""
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
                f"whether {name} is earth-frame or body-frame (against the horizon or the vehicle) cannot be told from "
                f"the vehicle's {evidence.motions} motions: {_AUTO} takes the horizon with a wider std; "
                'for a servo mount set "body"'
            )
    demands = [name for name, is_demand in report.demands.items() if is_demand]
    if demands and stated.is_demand is None:
        yield (
            f"{', '.join(demands)} may be what the gimbal was told, not where it is: the tilt's std is at least "
            f"{math.degrees(DEMAND_TILT_STD_RAD):g} deg, and larger after every move; for a gimbal that measures set "
            'telemetry.attitude.feedback = "measured"'
        )
    if any(source.name == "MOUNT_STATUS" for source in report.attitudes):
        yield "MOUNT_STATUS has no time stamp of its own: its arrival is used, late by the link's delay"


def notes(report: SurveyReport) -> Iterator[str]:
    """What is good to know of gimbals, and no problem."""
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
