"""What a station's configuration asks of the telemetry, and a survey shows that it does not get."""

from collections.abc import Iterator

from aerodft.adapters.mavlink.survey_report import SurveyReport
from aerodft.model.pose import GimbalSource, HeightSource
from aerodft.model.telemetry import ReportFrame
from aerodft.service.settings import TelemetrySettings


def contradictions(report: SurveyReport, settings: TelemetrySettings) -> list[str]:
    """One sentence for each setting that does not fit what came."""
    return [*_vehicle(report, settings), *_heights(report, settings), *_attitudes(report, settings)]


def _vehicle(report: SurveyReport, settings: TelemetrySettings) -> Iterator[str]:
    heard = sorted({each.system for each in report.streams if each.system is not None})
    if settings.system is not None and heard and settings.system not in heard:
        systems = ", ".join(map(str, heard))
        yield f"telemetry.system = {settings.system} is not heard, systems {systems} are: nothing would be measured"


def _heights(report: SurveyReport, settings: TelemetrySettings) -> Iterator[str]:
    there = {each.name for each in report.heights} | {str(HeightSource.MANUAL)}
    missing = [str(each) for each in settings.height.order if str(each) not in there]
    if len(missing) == len(settings.height.order):
        yield f"telemetry.height.order lists {', '.join(missing)}, and none of them comes: no image would have a height"
    elif missing:
        yield f"telemetry.height.order lists {', '.join(missing)}, which does not come: the next in the order is taken"


def _attitudes(report: SurveyReport, settings: TelemetrySettings) -> Iterator[str]:
    there = {each.name for each in report.attitudes}
    if report.vehicle_attitude is not None:
        there.add(str(GimbalSource.FIXED_MOUNT))
    order = [str(each) for each in settings.attitude.order]
    if not there & set(order):
        names = ", ".join(order)
        yield f"telemetry.attitude.order lists {names}, and none of them comes: no image would have an attitude"
    stated = settings.attitude.frame
    for name, evidence in report.frames.items():
        if stated is not None and evidence.frame is not None and evidence.frame is not stated:
            against = "the vehicle" if evidence.frame is ReportFrame.BODY else "the horizon"
            yield f'telemetry.attitude.frame = "{stated}", but {name} reports against {against}: set "auto"'
