"""What a station's configuration asks of the telemetry, and a survey shows that it does not get."""

from collections.abc import Iterator

from aerodft.adapters.mavlink.survey_report import SurveyReport
from aerodft.model.pose import GimbalSource, HeightSource
from aerodft.model.telemetry import ReportFrame
from aerodft.service.settings import TelemetrySettings


def contradictions(report: SurveyReport, settings: TelemetrySettings) -> list[str]:
    """One sentence for each setting that does not fit what came."""
    return [*_heights(report, settings), *_attitudes(report, settings)]


def _heights(report: SurveyReport, settings: TelemetrySettings) -> Iterator[str]:
    there = {each.name for each in report.heights} | {str(HeightSource.MANUAL)}
    missing = [str(each) for each in settings.height.order if str(each) not in there]
    if len(missing) == len(settings.height.order):
        yield f"telemetry.height.order lists {', '.join(missing)}, and none of them comes: no image would have a height"
    elif missing:
        yield f"telemetry.height.order lists {', '.join(missing)}, which does not come: the next in the order is taken"
    yield from _minimum(report, settings)


def _minimum(report: SurveyReport, settings: TelemetrySettings) -> Iterator[str]:
    """The minimum height against the highest flown."""
    above_m = {str(HeightSource.HOME): settings.height.home_above_plane_m}
    order = {str(each) for each in settings.height.order}
    highest_m = [each.high + above_m.get(each.name, 0.0) for each in report.heights if each.name in order]
    if highest_m and max(highest_m) < settings.height.min_m:
        yield (
            f"telemetry.height.min_m is {settings.height.min_m:g} m, and the highest flown is {max(highest_m):.1f} m: "
            "no image would have an answer"
        )


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
